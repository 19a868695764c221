//! Descriptions of the fields of `/status`.
//!
//! The table in `docs/src/status-api.md` is generated from this list, and a test compares the list
//! with a complete answer.

/// Path and description of every field, in the order of the JSON; `[]` stands for each element of
/// a list. The description says when a field is `null`.
pub const STATUS_FIELDS: &[(&str, &str)] = &[
    (
        "version",
        "Version of this table, 1. It changes when a field changes its meaning or is removed, not when one is added.",
    ),
    ("program.name", "The program that answers, `penumbra`."),
    ("program.version", "Its version."),
    ("program.uptime_seconds", "Time since the start, s."),
    (
        "program.memory.resident_bytes",
        "Memory that is resident, bytes; null where the system does not tell.",
    ),
    (
        "program.memory.limit_bytes",
        "What the service or container may use, else all memory of the machine, bytes; null likewise.",
    ),
    (
        "session.name",
        "File name of the recording, or name of the rig.",
    ),
    (
        "session.state",
        "State: `starting`, `live`, `replaying`, `paused`, `ended` or `failed`.",
    ),
    (
        "session.description",
        "That state in words, with the reason where there is one.",
    ),
    ("session.loops", "How often the recording was repeated."),
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
        "Scene frames skipped: replaced by a newer one, or damaged.",
    ),
    (
        "frames.lost",
        "Scene frames in damaged parts of the recording.",
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
    ("stages[].count", "Number of runs."),
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
        "pairing.rejected_poses",
        "Readings of the tracker that no motion of a hand explains, since the start; they are not used.",
    ),
    (
        "pairing.pose_sigma_mm",
        "Standard deviation of the camera's position at that instant, over all axes, mm: the tracker's noise and, if predicted, the error of recent predictions of equal length.",
    ),
    (
        "pairing.pose_sigma_deg",
        "Standard deviation of the camera's orientation, degrees.",
    ),
    (
        "pairing.pose_sigma_px",
        "Standard deviation of the image of a point amid the virtual objects, pixels.",
    ),
    (
        "pairing.tracker_latency_ms",
        "Tracker latency that is used, ms; null without a tracker.",
    ),
    (
        "pairing.tracker_latency_measured_ms",
        "Tracker latency as measured while the rig runs, from the rotations of tracker and pictures in the last 20 s, ms; null before the first measurement.",
    ),
    (
        "pairing.tracker_latency_sigma_ms",
        "Standard deviation of the measured latency, ms; it grows while the rig is at rest.",
    ),
    (
        "pairing.tracker_latency_by",
        "Source of the measurement: `poses` (from markers) or `image motion`.",
    ),
    (
        "pairing.tracker_latency_ago_s",
        "Time since the last measurement, s.",
    ),
    (
        "pairing.tracker_latency_note",
        "Why the latency cannot be measured now, and what to do; null if it can.",
    ),
    (
        "registration.source",
        "Source of the newest pose: `tracker`, `markers`, `hybrid` (the tracker, corrected by markers), `fixed` (as the configuration states) or `none`.",
    ),
    (
        "registration.markers",
        "Number of markers used for the pose or its correction.",
    ),
    (
        "registration.reprojection_px",
        "RMS reprojection error of their corners, pixels; null without markers.",
    ),
    (
        "registration.ambiguous",
        "Whether the pose is one of two possible poses of a single marker that cannot be distinguished.",
    ),
    (
        "registration.corrected_ago_s",
        "Time since markers last corrected the tracker, s; null before the first correction.",
    ),
    (
        "registration.correction_mm",
        "Correction of the camera's position by markers, mm.",
    ),
    (
        "registration.correction_deg",
        "Correction of the camera's orientation by markers, degrees.",
    ),
    (
        "registration.rejected",
        "Poses from markers rejected as implausible since the start.",
    ),
    (
        "registration.settling_px",
        "Remaining part of a correction that is still being blended in, pixels.",
    ),
    (
        "registration.sigma_mm",
        "Standard deviation of the camera's position, over all axes, mm; null where unknown.",
    ),
    (
        "registration.sigma_deg",
        "Standard deviation of the camera's orientation, degrees.",
    ),
    (
        "registration.sigma_px",
        "Standard deviation of the image of a point amid the virtual objects, pixels.",
    ),
    (
        "registration.landmarks",
        "Number of points of real surfaces, followed in the picture, that steady the tracker's pose; 0 where it is the tracker's alone.",
    ),
    (
        "registration.landmarks_px",
        "Median distance of their images from where the pose shows them, pixels; null without them.",
    ),
    (
        "registration.sphere_support",
        "Share of the rim of a mirrored ball, whose place is known only roughly, that was found in the picture, 0 to 1; null if it was not searched for or is not in the picture.",
    ),
    (
        "registration.sphere_off_mm",
        "Distance of that ball from its stated place, mm; null while it is not found.",
    ),
    (
        "registration.display.ahead_ms",
        "Prediction time from the middle of the exposure until the picture is seen, ms; `display` is null without prediction to the display.",
    ),
    (
        "registration.display.moved_px",
        "Displacement of the virtual objects by the camera's motion in that time, pixels.",
    ),
    (
        "registration.display.sigma_mm",
        "Standard deviation of the predicted position of the camera, over all axes, mm; null before the first predictions could be verified.",
    ),
    (
        "registration.display.sigma_deg",
        "Standard deviation of the predicted orientation, degrees.",
    ),
    (
        "registration.display.sigma_px",
        "Standard deviation of the predicted image of a point amid the virtual objects, pixels.",
    ),
    (
        "lens.source",
        "Where the scene camera's lens comes from: `assumed` (or stated in rig.json), `calibrated` or `refined` (by views of the markers).",
    ),
    (
        "lens.field_of_view_deg",
        "Its field of view across the picture, degrees; null before the first picture.",
    ),
    (
        "lens.refining",
        "Whether it is being refined by views of the markers.",
    ),
    ("lens.views", "Views of the markers that were kept."),
    (
        "lens.reprojection_px",
        "RMS reprojection error of these views, pixels; null before the lens is refined.",
    ),
    (
        "lens.focal_sigma_percent",
        "Standard deviation of the focal length, per cent; null likewise.",
    ),
    (
        "lens.hint",
        "The most useful further view, in words; null if there is none.",
    ),
    (
        "levels.mean_code",
        "Mean of the codes of the scene camera's picture, 0 to 255; null before the first.",
    ),
    (
        "levels.clipped",
        "Share of its pixels with a clipped channel.",
    ),
    (
        "white_balance.method",
        "Active method: `chart`, `automatic`, `known-surface`, `grey-world`, `same-camera`, `same-model`, `configured` or `none`.",
    ),
    (
        "white_balance.gains[]",
        "Linear factors on the environment camera's red, green, blue.",
    ),
    (
        "white_balance.uncertainty[]",
        "Relative standard deviation of each factor; null where unknown.",
    ),
    (
        "white_balance.disagreement",
        "Maximum relative difference between the methods with an estimate, without grey world; null with fewer than two.",
    ),
    (
        "white_balance.frozen",
        "Why the estimate is frozen; null while it is updated.",
    ),
    (
        "white_balance.estimates[].method",
        "A method that has an estimate.",
    ),
    (
        "white_balance.estimates[].gains[]",
        "Its factors for red, green, blue.",
    ),
    (
        "white_balance.estimates[].uncertainty[]",
        "Relative standard deviation of each.",
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
    (
        "lighting.dome_lights",
        "Number of dome lights that cast shadows.",
    ),
    (
        "lighting.compact_lights",
        "Number of those that represent compact sources.",
    ),
    (
        "lighting.compact_sources",
        "Number of compact sources detected: sun, lamps, windows.",
    ),
    (
        "lighting.lamps[].direction[]",
        "Unit vector from the environment camera towards a compact source, world, +Z up; strongest first.",
    ),
    (
        "lighting.lamps[].position[]",
        "Where it is, world, metres; null if it counts as infinitely far.",
    ),
    (
        "lighting.lamps[].distance_m",
        "Its distance from the environment camera, metres; null if it counts as infinitely far.",
    ),
    (
        "lighting.lamps[].distance_sigma_m",
        "Standard deviation of that distance, metres; 0 where the place is stated, null likewise.",
    ),
    (
        "lighting.lamps[].clipped",
        "Share of its light in pixels that every exposure clips, 0 to 1: so much is an estimate from the depth of real shadows.",
    ),
    (
        "lighting.lamps[].unseen",
        "Whether the environment camera does not see it: it was found by real shadows in the scene camera's picture.",
    ),
    (
        "lighting.age_ms",
        "Age of the environment picture relative to the scene picture, ms; null before the first, and while a repeated recording begins in the light of its end.",
    ),
    (
        "lighting.environments_left_out",
        "Number of environment pictures since the start from which no light was estimated, because estimates took longer than their interval.",
    ),
    (
        "lighting.stale",
        "Why the lighting is stale; null if it is not.",
    ),
    (
        "lighting.clipped_fraction",
        "Share of the environment's solid angle that is clipped, 0 to 1; null where unknown.",
    ),
    (
        "lighting.exposures_disagree",
        "By how much the environment camera's exposures disagree about the same light under its tone curve: root mean square, relative; above 0.1 they contradict it, and a curve that they tell is used; null before two exposures have shown enough.",
    ),
    (
        "lighting.picture_difference",
        "By how much the contrasts of real shadows in the scene camera's picture differ from what the estimated light predicts: root mean square over the surfaces, relative; null before any was compared.",
    ),
    (
        "lighting.picture_difference_sigma",
        "Its standard error, relative; null before any was compared.",
    ),
    (
        "lighting.disagreeing[]",
        "Real surfaces whose shadows differ significantly, a line each.",
    ),
    (
        "lighting.dominant_direction[]",
        "Unit vector towards the dominant light, world, +Z up; null where unknown.",
    ),
    (
        "lighting.dominance",
        "Dominance of that light over the rest, as a share of all light: 1 for a single sun, 0 for two equal lamps or uniform light; null where unknown.",
    ),
    (
        "lighting.probe.coverage",
        "Share of all directions that the mirrored sphere in the scene camera's picture has shown so far, 0 to 1; `probe` is null with another source of light.",
    ),
    (
        "lighting.probe.coverage_above",
        "The same for directions above the horizon.",
    ),
    (
        "lighting.probe.map_age_s",
        "Mean time since the directions were last seen, s; null before the first.",
    ),
    (
        "lighting.probe.sphere_age_s",
        "Time since the sphere was last seen, s; it grows while the sphere, its marker or the pose is missing; null before it was seen.",
    ),
    (
        "lighting.probe.rim_shift_px",
        "Correction of the sphere's position by its detected rim, pixels; null if the rim was not searched for.",
    ),
    (
        "lighting.preview_revision",
        "Number of pictures published at `/environment.png`; 0 = none yet.",
    ),
    (
        "scene.file",
        "The scene file or model that is shown, which is read again when it or a file that it names changes; null for the session's own scene and for none.",
    ),
    ("scene.loads", "Number of changed scenes that were applied."),
    (
        "scene.reason",
        "Why the newest change was not applied; null if it was.",
    ),
    (
        "objects.requested",
        "Number of changes of virtual objects that were requested.",
    ),
    (
        "objects.shown",
        "Number of the change that the newest picture shows; nothing is under way when both are equal.",
    ),
    (
        "objects.list[].name",
        "A virtual object, in the order of the scene.",
    ),
    (
        "objects.list[].offset_m[]",
        "Its requested displacement from its place in the scene's files, world (+Z up), m.",
    ),
    (
        "objects.list[].turn_deg",
        "Its requested turn about the vertical, degrees.",
    ),
    ("objects.list[].scale", "Its requested scale."),
    (
        "planes.state",
        "Shadowing planes: `off` (another technique is active), `baking`, `ready` or `failed`.",
    ),
    (
        "planes.done",
        "Lights whose basis images are rendered; null unless baking.",
    ),
    (
        "planes.total",
        "Total number of lights to bake, 0 while the planes are being chosen; null unless baking.",
    ),
    ("planes.reason", "Why baking failed; null otherwise."),
    ("planes.planes", "Number of baked planes."),
    (
        "planes.planes_seen",
        "Number of planes that face the viewer in the newest picture.",
    ),
    (
        "planes.lights",
        "Number of lights: faces of the geodesic dome.",
    ),
    (
        "planes.lights_skipped",
        "Lights skipped in the newest picture, because they contribute less than `settings.planes_skip_below`.",
    ),
    (
        "planes.sources",
        "Number of compact sources (sun, lamps) that cast shadows from their true directions instead of the centre of a face.",
    ),
    (
        "planes.source_images",
        "Basis images rendered for them since the start; they are rendered again when the sources move.",
    ),
    ("planes.basis_images", "Number of non-black basis images."),
    (
        "planes.basis_images_dropped",
        "Number of black basis images, which are neither stored nor summed.",
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
        "Share of these that was saved, 0 to 1; null before the first picture.",
    ),
    (
        "planes.planes_recomputed",
        "Planes whose sums were recomputed or updated since the start.",
    ),
    (
        "planes.frames_without_work",
        "Pictures for which nothing had to be summed.",
    ),
    (
        "planes.bake_seconds",
        "Duration of baking, s; null before it is complete.",
    ),
    ("planes.bake_bytes", "Size of the bake, bytes."),
    (
        "planes.from_cache",
        "Whether the bake was read from the cache.",
    ),
    (
        "exposure.ev",
        "Exposure of the newest picture, stops relative to the camera's; 0: the camera's picture is unchanged.",
    ),
    (
        "exposure.target_ev",
        "Target of the automatic exposure, stops.",
    ),
    (
        "exposure.camera",
        "Mean linear brightness of the camera's picture, 0 to 1; null where it is not measured.",
    ),
    (
        "exposure.added",
        "Mean linear brightness added by virtual lights; null likewise.",
    ),
    (
        "exposure.removed",
        "Mean linear brightness removed by virtual shadows; null likewise.",
    ),
    (
        "playback.closed",
        "Why the playback cannot be controlled; null if it can.",
    ),
    ("playback.paused", "Whether the picture stands still."),
    (
        "playback.repeat",
        "Whether the recording starts again at its end.",
    ),
    (
        "playback.jumps_requested",
        "Number of jumps to another position that were requested.",
    ),
    (
        "playback.jumps",
        "Number of the jump after which the newest picture was composed; a jump is done when both are equal.",
    ),
    (
        "playback.duration_s",
        "Length of the recording, s; null when live.",
    ),
    (
        "recording.state",
        "`unavailable` (a recording plays), `idle`, `recording`, `finished` or `failed`.",
    ),
    (
        "recording.description",
        "That state in words, with the reason where there is one.",
    ),
    (
        "recording.file",
        "The newest recording; null before the first.",
    ),
    ("recording.bytes", "Its size, bytes."),
    ("recording.seconds", "Its length so far, s."),
    (
        "recording.seconds_left",
        "Time until it ends by itself, from the free space or the requested length, s; null where unknown.",
    ),
    (
        "recording.free_bytes",
        "Free space on its disk, bytes; null where unknown.",
    ),
    (
        "recording.events",
        "Messages recorded: pictures, readings, notes.",
    ),
    (
        "recording.dropped",
        "Messages not recorded, because the disk was too slow or they could not be encoded.",
    ),
    (
        "recording.composite",
        "Whether the composited pictures are recorded, too; before a recording as configured.",
    ),
    ("recording.composites", "Composited pictures recorded."),
    (
        "recording.composites_dropped",
        "Composited pictures not recorded, because encoder or disk were too slow.",
    ),
    (
        "recording.bytes_per_second",
        "Mean data rate, bytes per second; null in the first second.",
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
    ("devices[].description", "That state in words."),
    (
        "devices[].reason",
        "The driver's error; null if there is none.",
    ),
    ("devices[].per_second", "Frames or records per second."),
    ("devices[].received", "Frames or records since the start."),
    (
        "devices[].dropped",
        "Frames or records lost: gaps in the counter, damaged, or replaced by newer ones; of a tracker also those that its rate shows to be missing, an estimate.",
    ),
    (
        "devices[].last_age_ms",
        "Age of the newest frame or record, ms; null before the first.",
    ),
    (
        "devices[].identity",
        "Identity that persists when the device is plugged in again; null before it was open, and in a replay.",
    ),
    (
        "devices[].mode",
        "Size, format and rate of a camera, protocol of a tracker; null before it was open.",
    ),
    ("devices[].attempts", "Number of attempts to open it."),
    (
        "devices[].losses",
        "Number of times that the open device was lost.",
    ),
    (
        "devices[].retry_in_ms",
        "Time until the next attempt, ms; null while it is open.",
    ),
    (
        "devices[].last_error",
        "The last error, even if it is resolved; null if there was none.",
    ),
    (
        "devices[].problems[].text",
        "What was wrong with single frames or records; kinds that have not occurred are left out.",
    ),
    (
        "devices[].problems[].count",
        "Number of them since the start; of bytes where it says so.",
    ),
    ("devices[].notes[]", "Notes for the user."),
    (
        "devices[].controls[].name",
        "A control that the configuration locks.",
    ),
    (
        "devices[].controls[].requested",
        "The requested value, in the device's unit.",
    ),
    (
        "devices[].controls[].active",
        "The value that the device reports; null if none.",
    ),
    (
        "devices[].controls[].status",
        "State of the control: a comparison of the two values, in words.",
    ),
    (
        "adapter.name",
        "Name of the graphics adapter, from its driver.",
    ),
    ("adapter.backend", "`Vulkan`, `Metal`, …"),
    ("adapter.kind", "`DiscreteGpu`, `IntegratedGpu`, `Cpu`, …"),
    (
        "adapter.losses",
        "Number of times that the graphics device was lost and opened again.",
    ),
    (
        "adapter.recovery_seconds",
        "Time from the last loss to the next picture, seconds; `null` without a loss.",
    ),
    (
        "quality",
        "Quality of the pictures, `[picture] quality`: `live` or `best`.",
    ),
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
        "Technique of the newest picture: `image-based-shadowing` (dome lights), `shadowing-planes` or `image-based-lighting` (no shadows). `POST /settings` takes any subset of `settings.*`.",
    ),
    (
        "settings.light_count",
        "Budget of dome lights: 8, 24, 48, 64, 96 or 384.",
    ),
    (
        "settings.light_placement",
        "Placement of the dome lights: `adaptive` (compact sources get lights at their true directions) or `grid` (Supan 2006).",
    ),
    (
        "settings.shadow_mode",
        "How shadows change the camera's picture: `ratio` or `subtract` (equation 4 of Supan 2006).",
    ),
    (
        "settings.shadow_strength",
        "Strength of shadows: 0 (none) to 1 (as measured).",
    ),
    (
        "settings.virtual_object_visible",
        "Whether virtual objects are composited; if not, the output is the camera's picture.",
    ),
    (
        "settings.reflections",
        "How the environment is filtered for reflections on virtual objects: `prefiltered` (over each material's lobe) or `box` (DiVerdi et al. 2003).",
    ),
    (
        "settings.indirect_light",
        "Whether virtual objects and real surfaces reflect light onto each other: a red box tints the table.",
    ),
    (
        "settings.lamp_response",
        "How real surfaces respond to virtual lamps: `intrinsic` (lamps multiply the picture) or `paper` (a blend of N·L and the relief in the picture is added; DiVerdi and Höllerer 2004).",
    ),
    (
        "settings.planes_skip_below",
        "With shadowing planes and 40 lights: lights that contribute less than this share of all light are skipped, 0 to 1.",
    ),
    (
        "settings.planes_recompute_above",
        "With shadowing planes: a light is summed again when it changes by more than this share of all light, 0 to 1.",
    ),
    (
        "settings.planes_shading",
        "Shading of virtual objects with shadowing planes: `irradiance`, `lights` (all lights of the dome) or `six` (six directional lights, Kakuta 2004).",
    ),
    (
        "settings.exposure_mode",
        "Exposure: `off` (the camera's picture is unchanged), `manual` or `auto` (from the light that virtual lamps add).",
    ),
    (
        "settings.exposure_ev",
        "With `manual`: stops relative to the camera's exposure, -8 to 3.",
    ),
    (
        "settings.exposure_highlights",
        "Clipped areas in a shorter exposure: `estimated` (radiance from their surroundings) or `paper` (each pixel's factor increases with the mean around it; DiVerdi and Höllerer 2004).",
    ),
    (
        "settings.exposure_min_ev",
        "With `auto`: minimum, stops, -8 to 0.",
    ),
    (
        "settings.exposure_max_ev",
        "With `auto`: maximum, stops, 0 to 3.",
    ),
    (
        "settings.exposure_key",
        "With `auto`: a picture whose linear mean is below this counts as dark, 0 to 1.",
    ),
    (
        "settings.exposure_adaptation_s",
        "With `auto`: time constant (63 % of a step), s, 0 to 60.",
    ),
    (
        "settings_requested",
        "As `settings`: the values requested last. A value that differs from `settings` takes effect with the next picture.",
    ),
    (
        "settings_configured",
        "As `settings`: the values at the start, by configuration and command line.",
    ),
    (
        "stream.viewers",
        "Number of viewers of `/stream.mjpeg` and `/compare.mjpeg`.",
    ),
    ("stream.encoded", "Pictures encoded for them."),
    (
        "guide.ball_mm",
        "Diameter of the ball of a webcam's rig, as stated, mm; `guide` is null for other rigs.",
    ),
    ("guide.tags", "Number of tags on its sheet."),
    (
        "guide.steps[].name",
        "A step of its set-up: `print`, `sheet`, `lens`, `ball`, `light` or `object`.",
    ),
    ("guide.steps[].title", "Its title."),
    (
        "guide.steps[].state",
        "Its state: `waiting` (needs an earlier step), `open`, `failed` or `done`.",
    ),
    ("guide.steps[].text", "What is known, in words."),
    (
        "guide.steps[].todo",
        "What to do, in words; empty if nothing.",
    ),
    ("warnings[].text", "A warning: what, where, what to do."),
    ("warnings[].count", "Number of occurrences."),
    (
        "log.newest",
        "Number of the newest entry of `/log`; 0 without entries.",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Snapshot;
    use crate::objects::ObjectPlace;
    use crate::snapshot::{
        Control, Device, LampStatus, Problem, WhiteBalanceEstimate, WhiteBalanceMethod, WhiteMatch,
    };
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
            problems: vec![Problem {
                text: "a",
                count: 1,
            }],
            notes: vec!["a".to_owned()],
            controls: vec![Control::default()],
            ..Device::new("a", DeviceKind::Tracker)
        }];
        s.warn("a");
        s.objects.list = vec![ObjectPlace::default()];
        s.lighting.probe = Some(crate::ProbeStatus::default());
        s.registration.display = Some(crate::DisplayStatus::default());
        s.guide = Some(crate::GuideStatus {
            steps: vec![crate::guide::GuideStep::default()],
            ..crate::GuideStatus::default()
        });
        s.lighting.dominant_direction = Some([0.0, 0.0, 1.0]);
        s.lighting.disagreeing = vec!["ground".to_owned()];
        s.lighting.lamps = vec![LampStatus {
            position: Some([0.0; 3]),
            ..LampStatus::default()
        }];
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

    /// Objects whose fields are described with `settings`.
    const AS_SETTINGS: [&str; 2] = ["settings_requested", "settings_configured"];

    fn paths(value: &Value, path: &str, found: &mut BTreeSet<String>) {
        match value {
            _ if AS_SETTINGS.contains(&path) => {
                found.insert(path.to_owned());
            }
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
    fn documents_exactly_the_fields_of_the_status() {
        let mut found = BTreeSet::new();
        paths(&serde_json::to_value(full()).unwrap(), "", &mut found);
        let documented: BTreeSet<String> =
            STATUS_FIELDS.iter().map(|(p, _)| (*p).to_owned()).collect();
        assert_eq!(found, documented);
        assert_eq!(documented.len(), STATUS_FIELDS.len(), "documented twice");
    }

    /// `UPDATE_DOCS=1 cargo test -p penumbra-status status_page` rewrites the table.
    #[test]
    fn status_page_has_the_table() {
        const PAGE: &str = "docs/src/status-api.md";
        let page = std::fs::read_to_string(penumbra_test_data::repository(PAGE)).unwrap();
        let (before, _) = page.split_once("| Field |").expect("the head of the table");
        let mut expected = format!("{before}| Field | Meaning |\n|---|---|\n");
        for (field, meaning) in STATUS_FIELDS {
            let _ = writeln!(expected, "| `{field}` | {meaning} |");
        }
        penumbra_test_data::check_page(PAGE, &expected);
    }
}
