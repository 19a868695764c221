//! Gains between the cameras from what both see anyway, over a session.

use super::fall_off::FallOff;
use crate::feed::decoder_for;
use glam::DVec3;
use penumbra_calibration::radiometric::vignetting::Fit;
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

/// Pairs of pictures that are compared.
const PAIRS: usize = 24;
/// What no number of pairs removes: registration, surfaces that are not matt, relative.
const SYSTEMATIC: f64 = 0.015;

/// What a session shows without a chart.
#[derive(Clone, Debug)]
pub struct SeenByBoth {
    /// Gains, and how many pairs of pictures they are from; `None` where the environment is seen
    /// by the scene camera itself, or the pictures say nothing.
    pub gains: Option<(GainEstimate, usize)>,
    /// The scene camera's fall-off.
    pub fall_off: Option<Fit>,
}

/// Compares the cameras over a session; `None` where the rig's geometry is not known.
#[must_use]
pub fn seen_by_both(session: &Session, config: &Config, rig: &RigDocument) -> Option<SeenByBoth> {
    rig.calibration.environment.as_ref()?;
    let scene = rig.phantom_scene(&|name| session.attachment(name)).ok()?;
    let (start, end) = session.span()?;
    let mut watch = Watch {
        config,
        rig,
        rays: RayCaster::from_phantoms(&scene),
        tracker: rig.calibration.tracker.as_ref()?,
        history: PoseHistory::new(HistoryConfig::default()),
        spacing: end.seconds_since(start) / PAIRS as f64,
        next: f64::MIN,
        scene: None,
        waiting: None,
        found: Vec::new(),
        fall_off: FallOff::default(),
    };
    let mut decoder = None;
    for event in session.events().flatten() {
        match event {
            SessionEvent::Scene(frame) => watch.scene = Some(frame),
            SessionEvent::Environment(frame) if frame.bracket_ev == 0.0 => {
                watch.pair(frame, start);
            }
            SessionEvent::TrackerBytes {
                protocol,
                bytes,
                arrived_at,
            } => {
                let (_, decoder) = decoder.get_or_insert_with(|| {
                    let metres = Some(watch.tracker.metres_per_unit);
                    (Arc::clone(&protocol), decoder_for(&protocol, metres))
                });
                let (tracker, history) = (watch.tracker, &mut watch.history);
                decoder.push(&bytes, arrived_at, |sample| {
                    let at = tracker.measured_at(sample.arrived_at);
                    history.push(at, sample.transmitter_from_sensor);
                });
                watch.compare();
            }
            SessionEvent::Pose(sample) => {
                let at = watch.tracker.measured_at(sample.arrived_at);
                watch.history.push(at, sample.transmitter_from_sensor);
                watch.compare();
            }
            _ => {}
        }
    }
    Some(SeenByBoth {
        gains: together(&watch.found),
        fall_off: watch.fall_off.fit(),
    })
}

struct Watch<'a> {
    config: &'a Config,
    rig: &'a RigDocument,
    rays: RayCaster,
    tracker: &'a TrackerCalibration,
    history: PoseHistory,
    spacing: f64,
    next: f64,
    scene: Option<Frame>,
    waiting: Option<(Frame, Frame)>,
    found: Vec<GainEstimate>,
    fall_off: FallOff,
}

impl Watch<'_> {
    /// A picture of the environment and the scene's last one before it.
    fn pair(&mut self, environment: Frame, start: MonotonicTime) {
        let at = environment.arrived_at.seconds_since(start);
        if at < self.next || self.waiting.is_some() {
            return;
        }
        if let Some(scene) = &self.scene {
            self.next = at + self.spacing;
            self.waiting = Some((scene.clone(), environment));
        }
    }

    /// Once there are poses on both sides of the waiting pair.
    fn compare(&mut self) {
        let Some((scene, _)) = &self.waiting else {
            return;
        };
        let latency = self.rig.calibration.scene_camera.latency_nanos;
        let at = scene.captured_at.offset_nanos(-latency);
        let enough = |newest: MonotonicTime| newest.nanos_since(at) > 20_000_000;
        if !self.history.newest().is_some_and(enough) {
            return;
        }
        let Some((scene, environment)) = self.waiting.take() else {
            return;
        };
        let pose = self.history.at(at);
        let pose = pose.map(|p| {
            self.tracker
                .world_from_scene_camera(p.transmitter_from_sensor)
        });
        if let Some(pose) = pose {
            let gains = self.gains(&scene, &environment, pose);
            self.found.extend(gains);
        }
    }

    fn gains(&mut self, scene: &Frame, seen: &Frame, pose: RigidTransform) -> Option<GainEstimate> {
        let (mut picture, mut around) = (Picture::default(), Picture::default());
        let encoding = self.config.input.encoding();
        decode_into(scene, &encoding, &mut picture).ok()?;
        decode_into(seen, &encoding, &mut around).ok()?;
        let rig = &self.rig.calibration;
        let environment = rig.environment.as_ref()?;
        let photograph = Photograph {
            picture: &picture,
            response: &rig.scene_camera.response,
        };
        let camera = &rig.scene_camera.camera;
        self.fall_off.look(photograph, camera, pose, &self.rays);
        if matches!(environment.view, EnvironmentView::SphereInScene { .. }) {
            return None;
        }
        let overlap = Overlap {
            scene: photograph,
            scene_camera: camera,
            world_from_scene_camera: pose,
            environment: Photograph {
                picture: &around,
                response: &environment.response,
            },
            environment_view: &environment.view,
            vignetting: [rig.scene_camera.vignetting, environment.vignetting],
        };
        let pairs = gather_pairs(&overlap, &self.rays, &GatherOptions::default());
        Some(estimate_overlap(&pairs).ok()?.estimate)
    }
}

/// The median of all, as one pair in which the light changed must not count.
fn together(found: &[GainEstimate]) -> Option<(GainEstimate, usize)> {
    let channel = |c: usize| {
        let mut logs: Vec<f64> = found.iter().map(|e| e.gains[c].ln()).collect();
        logs.sort_by(f64::total_cmp);
        let middle = *logs.get(logs.len() / 2)?;
        let mut off: Vec<f64> = logs.iter().map(|l| (l - middle).abs()).collect();
        off.sort_by(f64::total_cmp);
        let spread = 1.4826 * off[off.len() / 2] / (off.len() as f64).sqrt();
        let own = found.iter().map(|e| e.relative_sd[c]).sum::<f64>() / found.len() as f64;
        // The same surfaces again and again: their own error does not average out.
        Some((middle.exp(), spread.hypot(own).hypot(SYSTEMATIC)))
    };
    let [r, g, b] = [channel(0)?, channel(1)?, channel(2)?];
    let estimate = GainEstimate {
        gains: DVec3::new(r.0, g.0, b.0),
        relative_sd: DVec3::new(r.1, g.1, b.1),
    };
    Some((estimate, found.len()))
}
