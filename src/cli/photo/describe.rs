//! What `penumbra photo` tells of photographs.

use penumbra_photo::{
    ASSUMED_FIELD_OF_VIEW_DEGREES, Analysis, BallPicture, ExposuresFrom, GroundFrom, Placement,
    RaisedLamp, ShadowCheck,
};

/// Ratio of the depths of two shadows that agree.
const AGREES: f64 = 0.6;

/// Returns what was found, a line each.
pub fn describe(analysis: &Analysis) -> Vec<String> {
    let circle = analysis.ball.circle;
    let distance = analysis.ball.centre(analysis.ball_radius).length();
    let believed = if analysis.ball.is_fitted {
        ""
    } else {
        ", believed all the same"
    };
    let mut lines = vec![format!(
        "ball: centre {:.0}, {:.0}, radius {:.0} pixels; {:.0} % of its outline seen{believed}; {distance:.2} m \
         from the camera",
        circle.centre.x,
        circle.centre.y,
        circle.radius,
        100.0 * analysis.ball.support,
    )];
    let angle = 2.0
        * (f64::from(analysis.camera.width.max(analysis.camera.height))
            / (2.0 * analysis.camera.focal.x))
            .atan()
            .to_degrees();
    lines.push(match analysis.is_lens_assumed {
        true => format!(
            "lens: EXIF tells none, or an impossible one; {ASSUMED_FIELD_OF_VIEW_DEGREES}° along the longer side assumed \
             (--fov)"
        ),
        false => format!("lens: {angle:.1}° along the longer side"),
    });
    lines.push(describe_ground(&analysis.placement));
    lines.push(describe_exposures(analysis));
    let turned = |ball: &BallPicture| {
        Some(format!(
            "{}: the camera was turned by {:.1}° against the picture without the ball, so shadows are compared \
             less well; put it on something that stands still",
            ball.photograph.path.display(),
            ball.turned_degrees?.abs()
        ))
    };
    lines.extend(analysis.balls.iter().filter_map(turned));
    let clipped = analysis.clipped();
    if clipped > 0 {
        lines.push(describe_clipped(analysis, clipped));
    }
    let profiles = std::iter::once(&analysis.empty)
        .chain(analysis.balls.iter().map(|b| &b.photograph))
        .find_map(|p| p.profile.as_ref());
    lines.extend(profiles.map(|name| format!("colours: converted from {name} to sRGB")));
    lines
}

fn describe_ground(placement: &Placement) -> String {
    let tilt = placement.tilt_degrees;
    match placement.ground {
        GroundFrom::Tag => format!("ground: from the tag; the camera looks down by {tilt:.1}°"),
        GroundFrom::Rectangle { sigma_degrees } => format!(
            "ground: from the rectangle; the camera looks down by {tilt:.1}° and is rolled by {:.1}° \
             (± {sigma_degrees:.1}° if the corners are wrong by a 2000th of the picture)",
            placement.roll_degrees
        ),
        GroundFrom::Stated => format!("ground: the camera looks down by {tilt:.1}°, as stated"),
        GroundFrom::Shadow { sigma_degrees } => format!(
            "ground: from where the ball's shadow falls; the camera looks down by {tilt:.0}° ± {sigma_degrees:.0}°"
        ),
        GroundFrom::Assumed => format!(
            "ground: the camera is assumed to look down by {tilt:.0}°; state it with --tilt, or point at a \
             rectangle on the ground (--ground, --browser), or put a printed tag there (--tag)"
        ),
    }
}

fn describe_clipped(analysis: &Analysis, clipped: usize) -> String {
    let most = |lamp: &&RaisedLamp| lamp.factor.max_element();
    let brightest = analysis
        .raised
        .iter()
        .max_by(|a, b| most(a).total_cmp(&most(b)));
    let what = match brightest.filter(|lamp| most(lamp) > 1.0) {
        Some(lamp) => format!(
            "by the ball's shadow they are up to {:.1} ± {:.1} times as bright; a darker exposure would tell it \
             better",
            most(&lamp),
            lamp.sigma
        ),
        None => "shadows may come out too faint: add a darker exposure".to_owned(),
    };
    format!("lamps: {clipped} pixels of the ball are white in its darkest picture; {what}")
}

fn describe_exposures(analysis: &Analysis) -> String {
    let balls = analysis.by_exposure();
    let stops: Vec<String> = balls.iter().map(|b| format!("{:+.1}", b.ev)).collect();
    let from = match analysis.exposures_from {
        ExposuresFrom::Stated => "",
        ExposuresFrom::Pictures => {
            ", estimated from the pictures, since EXIF tells none (--exposures)"
        }
        ExposuresFrom::Contradicted => {
            ", estimated from the pictures, which contradict EXIF: were they edited? (--exposures)"
        }
    };
    let tone = match (&analysis.tone.refused, analysis.tone.exposures) {
        (Some(reason), _) => format!("tone curve: sRGB's, for {reason}"),
        (None, 0) => {
            "tone curve: sRGB's; two or more exposures of the ball would tell it".to_owned()
        }
        (None, n) => format!(
            "tone curve: measured from {n} exposures, {:.0} % from sRGB's",
            100.0 * analysis.tone.from_srgb
        ),
    };
    format!(
        "exposures of the ball: {} stops from the empty picture's{from}; {tone}",
        stops.join(", ")
    )
}

/// Returns the line of the shadow check.
pub fn describe_check(check: Option<ShadowCheck>) -> String {
    match check {
        Some(check) => format!(
            "check: the ball put back throws a shadow of {:.1} %, in the photograph it is {:.1} % \
             (they differ by {:.1} % rms){}",
            100.0 * check.composite,
            100.0 * check.real,
            100.0 * check.difference,
            advice(&check)
        ),
        None => "check: the ball throws no shadow that can be measured".to_owned(),
    }
}

/// What to do where the shadows disagree.
fn advice(check: &ShadowCheck) -> &'static str {
    if check.composite < AGREES * check.real {
        "; the light is wrong, shadows are too faint: the ball is dirty or not mirrored, lamps are white in \
         its darkest picture, or the exposures are not as stated (--exposures)"
    } else if check.real < AGREES * check.composite {
        "; the light is wrong, shadows are too deep: the exposures are not as stated (--exposures), or the \
         ground does not lie as stated (--tilt, --ground, --tag)"
    } else {
        ""
    }
}
