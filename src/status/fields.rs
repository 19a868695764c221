//! What the fields of `/status` mean.
//!
//! The table in `src/status/README.md` is made of this list, and a test compares the list
//! with a real answer, so neither can fall behind.

/// Path and meaning of every field, in the order of the JSON; `[]` stands for each element
/// of a list. Fields that may be `null` say when.
pub const STATUS_FIELDS: &[(&str, &str)] = &[
    (
        "version",
        "Version of this table, 1. It changes when a field changes its meaning or goes away, not when one is added.",
    ),
    ("program.name", "The program that answers, `penumbra`."),
    ("program.version", "Its version."),
    (
        "program.uptime_seconds",
        "Time since it began to answer, s.",
    ),
    (
        "session.name",
        "File name of the recording, or name of the rig.",
    ),
    (
        "session.state",
        "`starting`, `live`, `replaying`, `paused`, `ended` or `failed`.",
    ),
    (
        "session.sentence",
        "That state in words, with the reason where there is one.",
    ),
    ("session.loops", "How often the recording has begun anew."),
    (
        "session.progress",
        "Share of the recording played, 0 to 1; null when live.",
    ),
    (
        "frames.arrived",
        "Scene frames that arrived since the start.",
    ),
    ("frames.composed", "Pictures composited."),
    (
        "frames.skipped",
        "Scene frames left out: overtaken by a newer one, or damaged.",
    ),
    (
        "frames.without_pose",
        "Scene frames for which no pose was known; they show the camera's picture.",
    ),
    (
        "frames.per_second",
        "Composited pictures per second over the last two seconds.",
    ),
    (
        "frames.last_age_ms",
        "Age of the newest composited picture, ms; null before the first.",
    ),
    (
        "stages[].name",
        "A stage of the frame: `decode`, `environment`, `upload`, `composite`, `encode`, `total`, `arrival_to_picture` (live, from the arrival of the frame), or the name of a GPU pass.",
    ),
    (
        "stages[].kind",
        "`cpu` (wall time of a thread) or `gpu` (time stamps of a pass).",
    ),
    ("stages[].count", "How often it ran."),
    ("stages[].recent_ms", "Mean of about the last 16 runs, ms."),
    (
        "stages[].p50_ms",
        "Median since the start, ms, to within 2.2 %.",
    ),
    (
        "stages[].p99_ms",
        "99th percentile since the start, ms, to within 2.2 %.",
    ),
    ("stages[].max_ms", "Longest since the start, ms."),
    (
        "pairing.environment_skew_ms",
        "Scene frame minus its environment frame, ms; null before the first pair.",
    ),
    (
        "pairing.pose_skew_ms",
        "Distance of the scene frame to the farther of the pose records used, ms; null without a pose.",
    ),
    (
        "pairing.environment_skew_p50_ms",
        "Median of the environment skew, ms; null before the first pair.",
    ),
    (
        "pairing.environment_skew_p99_ms",
        "99th percentile of the environment skew, ms; null before the first pair.",
    ),
    (
        "pairing.pose",
        "How the newest pose was found: `exact`, `interpolated`, `predicted` or `none`.",
    ),
    (
        "pairing.pose_sigma_mm",
        "Standard deviation of the tracked camera's place at that instant by the tracker's noise and, if predicted, by how far predictions as long were off lately; over all axes, mm.",
    ),
    (
        "pairing.pose_sigma_deg",
        "The same of its direction, degrees.",
    ),
    (
        "pairing.pose_sigma_px",
        "The same of the picture of a point amid the virtual objects, pixels.",
    ),
    (
        "pairing.tracker_latency_ms",
        "The tracker's latency that poses are found by, ms; null without a tracker.",
    ),
    (
        "pairing.tracker_latency_measured_ms",
        "The tracker's latency as measured while the rig ran, from how tracker and pictures turned in the last 20 s, ms; null while nothing has told it.",
    ),
    (
        "pairing.tracker_latency_sigma_ms",
        "Standard deviation of the measured latency, ms; it grows while the rig rests.",
    ),
    (
        "pairing.tracker_latency_by",
        "What measured it: `poses` (by markers) or `image motion`.",
    ),
    (
        "pairing.tracker_latency_ago_s",
        "Seconds since it was last measured.",
    ),
    (
        "pairing.tracker_latency_note",
        "Why the newest seconds do not tell the latency, and what to do; null where they do.",
    ),
    (
        "registration.source",
        "What the newest pose was found by: `tracker`, `markers`, `hybrid` (the tracker, corrected by markers) or `none`.",
    ),
    (
        "registration.markers",
        "Markers that it was found or corrected by.",
    ),
    (
        "registration.reprojection_px",
        "Root mean square distance of their corners from where the pose puts them, pixels; null without markers.",
    ),
    (
        "registration.ambiguous",
        "Whether it was found by one marker whose corners allow two poses, with nothing to choose by.",
    ),
    (
        "registration.corrected_ago_s",
        "Seconds since markers last corrected the tracker; null where they never did.",
    ),
    (
        "registration.correction_mm",
        "By how much they correct the camera's place, mm.",
    ),
    (
        "registration.correction_deg",
        "By how much they correct its direction, degrees.",
    ),
    (
        "registration.rejected",
        "Poses by markers that could not be by what was known, since the start.",
    ),
    (
        "registration.settling_px",
        "How far virtual objects still slide to where they are known to belong, pixels.",
    ),
    (
        "registration.sigma_mm",
        "Standard deviation of the camera's place, over all axes, mm; null where nothing tells it.",
    ),
    (
        "registration.sigma_deg",
        "Standard deviation of its direction, degrees.",
    ),
    (
        "registration.sigma_px",
        "Standard deviation of the picture of a point amid the virtual objects, pixels.",
    ),
    (
        "registration.display.ahead_ms",
        "From the middle of the exposure until the picture is seen, where it is shown for that instant; `display` is null where not.",
    ),
    (
        "registration.display.moved_px",
        "How far the camera's motion until then moves the virtual objects, pixels.",
    ),
    (
        "registration.display.sigma_mm",
        "Standard deviation of the camera's place as expected then, over all axes, mm; null until predictions have come true.",
    ),
    (
        "registration.display.sigma_deg",
        "Standard deviation of its direction then, degrees.",
    ),
    (
        "registration.display.sigma_px",
        "Standard deviation of the picture of a point amid the virtual objects then, pixels.",
    ),
    (
        "white_balance.method",
        "Method in force: `chart`, `automatic`, `known-surface`, `grey-world`, `same-camera`, `configured` or `none`.",
    ),
    (
        "white_balance.gains[]",
        "Linear factors on the environment camera's red, green, blue.",
    ),
    (
        "white_balance.uncertainty[]",
        "Standard deviation of each factor as a share of it; null where unknown.",
    ),
    (
        "white_balance.disagreement",
        "Largest relative difference between the methods that have measured, grey world aside; null with fewer than two.",
    ),
    (
        "white_balance.frozen",
        "Why the estimate is held as it is; null while it follows.",
    ),
    (
        "white_balance.estimates[].method",
        "A method that has an estimate.",
    ),
    (
        "white_balance.estimates[].gains[]",
        "What it says, red, green, blue.",
    ),
    (
        "white_balance.estimates[].uncertainty[]",
        "Standard deviation of each as a share of it.",
    ),
    (
        "white_balance.white.scene[]",
        "A white surface as the scene camera sees it, linear RGB; `white` is null where none was seen by both.",
    ),
    (
        "white_balance.white.environment_before[]",
        "The same surface as the environment camera sees it, linear RGB.",
    ),
    (
        "white_balance.white.environment_after[]",
        "The same after the factors.",
    ),
    ("lighting.dome_lights", "Dome lights that cast shadows now."),
    (
        "lighting.compact_lights",
        "How many of them stand for compact sources.",
    ),
    (
        "lighting.compact_sources",
        "Compact sources found: sun, lamps, windows.",
    ),
    (
        "lighting.age_ms",
        "Age of the environment picture against the scene picture, ms; null before the first.",
    ),
    (
        "lighting.stale",
        "Why the light is older than it should be; null while it is not.",
    ),
    (
        "lighting.clipped_fraction",
        "Share of the environment's solid angle seen clipped, 0 to 1; null where unknown.",
    ),
    (
        "lighting.dominant_direction[]",
        "Unit vector to where most light comes from, world, +Z up; null where unknown.",
    ),
    (
        "lighting.dominance",
        "By how much that light outshines what lies elsewhere, as a share of all light: 1 for a sun alone, 0 for two equal lamps and for light from everywhere; null where unknown.",
    ),
    (
        "lighting.probe.coverage",
        "Share of all directions that the mirrored ball in the scene camera's picture has shown so far, 0 to 1; `probe` is null where the light is seen otherwise.",
    ),
    (
        "lighting.probe.coverage_above",
        "The same of the directions above the horizon.",
    ),
    (
        "lighting.probe.map_age_s",
        "Time since they were seen last, on average, s; null before the first.",
    ),
    (
        "lighting.probe.ball_age_s",
        "Time since the ball was seen, s: it grows while the ball, its marker or the pose is out of sight; null before it was seen.",
    ),
    (
        "lighting.probe.rim_shift_px",
        "How far its rim in the picture moved the ball then from where the pose puts it, pixels; null where it was not looked for.",
    ),
    (
        "lighting.preview_revision",
        "Counts the pictures at `/environment.png`; 0 = none yet.",
    ),
    (
        "scene.file",
        "The scene file, which is read anew when it or a model that it names is changed; null where the session brings the scene.",
    ),
    (
        "scene.loads",
        "Times that a changed scene was taken into the picture.",
    ),
    (
        "scene.reason",
        "Why the newest change was not taken, and the scene stayed as it was; null when it was.",
    ),
    (
        "planes.state",
        "Shadowing planes: `off` (another technique is in force), `baking`, `ready` or `failed`.",
    ),
    (
        "planes.done",
        "Lights whose basis images are drawn; null unless baking.",
    ),
    ("planes.total", "Of so many; null unless baking."),
    ("planes.reason", "Why there is no bake; null unless failed."),
    ("planes.planes", "Planes baked."),
    (
        "planes.planes_seen",
        "Planes that face the viewer in the newest picture.",
    ),
    ("planes.lights", "Lights: faces of the geodesic dome."),
    (
        "planes.lights_skipped",
        "Lights left out of the newest picture, because they give less than `settings.planes_skip_below`.",
    ),
    (
        "planes.sources",
        "Compact sources of light (sun, lamp) that cast shadows from their true directions, not from the middle of a face.",
    ),
    (
        "planes.source_images",
        "Basis images drawn for them since the start: anew when they move.",
    ),
    (
        "planes.basis_images",
        "Basis images in which light arrives.",
    ),
    (
        "planes.basis_images_dropped",
        "Black basis images: neither stored nor summed.",
    ),
    (
        "planes.images_summed",
        "Basis images summed for the newest picture.",
    ),
    (
        "planes.images_total",
        "Basis images summed since the start.",
    ),
    (
        "planes.images_possible",
        "Basis images that would have been summed if every picture had summed all of them.",
    ),
    (
        "planes.work_saved",
        "Share of these that was not needed, 0 to 1; null before the first picture.",
    ),
    (
        "planes.planes_resummed",
        "Planes whose sums were made anew or mended, since the start.",
    ),
    (
        "planes.frames_without_work",
        "Pictures for which nothing had to be summed.",
    ),
    (
        "planes.bake_seconds",
        "How long baking took, s; null before it was done.",
    ),
    ("planes.bake_bytes", "Size of the bake."),
    (
        "planes.from_cache",
        "Whether it had been baked before and was read from the cache.",
    ),
    (
        "exposure.ev",
        "Exposure of the newest picture, stops beside the camera's own; 0: the camera's picture is untouched.",
    ),
    (
        "exposure.wanted_ev",
        "Where the automatic exposure is going, stops.",
    ),
    (
        "exposure.camera",
        "Mean linear brightness of the camera's picture, 0 to 1; null where it is not measured.",
    ),
    (
        "exposure.added",
        "What virtual lights add to it; null likewise.",
    ),
    (
        "exposure.taken",
        "What virtual shadows take from it; null likewise.",
    ),
    (
        "recording.state",
        "`unavailable` (a recording plays), `idle`, `recording`, `finished` or `failed`.",
    ),
    (
        "recording.sentence",
        "That state in words, with the reason where there is one.",
    ),
    (
        "recording.file",
        "The newest recording; null before the first.",
    ),
    ("recording.bytes", "Its size."),
    ("recording.seconds", "Its length so far, s."),
    (
        "recording.seconds_left",
        "Until it ends by itself, by the room on the disk or the length asked for, s; null where unknown.",
    ),
    (
        "recording.free_bytes",
        "Room on its disk; null where unknown.",
    ),
    (
        "recording.events",
        "Messages recorded: pictures, readings, notes.",
    ),
    (
        "recording.dropped",
        "Messages not recorded, because the disk was too slow or they could not be written down.",
    ),
    ("devices[].name", "Name or path of a camera or tracker."),
    (
        "devices[].kind",
        "`scene-camera`, `environment-camera` or `tracker`.",
    ),
    (
        "devices[].state",
        "`absent`, `opening`, `streaming`, `silent`, `retrying`, `failed` or `ended`.",
    ),
    ("devices[].sentence", "That state in words."),
    (
        "devices[].reason",
        "What the driver said; null while nothing is wrong.",
    ),
    ("devices[].per_second", "Frames or records per second."),
    ("devices[].received", "Frames or records since the start."),
    (
        "devices[].dropped",
        "Of these lost: gaps in its counter, damaged, or overtaken.",
    ),
    (
        "devices[].last_age_ms",
        "Age of the newest frame or record, ms; null before the first.",
    ),
    (
        "devices[].identity",
        "Who it is, the same after replugging; null before it was open, and in a replay.",
    ),
    (
        "devices[].mode",
        "Size, format and rate of a camera, protocol of a tracker; null before it was open.",
    ),
    ("devices[].attempts", "Times that it was tried to open it."),
    (
        "devices[].losses",
        "Times that it was lost after it had been open.",
    ),
    (
        "devices[].retry_in_ms",
        "When it is tried again, ms from now; null while it is open.",
    ),
    (
        "devices[].last_trouble",
        "What went wrong last, even if all is well again; null if nothing did.",
    ),
    ("devices[].notes[]", "What its user should know."),
    (
        "devices[].controls[].name",
        "A control that the configuration locks.",
    ),
    (
        "devices[].controls[].wanted",
        "The value asked for, in the device's unit.",
    ),
    (
        "devices[].controls[].in_force",
        "The value that the device reports; null if none.",
    ),
    (
        "devices[].controls[].standing",
        "How the two compare, in words.",
    ),
    ("adapter.name", "What draws, as its driver calls it."),
    ("adapter.backend", "`Vulkan`, `Metal`, …"),
    ("adapter.kind", "`DiscreteGpu`, `IntegratedGpu`, `Cpu`, …"),
    (
        "resolution.width",
        "Width of the composited picture, pixels.",
    ),
    (
        "resolution.height",
        "Height of the composited picture, pixels.",
    ),
    (
        "settings.technique",
        "In force for the newest picture: `image-based-shadowing` (dome lights), `shadowing-planes` or `image-based-lighting` (no shadows). What `POST /settings` takes, all of it optional there.",
    ),
    (
        "settings.light_count",
        "Budget of dome lights: 8, 24, 48, 64, 96 or 384.",
    ),
    (
        "settings.light_placement",
        "`adaptive` (compact sources get lights of their own) or `grid` (the paper's).",
    ),
    (
        "settings.shadow_mode",
        "`ratio` or `subtract` (the paper's equation 4).",
    ),
    (
        "settings.shadow_strength",
        "0 (no shadow) to 1 (as measured).",
    ),
    (
        "settings.virtual_object_visible",
        "Whether virtual objects are composited; if not, the output is the camera's picture.",
    ),
    (
        "settings.reflections",
        "How the environment is filtered for what virtual objects mirror: `prefiltered` (over each material's lobe) or `box` (the paper's chain).",
    ),
    (
        "settings.indirect_light",
        "Whether virtual objects throw light on real things, and those on them: a red one tints the table.",
    ),
    (
        "settings.lamp_response",
        "How real surfaces answer virtual lamps: `intrinsic` (lamps multiply the picture) or `paper` (N·L and the picture's own relief, blended, are added).",
    ),
    (
        "settings.planes_skip_below",
        "With shadowing planes: of 40 lights, those that give less than this share of all light are left out, 0 to 1.",
    ),
    (
        "settings.planes_recompute_above",
        "With shadowing planes: a light is summed anew when it changes by more than this share of all light, 0 to 1.",
    ),
    (
        "settings.planes_shading",
        "With shadowing planes, what virtual objects are shaded with: `irradiance`, `lights` (all of the dome) or `six` (the papers').",
    ),
    (
        "settings.exposure_mode",
        "`off` (the camera's picture is untouched), `manual` or `auto` (by what virtual lights add).",
    ),
    (
        "settings.exposure_ev",
        "With `manual`: stops beside the camera's own exposure, -8 to 3.",
    ),
    (
        "settings.exposure_highlights",
        "What clipped areas become in a shorter exposure: `estimated` (by what surrounds them) or `paper` (every pixel's factor rises with the mean around it).",
    ),
    (
        "settings.exposure_min_ev",
        "With `auto`: no darker than this, stops, -8 to 0.",
    ),
    (
        "settings.exposure_max_ev",
        "With `auto`: no brighter than this, stops, 0 to 3.",
    ),
    (
        "settings.exposure_key",
        "With `auto`: a picture with a mean below this is dark, linear, 0 to 1.",
    ),
    (
        "settings.exposure_adaptation_s",
        "With `auto`: time in which 63 % of a sudden change is followed, s, 0 to 60.",
    ),
    ("stream.viewers", "Browsers that watch `/stream.mjpeg`."),
    ("stream.encoded", "Pictures encoded for them."),
    (
        "warnings[].text",
        "What somebody should look at: what, where, what to do.",
    ),
    ("warnings[].count", "How often it happened."),
];

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::Snapshot;
    use crate::snapshot::{Control, Device, WhiteBalanceEstimate, WhiteBalanceMethod, WhiteMatch};
    use penumbra_interface::DeviceKind;
    use serde_json::Value;
    use std::collections::BTreeSet;
    use std::fmt::Write as _;
    use std::time::Duration;

    /// A snapshot in which no list is empty and no object missing.
    fn full() -> Snapshot {
        let mut s = Snapshot::default();
        s.stages.record("decode", Duration::from_millis(1));
        s.devices = vec![Device {
            notes: vec!["a".to_owned()],
            controls: vec![Control::default()],
            ..Device::new("a", DeviceKind::Tracker)
        }];
        s.warn("a");
        s.lighting.probe = Some(crate::ProbeStatus::default());
        s.registration.display = Some(crate::DisplayStatus::default());
        s.lighting.dominant_direction = Some([0.0, 0.0, 1.0]);
        let (method, rgb) = (WhiteBalanceMethod::Chart, [1.0; 3]);
        let b = &mut s.white_balance;
        b.uncertainty = Some(rgb);
        b.estimates = vec![WhiteBalanceEstimate {
            method,
            gains: rgb,
            uncertainty: rgb,
        }];
        b.white = Some(WhiteMatch {
            scene: rgb,
            environment_before: rgb,
            environment_after: rgb,
        });
        s
    }

    fn paths(value: &Value, path: &str, found: &mut BTreeSet<String>) {
        match value {
            Value::Object(fields) => fields.iter().for_each(|(name, v)| {
                let dot = if path.is_empty() { "" } else { "." };
                paths(v, &format!("{path}{dot}{name}"), found);
            }),
            Value::Array(elements) => {
                elements
                    .iter()
                    .for_each(|v| paths(v, &format!("{path}[]"), found));
            }
            _ => {
                found.insert(path.to_owned());
            }
        }
    }

    #[test]
    fn every_field_of_the_answer_is_documented_and_no_other() {
        let mut found = BTreeSet::new();
        paths(&serde_json::to_value(full()).unwrap(), "", &mut found);
        let documented: BTreeSet<String> =
            STATUS_FIELDS.iter().map(|(p, _)| (*p).to_owned()).collect();
        assert_eq!(found, documented);
        assert_eq!(documented.len(), STATUS_FIELDS.len(), "documented twice");
    }

    /// `UPDATE_DOCS=1 cargo test --lib readme_has_the_table` writes the table anew.
    #[test]
    fn readme_has_the_table() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/README.md");
        let readme = std::fs::read_to_string(path).unwrap();
        let (before, _) = readme.split_once("| Field |").expect("the table's head");
        let mut expected = format!("{before}| Field | Meaning |\n|---|---|\n");
        for (field, meaning) in STATUS_FIELDS {
            let _ = writeln!(expected, "| `{field}` | {meaning} |");
        }
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(path, &expected).unwrap();
        }
        assert!(
            readme == expected,
            "{path} is behind; run this test with UPDATE_DOCS=1"
        );
    }
}
