//! `penumbra bake`.

use super::files;
use super::show::set;
use crate::cli::progress::Progress;
use anyhow::anyhow;
use clap::Args;
use penumbra_compositor::Gpu;
use penumbra_config::{Config, FREQUENCIES, lights_of_dome};
use penumbra_rig::bake::{BakePlan, scene_to_bake};
use penumbra_scene::planes::store::{CACHE_LIMIT, save, trim};
use penumbra_scene::planes::{Bake, Layer, ShadowingPlane};
use serde::Serialize;
use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

#[derive(Debug, Args)]
pub struct BakeArgs {
    /// A scene file, a glTF model, or a session: its object and phantoms
    #[arg(value_name = "SCENE.toml|MODEL.glb|SESSION.mcap")]
    scene: PathBuf,
    /// Session with the phantoms and the ground, for a scene file or a model
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// Configuration file; options on the command line override it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Maximum number of planes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=256))]
    planes: Option<u32>,
    /// Number of lights: 40, 160, 360 or 640, the faces of a geodesic dome
    #[arg(long = "lights", value_name = "N", value_parser = frequency)]
    frequency: Option<u32>,
    /// Maximum number of parts that a complex model is divided into
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    clusters: Option<u32>,
    /// Texels along a side of a basis image: a multiple of 4 from 16 to 512
    #[arg(long, value_name = "N", value_parser = resolution)]
    resolution: Option<u32>,
    /// Directions per light: more give softer shadows
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=64))]
    samples: Option<u32>,
    /// Write the bake to this file instead of the cache
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    force: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Part of the graphics adapter's name, or its number
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
}

/// Parses a number of lights; returns the frequency of the dome with that number.
fn frequency(text: &str) -> Result<u32, String> {
    let has = |f: &u32| text.parse() == Ok(lights_of_dome(*f));
    let found = FREQUENCIES.into_iter().find(has);
    found.ok_or_else(|| format!("expected one of {:?}", FREQUENCIES.map(lights_of_dome)))
}

fn resolution(text: &str) -> Result<u32, String> {
    let fits = |n: &u32| n.is_multiple_of(4) && (16..=512).contains(n);
    let found = text.parse().ok().filter(fits);
    found.ok_or_else(|| "expected a multiple of 4 from 16 to 512".to_owned())
}

impl BakeArgs {
    /// Returns the configuration with the options of the command line applied.
    fn config(&self) -> anyhow::Result<Config> {
        let mut config = match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        };
        set(&mut config.planes.count, self.planes);
        set(&mut config.planes.frequency, self.frequency);
        set(&mut config.planes.clusters, self.clusters);
        set(&mut config.planes.resolution, self.resolution);
        set(&mut config.planes.samples, self.samples);
        config.gpu.adapter = self.adapter.clone().or(config.gpu.adapter.take());
        Ok(config)
    }
}

/// Checks all inputs, bakes, writes the bake and prints a summary.
pub fn run(args: &BakeArgs) -> anyhow::Result<ExitCode> {
    if let Some(out) = &args.out {
        files::claim(out, args.force)?;
    }
    let config = args.config()?;
    let scene = scene_to_bake(&args.scene, args.session.as_deref(), &config)?;
    let plan = BakePlan::new(&scene, &config.planes);
    let file = match &args.out {
        Some(out) => out.clone(),
        None => plan
            .cache_file(&config.planes)
            .ok_or_else(no_cache_folder)?,
    };
    let gpu = Gpu::open(config.gpu.adapter.as_deref())?;
    let begun = Instant::now();
    let progress = Progress::new("baking");
    let bake = plan.bake(&gpu, &scene, &config.planes, &mut |done, total| {
        progress.set(done as f64 / total.max(1) as f64);
        ControlFlow::Continue(())
    })?;
    progress.finish();
    let seconds = begun.elapsed().as_secs_f64();
    save(&file, &bake)?;
    if bake.planes.iter().all(|p| p.layer == Layer::Virtual) {
        tracing::warn!(
            "there is no ground, so shadows fall on the model alone; name a session with --session, \
             or add [ground] to a scene file"
        );
    }
    if let (None, Some(folder)) = (&args.out, file.parent()) {
        trim(folder, CACHE_LIMIT)?;
    }
    let summary = BakeSummary::new(&bake, seconds, &file)?;
    if args.json {
        super::say(serde_json::to_string_pretty(&summary)?);
    } else {
        super::say(summary);
    }
    Ok(ExitCode::SUCCESS)
}

fn no_cache_folder() -> anyhow::Error {
    anyhow!("there is no folder for bakes, as $HOME is not set; name a file with --out")
}

/// Summary of a bake.
#[derive(Debug, Serialize)]
struct BakeSummary {
    planes: usize,
    /// Those on the ground and on phantoms.
    planes_on_real_surfaces: usize,
    lights: usize,
    resolution: u32,
    /// Basis images that are not black.
    basis_images: usize,
    /// Black basis images, which are not stored.
    basis_images_dropped: usize,
    bytes: u64,
    seconds: f64,
    file: PathBuf,
}

impl BakeSummary {
    fn new(bake: &Bake, seconds: f64, file: &Path) -> std::io::Result<Self> {
        let (lit, all) = bake.counts();
        let on_real = |p: &&ShadowingPlane| p.layer == Layer::Real;
        Ok(Self {
            planes: bake.planes.len(),
            planes_on_real_surfaces: bake.planes.iter().filter(on_real).count(),
            lights: bake.lights(),
            resolution: bake.settings.resolution,
            basis_images: lit,
            basis_images_dropped: all - lit,
            bytes: std::fs::metadata(file)?.len(),
            seconds,
            file: file.to_owned(),
        })
    }
}

impl fmt::Display for BakeSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let on_virtual = self.planes - self.planes_on_real_surfaces;
        writeln!(
            f,
            "planes          {} ({} on real surfaces, {on_virtual} on virtual objects)",
            self.planes, self.planes_on_real_surfaces
        )?;
        writeln!(f, "lights          {}", self.lights)?;
        writeln!(
            f,
            "basis images    {} of {size}x{size}",
            self.basis_images,
            size = self.resolution
        )?;
        writeln!(f, "black images    {}", self.basis_images_dropped)?;
        writeln!(f, "size            {:.2} MB", self.bytes as f64 * 1e-6)?;
        writeln!(f, "time            {:.1} s", self.seconds)?;
        write!(f, "written to      {}", self.file.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_counts_that_no_dome_has() {
        assert_eq!(frequency("40"), Ok(2));
        assert_eq!(frequency("640"), Ok(8));
        let wrong = Err("expected one of [40, 160, 360, 640]".to_owned());
        assert_eq!(frequency("48"), wrong);
        assert_eq!(frequency("many"), wrong);
        assert_eq!(resolution("128"), Ok(128));
        assert!(resolution("130").is_err() && resolution("8").is_err());
    }
}
