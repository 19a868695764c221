//! `penumbra photo`.

mod browser;
mod describe;

use super::files;
use super::progress::Watch;
use anyhow::{Context, anyhow, bail};
use clap::Args;
use describe::{describe, describe_check};
use glam::DVec2;
use penumbra_compositor::Gpu;
use penumbra_config::{Config, Quality, ReplaySpeed};
use penumbra_fiducials::Family;
use penumbra_lighting::Circle;
use penumbra_photo::{
    ASSUMED_REFLECTANCE, Analysis, GroundFrom, PhotoOptions, Photograph, Photographs, PrintedTag,
};
use penumbra_picture::Picture;
use penumbra_rig::light::report::light_of_session;
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
/// Times that the light is found anew with what the shadow tells.
const LOOKS: usize = 5;
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
    /// How far the camera looked down, degrees; by default the ball's shadow tells it, or 30 is assumed
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
    /// Adjust the ball and the ground in the browser, look at the composite, and adjust again
    #[arg(long)]
    browser: bool,
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
    let (photographs, options) = read(args)?;
    if args.browser {
        return browser::run(args, photographs, options);
    }
    let mut analysis = photographs.analyse(&options)?;
    let composed = Composed::new(args, &mut analysis, &Arc::default())?;
    describe(&analysis).into_iter().for_each(super::say);
    if let Some(path) = &args.found {
        files::write(path, &penumbra_photo::png(&analysis.drawn())?, args.force)?;
    }
    composed.write(args)?;
    super::say(composed.check);
    Ok(ExitCode::SUCCESS)
}

/// Reads and aligns the photographs; returns them with what the user states.
fn read(args: &PhotoArgs) -> anyhow::Result<(Photographs, PhotoOptions)> {
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
    Ok((Photographs::new(empty, balls, &options)?, options))
}

/// A composed picture.
struct Composed {
    /// The PNG file.
    picture: Vec<u8>,
    /// The session, if it shall be kept.
    session: Option<Vec<u8>>,
    /// How the shadow of the ball agrees, in a line.
    check: String,
}

impl Composed {
    /// Composes the picture with what the ball's shadow tells, and puts the ball back, until `shutdown` is set.
    fn new(
        args: &PhotoArgs,
        analysis: &mut Analysis,
        shutdown: &Arc<AtomicBool>,
    ) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir().context("no temporary folder can be created")?;
        let session = folder.path().join("photographs.mcap");
        write_session(analysis, &session, args.size)?;
        let kept = args.session.as_ref().map(|_| std::fs::read(&session));
        let kept = kept.transpose();
        let kept = kept.map_err(|e| anyhow!("{}: cannot be read ({e})", session.display()))?;
        let scene = match &args.scene {
            Some(scene) => scene.clone(),
            None => written(folder.path(), "scene.toml", SCENE)?,
        };
        let picture = compose(&session, &scene, &folder.path().join("picture"), shutdown)?;
        let ball = written(folder.path(), "ball.toml", &ball_scene(analysis))?;
        let with_ball = compose(&session, &ball, &folder.path().join("ball"), shutdown)?;
        let check = analysis.check(&Picture::from_file_bytes(&with_ball)?);
        Ok(Self {
            picture,
            session: kept,
            check: describe_check(check),
        })
    }

    /// Writes the picture, and the session if it shall be kept.
    fn write(&self, args: &PhotoArgs) -> anyhow::Result<()> {
        if let (Some(path), Some(session)) = (&args.session, &self.session) {
            files::write(path, session, args.force)?;
        }
        files::write(&args.out, &self.picture, args.force)
    }
}

/// Writes the session, with what the ball's shadow tells of the ground and of lamps that are white in its darkest
/// picture.
fn write_session(analysis: &mut Analysis, path: &Path, size: u32) -> anyhow::Result<()> {
    analysis.write_session(path, size)?;
    if analysis.clipped() == 0 && analysis.placement.ground != GroundFrom::Assumed {
        return Ok(());
    }
    for _ in 0..LOOKS {
        let light = light_of_session(&Session::open(path)?, &Config::default(), |_| ())?;
        if !analysis.learn_from_shadow(&light.lamps, &light.lighting.irradiance) {
            break;
        }
        std::fs::remove_file(path)
            .map_err(|e| anyhow!("{}: cannot be written anew ({e})", path.display()))?;
        analysis.write_session(path, size)?;
    }
    Ok(())
}

/// Composes one picture of a session at best quality. Returns the PNG file.
fn compose(
    session: &Path,
    scene: &Path,
    frames: &Path,
    shutdown: &Arc<AtomicBool>,
) -> anyhow::Result<Vec<u8>> {
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
    let gpu = Gpu::open(config.gpu.adapter.as_deref())?;
    Runner::new(source, config, options, status, Arc::clone(shutdown))?.run(gpu, None)?;
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
