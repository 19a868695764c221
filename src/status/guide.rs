//! The steps in which a webcam's rig is set up: what is done, what is wrong, and what to do next.
//! Each follows from the rest of the status, never from a timer.

use super::registration::RegistrationSource;
use super::snapshot::{Device, DeviceState, LensSource, Snapshot};
use penumbra_interface::DeviceKind;
use serde::Serialize;

/// Mean code below which a picture is too dark for tags and light, and above which it is too bright.
const DARK: f64 = 35.0;
const BRIGHT: f64 = 225.0;
/// Minimum number of tags for a good pose.
const ENOUGH_TAGS: u32 = 3;
/// Directions above the horizon that the ball must have shown for the light to count as measured.
const ENOUGH_LIGHT: f64 = 0.5;

/// The set-up of a webcam's rig.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GuideStatus {
    /// Diameter of the ball, as stated, millimetres.
    pub ball_mm: f64,
    /// Number of tags on the sheet.
    pub tags: u32,
    /// The steps, in order. Filled in when the snapshot is read.
    pub steps: Vec<GuideStep>,
}

/// A step of the set-up.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GuideStep {
    /// Name: `print`, `sheet`, `lens`, `ball`, `light` or `object`.
    pub name: &'static str,
    /// Title.
    pub title: &'static str,
    /// Its state.
    pub state: StepState,
    /// What is known.
    pub text: String,
    /// What to do; empty if nothing.
    pub todo: String,
}

/// State of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StepState {
    /// Needs an earlier step.
    #[default]
    Waiting,
    /// To be done.
    Open,
    /// Something is wrong.
    Failed,
    /// Done.
    Done,
}

/// State, what is known, and what to do.
type Finding = (StepState, String, String);

fn finding(state: StepState, text: impl Into<String>, todo: impl Into<String>) -> Finding {
    (state, text.into(), todo.into())
}

/// Returns the steps of the set-up `guide` in the state `s`.
pub(crate) fn steps(guide: &GuideStatus, s: &Snapshot) -> Vec<GuideStep> {
    let sees_sheet = s.registration.source != RegistrationSource::None;
    let steps = [
        ("print", "Print the sheet", print(s)),
        ("sheet", "Show it to the camera", sheet(guide, s)),
        ("lens", "Lens", lens(s, sees_sheet)),
        ("ball", "Ball", ball(guide, s, sees_sheet)),
        ("light", "Light", light(s)),
        ("object", "Virtual object", object(s, sees_sheet)),
    ];
    let step = |(name, title, (state, text, todo))| GuideStep {
        name,
        title,
        state,
        text,
        todo,
    };
    steps.into_iter().map(step).collect()
}

fn camera(s: &Snapshot) -> Option<&Device> {
    s.devices.iter().find(|d| d.kind == DeviceKind::SceneCamera)
}

fn print(s: &Snapshot) -> Finding {
    if s.registration.markers > 0 || s.lighting.probe.is_some() {
        return finding(StepState::Done, "A sheet is in front of the camera.", "");
    }
    finding(
        StepState::Open,
        "",
        "Print it at 100 %, measure its line of 100 mm, and tape the sheet flat onto a table.",
    )
}

fn sheet(guide: &GuideStatus, s: &Snapshot) -> Finding {
    if let Some(trouble) = camera_trouble(s) {
        return trouble;
    }
    let n = s.registration.markers;
    let seen = format!("{n} of {} tags seen.", guide.tags);
    if n >= ENOUGH_TAGS {
        return finding(StepState::Done, seen, "");
    }
    match s.levels.mean_code {
        Some(mean) if mean < DARK => finding(
            StepState::Failed,
            format!("The picture is too dark: {mean:.0} of 255 on average. {seen}"),
            "Switch on a light, or give the camera a longer exposure.",
        ),
        Some(mean) if mean > BRIGHT => finding(
            StepState::Failed,
            format!("The picture is too bright: {mean:.0} of 255 on average. {seen}"),
            "Give the camera a shorter exposure, or turn it away from the window.",
        ),
        _ if n == 0 => finding(
            StepState::Open,
            "No tag is seen.",
            "Point the camera at the sheet from 40 to 80 cm, so that all of it is in the picture and sharp.",
        ),
        _ => finding(
            StepState::Open,
            seen,
            "Show more of the sheet; cover no tags and keep it flat.",
        ),
    }
}

/// Returns what is wrong with the camera, if it delivers no pictures.
fn camera_trouble(s: &Snapshot) -> Option<Finding> {
    let Some(camera) = camera(s) else {
        return Some(finding(StepState::Open, "The rig is starting.", ""));
    };
    match camera.state {
        DeviceState::Streaming | DeviceState::Ended | DeviceState::Absent => None,
        DeviceState::Opening if camera.reason.is_none() => {
            Some(finding(StepState::Open, "The camera is being opened.", ""))
        }
        _ => {
            let why = camera.reason.as_deref().unwrap_or(camera.description);
            Some(finding(
                StepState::Failed,
                format!("The camera {} gives no pictures: {why}", camera.name),
                "Close other programs that use the camera, plug it in again, or start with another \
                 one: `make demo-webcam CAMERA=NAME`; `penumbra devices` lists them.",
            ))
        }
    }
}

fn lens(s: &Snapshot, sees_sheet: bool) -> Finding {
    let lens = &s.lens;
    let across = lens
        .field_of_view_deg
        .map_or_else(String::new, |degrees| format!("{degrees:.1}° across"));
    let error = lens
        .focal_sigma_percent
        .map_or_else(String::new, |percent| format!(", ± {percent:.1} %"));
    match lens.source {
        LensSource::Calibrated => finding(StepState::Done, format!("Calibrated: {across}."), ""),
        LensSource::Refined => finding(
            StepState::Done,
            format!("Measured from {} views: {across}{error}.", lens.views),
            "",
        ),
        LensSource::Assumed if lens.field_of_view_deg.is_none() => {
            finding(StepState::Waiting, "", "")
        }
        LensSource::Assumed if !lens.refining => {
            finding(StepState::Done, format!("Assumed: {across}."), "")
        }
        LensSource::Assumed if !sees_sheet => {
            finding(StepState::Waiting, format!("Assumed: {across}."), "")
        }
        LensSource::Assumed => finding(
            StepState::Open,
            format!("Assumed: {across}. {} views so far.", lens.views),
            format!(
                "Move the camera slowly around the sheet: near and far, from all sides, so that the \
                 sheet gets into every corner of the picture. Hold it still now and then.{}",
                lens.hint
                    .as_ref()
                    .map_or_else(String::new, |hint| format!(" Next: {hint}."))
            ),
        ),
    }
}

fn ball(guide: &GuideStatus, s: &Snapshot, sees_sheet: bool) -> Finding {
    let r = &s.registration;
    let mm = guide.ball_mm;
    if !sees_sheet {
        return finding(StepState::Waiting, "", "");
    }
    let rim = |share: f64| format!("{:.0} % of its rim", 100.0 * share);
    match (r.sphere_support, r.sphere_off_mm) {
        (Some(support), Some(off)) => finding(
            StepState::Done,
            format!(
                "Found: {} is seen, {off:.0} mm from the middle of its ring.",
                rim(support)
            ),
            "",
        ),
        (None, Some(_)) => finding(
            StepState::Done,
            "Found before; it is not in the picture now.",
            "",
        ),
        (Some(support), None) => finding(
            StepState::Failed,
            format!("Not found: no more than {} is seen.", rim(support)),
            format!(
                "Put a shiny ball of {mm:.0} mm into the middle of its ring. A ball of another size \
                 needs its diameter: `make demo-webcam BALL_MM=80`."
            ),
        ),
        (None, None) => finding(
            StepState::Open,
            "Not found.",
            format!(
                "Put a shiny ball of {mm:.0} mm into the middle of its ring, and show it to the camera."
            ),
        ),
    }
}

fn light(s: &Snapshot) -> Finding {
    let l = &s.lighting;
    let Some(probe) = l.probe.as_ref().filter(|p| p.coverage > 0.0) else {
        return finding(StepState::Waiting, "", "");
    };
    let lamps = match l.compact_sources {
        0 => "no lamp".to_owned(),
        1 => "1 lamp or window".to_owned(),
        n => format!("{n} lamps or windows"),
    };
    let text = format!(
        "{} lights, {lamps}; {:.0} % of the directions above the table seen.",
        l.dome_lights,
        100.0 * probe.coverage_above
    );
    if probe.coverage_above < ENOUGH_LIGHT {
        let todo = "Move the camera around the ball, so that it shows more of the room.";
        return finding(StepState::Open, text, todo);
    }
    finding(StepState::Done, text, "")
}

fn object(s: &Snapshot, sees_sheet: bool) -> Finding {
    let has_moved = |o: &super::objects::ObjectPlace| {
        o.offset_m != [0.0; 3] || o.turn_deg != 0.0 || (o.scale - 1.0).abs() > 1e-9
    };
    if !sees_sheet || s.lighting.dome_lights == 0 || s.objects.list.is_empty() {
        return finding(StepState::Waiting, "", "");
    }
    if s.objects.list.iter().any(has_moved) {
        return finding(StepState::Done, "You have moved it.", "");
    }
    finding(
        StepState::Open,
        "It stands on the sheet.",
        "Press Move objects, then drag it with the pointer.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ProbeStatus;
    use crate::snapshot::LensStatus;

    fn snapshot() -> Snapshot {
        let mut s = Snapshot::default();
        let mut camera = Device::new("/dev/video0", DeviceKind::SceneCamera);
        camera.enter(DeviceState::Streaming, None);
        s.devices = vec![camera];
        s.levels.mean_code = Some(110.0);
        s
    }

    /// The step of this name, of a sheet with ten tags and a ball of 70 mm.
    fn step(s: &Snapshot, name: &str) -> GuideStep {
        let guide = GuideStatus {
            ball_mm: 70.0,
            tags: 10,
            steps: Vec::new(),
        };
        let mut found = steps(&guide, s)
            .into_iter()
            .filter(|step| step.name == name);
        found.next().expect("the step")
    }

    #[test]
    fn steps_follow_from_the_status_in_their_order() {
        let mut s = snapshot();
        assert_eq!(step(&s, "sheet").state, StepState::Open);
        assert!(step(&s, "sheet").text.contains("No tag"));
        for name in ["ball", "light", "object"] {
            assert_eq!(step(&s, name).state, StepState::Waiting, "{name}");
        }
        s.registration.source = RegistrationSource::Markers;
        s.registration.markers = 2;
        assert_eq!(step(&s, "sheet").state, StepState::Open);
        s.registration.markers = 8;
        assert_eq!(step(&s, "sheet").text, "8 of 10 tags seen.");
        assert_eq!(step(&s, "print").state, StepState::Done);
        assert_eq!(step(&s, "ball").state, StepState::Open);
        s.registration.sphere_support = Some(0.2);
        assert_eq!(step(&s, "ball").state, StepState::Failed);
        assert!(step(&s, "ball").todo.contains("BALL_MM"));
        s.registration.sphere_support = Some(0.6);
        s.registration.sphere_off_mm = Some(2.0);
        assert_eq!(step(&s, "ball").state, StepState::Done);
        s.lighting.dome_lights = 64;
        let probe = |coverage_above| ProbeStatus {
            coverage: 0.3,
            coverage_above,
            ..ProbeStatus::default()
        };
        s.lighting.probe = Some(probe(0.2));
        assert_eq!(step(&s, "light").state, StepState::Open);
        s.lighting.probe = Some(probe(0.9));
        assert_eq!(step(&s, "light").state, StepState::Done);
        s.objects.list = vec![crate::objects::ObjectPlace {
            scale: 1.0,
            ..crate::objects::ObjectPlace::default()
        }];
        assert_eq!(step(&s, "object").state, StepState::Open);
        s.objects.list[0].offset_m[0] = 0.1;
        assert_eq!(step(&s, "object").state, StepState::Done);
    }

    #[test]
    fn trouble_is_named_with_what_to_do() {
        let mut s = snapshot();
        s.levels.mean_code = Some(8.0);
        assert!(step(&s, "sheet").text.contains("too dark"));
        s.levels.mean_code = Some(250.0);
        assert!(step(&s, "sheet").text.contains("too bright"));
        s.devices[0].enter(DeviceState::Retrying, Some("device busy"));
        let sheet = step(&s, "sheet");
        assert_eq!(sheet.state, StepState::Failed);
        assert!(sheet.text.contains("/dev/video0") && sheet.text.contains("busy"));
        assert!(sheet.todo.contains("CAMERA="));
    }

    #[test]
    fn lens_is_open_until_it_is_refined() {
        let mut s = snapshot();
        s.registration.source = RegistrationSource::Markers;
        s.lens = LensStatus {
            refining: true,
            field_of_view_deg: Some(65.0),
            hint: Some("show the sheet in the top left corner".to_owned()),
            ..LensStatus::default()
        };
        let lens = step(&s, "lens");
        assert_eq!(lens.state, StepState::Open);
        assert!(lens.todo.contains("top left"), "{lens:?}");
        s.lens.source = LensSource::Refined;
        assert_eq!(step(&s, "lens").state, StepState::Done);
        s.lens = LensStatus::default();
        let state = |s: &Snapshot| step(s, "lens").state;
        assert_eq!(state(&s), StepState::Waiting, "no picture yet");
        s.lens.field_of_view_deg = Some(60.0);
        assert_eq!(state(&s), StepState::Done, "nothing refines it");
    }
}
