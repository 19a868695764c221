//! `penumbra photo`.

use super::files;
use super::progress::Watch;
use anyhow::{Context, anyhow, bail};
use clap::Args;
use glam::DVec2;
use penumbra_compositor::Gpu;
use penumbra_config::{Config, Quality, ReplaySpeed};
use penumbra_fiducials::Family;
use penumbra_lighting::Circle;
use penumbra_photo::{
    ASSUMED_FIELD_OF_VIEW_DEGREES, ASSUMED_REFLECTANCE, Analysis, ExposuresFrom, GroundFrom,
    PhotoOptions, Photograph, Placement, PrintedTag, ShadowCheck,
};
use penumbra_picture::Picture;
use penumbra_rig::{RunOptions, Runner, Source, live_settings};
use penumbra_scene::SceneChoice;
use penumbra_session::Session;
use penumbra_status::SharedStatus;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What is shown without `--scene`: a golden ring, a cone and a small ball.
const SCENE: &str = include_str!("../../config/scene.toml");
/// Ratio of the depths of two shadows that agree.
const AGREES: f64 = 0.6;
/// Maximum number of pictures of the ball.
const MAX_BALLS: usize = 16;

#[derive(Debug, Args)]
pub struct PhotoArgs {
    /// The place without the ball (JPEG, PNG)
    #[arg(value_name = "EMPTY.jpg")]
    empty: PathBuf,
    /// The same with a mirrored ball, in one or more exposures
    #[arg(value_name = "BALL.jpg", required = true, num_args = 1..=MAX_BALLS)]
    balls: Vec<PathBuf>,
    /// Diameter of the ball, e.g. 80mm or 8cm
    #[arg(long, value_name = "LENGTH", value_parser = diameter)]
    ball_diameter: f64,
    /// The composite (PNG)
    #[arg(long, short, value_name = "OUT.png")]
    out: PathBuf,
    /// Virtual objects; their origin is where the ball touches the ground, +Y points away from the camera
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// How far the camera looked down, degrees; 30 is assumed
    #[arg(long, value_name = "DEGREES", value_parser = tilt)]
    tilt: Option<f64>,
    /// A printed tag that lies on the ground, and the edge of its black border
    #[arg(long, value_name = "FAMILY:LENGTH", value_parser = tag, conflicts_with = "tilt")]
    tag: Option<PrintedTag>,
    /// The corners of any rectangle that lies on the ground, a sheet of paper or a tile, in order round it:
    /// pixels of the same picture as those of --ball
    #[arg(
        long,
        value_name = "X,Y,X,Y,X,Y,X,Y",
        value_parser = corners,
        allow_hyphen_values = true,
        conflicts_with_all = ["tilt", "tag"]
    )]
    ground: Option<Corners>,
    /// Field of view along the longer side, degrees, in place of EXIF's
    #[arg(long, value_name = "DEGREES", value_parser = field_of_view)]
    fov: Option<f64>,
    /// The ball's circle, pixels, if it is not found: in the picture with the ball whose exposure is the
    /// most similar to the empty one's
    #[arg(long, value_name = "X,Y,RADIUS", value_parser = circle)]
    ball: Option<Circle>,
    /// Share of the light that the ball reflects: 0.85 silvered glass, 0.6 steel
    #[arg(long, value_name = "SHARE", default_value_t = ASSUMED_REFLECTANCE, value_parser = reflectance)]
    reflectance: f32,
    /// Exposures of all pictures in stops, in place of EXIF's, e.g. 0,0,-2,-4
    #[arg(
        long,
        value_name = "STOPS",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    exposures: Option<Vec<f64>>,
    /// Maximum side of the composite, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1920, value_parser = clap::value_parser!(u32).range(64..=8192))]
    size: u32,
    /// Write the picture of the ball with what was found: its outline, the ground
    #[arg(long, value_name = "FILE.png")]
    found: Option<PathBuf>,
    /// Keep the session, to replay it with `penumbra replay --loop`
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
}

/// Analyses the photographs, composes the picture, and checks it with the ball put back.
pub fn run(args: &PhotoArgs) -> anyhow::Result<ExitCode> {
    let outputs = [Some(&args.out), args.found.as_ref(), args.session.as_ref()];
    for path in outputs.into_iter().flatten() {
        files::claim(path, args.force)?;
    }
    let analysis = analyse(args)?;
    describe(&analysis).into_iter().for_each(super::say);
    if let Some(path) = &args.found {
        files::write(path, &penumbra_photo::png(&analysis.drawn())?, args.force)?;
    }
    let folder = tempfile::tempdir().context("no temporary folder can be created")?;
    let session = folder.path().join("photographs.mcap");
    analysis.write_session(&session, args.size)?;
    if let Some(path) = &args.session {
        let bytes = std::fs::read(&session)
            .map_err(|e| anyhow!("{}: cannot be read ({e})", session.display()))?;
        files::write(path, &bytes, args.force)?;
    }
    let scene = match &args.scene {
        Some(scene) => scene.clone(),
        None => written(folder.path(), "scene.toml", SCENE)?,
    };
    let picture = compose(&session, &scene, &folder.path().join("picture"))?;
    files::write(&args.out, &picture, args.force)?;
    let ball = written(folder.path(), "ball.toml", &ball_scene(&analysis))?;
    let with_ball = compose(&session, &ball, &folder.path().join("ball"))?;
    let check = analysis.check(&Picture::from_file_bytes(&with_ball)?);
    super::say(describe_check(check));
    Ok(ExitCode::SUCCESS)
}

fn analyse(args: &PhotoArgs) -> anyhow::Result<Analysis> {
    let (count, stated) = (args.balls.len() + 1, args.exposures.as_deref());
    if let Some(stated) = stated.filter(|stated| stated.len() != count) {
        bail!(
            "--exposures: {} values for {count} pictures; state one in stops for each, the picture \
             without the ball first",
            stated.len()
        );
    }
    if let Some(ev) =
        stated.and_then(|stated| stated.iter().find(|ev| ev.abs() > 30.0 || ev.is_nan()))
    {
        bail!("--exposures: {ev} is no exposure in stops; expected -30 to 30");
    }
    let empty = Photograph::read(&args.empty)?;
    let balls = args.balls.iter().map(|path| Photograph::read(path));
    let balls = balls.collect::<Result<Vec<_>, _>>()?;
    let options = PhotoOptions {
        ball_radius: args.ball_diameter / 2.0,
        reflectance: [args.reflectance; 3],
        circle: args.ball,
        field_of_view_degrees: args.fov,
        tilt_degrees: args.tilt,
        tag: args.tag,
        rectangle: args.ground.map(|Corners(corners)| corners),
        exposures: args.exposures.clone(),
    };
    Ok(Analysis::new(empty, balls, &options)?)
}

/// Composes one picture of a session at best quality. Returns the PNG file.
fn compose(session: &Path, scene: &Path, frames: &Path) -> anyhow::Result<Vec<u8>> {
    let mut config = Config {
        scene: SceneChoice::from_text(&scene.display().to_string()),
        ..Config::default()
    };
    config.picture.quality = Quality::Best;
    config.replay.speed = ReplaySpeed::Max;
    config.output.window = false;
    config.output.frames = Some(frames.to_owned());
    let status = SharedStatus::new(live_settings(&config));
    let options = RunOptions {
        frame_limit: Some(1),
        force: false,
        poses: None,
    };
    let shared = Arc::clone(&status);
    let watch = Watch::start("composing", move || {
        Some(shared.snapshot().frames.composed as f64)
    })?;
    let source = Source::Recorded(Session::open(session)?);
    let shutdown = Arc::new(AtomicBool::new(false));
    let gpu = Gpu::open(config.gpu.adapter.as_deref())?;
    Runner::new(source, config, options, status, shutdown)?.run(gpu, None)?;
    drop(watch);
    let mut written = std::fs::read_dir(frames)?;
    let first = written
        .next()
        .ok_or_else(|| anyhow!("no picture was composed"))??;
    Ok(std::fs::read(first.path())?)
}

/// Returns the scene of the ball itself, where it stood.
fn ball_scene(analysis: &Analysis) -> String {
    let [r, g, b] = analysis.reflectance;
    let (radius, height) = (analysis.ball_radius, analysis.placement.ball.z);
    format!(
        "[[object]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = {radius}\nsegments = 192\n\
         position_m = [0.0, 0.0, {height}]\n\
         material = {{ base_colour = [{r}, {g}, {b}], metallic = 1.0, roughness = 0.0 }}\n"
    )
}

fn written(folder: &Path, name: &str, text: &str) -> anyhow::Result<PathBuf> {
    let path = folder.join(name);
    std::fs::write(&path, text)
        .map_err(|e| anyhow!("{}: cannot be written ({e})", path.display()))?;
    Ok(path)
}

/// Returns what was found, a line each.
fn describe(analysis: &Analysis) -> Vec<String> {
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
    let clipped = analysis.clipped();
    if clipped > 0 {
        lines.push(format!(
            "lamps: {clipped} pixels of the ball are white in its darkest picture; shadows come out too \
             faint: add a darker exposure"
        ));
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
        GroundFrom::Assumed => format!(
            "ground: the camera is assumed to look down by {tilt:.0}°; state it with --tilt, or point at a \
             rectangle on the ground (--ground, --browser), or put a printed tag there (--tag)"
        ),
    }
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

fn describe_check(check: Option<ShadowCheck>) -> String {
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

/// Parses a length with its unit: metres.
fn length(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, unit) = [("mm", 1e-3), ("cm", 1e-2), ("m", 1.0)]
        .iter()
        .find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)))
        .ok_or_else(|| format!("{text:?} has no unit; write e.g. 80mm"))?;
    let value: Result<f64, _> = number.trim().parse();
    let value = value.map_err(|_| format!("{text:?} is no length; write e.g. 80mm"))?;
    Ok(value * unit)
}

fn diameter(text: &str) -> Result<f64, String> {
    within(length(text)?, 0.005..=2.0, "expected 5mm to 2m")
}

fn tilt(text: &str) -> Result<f64, String> {
    let degrees = text.parse().map_err(|_| "expected degrees".to_owned())?;
    within(degrees, -30.0..=90.0, "expected -30 to 90 degrees")
}

fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse().map_err(|_| "expected degrees".to_owned())?;
    within(degrees, 5.0..=140.0, "expected 5 to 140 degrees")
}

fn reflectance(text: &str) -> Result<f32, String> {
    let share = text.parse().map_err(|_| "expected a share".to_owned())?;
    within(share, 0.02..=1.0, "expected 0.02 to 1").map(|share| share as f32)
}

fn within(value: f64, range: std::ops::RangeInclusive<f64>, expected: &str) -> Result<f64, String> {
    let is_within = range.contains(&value);
    is_within
        .then_some(value)
        .ok_or_else(|| expected.to_owned())
}

fn tag(text: &str) -> Result<PrintedTag, String> {
    let (family, size) = text
        .split_once(':')
        .ok_or("expected FAMILY:LENGTH, e.g. tag36h11:60mm")?;
    let family: Family = family.parse().map_err(|e| format!("{e}"))?;
    let size = within(length(size)?, 0.002..=5.0, "expected a tag of 2mm to 5m")?;
    Ok(PrintedTag { family, size })
}

/// Parses numbers between commas.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    numbers.ok()?.try_into().ok()
}

fn circle(text: &str) -> Result<Circle, String> {
    match numbers(text) {
        Some([x, y, radius]) if radius > 0.0 && radius.is_finite() => Ok(Circle {
            centre: DVec2::new(x, y),
            radius,
        }),
        _ => Err("expected X,Y,RADIUS in pixels, e.g. 1010,760,120".to_owned()),
    }
}

/// The corners of a rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corners([DVec2; 4]);

fn corners(text: &str) -> Result<Corners, String> {
    let numbers: Option<[f64; 8]> = numbers(text);
    let corners = |n: [f64; 8]| [0, 2, 4, 6].map(|k| DVec2::new(n[k], n[k + 1]));
    numbers.map(|n| Corners(corners(n))).ok_or_else(|| {
        "expected four corners in pixels: X,Y,X,Y,X,Y,X,Y, e.g. 610,420,940,415,1010,655,580,660"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_need_a_unit() {
        let close = |text: &str, metres: f64| (length(text).unwrap() - metres).abs() < 1e-12;
        assert!(close("80mm", 0.08) && close("8 cm", 0.08) && close("0.08m", 0.08));
        for wrong in ["80", "mm", "8 inch", "", "nanm x"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
        assert!(diameter("80m").is_err() && diameter("nanmm").is_err());
    }

    #[test]
    fn tags_and_circles() {
        assert_eq!(tag("tag36h11:60mm").unwrap().size, 0.06);
        assert!(tag("tag36h11").is_err() && tag("tagged:60mm").is_err());
        assert_eq!(circle("10, 20,5").unwrap().radius, 5.0);
        assert!(circle("10,20").is_err() && circle("1,2,nan").is_err());
        let Corners(found) = corners("1,2,3,4, 5,6,-7,8").unwrap();
        assert_eq!((found[0].x, found[3]), (1.0, DVec2::new(-7.0, 8.0)));
        assert!(corners("1,2,3,4,5,6,7").is_err() && corners("1,2,3,4,5,6,7,x").is_err());
    }
}
