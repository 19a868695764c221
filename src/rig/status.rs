//! Publishes the state of a run in the status.

use crate::damage::LostCounts;
use crate::frame::{Counts, PreparedFrame};
use crate::latency_status;
use crate::light::bracket_response::{ExposureAgreement, WARNINGS};
use crate::light::state::{LightState, STATED_AT};
use crate::live_status;
use crate::probe_status;
use crate::rates::Rates;
use crate::report::FrameCounts;
use crate::setup::RigSetup;
use crate::source::Source;
use penumbra_camera::EnvironmentView;
use penumbra_compositor::Gpu;
use penumbra_compositor::exposure::ActiveExposure;
use penumbra_config::{Config, Quality};
use penumbra_interface::{DeviceKind, MonotonicTime};
use penumbra_lighting::BrightestLight;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_status::planes::PlanesStatus;
use penumbra_status::snapshot::{
    Adapter, Device, DeviceState, ExposureStatus, LampStatus, PoseAnswer, SessionState,
    WhiteBalance, WhiteBalanceEstimate, WhiteBalanceMethod, WhiteMatch,
};
use penumbra_status::{GuideStatus, SceneStatus, Settings, SharedStatus, Snapshot, StageTimes};
use penumbra_sync as sync;
use penumbra_sync::RigFrame;
use penumbra_white_balance::{MatchStatus, MethodStatus, Provenance};
use std::time::Duration;

/// Everything that a frame changes in the status.
pub struct Published<'a> {
    /// Destination.
    pub status: &'a SharedStatus,
    /// Source of the frame.
    pub source: &'a Source,
    /// The frame.
    pub prepared: &'a PreparedFrame,
    /// Durations of the stages so far.
    pub stages: &'a StageTimes,
    /// Counts so far.
    pub frames: &'a FrameCounts,
    /// Number of pictures composed again during pauses.
    pub repeated: u64,
    /// Whether the picture stands still.
    pub holds: bool,
    /// What the damaged parts of the recording held.
    pub lost: LostCounts,
    /// Rates of composed frames and of the devices.
    pub rates: &'a Rates,
    /// Share of the recording that has been played.
    pub played: Option<f64>,
    /// Active settings.
    pub settings: &'a Settings,
    /// Status of the shadowing planes.
    pub planes: &'a PlanesStatus,
    /// Status of the scene file.
    pub scene: &'a SceneStatus,
    /// The picture's exposure.
    pub exposure: ActiveExposure,
    /// The brightest light of the real scene, smoothed over time.
    pub brightest: BrightestLight,
    /// Age from which light is reported as stale, nanoseconds.
    pub stale_after_nanos: i64,
}

/// Publishes the state before the first frame.
pub fn begin(
    status: &SharedStatus,
    source: &Source,
    (setup, guide): (&RigSetup, Option<GuideStatus>),
    (gpu, quality): (&Gpu, Quality),
) {
    status.update(|s| {
        s.session.name = match source {
            Source::Recorded(_) => source.name(),
            Source::Live(_) => setup.calibration.name.clone(),
        };
        if !setup.calibrated {
            s.warn(UNCALIBRATED);
        }
        s.adapter = adapter(gpu);
        s.quality = quality;
        s.guide = guide.clone();
    });
}

/// Returns the set-up through which the page guides, without its steps; `None` if it does not guide.
pub fn guide(setup: &RigSetup, config: &Config) -> Option<GuideStatus> {
    config.status.guide.as_ref()?;
    let view = setup.calibration.environment.as_ref().map(|e| &e.view);
    let ball_mm = match view {
        Some(EnvironmentView::SphereInScene { sphere }) => 2e3 * sphere.radius,
        _ => return None,
    };
    let tags = setup.tags.as_ref().map_or(0, |map| map.tags().len());
    Some(GuideStatus {
        ball_mm,
        tags: tags as u32,
        steps: Vec::new(),
    })
}

/// Publishes that the graphics device was lost and replaced by `gpu`.
pub fn reopened(status: &SharedStatus, gpu: &Gpu, text: &str) {
    status.update(|s| {
        s.warn(text);
        s.adapter = Adapter {
            losses: s.adapter.losses + 1,
            recovery_seconds: s.adapter.recovery_seconds,
            ..adapter(gpu)
        };
    });
}

/// Publishes that the first picture was composed, `took` after the loss of the graphics device.
pub fn recovered(status: &SharedStatus, took: Duration) {
    status.update(|s| s.adapter.recovery_seconds = Some(took.as_secs_f64()));
}

fn adapter(gpu: &Gpu) -> Adapter {
    let info = gpu.adapter.get_info();
    Adapter {
        name: gpu.name.clone(),
        backend: info.backend.to_string(),
        kind: format!("{:?}", info.device_type),
        ..Adapter::default()
    }
}

/// Warning of a live rig without a calibration.
pub(super) const UNCALIBRATED: &str = "the rig is not calibrated, so no virtual objects are shown; set \
    `[calibration] from` to the folder of its calibration";

/// Publishes the state of a live rig while no picture arrives.
pub fn publish_idle(status: &SharedStatus, source: &Source, (rates, counts): (&Rates, &Counts)) {
    let Source::Live(live) = source else { return };
    status.update(|s| {
        s.frames.per_second = rates.pictures_per_second();
        live_status::devices(s, live, &rates.devices(), counts);
        live_status::session(s);
    });
}

/// Publishes the state after a frame.
pub fn publish(p: &Published<'_>) {
    let frame = &p.prepared.frame;
    if let Some(preview) = &p.prepared.preview {
        p.status.publish_environment_preview(preview.clone());
    }
    p.status.update(|s| {
        s.frames.arrived = p.frames.composed + p.frames.skipped + p.frames.damaged;
        s.frames.composed = p.frames.composed + p.repeated;
        s.playback.jumps = p.prepared.jumps;
        s.frames.skipped = p.frames.skipped + p.frames.damaged;
        s.frames.lost = p.lost.scene_frames;
        s.frames.without_pose = p.frames.without_pose;
        s.frames.per_second = p.rates.pictures_per_second();
        s.session.progress = p.played;
        s.stages.clone_from(p.stages);
        s.settings.clone_from(p.settings);
        s.planes.clone_from(p.planes);
        s.scene.clone_from(p.scene);
        s.exposure = exposure(p.exposure);
        let picture = &p.prepared.picture;
        (s.resolution.width, s.resolution.height) = (picture.width, picture.height);
        if let Some(warning) = &p.prepared.warning {
            s.warn(warning);
        }
        pairing(s, frame, p.rates);
        s.pairing.rejected_poses = p.prepared.counts.pairing.rejected_poses;
        latency_status::publish(s, p.prepared);
        let sigma = p.prepared.tracker_sigma;
        s.pairing.pose_sigma_mm = sigma.map(|[mm, ..]| mm);
        s.pairing.pose_sigma_deg = sigma.map(|[_, degrees, _]| degrees);
        s.pairing.pose_sigma_px = sigma.map(|[.., pixels]| pixels);
        s.registration = p.prepared.registration;
        s.lens.clone_from(&p.prepared.lens);
        s.levels = p.prepared.levels;
        lighting(s, p);
        match p.source {
            Source::Recorded(_) => {
                let state = if p.holds {
                    SessionState::Paused
                } else {
                    SessionState::Replaying
                };
                if s.session.state != state {
                    s.session.enter(state);
                }
                devices(s, p);
            }
            Source::Live(live) => {
                live_status::devices(s, live, &p.rates.devices(), &p.prepared.counts);
                live_status::session(s);
            }
        }
    });
}

fn exposure(active: ActiveExposure) -> ExposureStatus {
    let brightness = active.brightness;
    ExposureStatus {
        ev: active.stops,
        target_ev: active.target,
        camera: brightness.map(|b| b.camera),
        added: brightness.map(|b| b.added),
        removed: brightness.map(|b| b.taken),
    }
}

fn pairing(s: &mut Snapshot, frame: &RigFrame, rates: &Rates) {
    if let Some([median, p99]) = rates.skew_ms() {
        s.pairing.environment_skew_p50_ms = Some(median);
        s.pairing.environment_skew_p99_ms = Some(p99);
    }
    s.pairing.environment_skew_ms = frame
        .environment
        .as_ref()
        .map(|e| e.skew_nanos as f64 * 1e-6);
    s.pairing.pose_skew_ms = frame.pose.as_ref().map(|pose| pose.age_nanos as f64 * 1e-6);
    s.pairing.pose = pose_answer(frame.pose.as_ref());
}

/// Converts the provenance of a pose for the status.
pub(super) fn pose_answer(pose: Option<&sync::PoseAt>) -> PoseAnswer {
    match pose.map(|pose| pose.provenance) {
        None => PoseAnswer::None,
        Some(sync::Provenance::Exact) => PoseAnswer::Exact,
        Some(sync::Provenance::Interpolated) => PoseAnswer::Interpolated,
        Some(sync::Provenance::Predicted) => PoseAnswer::Predicted,
    }
}

fn lamp(source: &CompactSource) -> LampStatus {
    let metres = source.distance.metres();
    LampStatus {
        direction: source.direction.as_dvec3().to_array(),
        position: source.position.map(|at| at.to_array()),
        distance_m: metres.map(|(away, _)| f64::from(away)),
        distance_sigma_m: metres.map(|(_, sigma)| f64::from(sigma)),
        clipped: f64::from(source.clipped.clamp(0.0, 1.0)),
        unseen: source.is_unseen,
    }
}

/// Whether the environment camera's exposures agree under its tone curve.
fn exposures(s: &mut Snapshot, agreement: Option<ExposureAgreement>) {
    let disagreement = agreement.map(|agreement| agreement.disagreement);
    if s.lighting.exposures_disagree == disagreement {
        return;
    }
    s.lighting.exposures_disagree = disagreement;
    let warning = agreement.and_then(ExposureAgreement::warning);
    for known in WARNINGS.into_iter().filter(|known| Some(*known) != warning) {
        s.clear_warning(known);
    }
    if let Some(warning) = warning.filter(|new| s.warnings.iter().all(|known| known.text != *new)) {
        s.warn(warning);
    }
}

/// Maximum time by which an environment picture follows the scene picture that it lights, seconds.
const MAX_AHEAD: f64 = 1.0;

/// Returns the age of the light in a picture, seconds; `None` where a recording has begun again, and the
/// light is still that of its end.
fn age_of_light(picture: MonotonicTime, light: MonotonicTime) -> Option<f64> {
    let age = picture.seconds_since(light);
    (age >= -MAX_AHEAD).then_some(age)
}

fn lighting(s: &mut Snapshot, p: &Published<'_>) {
    let LightState {
        lighting,
        white_balance,
        sources,
        clipped,
        probe: map,
        exposures: agreement,
        picture,
        ..
    } = &p.prepared.light;
    let (dome_lights, compact_lights) = p.prepared.light.count();
    (s.lighting.dome_lights, s.lighting.compact_lights) = (dome_lights, compact_lights);
    s.lighting.compact_sources = sources.len() as u32;
    s.lighting.lamps = sources.iter().map(lamp).collect();
    s.lighting.environments_left_out = p.prepared.environments_left_out;
    s.lighting.clipped_fraction = Some(f64::from(clipped.max(0.0)));
    exposures(s, *agreement);
    s.lighting.picture_difference = picture.as_ref().map(|picture| picture.difference);
    s.lighting.picture_difference_sigma = picture.as_ref().map(|picture| picture.sigma);
    match picture {
        Some(picture) => s.lighting.disagreeing.clone_from(&picture.disagreeing),
        None => s.lighting.disagreeing.clear(),
    }
    let Some(lighting) = lighting else { return };
    let is_stated = lighting.captured_at == STATED_AT;
    let captured_at = p.prepared.frame.captured_at;
    let age = age_of_light(captured_at, lighting.captured_at);
    s.lighting.age_ms = age.filter(|_| !is_stated).map(|age| age * 1e3);
    let stale = age.is_some_and(|age| age * 1e9 > p.stale_after_nanos as f64);
    s.lighting.probe = map.map(|map| probe_status::probe(&map, p.prepared.frame.captured_at));
    s.lighting.stale = match &s.lighting.probe {
        Some(probe) => probe_status::stale(probe, p.stale_after_nanos),
        None => stale.then(|| {
            let environment = p.prepared.frame.environment.as_ref();
            let skew = environment.map(|e| e.skew_nanos);
            stale_reason(skew.is_some_and(|skew| skew <= p.stale_after_nanos)).to_owned()
        }),
    };
    let direction = p.brightest.direction.as_dvec3();
    s.lighting.dominant_direction = (p.brightest.dominance > 0.0).then(|| direction.to_array());
    s.lighting.dominance = Some(f64::from(p.brightest.dominance));
    if let Some(status) = white_balance {
        s.white_balance = white_balance_status(status);
    }
}

/// Why the light is old. `delivers`: the environment camera's pictures are not.
const fn stale_reason(delivers: bool) -> &'static str {
    if delivers {
        "estimating it takes longer than `stale_after_ms` of [environment] on this machine"
    } else {
        "the environment camera delivers no pictures: the last estimated light is used"
    }
}

fn white_balance_status(status: &MatchStatus) -> WhiteBalance {
    let relative = |percent: &Option<[f64; 3]>| percent.map(|p| p.map(|x| x / 100.0));
    let estimates = status.methods.iter().map(|m| WhiteBalanceEstimate {
        method: method(m.method),
        gains: m.gains,
        uncertainty: relative(&m.uncertainty_percent).unwrap_or([f64::NAN; 3]),
    });
    // The grey world is an assumption, not a measurement.
    let measured = |m: &&MethodStatus| m.method != Provenance::GreyWorld;
    let disagreement = status
        .methods
        .iter()
        .filter(measured)
        .map(|m| m.disagreement_percent / 100.0);
    WhiteBalance {
        method: method(status.in_force),
        gains: status.gains,
        uncertainty: relative(&status.uncertainty_percent),
        disagreement: disagreement.reduce(f64::max),
        frozen: status.notice.clone().filter(|_| status.frozen),
        estimates: estimates.collect(),
        white: white(status),
    }
}

/// Linear value of the grey surface that illustrates the match.
const GREY: f64 = 0.6;

/// Returns a grey surface as seen by the scene camera and by the environment camera, the latter by
/// the best measurement other than the active one. Without another measurement the match is exact
/// by definition.
fn white(status: &MatchStatus) -> Option<WhiteMatch> {
    let measured = |wanted: Provenance| status.methods.iter().find(|m| m.method == wanted);
    let others = [
        Provenance::Chart,
        Provenance::Overlap,
        Provenance::Reflectance,
    ];
    let reference = others
        .into_iter()
        .filter(|m| *m != status.in_force)
        .find_map(measured);
    let seen = reference.map_or(status.gains, |m| m.gains);
    if seen.iter().any(|g| !g.is_finite() || *g <= 0.0) {
        return None;
    }
    let before = seen.map(|gain| GREY / gain);
    let after = [0, 1, 2].map(|c| before[c] * status.gains[c]);
    Some(WhiteMatch {
        scene: [GREY; 3],
        environment_before: before,
        environment_after: after,
    })
}

const fn method(provenance: Provenance) -> WhiteBalanceMethod {
    match provenance {
        // Both use pictures taken during calibration.
        Provenance::Calibrated | Provenance::Chart => WhiteBalanceMethod::Chart,
        Provenance::Overlap => WhiteBalanceMethod::Automatic,
        Provenance::Reflectance => WhiteBalanceMethod::KnownSurface,
        Provenance::SameCamera => WhiteBalanceMethod::SameCamera,
        Provenance::SameModel => WhiteBalanceMethod::SameModel,
        Provenance::SameProduct => WhiteBalanceMethod::SameProduct,
        Provenance::Fixed => WhiteBalanceMethod::Configured,
        Provenance::GreyWorld => WhiteBalanceMethod::GreyWorld,
        Provenance::Unknown => WhiteBalanceMethod::None,
    }
}

/// Publishes the devices of a recording, as streaming while they deliver.
fn devices(s: &mut Snapshot, p: &Published<'_>) {
    let frame = &p.prepared.frame;
    if s.devices.is_empty() {
        s.devices = vec![
            Device::new("scene camera", DeviceKind::SceneCamera),
            Device::new("environment camera", DeviceKind::EnvironmentCamera),
            Device::new("tracker", DeviceKind::Tracker),
        ];
    }
    let delivering = [true, frame.environment.is_some(), frame.pose.is_some()];
    let lost = [
        p.lost.scene_frames,
        p.lost.environment_frames,
        p.lost.tracker_messages,
    ];
    for (device, lost) in s.devices.iter_mut().zip(lost) {
        device.dropped = lost;
        if device.kind == DeviceKind::Tracker {
            // The readings of a damaged part are missing in the stream, too.
            device.dropped = lost.max(p.prepared.counts.lost_readings);
        }
    }
    for ((device, delivers), rate) in s.devices.iter_mut().zip(delivering).zip(p.rates.devices()) {
        let state = if delivers {
            DeviceState::Streaming
        } else {
            DeviceState::Silent
        };
        if device.state != state {
            device.enter(state, None);
        }
        if device.kind == DeviceKind::Tracker {
            device.reason = p.prepared.counts.pairing.wrong_station();
        }
        device.received = rate.received;
        device.per_second = rate.per_second;
        device.last_age_ms = rate.last_age_ms;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_estimates_are_not_blamed_on_the_camera() {
        assert!(stale_reason(false).contains("environment camera delivers no pictures"));
        assert!(!stale_reason(true).contains("camera"));
    }

    #[test]
    fn light_from_the_end_of_a_repeated_recording_has_no_age() {
        let at = |millis: i64| MonotonicTime::from_nanos(millis * 1_000_000);
        assert_eq!(age_of_light(at(5000), at(4750)), Some(0.25));
        // The environment camera's exposure may be the later one.
        assert_eq!(age_of_light(at(5000), at(5250)), Some(-0.25));
        assert_eq!(age_of_light(at(200), at(9677)), None);
    }
}
