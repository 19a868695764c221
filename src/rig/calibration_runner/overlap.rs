//! Gains between the cameras from surfaces that both see, and the scene camera's vignetting, over a
//! session.

use super::vignetting::VignettingCollector;
use crate::damage::intact_events;
use crate::feed::decoder_for;
use glam::DVec3;
use penumbra_calibration::radiometric::vignetting::VignettingFit;
use penumbra_camera::EnvironmentView;
use penumbra_config::Config;
use penumbra_interface::{Frame, MonotonicTime, RigidTransform};
use penumbra_picture::{Picture, decode_into};
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::TrackerCalibration;
use penumbra_scene::RayCaster;
use penumbra_session::{Session, SessionEvent};
use penumbra_sync::{HistoryConfig, PoseHistory};
use penumbra_white_balance::GainEstimate;
use penumbra_white_balance::chart::Photograph;
use penumbra_white_balance::gather::{GatherOptions, Overlap, gather_pairs};
use penumbra_white_balance::overlap::estimate_overlap;
use std::sync::Arc;

/// Number of picture pairs that are compared.
const PAIRS: usize = 24;
/// Systematic error of the gains, which no number of pairs reduces: registration, surfaces that are
/// not matt; relative.
const SYSTEMATIC_SIGMA: f64 = 0.015;

/// Estimates from a session without a chart.
#[derive(Clone, Debug)]
pub struct OverlapEstimates {
    /// Gains, and the number of picture pairs that they are from; `None` if the scene camera itself
    /// sees the environment (in a mirrored sphere), or no pair gives an estimate.
    pub gains: Option<(GainEstimate, usize)>,
    /// The scene camera's vignetting; `None` if it could not be fitted.
    pub vignetting: Option<VignettingFit>,
}

/// Compares the cameras over a session; `None` if the rig has no environment camera or tracker, or
/// its phantoms cannot be read.
#[must_use]
pub fn estimate_from_overlap(
    session: &Session,
    config: &Config,
    rig: &RigDocument,
) -> Option<OverlapEstimates> {
    rig.calibration.environment.as_ref()?;
    let scene = rig.phantom_scene(&|name| session.attachment(name)).ok()?;
    let (start, end) = session.span()?;
    let mut collector = OverlapCollector {
        config,
        rig,
        rays: RayCaster::from_phantoms(&scene),
        tracker: rig.calibration.tracker.as_ref()?,
        history: PoseHistory::new(HistoryConfig::default()),
        spacing: end.seconds_since(start) / PAIRS as f64,
        next: f64::MIN,
        scene: None,
        pending: None,
        estimates: Vec::new(),
        vignetting: VignettingCollector::default(),
    };
    let mut decoder = None;
    for event in intact_events(session) {
        match event {
            SessionEvent::Scene(frame) => collector.scene = Some(frame),
            SessionEvent::Environment(frame) if frame.bracket_ev == 0.0 => {
                collector.pair(frame, start);
            }
            SessionEvent::TrackerBytes {
                protocol,
                bytes,
                arrived_at,
            } => {
                let (_, decoder) = decoder.get_or_insert_with(|| {
                    let metres = Some(collector.tracker.metres_per_unit);
                    (Arc::clone(&protocol), decoder_for(&protocol, metres))
                });
                let (tracker, history) = (collector.tracker, &mut collector.history);
                decoder.push(&bytes, arrived_at, |sample| {
                    let at = tracker.measured_at(sample.arrived_at);
                    history.push(at, sample.transmitter_from_sensor);
                });
                collector.compare();
            }
            SessionEvent::Pose(sample) => {
                let at = collector.tracker.measured_at(sample.arrived_at);
                collector.history.push(at, sample.transmitter_from_sensor);
                collector.compare();
            }
            _ => {}
        }
    }
    Some(OverlapEstimates {
        gains: combined(&collector.estimates),
        vignetting: collector.vignetting.fit(),
    })
}

/// Pairs pictures of both cameras, and compares each pair as soon as its pose is known.
struct OverlapCollector<'a> {
    config: &'a Config,
    rig: &'a RigDocument,
    rays: RayCaster,
    tracker: &'a TrackerCalibration,
    history: PoseHistory,
    /// Minimum interval between pairs, seconds.
    spacing: f64,
    /// Earliest time of the next pair, seconds since the start of the session.
    next: f64,
    /// The newest scene picture.
    scene: Option<Frame>,
    /// Scene and environment picture whose pose is not known yet.
    pending: Option<(Frame, Frame)>,
    estimates: Vec<GainEstimate>,
    vignetting: VignettingCollector,
}

impl OverlapCollector<'_> {
    /// Pairs an environment picture with the newest scene picture.
    fn pair(&mut self, environment: Frame, start: MonotonicTime) {
        let at = environment.arrived_at.seconds_since(start);
        if at < self.next || self.pending.is_some() {
            return;
        }
        if let Some(scene) = &self.scene {
            self.next = at + self.spacing;
            self.pending = Some((scene.clone(), environment));
        }
    }

    /// Compares the pending pair once there are poses before and after it.
    fn compare(&mut self) {
        let Some((scene, _)) = &self.pending else {
            return;
        };
        let latency = self.rig.calibration.scene_camera.latency_nanos;
        let at = scene.captured_at.offset_nanos(-latency);
        let is_after_pair = |newest: MonotonicTime| newest.nanos_since(at) > 20_000_000;
        if !self.history.newest().is_some_and(is_after_pair) {
            return;
        }
        let Some((scene, environment)) = self.pending.take() else {
            return;
        };
        let pose = self.history.at(at);
        let pose = pose.map(|p| {
            self.tracker
                .world_from_scene_camera(p.transmitter_from_sensor)
        });
        if let Some(pose) = pose {
            let gains = self.gains(&scene, &environment, pose);
            self.estimates.extend(gains);
        }
    }

    /// Decodes a pair, adds the scene picture to the vignetting readings, and estimates the gains.
    /// `pose` is world from scene camera.
    fn gains(
        &mut self,
        scene_frame: &Frame,
        environment_frame: &Frame,
        pose: RigidTransform,
    ) -> Option<GainEstimate> {
        let (mut picture, mut environment_picture) = (Picture::default(), Picture::default());
        let encoding = self.config.input.encoding();
        decode_into(scene_frame, &encoding, &mut picture).ok()?;
        decode_into(environment_frame, &encoding, &mut environment_picture).ok()?;
        let rig = &self.rig.calibration;
        let environment = rig.environment.as_ref()?;
        let photograph = Photograph {
            picture: &picture,
            response: &rig.scene_camera.response,
        };
        let camera = &rig.scene_camera.camera;
        self.vignetting
            .observe(photograph, camera, pose, &self.rays);
        if matches!(environment.view, EnvironmentView::SphereInScene { .. }) {
            return None;
        }
        let overlap = Overlap {
            scene: photograph,
            scene_camera: camera,
            world_from_scene_camera: pose,
            environment: Photograph {
                picture: &environment_picture,
                response: &environment.response,
            },
            environment_view: &environment.view,
            vignetting: [rig.scene_camera.vignetting, environment.vignetting],
        };
        let pairs = gather_pairs(&overlap, &self.rays, &GatherOptions::default());
        Some(estimate_overlap(&pairs).ok()?.estimate)
    }
}

/// Returns the median of the estimates, which is robust against a pair between whose pictures the
/// light changed, and their number; `None` without an estimate.
fn combined(estimates: &[GainEstimate]) -> Option<(GainEstimate, usize)> {
    let channel = |c: usize| {
        let mut logs: Vec<f64> = estimates.iter().map(|e| e.gains[c].ln()).collect();
        logs.sort_by(f64::total_cmp);
        let median = *logs.get(logs.len() / 2)?;
        let mut deviations: Vec<f64> = logs.iter().map(|l| (l - median).abs()).collect();
        deviations.sort_by(f64::total_cmp);
        let n = deviations.len();
        // Standard error of the median, from 1.4826 MAD.
        let between_pairs = 1.4826 * deviations[n / 2] / (n as f64).sqrt();
        // The pairs show the same surfaces, so that the error within a pair does not average out.
        let within_pair = estimates.iter().map(|e| e.relative_sd[c]).sum::<f64>() / n as f64;
        let sigma = between_pairs.hypot(within_pair).hypot(SYSTEMATIC_SIGMA);
        Some((median.exp(), sigma))
    };
    let [r, g, b] = [channel(0)?, channel(1)?, channel(2)?];
    let estimate = GainEstimate {
        gains: DVec3::new(r.0, g.0, b.0),
        relative_sd: DVec3::new(r.1, g.1, b.1),
    };
    Some((estimate, estimates.len()))
}
