//! `penumbra webcam`: the rig that anybody can have. Writes its sheet, `rig.json` and configuration
//! into a folder, then runs it.

use super::files::write;
use super::live::{self, RunArgs};
use super::say;
use anyhow::{anyhow, bail};
use clap::Args;
use penumbra_calibration::simulation::SimulatedWebcam;
use penumbra_calibration::webcam_sheet::{Paper, WebcamSheet, assumed_lens};
use penumbra_interface::CameraInfo;
use penumbra_rig::REFINED_SOURCE;
use penumbra_rig::calibration_runner::record_webcam;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::lens_record::LensRecord;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The virtual objects of a new rig.
const SCENE: &str = include_str!("../../config/webcam.toml");
/// Name of the simulated camera.
const SIMULATED: &str = "simulated";
/// Duration and rate of the simulated camera.
const SIMULATED_SECONDS: f64 = 24.0;
const SIMULATED_RATE: f64 = 6.0;

#[derive(Debug, Args)]
pub struct WebcamArgs {
    /// The camera: a name of `penumbra devices`, a device file, "replay:SESSION.mcap" or "simulated";
    /// "auto" takes the first one
    #[arg(long, value_name = "NAME", default_value = "auto")]
    camera: String,
    /// Diameter of the ball, millimetres: 50 to 100
    #[arg(long, value_name = "MM", default_value_t = 70.0)]
    ball_mm: f64,
    /// Height of the ball's lowest point above the paper, millimetres: of a stand, if it has one
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    stand_mm: f64,
    /// Size of the paper
    #[arg(long, value_enum, default_value_t)]
    paper: Paper,
    /// Length of the printed line of 100 mm as measured on the sheet, millimetres
    #[arg(long, value_name = "MM", default_value_t = 100.0)]
    ruler_mm: f64,
    /// Size of the camera's pictures, pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1280x720", value_parser = size)]
    size: (u32, u32),
    /// Field of view across the picture, degrees: the assumption from which the lens is refined
    #[arg(long, value_name = "DEGREES", default_value_t = 65.0, value_parser = field_of_view)]
    fov_deg: f64,
    /// Folder of the rig: sheet, configuration, virtual objects, lens
    #[arg(long, value_name = "DIR", default_value = "webcam")]
    folder: PathBuf,
    /// Write the files, and run nothing
    #[arg(long)]
    prepare_only: bool,
    #[command(flatten)]
    run: RunArgs,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once('x');
    let parsed = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parsed
        .filter(|(w, h)| (160..=4096).contains(w) && (120..=4096).contains(h))
        .ok_or_else(|| "expected WIDTHxHEIGHT in pixels, e.g. 1280x720 or 640x480".to_owned())
}

fn field_of_view(text: &str) -> Result<f64, String> {
    let degrees = text.parse().ok().filter(|d| (30.0..=120.0).contains(d));
    degrees.ok_or_else(|| "expected degrees across the picture, 30 to 120".to_owned())
}

pub fn run(mut args: WebcamArgs) -> anyhow::Result<ExitCode> {
    if args.run.show.config.is_some() {
        bail!(
            "webcam: --config is of no use here, because the configuration is written to --folder; use `penumbra run --config`"
        );
    }
    let sheet = WebcamSheet::new(args.paper, args.ruler_mm, args.ball_mm, args.stand_mm)?;
    let folder = &args.folder;
    std::fs::create_dir_all(folder.join("calibration")).map_err(|e| {
        anyhow!(
            "{}: cannot be created ({e}); name another --folder",
            folder.display()
        )
    })?;
    let pdf = folder.join("sheet.pdf");
    write(&pdf, &sheet.sheet().pdf(), true)?;
    say(format_args!(
        "{}: print it on {} at 100 %, put a shiny ball of {} mm onto its ring",
        pdf.display(),
        args.paper.name(),
        args.ball_mm
    ));
    let camera = camera(&args, &sheet)?;
    let lens = assumed_lens(args.size, args.fov_deg.to_radians());
    let rig = serde_json::to_string_pretty(&sheet.rig_json(&lens))?;
    write(&folder.join("rig.json"), rig.as_bytes(), true)?;
    let config = folder.join("rig.toml");
    write(&config, configuration(&camera, args.size).as_bytes(), true)?;
    let scene = folder.join("scene.toml");
    if !scene.exists() {
        write(&scene, SCENE.as_bytes(), true)?;
    }
    set_other_lens_aside(folder, &camera, args.size)?;
    if args.prepare_only {
        say(format_args!(
            "run it: penumbra run --config {}",
            config.display()
        ));
        return Ok(ExitCode::SUCCESS);
    }
    say(format_args!("camera: {camera}"));
    args.run.show.config = Some(config);
    live::run(&args.run)
}

/// Returns the configuration's name of the camera.
fn camera(args: &WebcamArgs, sheet: &WebcamSheet) -> anyhow::Result<String> {
    match args.camera.as_str() {
        "auto" => first_camera(&penumbra_capture::list_cameras()),
        SIMULATED => {
            let session = args.folder.join("simulated.mcap");
            simulate(&session, args, sheet)?;
            replay(&session)
        }
        other => match other.strip_prefix("replay:") {
            Some(session) => replay(Path::new(session)),
            None => Ok(other.to_owned()),
        },
    }
}

/// Returns the name of a session as a device; names in the configuration are relative to its folder.
fn replay(session: &Path) -> anyhow::Result<String> {
    let path = std::path::absolute(session)?;
    if !path.is_file() {
        bail!(
            "{}: there is no such session; record one, or use --camera auto",
            session.display()
        );
    }
    Ok(format!("replay:{}", path.display()))
}

/// Returns the first camera that streams colour, else the first one.
fn first_camera(cameras: &[CameraInfo]) -> anyhow::Result<String> {
    let has_colour = |camera: &&CameraInfo| {
        let colour = |f: &str| ["MJPG", "YUYV", "NV12"].contains(&f.to_uppercase().as_str());
        camera.formats.iter().any(|format| colour(&format.fourcc))
    };
    let Some(camera) = cameras.iter().find(has_colour).or(cameras.first()) else {
        bail!(
            "no camera was found; plug one in, or try without: --camera simulated (`penumbra devices` lists cameras)"
        );
    };
    if cameras.len() > 1 {
        let others = cameras.iter().filter(|c| c.identity != camera.identity);
        let names: Vec<&str> = others.map(|c| c.identity.as_str()).collect();
        say(format_args!("other cameras: --camera {}", names.join(", ")));
    }
    Ok(camera.identity.clone())
}

/// Records a simulated camera before the sheet, anew for each start: another ball gives other
/// pictures.
fn simulate(session: &Path, args: &WebcamArgs, sheet: &WebcamSheet) -> anyhow::Result<()> {
    let webcam = SimulatedWebcam::of_typical_lens(args.size, *sheet, 1);
    let progress = super::progress::Progress::new("simulating a camera");
    if session.is_file() {
        std::fs::remove_file(session)?;
    }
    let duration = (SIMULATED_SECONDS, SIMULATED_RATE);
    record_webcam(&webcam, session, duration, |share| progress.set(share))?;
    progress.finish();
    Ok(())
}

/// Returns the configuration of the rig.
fn configuration(camera: &str, (width, height): (u32, u32)) -> String {
    let mut text = String::from(
        "# Written by `penumbra webcam` at each start. To keep changes, use a copy in the same folder:\n\
         # penumbra run --config my-rig.toml\n\n",
    );
    // A JSON string is a TOML string.
    let device = serde_json::Value::from(camera);
    let _ = write!(
        text,
        "[scene]\nfile = \"scene.toml\"\n\n\
         [scene_camera]\ndevice = {device}\nwidth = {width}\nheight = {height}\n\
         frames_per_second = 30\nformats = [\"mjpeg\", \"yuyv\"]\n\n\
         [calibration]\nfrom = \".\"\n\n\
         [registration]\npose = \"markers\"\nrefine_lens = true\n\n\
         [environment]\nsource = \"sphere-in-scene\"\n\
         # Without a GPU the light is estimated less often.\nstale_after_ms = 3000\n\n\
         # A laptop without a GPU is fast enough if not every shadow map is rendered in every frame.\n\
         [shadows]\nrefresh_per_frame = 8\n\n\
         [status]\nguide = \"sheet.pdf\"\n"
    );
    text
}

/// Moves the refined lens of another camera or picture size out of the way.
fn set_other_lens_aside(folder: &Path, camera: &str, size: (u32, u32)) -> anyhow::Result<()> {
    let path = folder.join(SCENE_LENS);
    let owner = folder.join("calibration").join("camera.txt");
    let same_camera = std::fs::read_to_string(&owner).is_ok_and(|name| name == camera);
    if let Ok(bytes) = std::fs::read(&path) {
        let record = LensRecord::parse(SCENE_LENS, &bytes);
        let fits = record.is_ok_and(|record| {
            let is_refined = record.source == REFINED_SOURCE;
            record.image_size == [size.0, size.1] && (same_camera || !is_refined)
        });
        if !fits {
            let aside = path.with_extension("json.other");
            std::fs::rename(&path, &aside)
                .map_err(|e| anyhow!("{}: cannot be moved ({e})", path.display()))?;
            say(format_args!(
                "{}: of another camera or picture size, kept as {}",
                path.display(),
                aside.display()
            ));
        }
    }
    if !same_camera {
        write(&owner, camera.as_bytes(), true)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configuration_is_valid_for_every_name_of_a_camera() {
        for camera in [
            "/dev/video0",
            "usb-A \"quoted\" \\ name",
            "replay:/tmp/ä.mcap",
        ] {
            let text = configuration(camera, (640, 480));
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("rig.toml");
            std::fs::write(&path, text).unwrap();
            std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
            let config = penumbra_config::Config::load(&path).unwrap();
            assert!(config.registration.refine_lens);
            assert_eq!(config.status.guide, Some(folder.path().join("sheet.pdf")));
        }
    }

    #[test]
    fn first_camera_with_colour_is_taken() {
        let camera = |name: &str, fourcc: &str| CameraInfo {
            identity: name.to_owned(),
            formats: vec![penumbra_interface::CameraFormat {
                fourcc: fourcc.to_owned(),
                description: String::new(),
                usable: true,
                sizes: Vec::new(),
            }],
            ..CameraInfo::default()
        };
        let cameras = [camera("infrared", "GREY"), camera("colour", "MJPG")];
        assert_eq!(first_camera(&cameras).unwrap(), "colour");
        assert!(
            first_camera(&[])
                .unwrap_err()
                .to_string()
                .contains("no camera")
        );
    }
}
