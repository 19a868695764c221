//! What the rig writes into the status.

use super::light::LightStation;
use super::report::FrameCounts;
use crate::calibration::photometry::{MatchStatus, Provenance};
use crate::status::snapshot::{
    Device, DeviceKind, DeviceState, PoseAnswer, WhiteBalance, WhiteBalanceEstimate,
    WhiteBalanceMethod,
};
use crate::status::{Settings, SharedStatus, Snapshot, StageTimes};
use crate::sync::{self, RigFrame};

/// Everything that a frame changes in the status.
pub struct Published<'a> {
    /// Where to write.
    pub status: &'a SharedStatus,
    /// The frame.
    pub frame: &'a RigFrame,
    /// Light and white balance.
    pub light: &'a LightStation,
    /// Times so far.
    pub stages: &'a StageTimes,
    /// Counts so far.
    pub frames: &'a FrameCounts,
    /// Dome lights, and compact ones among them.
    pub lights: (u32, u32),
    /// Settings in force.
    pub settings: &'a Settings,
    /// Picture size, pixels.
    pub size: (u32, u32),
}

/// Writes it.
pub fn publish(p: &Published<'_>) {
    p.status.update(|s| {
        s.frames.arrived = p.frames.composed + p.frames.skipped + p.frames.damaged;
        s.frames.composed = p.frames.composed;
        s.frames.skipped = p.frames.skipped;
        s.frames.without_pose = p.frames.without_pose;
        s.stages.clone_from(p.stages);
        s.settings.clone_from(p.settings);
        (s.resolution.width, s.resolution.height) = p.size;
        s.lighting.dome_lights = p.lights.0;
        s.lighting.compact_lights = p.lights.1;
        pairing(s, p.frame);
        lighting(s, p);
        devices(s, p.frame);
    });
}

fn pairing(s: &mut Snapshot, frame: &RigFrame) {
    s.pairing.environment_skew_ms = frame
        .environment
        .as_ref()
        .map(|e| e.skew_nanos as f64 * 1e-6);
    s.pairing.pose_skew_ms = frame.pose.as_ref().map(|pose| pose.age_nanos as f64 * 1e-6);
    s.pairing.pose = match frame.pose.as_ref().map(|pose| pose.provenance) {
        None => PoseAnswer::None,
        Some(sync::Provenance::Exact) => PoseAnswer::Exact,
        Some(sync::Provenance::Interpolated) => PoseAnswer::Interpolated,
        Some(sync::Provenance::Predicted) => PoseAnswer::Predicted,
    };
}

fn lighting(s: &mut Snapshot, p: &Published<'_>) {
    let Some(lighting) = p.light.lighting() else {
        return;
    };
    s.lighting.age_ms = Some(p.frame.captured_at.seconds_since(lighting.captured_at) * 1e3);
    let total = |c: glam::Vec3| c.element_sum();
    s.lighting.dominant_direction = lighting
        .lights
        .iter()
        .max_by(|a, b| total(a.irradiance).total_cmp(&total(b.irradiance)))
        .map(|l| l.direction.as_dvec3().to_array());
    s.white_balance = white_balance(&p.light.match_status());
}

fn white_balance(status: &MatchStatus) -> WhiteBalance {
    let relative = |percent: &Option<[f64; 3]>| percent.map(|p| p.map(|x| x / 100.0));
    let estimates = status
        .methods
        .iter()
        .map(|m| WhiteBalanceEstimate {
            method: method(m.method),
            gains: m.gains,
            uncertainty: relative(&m.uncertainty_percent).unwrap_or([f64::NAN; 3]),
        })
        .collect();
    let disagreement = status
        .methods
        .iter()
        .map(|m| m.disagreement_percent / 100.0);
    WhiteBalance {
        method: method(status.in_force),
        gains: status.gains,
        uncertainty: relative(&status.uncertainty_percent),
        disagreement: disagreement.reduce(f64::max),
        frozen: status.notice.clone().filter(|_| status.frozen),
        estimates,
        white: None,
    }
}

const fn method(provenance: Provenance) -> WhiteBalanceMethod {
    match provenance {
        Provenance::Chart => WhiteBalanceMethod::Chart,
        Provenance::Overlap => WhiteBalanceMethod::Automatic,
        Provenance::Reflectance => WhiteBalanceMethod::KnownSurface,
        Provenance::Fixed => WhiteBalanceMethod::Configured,
        _ => WhiteBalanceMethod::None,
    }
}

/// The recording's devices: streaming while they deliver.
fn devices(s: &mut Snapshot, frame: &RigFrame) {
    if s.devices.is_empty() {
        s.devices = vec![
            Device::new("scene camera", DeviceKind::SceneCamera),
            Device::new("environment camera", DeviceKind::EnvironmentCamera),
            Device::new("tracker", DeviceKind::Tracker),
        ];
    }
    let delivering = [true, frame.environment.is_some(), frame.pose.is_some()];
    for (device, delivers) in s.devices.iter_mut().zip(delivering) {
        let state = if delivers {
            DeviceState::Streaming
        } else {
            DeviceState::Silent
        };
        if device.state != state {
            device.enter(state, None);
        }
        if delivers {
            device.received += 1;
        }
    }
}
