//! `penumbra calibrate environment`.

use super::args::InputArgs;
use anyhow::{anyhow, bail};
use clap::{Args, ValueEnum};
use glam::{DVec2, DVec3};
use penumbra_calibration::environment_camera_calibration::{
    Click, EnvironmentCameraKind, EnvironmentOptions, EnvironmentStep, KnownRig, RoughSphere,
    parse_clicks,
};
use penumbra_fiducials::Family;
use penumbra_picture::read_text_bounded;
use penumbra_rig_model::lens_files::ENVIRONMENT_LENS;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_session::Session;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct EnvironmentArgs {
    #[command(flatten)]
    input: InputArgs,
    /// Kind of environment camera; without it as in rig.json, else a fisheye
    #[arg(long, value_enum)]
    kind: Option<KindName>,
    /// Field of view of the fisheye, degrees; without it as in rig.json, else 180
    #[arg(long, value_name = "DEGREES", value_parser = degrees)]
    fov: Option<f64>,
    /// Centre of the sphere in the environment camera's picture, and its radius, pixels
    #[arg(long, value_name = "X,Y[,RADIUS]", value_parser = click)]
    click: Option<RoughSphere>,
    /// Points clicked in the environment camera's picture: lines `x, y, point, X, Y, Z` (world,
    /// metres), `x, y, towards, X, Y, Z` (direction) or `x, y, scene, U, V, SECONDS`
    #[arg(long, value_name = "FILE.csv")]
    click_pairs: Option<PathBuf>,
    /// Position of the environment camera, world, metres; then only its orientation is estimated
    #[arg(long, value_name = "X,Y,Z", value_parser = position, allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// Family of static markers that both cameras see and that are not in rig.json
    #[arg(long, value_name = "tag36h11", value_parser = super::dictionary::family)]
    family: Vec<Family>,
    /// Maximum error of the orientation in rig.json
    #[arg(long, value_name = "DEGREES", value_parser = degrees)]
    rough: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum KindName {
    Fisheye,
    Sphere,
}

fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let number = |t: &str| match t.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(format!("`{t}` is not a number")),
    };
    text.split(',').map(number).collect()
}

fn degrees(text: &str) -> Result<f64, String> {
    match numbers(text)?[..] {
        [d] if d > 0.0 && d <= 360.0 => Ok(d.to_radians()),
        _ => Err("expected degrees above 0 and at most 360".to_owned()),
    }
}

fn click(text: &str) -> Result<RoughSphere, String> {
    match numbers(text)?[..] {
        [x, y] => Ok(RoughSphere {
            centre: DVec2::new(x, y),
            radius: None,
        }),
        [x, y, r] if r > 2.0 => Ok(RoughSphere {
            centre: DVec2::new(x, y),
            radius: Some(r),
        }),
        _ => Err("expected X,Y or X,Y,RADIUS in pixels".to_owned()),
    }
}

fn position(text: &str) -> Result<DVec3, String> {
    match numbers(text)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("expected X,Y,Z in metres".to_owned()),
    }
}

pub fn run(args: &EnvironmentArgs) -> anyhow::Result<ExitCode> {
    let rig = known_rig(args)?;
    let asked = EnvironmentOptions {
        kind: args.kind.map(|k| match k {
            KindName::Fisheye => EnvironmentCameraKind::Fisheye,
            KindName::Sphere => EnvironmentCameraKind::Sphere,
        }),
        fov: args.fov,
        rough_sphere: args.click,
        clicks: clicked_pairs(args)?,
        position: args.at,
        families: args.family.clone(),
        max_rotation_error: args.rough,
    };
    let mut step = EnvironmentStep::new(rig, asked)?;
    args.input.run_step(&mut step)
}

/// Reads the known calibration and the lens of the environment camera.
fn known_rig(args: &EnvironmentArgs) -> anyhow::Result<KnownRig> {
    if let Some(path) = &args.input.session
        && !Session::open(path)?.has_environment()
    {
        bail!(
            "{}: has no pictures of an environment camera",
            path.display()
        );
    }
    let files = args.input.files()?;
    let lens = match files.get(ENVIRONMENT_LENS) {
        Some(bytes) => Some(LensRecord::parse(ENVIRONMENT_LENS, bytes)?.lens(ENVIRONMENT_LENS)?),
        None => None,
    };
    Ok(KnownRig {
        rig: args.input.rig()?,
        lens,
    })
}

/// Reads the clicked points.
fn clicked_pairs(args: &EnvironmentArgs) -> anyhow::Result<Vec<Click>> {
    let Some(path) = &args.click_pairs else {
        return Ok(Vec::new());
    };
    let name = path.display().to_string();
    let text = read_text_bounded(path, 16 << 20).map_err(|error| anyhow!("{name}: {error}"))?;
    parse_clicks(&text).map_err(|error| anyhow!("{name}: {error}"))
}
