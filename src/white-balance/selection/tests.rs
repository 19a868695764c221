use super::*;

const NOW: MonotonicTime = MonotonicTime::from_nanos(0);
const GAINS: DVec3 = DVec3::new(3.0, 2.5, 4.0);

fn known(gains: DVec3, sd: f64) -> GainEstimate {
    GainEstimate {
        gains,
        relative_sd: DVec3::splat(sd),
    }
}

fn chart(gains: DVec3) -> Result<ChartMatch, ChartError> {
    Ok(ChartMatch {
        estimate: known(gains, 0.002),
        matrix: Some(DMat3::from_diagonal(gains) * 1.01),
        patches: [20; 3],
        residual_delta_e: 0.4,
        worst_delta_e: 1.0,
    })
}

fn overlap(gains: DVec3) -> Result<OverlapEstimate, Shortage> {
    Ok(OverlapEstimate {
        estimate: known(gains, 0.01),
        pairs: 100,
        clusters: 12,
        spread: 0.04,
        log_brightness: DVec3::ZERO,
    })
}

fn with(method: WhiteBalanceMethod) -> WhiteBalanceMatch {
    let settings = WhiteBalanceSettings {
        method,
        ..WhiteBalanceSettings::default()
    };
    WhiteBalanceMatch::new(settings, false)
}

#[test]
fn cameras_of_one_model_differ_by_their_exposures_alone() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_same_model(SameModel::Stated);
    matched.update_grey_world(Some(known(GAINS, 0.5)));
    assert_eq!(matched.in_force().0, Provenance::SameModel);
    assert_eq!(matched.gains(), DVec3::ONE);
    assert_eq!(matched.status().notice, None);
    let exposure = |exposure_micros: f64, gain: f64| {
        Some(Exposure {
            exposure_micros,
            gain,
        })
    };
    matched.set_exposures(exposure(8000.0, 2.0), exposure(4000.0, 1.0));
    assert!((matched.gains() - 4.0).abs().max_element() < 1e-12);
    // The pictures tell that it is not true.
    matched.update_overlap(overlap(GAINS * 4.0), NOW, NOW);
    assert!(matched.gains().x / matched.gains().z != 1.0);
    matched.set_chart(chart(GAINS));
    assert_eq!(matched.in_force().0, Provenance::Chart);
}

#[test]
fn product_names_are_better_than_a_guess_and_worse_than_a_measurement() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.update_grey_world(Some(known(GAINS, 0.5)));
    matched.set_same_model(SameModel::ByName);
    assert_eq!(matched.in_force().0, Provenance::SameProduct);
    assert_eq!(matched.gains(), DVec3::ONE);
    let notice = matched.status().notice.unwrap();
    assert!(notice.contains("same_camera"), "{notice}");
    matched.update_reflectance(Some(known(GAINS, 0.1)));
    assert_eq!(matched.in_force().0, Provenance::Reflectance);
}

#[test]
fn automatic_selection_uses_the_best_available_method() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    assert_eq!(matched.in_force().0, Provenance::Unknown);
    assert_eq!(matched.gains(), DVec3::ONE);
    assert_eq!(matched.status().uncertainty_percent, None);
    matched.update_grey_world(Some(known(GAINS, 0.5)));
    assert_eq!(matched.in_force().0, Provenance::GreyWorld);
    assert!(matched.status().notice.is_some());
    matched.update_reflectance(Some(known(GAINS, 0.1)));
    assert_eq!(matched.in_force().0, Provenance::Reflectance);
    assert_eq!(matched.status().notice, None);
    matched.update_overlap(overlap(GAINS), NOW, NOW);
    assert_eq!(matched.in_force().0, Provenance::Overlap);
    matched.set_chart(chart(GAINS));
    assert_eq!(matched.in_force().0, Provenance::Chart);
    assert_eq!(matched.status().methods.len(), 4);
    assert!((matched.gains() - GAINS).abs().max_element() < 1e-12);
}

#[test]
fn requested_method_is_used_once_it_has_gains() {
    let mut matched = with(WhiteBalanceMethod::Overlap);
    matched.set_chart(chart(GAINS));
    assert_eq!(matched.in_force().0, Provenance::Chart);
    matched.update_overlap(overlap(GAINS), NOW, NOW);
    assert_eq!(matched.in_force().0, Provenance::Overlap);
    matched.set_settings(WhiteBalanceSettings {
        method: WhiteBalanceMethod::Fixed,
        fixed_gains: Some([1.0, 2.0, 3.0]),
        matrix: false,
    });
    assert_eq!(matched.gains(), DVec3::new(1.0, 2.0, 3.0));
    let mut single = WhiteBalanceMatch::new(WhiteBalanceSettings::default(), true);
    single.set_chart(chart(GAINS));
    assert_eq!(single.in_force().0, Provenance::SameCamera);
    assert_eq!(single.gains(), DVec3::ONE);
}

#[test]
fn automatic_selection_ignores_fixed_gains() {
    let settings = WhiteBalanceSettings {
        method: WhiteBalanceMethod::Auto,
        fixed_gains: Some([9.0; 3]),
        matrix: false,
    };
    let mut matched = WhiteBalanceMatch::new(settings, false);
    matched.update_reflectance(Some(known(GAINS, 0.1)));
    assert_eq!(matched.in_force().0, Provenance::Reflectance);
}

#[test]
fn reports_methods_that_disagree() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_chart(chart(GAINS));
    let warm = GAINS * DVec3::new(1.2, 1.0, 1.0);
    matched.update_overlap(overlap(warm), NOW, NOW);
    let status = matched.status();
    let other = &status.methods[1];
    assert_eq!(other.method, Provenance::Overlap);
    assert!((other.disagreement_percent - 20.0).abs() < 0.1);
    assert!(other.disagreement_delta_e > 3.0 && other.disagrees);
    assert!(status.notice.unwrap().contains("disagree by 20 %"));
    // A method with a large standard error may differ as much.
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_chart(chart(GAINS));
    matched.update_grey_world(Some(known(warm, 0.5)));
    assert!(!matched.status().methods[1].disagrees);
}

#[test]
fn status_shows_that_the_active_overlap_is_frozen() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.update_overlap(overlap(GAINS), NOW, NOW);
    assert!(!matched.status().frozen);
    let few = Shortage::TooFew {
        pairs: 2,
        clusters: 1,
    };
    matched.update_overlap(Err(few), NOW, NOW);
    assert!(matched.status().frozen);
    assert!((matched.gains() - GAINS).abs().max_element() < 1e-12);
    matched.set_chart(chart(GAINS));
    assert!(!matched.status().frozen);
    assert_eq!(matched.status().overlap_frozen, Some(few));
}

#[test]
fn gains_follow_the_reported_exposures() {
    let exposure = |micros: f64, gain: f64| {
        Some(Exposure {
            exposure_micros: micros,
            gain,
        })
    };
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_chart(chart(GAINS));
    matched.set_exposures(exposure(8000.0, 1.0), exposure(2000.0, 1.0));
    assert!((matched.gains() - GAINS).abs().max_element() < 1e-12);
    matched.set_exposures(exposure(4000.0, 1.0), exposure(2000.0, 2.0));
    assert!((matched.gains() - 0.25 * GAINS).abs().max_element() < 1e-12);
    // Gains measured now are consistent with the chart although the exposures have changed.
    matched.update_overlap(overlap(0.25 * GAINS), NOW, NOW);
    matched.update_reflectance(Some(known(0.25 * GAINS, 0.1)));
    let status = matched.status();
    assert!(status.methods.iter().all(|m| m.disagreement_percent < 1e-6));
    assert_eq!(status.exposure_factor, 0.25);
}

#[test]
fn uses_the_matrix_only_on_request() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_chart(chart(GAINS));
    assert_eq!(
        matched.scene_from_environment(),
        DMat3::from_diagonal(matched.gains())
    );
    matched.set_settings(WhiteBalanceSettings {
        matrix: true,
        ..WhiteBalanceSettings::default()
    });
    let matrix = matched.scene_from_environment();
    assert!((matrix.x_axis.x - 3.03).abs() < 1e-12);
    assert!(matched.status().matrix.is_some());
}

#[test]
fn refused_chart_leaves_a_notice_in_the_status() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.update_overlap(overlap(GAINS), NOW, NOW);
    matched.set_chart(Err(ChartError::TooFew {
        usable: 1,
        channel: "red",
    }));
    let status = matched.status();
    assert!(
        status
            .notice
            .as_ref()
            .unwrap()
            .contains("photograph the chart again")
    );
    let json = serde_json::to_value(&status).unwrap();
    assert_eq!(json["in_force"], "overlap");
    assert_eq!(json["wanted"], "auto");
}

fn calibrated(gains: DVec3, exposures: Option<[f64; 2]>) -> CalibratedGains {
    CalibratedGains {
        estimate: known(gains, 0.004),
        matrix: None,
        exposures,
    }
}

#[test]
fn calibrated_gains_prevail_until_the_live_pictures_are_inconsistent_with_them() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_calibrated(calibrated(GAINS, None));
    matched.set_chart(chart(1.03 * GAINS));
    assert_eq!(matched.in_force().0, Provenance::Calibrated);
    assert_eq!(matched.gains(), GAINS);
    // A difference of 3 % is within both standard errors: the calibration prevails.
    for _ in 0..40 {
        matched.update_overlap(overlap(1.03 * GAINS), NOW, NOW);
    }
    let error = matched.gains() / GAINS - 1.0;
    assert!(error.abs().max_element() < 0.005, "{error}");
    // The white balance of a camera was changed.
    let changed = GAINS * DVec3::new(1.3, 1.0, 0.8);
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_calibrated(calibrated(GAINS, None));
    for _ in 0..40 {
        matched.update_overlap(overlap(changed), NOW, NOW);
    }
    let error = matched.gains() / changed - 1.0;
    assert!(error.abs().max_element() < 0.02, "{error}");
    assert!(matched.in_force().1.relative_sd.x < 0.02);
}

#[test]
fn calibrated_gains_are_scaled_to_the_current_exposures() {
    let mut matched = with(WhiteBalanceMethod::Auto);
    matched.set_calibrated(calibrated(GAINS, Some([0.01, 0.002])));
    let exposure = |micros| {
        Some(Exposure {
            exposure_micros: micros,
            gain: 1.0,
        })
    };
    matched.set_exposures(exposure(20_000.0), exposure(2_000.0));
    assert!((matched.gains() / GAINS - 2.0).abs().max_element() < 1e-12);
}
