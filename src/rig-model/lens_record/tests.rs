use super::*;

fn record() -> LensRecord {
    let mut lens = Lens::ideal(
        LensModel::Brown,
        (640, 480),
        DVec2::new(535.0, 536.0),
        DVec2::new(320.5, 240.25),
    );
    lens.coefficients[..5].copy_from_slice(&[-0.28, 0.1, 0.001, -0.002, 0.03]);
    LensRecord::from_lens(&lens, "scene", "2026-11-21T12:00:00Z".to_owned())
}

#[test]
fn written_file_reads_back_unchanged() {
    let record = record();
    let bytes = serde_json::to_vec_pretty(&record).unwrap();
    let again = LensRecord::parse("a.json", &bytes).unwrap();
    assert_eq!(again, record);
    let lens = again.lens("a.json").unwrap();
    assert_eq!(lens.coefficients[3], -0.002);
    assert_eq!(
        lens.as_pinhole().unwrap().distortion,
        [-0.28, 0.1, 0.001, -0.002, 0.03]
    );
}

#[test]
fn errors_name_file_and_key() {
    let good = serde_json::to_string_pretty(&record()).unwrap();
    for (from, to, expected_text) in [
        ("\"brown\"", "\"pinhole\"", "a.json: `model` must be"),
        ("535.0", "-1.0", "`focal`"),
        ("640", "0", "`image_size`"),
        ("320.5", "1e300", "`centre`"),
        ("k1", "k9", "`distortion`"),
        (
            "\"penumbra_calibration\": 1",
            "\"penumbra_calibration\": 2",
            "newer Penumbra",
        ),
        ("\"focal\"", "\"fokal\"", "missing field `focal`"),
        ("{", "[", "line 2"),
    ] {
        let text = good.replacen(from, to, 1);
        let error = LensRecord::parse("a.json", text.as_bytes()).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains(expected_text) && !error.contains('\n'),
            "{from}: {error}"
        );
    }
}
