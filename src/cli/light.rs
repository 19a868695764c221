//! `penumbra light`.

use super::files::refuse_overwriting;
use super::progress::Progress;
use anyhow::{anyhow, bail};
use clap::Args;
use glam::Vec3;
use penumbra_config::Config;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::photograph::{PhotographKind, SurroundingsCircle};
use penumbra_lighting::{Circle, LightReport};
use penumbra_rig::light::report::light_of_session;
use penumbra_session::Session;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct LightArgs {
    /// A photograph (JPEG, PNG) or a session
    #[arg(value_name = "IMAGE|SESSION.mcap")]
    source: PathBuf,
    /// Kind of photograph
    #[arg(long, value_enum)]
    kind: Option<PhotographKind>,
    /// Geometry of the photograph, if it cannot be found in the picture
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Configuration file, for a session
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Folder for environment.exr, environment.png, lights.png and light.json; of a photograph
    /// found.png, too, in which the circle that was found is drawn
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Overwrite existing files
    #[arg(long)]
    force: bool,
    /// Print light.json instead of a sentence
    #[arg(long)]
    json: bool,
}

const FILES: [&str; 5] = [
    "environment.exr",
    "environment.png",
    "lights.png",
    "found.png",
    "light.json",
];

pub fn run(args: &LightArgs) -> anyhow::Result<ExitCode> {
    refuse_overwriting(&args.out, &FILES, args.force)?;
    if args.out.exists() && !args.out.is_dir() {
        bail!("{}: is a file; name a folder", args.out.display());
    }
    let progress = Progress::new("light");
    let report = report(args, &progress)?;
    report.write(&args.out)?;
    progress.finish();
    if args.json {
        let file = args.out.join("light.json");
        let text = std::fs::read_to_string(&file)
            .map_err(|error| anyhow!("{}: cannot be read ({error})", file.display()))?;
        super::say(text.trim_end());
    } else {
        super::say(describe(&report));
    }
    Ok(ExitCode::SUCCESS)
}

fn report(args: &LightArgs, progress: &Progress) -> anyhow::Result<LightReport> {
    if !is_mcap(&args.source) {
        return Ok(LightReport::from_photograph(
            &args.source,
            args.kind,
            args.calibration.as_deref(),
            |share| progress.set(share),
        )?);
    }
    if args.kind.is_some() || args.calibration.is_some() {
        bail!(
            "{}: a session has its own calibration; leave out --kind and --calibration",
            args.source.display()
        );
    }
    let config = args
        .config
        .as_deref()
        .map_or_else(|| Ok(Config::default()), Config::load)?;
    let session = Session::open(&args.source)?;
    Ok(light_of_session(&session, &config, |share| {
        progress.set(share)
    })?)
}

/// Returns whether a file is a session, by its name or its first bytes. An unreadable file is
/// reported later, when it is opened.
fn is_mcap(path: &Path) -> bool {
    let mut magic = [0; 5];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut magic));
    let has_extension = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    has_extension || (read.is_ok() && magic == *b"\x89MCAP")
}

fn describe(report: &LightReport) -> String {
    let mut text = String::new();
    if let Some((found, _)) = &report.photograph {
        let _ = writeln!(text, "{}", describe_circle(found));
    }
    for lamp in &report.lamps {
        let _ = writeln!(text, "{}", describe_lamp(&lamp.source));
    }
    let _ = write!(
        text,
        "dominant light at {}; {} dome lights, {} clipped pixels",
        describe_direction(report.dominant_direction),
        report.lighting.lights.len(),
        report.clipped_pixels
    );
    text
}

/// Describes a compact source as the environment camera sees it.
fn describe_lamp(source: &CompactSource) -> String {
    let direction = describe_direction(source.direction);
    let mut text = match source.position.zip(source.distance.metres()) {
        Some((at, (away, sigma))) => format!(
            "lamp at ({:.2}, {:.2}, {:.2}) m, {away:.2} ± {sigma:.2} m from the environment camera, {direction}",
            at.x, at.y, at.z,
        ),
        None => format!("lamp at {direction}, how far is not known: it counts as infinitely far"),
    };
    if source.clipped > 0.0 {
        let _ = write!(
            text,
            "; {:.0} % of its light is in clipped pixels",
            100.0 * source.clipped.min(1.0)
        );
    }
    if source.is_unseen {
        text.push_str("; the environment camera does not see it, real shadows show it");
    }
    text
}

fn describe_direction(d: Vec3) -> String {
    format!(
        "azimuth {:.1}°, elevation {:.1}°",
        d.y.atan2(d.x).to_degrees(),
        d.z.clamp(-1.0, 1.0).asin().to_degrees()
    )
}

fn describe_circle(found: &SurroundingsCircle) -> String {
    let Circle { centre, radius } = found.circle;
    let how_sure = found.visible.map_or_else(
        || "as stated".to_owned(),
        |visible| {
            format!(
                "{:.0} % of it visible as a round border; see found.png",
                100.0 * visible
            )
        },
    );
    format!(
        "{}: centre ({:.0}, {:.0}), radius {radius:.0} pixels, {how_sure}",
        found.kind.name(),
        centre.x,
        centre.y
    )
}
