//! Publishes the state of live devices in the status.

use crate::feed::FeedCounts;
use crate::frame::Counts;
use crate::rates::DeviceRate;
use crate::source::Live;
use penumbra_capture::{DeviceReport, DeviceState as Captured, DeviceStatus, Irregularity};
use penumbra_interface::DeviceKind;
use penumbra_interface::{
    CameraReport, Clock, ControlReport, ControlStanding, MonotonicTime, StampSource, SystemClock,
};
use penumbra_status::Snapshot;
use penumbra_status::snapshot::{Control, Device, DeviceState, Problem, SessionState};
use penumbra_sync::PairingCounts;

/// Number of bytes from a tracker within which a record is expected.
const BYTES_FOR_A_RECORD: u64 = 1000;

/// Publishes the state of every device. `rates` are those of the scene camera, the environment
/// camera and the tracker.
pub(super) fn devices(s: &mut Snapshot, live: &Live, rates: &[DeviceRate; 3], counts: &Counts) {
    let now = SystemClock.now();
    let (devices, lost) = (live.supervised(), live.hub.counts());
    if s.devices.len() != devices.len() {
        s.devices = devices
            .iter()
            .map(|device| Device::new(&device.name, device.kind))
            .collect();
    }
    for (device, live) in s.devices.iter_mut().zip(devices) {
        let (rate, lost) = match live.kind {
            DeviceKind::SceneCamera => (&rates[0], lost.scene_superseded),
            DeviceKind::EnvironmentCamera => (&rates[1], lost.environment_lost),
            DeviceKind::Tracker => (&rates[2], lost.tracker_lost),
        };
        let status = live.status();
        write(device, &status, rate, now);
        device.dropped += lost;
        if live.kind == DeviceKind::Tracker {
            device.dropped += counts.lost_readings;
            let (skipped, lost) = (counts.skipped_tracker_bytes, counts.lost_readings);
            let found = tracker_problems(&counts.pairing, skipped, lost);
            device.problems.extend(problems(&found));
            let reason = device.reason.take();
            let reason = reason.or_else(|| counts.pairing.wrong_station());
            device.reason = unreadable(&status, &counts.feed).or(reason);
        }
    }
}

/// Publishes that the rig is live, or why no picture arrives.
pub(super) fn session(s: &mut Snapshot) {
    let scene = s.devices.iter().find(|d| d.kind == DeviceKind::SceneCamera);
    let trouble = scene.filter(|d| d.state != DeviceState::Streaming);
    let description = match trouble.map(|d| &d.reason) {
        None => SessionState::Live.description().to_owned(),
        Some(Some(reason)) => format!("Live, but no picture arrives: {reason}"),
        Some(None) => "Live; the scene camera is being opened.".to_owned(),
    };
    if s.session.state != SessionState::Live || s.session.description != description {
        s.session.enter_because(SessionState::Live, &description);
    }
}

fn write(device: &mut Device, status: &DeviceStatus, rate: &DeviceRate, now: MonotonicTime) {
    let state = match status.state {
        Captured::Opening => DeviceState::Opening,
        Captured::Streaming => DeviceState::Streaming,
        Captured::Silent => DeviceState::Silent,
        Captured::BackingOff { .. } => DeviceState::Retrying,
        Captured::Failed { .. } => DeviceState::Failed,
        Captured::Closed => DeviceState::Ended,
    };
    device.enter(state, status.reason.as_deref());
    device.retry_in_ms = match status.state {
        Captured::BackingOff { until } | Captured::Failed { until } => {
            Some((until.seconds_since(now) * 1e3).max(0.0))
        }
        _ => None,
    };
    device.attempts = status.attempts;
    device.losses = status.losses;
    device.last_error.clone_from(&status.last_trouble);
    device.received = match device.kind {
        DeviceKind::Tracker => rate.received,
        _ => status.received,
    };
    device.per_second = rate.per_second;
    let irregular = Irregularity::ALL.map(|k| (k.description(), status.irregular.get(k)));
    device.problems.clear();
    device.problems.extend(problems(&irregular));
    device.last_age_ms = status.last_at.map(|at| now.seconds_since(at) * 1e3);
    match &status.report {
        DeviceReport::None => (),
        DeviceReport::Camera(report) => camera(device, report, status),
        DeviceReport::Tracker(report) => {
            device.identity = Some(report.identity.clone());
            device.mode = Some(report.protocol.clone());
            device.notes.clear();
            device.notes.extend(report.description.clone());
            device.notes.extend(report.warning.clone());
            device.dropped = status.damaged;
        }
    }
}

/// Returns those that have occurred.
fn problems(counts: &[(&'static str, u64)]) -> impl Iterator<Item = Problem> {
    let occurred = counts.iter().filter(|(_, count)| *count > 0);
    occurred.map(|&(text, count)| Problem { text, count })
}

/// What was wrong with single readings of the tracker.
fn tracker_problems(
    pairing: &PairingCounts,
    skipped_bytes: u64,
    lost: u64,
) -> [(&'static str, u64); 5] {
    let other = pairing.invalid_poses + pairing.late_poses;
    let jumps = pairing.rejected_poses.saturating_sub(other);
    [
        ("bytes that belong to no record", skipped_bytes),
        ("missing, by its rate", lost),
        ("no numbers or no rotation", pairing.invalid_poses),
        ("not newer than the one before", pairing.late_poses),
        ("position that no motion explains", jumps),
    ]
}

/// What was wrong with single pictures of a camera, as its driver counts.
fn camera_problems(report: &CameraReport, status: &DeviceStatus) -> [(&'static str, u64); 3] {
    let counters = report.counters;
    [
        ("lost before they reached the driver", counters.lost),
        (
            "damaged, by the driver",
            counters.damaged.max(status.damaged),
        ),
        (
            "controls changed by another program",
            counters.controls_changed,
        ),
    ]
}

/// Message for a tracker whose bytes contain no record of its protocol. Bytes count once they were
/// decoded, which is not done before the first picture is composed.
fn unreadable(status: &DeviceStatus, counts: &FeedCounts) -> Option<String> {
    let DeviceReport::Tracker(report) = &status.report else {
        return None;
    };
    let (identity, protocol, bytes) = (&report.identity, &report.protocol, counts.tracker_bytes);
    if bytes <= BYTES_FOR_A_RECORD || counts.poses > 0 {
        return None;
    }
    // Only a serial line has a baud rate, and only serial ports are probed.
    let advice = if identity.starts_with("udp:") || identity.starts_with("vrpn:") {
        "check `protocol` under [tracker], and what its sender sends"
    } else {
        "check `protocol` and `baud` under [tracker]; `penumbra devices --probe` detects them"
    };
    Some(format!(
        "received {bytes} bytes without a {protocol} record; {advice}"
    ))
}

fn camera(device: &mut Device, report: &CameraReport, status: &DeviceStatus) {
    let counters = report.counters;
    device.identity = Some(report.identity.clone());
    device.dropped = counters.lost
        + counters.damaged.max(status.damaged)
        + counters.superseded
        + counters.unattributed
        + status.irregular.get(Irregularity::Undecodable);
    device
        .problems
        .extend(problems(&camera_problems(report, status)));
    device.mode = report.mode.map(|mode| {
        let size = match (mode.width, mode.height) {
            (0, 0) => String::new(),
            (width, height) => format!("{width}x{height} "),
        };
        let rate = mode
            .frames_per_second
            .map_or(String::new(), |rate| format!(" at {rate:.4}/s"));
        format!("{size}{:?}{rate}", mode.format)
    });
    device.notes.clear();
    device.notes.extend(report.notes.iter().cloned());
    device.notes.push(stamps(report.stamps).to_owned());
    device.controls = report.controls.iter().map(control).collect();
}

const fn stamps(source: StampSource) -> &'static str {
    match source {
        StampSource::StartOfExposure => "stamped at the start of the exposure, monotonic clock",
        StampSource::FirstBytes => "stamped at the arrival of the first bytes, monotonic clock",
        StampSource::EndOfFrame => "stamped at the end of the frame, monotonic clock",
        StampSource::Arrival => "not stamped: the time of arrival is used",
        StampSource::WallClock => "stamped on the wall clock, which may jump",
        StampSource::Recorded => "recorded timestamps, shifted to the current time",
    }
}

fn control(report: &ControlReport) -> Control {
    Control {
        name: report.name.to_string(),
        requested: report.wanted,
        active: report.in_force,
        status: match &report.standing {
            ControlStanding::Held => "held".to_owned(),
            ControlStanding::Missing => "the camera has no such control".to_owned(),
            ControlStanding::Adjusted => "the camera set another value".to_owned(),
            ControlStanding::Refused(reason) => format!("refused: {reason}"),
            ControlStanding::Changed => "changed by another program".to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_interface::{CameraCounters, TrackerReport};

    fn rate(received: u64) -> DeviceRate {
        DeviceRate {
            received,
            per_second: 1.0,
            last_age_ms: None,
        }
    }

    /// What the status says of a tracker that has sent 2,000 bytes, of which some are decoded.
    fn reason(identity: &str, decoded: u64, poses: u64) -> Option<String> {
        let status = DeviceStatus {
            state: Captured::Streaming,
            bytes: 2000,
            report: DeviceReport::Tracker(TrackerReport {
                identity: identity.to_owned(),
                protocol: "liberty".to_owned(),
                ..TrackerReport::default()
            }),
            ..DeviceStatus::default()
        };
        let counts = FeedCounts {
            tracker_bytes: decoded,
            poses,
            ..FeedCounts::default()
        };
        unreadable(&status, &counts)
    }

    #[test]
    fn reports_bytes_without_a_record_as_wrong_protocol_or_baud_rate() {
        let of = |identity| reason(identity, 2000, 0).unwrap();
        let serial = of("usb-FTDI_X");
        assert!(
            serial.contains("2000 bytes") && serial.contains("liberty"),
            "{serial}"
        );
        assert!(serial.contains("`baud`"), "{serial}");
        let network = of("udp:0.0.0.0:40000");
        assert!(!network.contains("baud"), "{network}");
        assert_eq!(reason("usb-FTDI_X", 2000, 5), None);
        assert_eq!(reason("usb-FTDI_X", 100, 0), None);
    }

    /// The first picture takes seconds, in which nobody reads what the tracker sends.
    #[test]
    fn bytes_that_nobody_has_decoded_yet_are_not_called_unreadable() {
        assert_eq!(reason("usb-FTDI_X", 0, 0), None);
    }

    #[test]
    fn shows_controls_losses_and_next_attempt_of_a_camera() {
        let now = SystemClock.now();
        let report = |name: &str, standing| ControlReport {
            name: name.into(),
            wanted: 1,
            in_force: Some(2),
            standing,
        };
        let status = DeviceStatus {
            state: Captured::BackingOff {
                until: now.offset_nanos(500_000_000),
            },
            reason: Some("gone".to_owned()),
            losses: 3,
            damaged: 1,
            report: DeviceReport::Camera(CameraReport {
                identity: "usb-cam".to_owned(),
                counters: CameraCounters {
                    lost: 2,
                    damaged: 4,
                    superseded: 5,
                    ..CameraCounters::default()
                },
                controls: [
                    report("gain", ControlStanding::Refused("EACCES".to_owned())),
                    report("hue", ControlStanding::Missing),
                ]
                .into(),
                ..CameraReport::default()
            }),
            ..DeviceStatus::default()
        };
        let mut device = Device::new("c", DeviceKind::SceneCamera);
        write(&mut device, &status, &rate(0), now);
        assert_eq!(device.state, DeviceState::Retrying);
        assert_eq!((device.losses, device.dropped), (3, 11));
        assert!((device.retry_in_ms.unwrap() - 500.0).abs() < 1e-6);
        assert_eq!(device.identity.as_deref(), Some("usb-cam"));
        let statuses: Vec<_> = device.controls.iter().map(|c| c.status.as_str()).collect();
        assert_eq!(
            statuses,
            ["refused: EACCES", "the camera has no such control"]
        );
    }

    #[test]
    fn problems_of_single_deliveries_are_named_with_their_numbers() {
        let occurred = |counts: &[(&'static str, u64)]| -> Vec<(&str, u64)> {
            problems(counts).map(|p| (p.text, p.count)).collect()
        };
        let status = DeviceStatus {
            damaged: 3,
            ..DeviceStatus::default()
        };
        let report = CameraReport {
            counters: CameraCounters {
                lost: 2,
                damaged: 1,
                ..CameraCounters::default()
            },
            ..CameraReport::default()
        };
        assert_eq!(
            occurred(&camera_problems(&report, &status)),
            [
                ("lost before they reached the driver", 2),
                ("damaged, by the driver", 3)
            ]
        );
        let pairing = PairingCounts {
            rejected_poses: 6,
            invalid_poses: 1,
            late_poses: 2,
            ..Default::default()
        };
        assert_eq!(
            occurred(&tracker_problems(&pairing, 70, 0)),
            [
                ("bytes that belong to no record", 70),
                ("no numbers or no rotation", 1),
                ("not newer than the one before", 2),
                ("position that no motion explains", 3)
            ]
        );
    }

    #[test]
    fn session_reports_why_no_picture_arrives_and_recovery() {
        let mut s = Snapshot {
            devices: vec![Device::new("c", DeviceKind::SceneCamera)],
            ..Snapshot::default()
        };
        session(&mut s);
        assert!(s.session.description.contains("being opened"));
        s.devices[0].enter(DeviceState::Retrying, Some("c: not connected"));
        session(&mut s);
        assert!(s.session.description.contains("c: not connected"));
        s.devices[0].enter(DeviceState::Streaming, None);
        session(&mut s);
        assert_eq!(s.session.description, SessionState::Live.description());
    }
}
