//! The snapshot in Prometheus' text exposition format, version 0.0.4.

use super::health::health;
use super::probe::ProbeStatus;
use super::snapshot::Snapshot;
use super::times::{Histogram, Stage};
use std::fmt::{Display, Write as _};

/// The `Content-Type` of the format.
pub const METRICS_CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Upper bounds of the histogram buckets, seconds.
const BOUNDS: [f64; 14] = [
    0.00025, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.033, 0.066, 0.1, 0.25, 0.5, 1.0, 5.0,
];

/// Returns all metrics of a snapshot.
#[must_use]
pub fn metrics(snapshot: &Snapshot) -> String {
    let mut page = Page::default();
    program(&mut page, snapshot);
    frames(&mut page, snapshot);
    stages(&mut page, snapshot.stages.stages());
    pairing(&mut page, snapshot);
    registration(&mut page, snapshot);
    display(&mut page, snapshot);
    latency(&mut page, snapshot);
    white_balance(&mut page, snapshot);
    lighting(&mut page, snapshot);
    planes(&mut page, snapshot);
    page.one(
        "penumbra_exposure_stops",
        "gauge",
        "Exposure of the picture relative to the camera's.",
        snapshot.exposure.ev,
    );
    devices(&mut page, snapshot);
    recording(&mut page, snapshot);
    page.text
}

fn program(page: &mut Page, s: &Snapshot) {
    page.family(
        "penumbra_info",
        "gauge",
        "Version and adapter, as labels; always 1.",
    );
    let labels = [("version", s.program.version), ("adapter", &s.adapter.name)];
    page.sample("penumbra_info", &labels, 1);
    page.one(
        "penumbra_uptime_seconds",
        "gauge",
        "Time since the start.",
        s.program.uptime_seconds,
    );
    let memory = [
        (
            "penumbra_resident_memory_bytes",
            "Memory that is resident.",
            s.program.memory.resident_bytes,
        ),
        (
            "penumbra_memory_limit_bytes",
            "Memory that the service, the container or the machine has.",
            s.program.memory.limit_bytes,
        ),
    ];
    for (name, help, value) in memory {
        if let Some(value) = value {
            page.one(name, "gauge", help, value);
        }
    }
    page.one(
        "penumbra_healthy",
        "gauge",
        "1 when /healthz answers 200.",
        u8::from(health(s).is_ok()),
    );
    let warnings = s.warnings.iter().map(|w| w.count).sum::<u64>();
    page.one(
        "penumbra_warnings",
        "gauge",
        "Occurrences of the active warnings.",
        warnings,
    );
    page.one(
        "penumbra_stream_viewers",
        "gauge",
        "Viewers of the stream.",
        s.stream.viewers,
    );
    page.one(
        "penumbra_stream_frames_total",
        "counter",
        "Pictures encoded for the stream.",
        s.stream.encoded,
    );
}

fn frames(page: &mut Page, s: &Snapshot) {
    let f = &s.frames;
    page.one(
        "penumbra_frames_arrived_total",
        "counter",
        "Scene frames that arrived.",
        f.arrived,
    );
    page.one(
        "penumbra_frames_composed_total",
        "counter",
        "Pictures composited.",
        f.composed,
    );
    page.one(
        "penumbra_frames_skipped_total",
        "counter",
        "Scene frames skipped.",
        f.skipped,
    );
    page.one(
        "penumbra_frames_without_pose_total",
        "counter",
        "Scene frames shown without virtual objects, because no pose was known.",
        f.without_pose,
    );
    page.one(
        "penumbra_frame_rate_hertz",
        "gauge",
        "Composited pictures per second.",
        f.per_second,
    );
    page.some(
        "penumbra_frame_age_seconds",
        "Age of the newest composited picture.",
        f.last_age_ms.map(|ms| ms * 1e-3),
    );
}

fn stages(page: &mut Page, stages: &[Stage]) {
    let name = "penumbra_stage_seconds";
    page.family(name, "histogram", "Duration of a stage of the frame.");
    for stage in stages {
        let labels = [("stage", stage.name), ("processor", stage.kind.label())];
        page.histogram(name, &labels, &stage.times);
    }
}

fn pairing(page: &mut Page, s: &Snapshot) {
    page.some(
        "penumbra_environment_skew_seconds",
        "Scene frame minus its environment frame.",
        s.pairing.environment_skew_ms.map(|ms| ms * 1e-3),
    );
    page.some(
        "penumbra_pose_skew_seconds",
        "Distance of the scene frame to the pose records used.",
        s.pairing.pose_skew_ms.map(|ms| ms * 1e-3),
    );
}

fn white_balance(page: &mut Page, s: &Snapshot) {
    let name = "penumbra_white_balance_gain";
    page.family(
        name,
        "gauge",
        "Linear factor on the environment camera, by channel.",
    );
    for (channel, gain) in ["red", "green", "blue"]
        .into_iter()
        .zip(s.white_balance.gains)
    {
        page.sample(name, &[("channel", channel)], gain);
    }
    let frozen = u8::from(s.white_balance.frozen.is_some());
    page.one(
        "penumbra_white_balance_frozen",
        "gauge",
        "1 while the estimate is frozen.",
        frozen,
    );
    page.some(
        "penumbra_white_balance_disagreement_ratio",
        "Maximum relative difference between the methods.",
        s.white_balance.disagreement,
    );
}

fn lighting(page: &mut Page, s: &Snapshot) {
    let l = &s.lighting;
    page.one(
        "penumbra_dome_lights",
        "gauge",
        "Dome lights that cast shadows.",
        l.dome_lights,
    );
    page.one(
        "penumbra_compact_sources",
        "gauge",
        "Compact sources detected.",
        l.compact_sources,
    );
    page.one(
        "penumbra_lighting_stale",
        "gauge",
        "1 while stale lighting is used.",
        u8::from(l.stale.is_some()),
    );
    page.some(
        "penumbra_lighting_age_seconds",
        "Age of the environment picture relative to the scene picture.",
        l.age_ms.map(|ms| ms * 1e-3),
    );
    page.one(
        "penumbra_environments_left_out_total",
        "counter",
        "Environment pictures from which no light was estimated, because estimates took longer than their interval.",
        l.environments_left_out,
    );
    page.some(
        "penumbra_environment_clipped_ratio",
        "Share of the environment that is clipped.",
        l.clipped_fraction,
    );
    page.some(
        "penumbra_environment_exposures_disagree_ratio",
        "By how much the environment camera's exposures disagree about the same light.",
        l.exposures_disagree,
    );
    page.some(
        "penumbra_lighting_picture_difference_ratio",
        "By how much real shadows in the picture differ from what the estimated light predicts.",
        l.picture_difference,
    );
    if let Some(map) = &l.probe {
        probe(page, map);
    }
}

fn probe(page: &mut Page, map: &ProbeStatus) {
    page.one(
        "penumbra_probe_coverage_ratio",
        "gauge",
        "Share of all directions that the mirrored sphere has shown.",
        map.coverage,
    );
    page.one(
        "penumbra_probe_coverage_above_ratio",
        "gauge",
        "Share of the directions above the horizon that it has shown.",
        map.coverage_above,
    );
    page.some(
        "penumbra_probe_map_age_seconds",
        "Mean time since the directions were last seen.",
        map.map_age_s,
    );
    page.some(
        "penumbra_probe_sphere_age_seconds",
        "Time since the sphere was seen.",
        map.sphere_age_s,
    );
    page.some(
        "penumbra_probe_rim_shift_pixels",
        "Correction of the sphere's position by its rim.",
        map.rim_shift_px,
    );
}

fn registration(page: &mut Page, s: &Snapshot) {
    let r = &s.registration;
    page.one(
        "penumbra_registration_markers",
        "gauge",
        "Markers used for the newest pose.",
        r.markers,
    );
    page.one(
        "penumbra_registration_ambiguous",
        "gauge",
        "1 while the pose is ambiguous.",
        u8::from(r.ambiguous),
    );
    page.some(
        "penumbra_registration_reprojection_pixels",
        "RMS reprojection error of the markers' corners.",
        r.reprojection_px,
    );
    page.one(
        "penumbra_registration_rejected_total",
        "counter",
        "Poses from markers rejected as implausible.",
        r.rejected,
    );
    let figures = [
        (
            "penumbra_registration_corrected_seconds",
            "Time since markers last corrected the tracker.",
            r.corrected_ago_s,
        ),
        (
            "penumbra_registration_settling_pixels",
            "Remaining part of a correction that is still being blended in.",
            r.settling_px,
        ),
        (
            "penumbra_registration_sigma_millimetres",
            "Standard deviation of the camera's position.",
            r.sigma_mm,
        ),
        (
            "penumbra_registration_sigma_degrees",
            "Standard deviation of the camera's orientation.",
            r.sigma_deg,
        ),
        (
            "penumbra_registration_sigma_pixels",
            "Standard deviation of the image of a point amid the virtual objects.",
            r.sigma_px,
        ),
    ];
    for (name, help, value) in figures {
        page.some(name, help, value);
    }
}

fn display(page: &mut Page, s: &Snapshot) {
    let display = s.registration.display;
    let figures = [
        (
            "penumbra_display_ahead_seconds",
            "Prediction time from the exposure until the picture is seen.",
            display.map(|d| 1e-3 * d.ahead_ms),
        ),
        (
            "penumbra_display_moved_pixels",
            "Displacement of the virtual objects by the camera's motion in that time.",
            display.map(|d| d.moved_px),
        ),
        (
            "penumbra_display_sigma_pixels",
            "Standard deviation of their predicted image.",
            display.and_then(|d| d.sigma_px),
        ),
    ];
    for (name, help, value) in figures {
        page.some(name, help, value);
    }
}

fn latency(page: &mut Page, s: &Snapshot) {
    let latencies = [
        (
            "penumbra_tracker_latency_seconds",
            "Tracker latency that is used.",
            s.pairing.tracker_latency_ms,
        ),
        (
            "penumbra_tracker_latency_measured_seconds",
            "Tracker latency as measured while the rig runs.",
            s.pairing.tracker_latency_measured_ms,
        ),
        (
            "penumbra_tracker_latency_sigma_seconds",
            "Standard deviation of the measured latency.",
            s.pairing.tracker_latency_sigma_ms,
        ),
    ];
    for (name, help, millis) in latencies {
        page.some(name, help, millis.map(|ms| ms * 1e-3));
    }
    page.some(
        "penumbra_pose_sigma_pixels",
        "Standard deviation of the image of a point amid the virtual objects by the tracker's noise and prediction.",
        s.pairing.pose_sigma_px,
    );
}

fn planes(page: &mut Page, s: &Snapshot) {
    let p = &s.planes;
    let name = "penumbra_planes_state";
    page.family(name, "gauge", "1 for the state of shadowing planes.");
    page.sample(name, &[("state", p.state.label())], 1);
    let name = "penumbra_planes";
    page.family(name, "gauge", "Shadowing planes, total and visible.");
    page.sample(name, &[("which", "all")], p.planes);
    page.sample(name, &[("which", "seen")], p.planes_seen);
    page.one(
        "penumbra_basis_images",
        "gauge",
        "Non-black basis images.",
        p.basis_images,
    );
    page.one(
        "penumbra_basis_images_summed_total",
        "counter",
        "Basis images summed.",
        p.images_total,
    );
    page.one(
        "penumbra_planes_idle_frames_total",
        "counter",
        "Pictures for which no basis image had to be summed.",
        p.frames_without_work,
    );
    page.one(
        "penumbra_bake_bytes",
        "gauge",
        "Size of the bake.",
        p.bake_bytes,
    );
    page.some(
        "penumbra_bake_seconds",
        "Duration of baking.",
        p.bake_seconds,
    );
}

fn recording(page: &mut Page, s: &Snapshot) {
    let r = &s.recording;
    page.family(
        "penumbra_recording_state",
        "gauge",
        "1 for the state of the recorder.",
    );
    page.sample("penumbra_recording_state", &[("state", r.state.label())], 1);
    page.one(
        "penumbra_recording_bytes",
        "gauge",
        "Size of the newest recording.",
        r.bytes,
    );
    page.one(
        "penumbra_recording_dropped",
        "gauge",
        "Messages missing from the newest recording.",
        r.dropped,
    );
}

fn devices(page: &mut Page, s: &Snapshot) {
    page.family(
        "penumbra_device_state",
        "gauge",
        "1 for the state of a device.",
    );
    for d in &s.devices {
        let labels = [
            ("device", d.name.as_str()),
            ("kind", d.kind.label()),
            ("state", d.state.label()),
        ];
        page.sample("penumbra_device_state", &labels, 1);
    }
    page.family(
        "penumbra_device_received_total",
        "counter",
        "Frames or records that arrived.",
    );
    for d in &s.devices {
        page.sample(
            "penumbra_device_received_total",
            &[("device", &d.name), ("kind", d.kind.label())],
            d.received,
        );
    }
    page.family(
        "penumbra_device_dropped_total",
        "counter",
        "Frames or records lost.",
    );
    for d in &s.devices {
        page.sample(
            "penumbra_device_dropped_total",
            &[("device", &d.name), ("kind", d.kind.label())],
            d.dropped,
        );
    }
    page.family(
        "penumbra_device_losses_total",
        "counter",
        "Number of times that an open device was lost.",
    );
    for d in &s.devices {
        let labels = [("device", d.name.as_str()), ("kind", d.kind.label())];
        page.sample("penumbra_device_losses_total", &labels, d.losses);
    }
    page.family(
        "penumbra_device_rate_hertz",
        "gauge",
        "Frames or records per second.",
    );
    for d in &s.devices {
        page.sample(
            "penumbra_device_rate_hertz",
            &[("device", &d.name), ("kind", d.kind.label())],
            d.per_second,
        );
    }
}

/// The text. Writing to a `String` cannot fail, so results are ignored.
#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        let _ = write!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: impl Display) {
        self.text.push_str(name);
        for (i, (key, text)) in labels.iter().enumerate() {
            let open = if i == 0 { '{' } else { ',' };
            let _ = write!(self.text, "{open}{key}=\"{}\"", escaped(text));
        }
        if !labels.is_empty() {
            self.text.push('}');
        }
        let _ = writeln!(self.text, " {value}");
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: impl Display) {
        self.family(name, kind, help);
        self.sample(name, &[], value);
    }

    /// A gauge that has no sample while its value is unknown.
    fn some(&mut self, name: &str, help: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.one(name, "gauge", help, value);
        }
    }

    fn histogram(&mut self, name: &str, labels: &[(&str, &str)], times: &Histogram) {
        let bucket = format!("{name}_bucket");
        for bound in BOUNDS {
            let le = bound.to_string();
            let with_bound = [labels, &[("le", le.as_str())]].concat();
            self.sample(&bucket, &with_bound, times.count_up_to(bound));
        }
        let with_infinity = [labels, &[("le", "+Inf")]].concat();
        self.sample(&bucket, &with_infinity, times.count());
        self.sample(&format!("{name}_sum"), labels, times.sum_seconds());
        self.sample(&format!("{name}_count"), labels, times.count());
    }
}

/// Label values escape backslash, quote and line feed.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::snapshot::Device;
    use penumbra_interface::DeviceKind;
    use std::collections::{BTreeMap, BTreeSet};
    use std::time::Duration;

    /// One sample: name, labels as written, value.
    type Sample = (String, String, f64);

    /// Reads a page strictly: every sample belongs to the family announced before it, and
    /// no family comes twice.
    fn parse(page: &str) -> (BTreeMap<String, String>, Vec<Sample>) {
        let (mut types, mut samples) = (BTreeMap::new(), Vec::new());
        let mut family = String::new();
        for line in page.lines() {
            if let Some(help) = line.strip_prefix("# HELP ") {
                let (name, text) = help.split_once(' ').unwrap();
                assert!(text.ends_with('.'), "{line}");
                family = name.to_owned();
            } else if let Some(kind) = line.strip_prefix("# TYPE ") {
                let (name, kind) = kind.split_once(' ').unwrap();
                assert_eq!(name, family);
                assert!(
                    types.insert(family.clone(), kind.to_owned()).is_none(),
                    "{name} twice"
                );
            } else {
                let (key, value) = line.rsplit_once(' ').unwrap();
                let (name, labels) = key.split_once('{').unwrap_or((key, ""));
                let stem = ["_bucket", "_sum", "_count"]
                    .iter()
                    .find_map(|s| name.strip_suffix(s));
                assert!(
                    name == family || stem == Some(family.as_str()),
                    "{line} in {family}"
                );
                samples.push((
                    name.to_owned(),
                    labels.trim_end_matches('}').to_owned(),
                    value.parse().unwrap(),
                ));
            }
        }
        (types, samples)
    }

    fn busy() -> Snapshot {
        let mut s = Snapshot::default();
        s.stages.record("decode", Duration::from_millis(3));
        s.stages.record("decode", Duration::from_millis(300));
        s.stages
            .record_gpu("shadow_maps", Duration::from_micros(700));
        s.frames.composed = 41;
        s.frames.last_age_ms = Some(20.0);
        s.devices = vec![
            Device::new("a \"b\"\\\n", DeviceKind::Tracker),
            Device::new("c", DeviceKind::SceneCamera),
        ];
        s
    }

    #[test]
    fn page_follows_the_exposition_format() {
        let (types, samples) = parse(&metrics(&busy()));
        for (name, kind) in &types {
            assert_eq!(
                name.ends_with("_total"),
                kind == "counter",
                "{name} is a {kind}"
            );
            assert!(name.starts_with("penumbra_"), "{name}");
        }
        let keys: BTreeSet<_> = samples.iter().map(|(n, l, _)| (n, l)).collect();
        assert_eq!(keys.len(), samples.len(), "a sample comes twice");
        let composed = samples
            .iter()
            .find(|(n, ..)| n == "penumbra_frames_composed_total")
            .unwrap();
        assert_eq!(composed.2, 41.0);
        let age = samples
            .iter()
            .find(|(n, ..)| n == "penumbra_frame_age_seconds")
            .unwrap();
        assert!((age.2 - 0.02).abs() < 1e-12);
    }

    #[test]
    fn histograms_are_cumulative_up_to_infinity() {
        let (_, samples) = parse(&metrics(&busy()));
        let decode = |suffix: &str| -> Vec<f64> {
            let name = format!("penumbra_stage_seconds_{suffix}");
            samples
                .iter()
                .filter(|(n, l, _)| *n == name && l.contains("\"decode\""))
                .map(|s| s.2)
                .collect()
        };
        let buckets = decode("bucket");
        assert_eq!(buckets.len(), BOUNDS.len() + 1);
        assert!(buckets.is_sorted());
        assert_eq!(buckets[3..5], [0.0, 1.0], "3 ms lies between 2 and 4");
        assert_eq!(
            buckets[10..12],
            [1.0, 2.0],
            "300 ms lies between 250 and 500"
        );
        assert_eq!(
            (buckets.last().copied(), decode("count")[0]),
            (Some(2.0), 2.0)
        );
        assert!((decode("sum")[0] - 0.303).abs() < 1e-9);
    }

    #[test]
    fn has_the_exposure() {
        let mut s = busy();
        s.exposure.ev = -1.5;
        let (types, samples) = parse(&metrics(&s));
        let name = "penumbra_exposure_stops";
        assert!(types.iter().any(|(n, kind)| n == name && kind == "gauge"));
        assert!(samples.iter().any(|(n, _, v)| n == name && *v == -1.5));
    }

    #[test]
    fn escapes_device_names() {
        let page = metrics(&busy());
        assert!(
            page.contains(
                r#"penumbra_device_received_total{device="a \"b\"\\\n",kind="tracker"} 0"#
            ),
            "{page}"
        );
    }

    #[test]
    fn page_of_an_empty_snapshot_omits_unknown_values() {
        let (_, samples) = parse(&metrics(&Snapshot::default()));
        assert!(
            samples
                .iter()
                .all(|(n, ..)| n != "penumbra_frame_age_seconds")
        );
    }
}
