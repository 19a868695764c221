//! The rows of Kakuta 2007 (40 lights × 38 planes, 58,500 triangles) and 2004 (40 × 8, black
//! images dropped): 640×480, a temple gate on its site, a moving visitor; constant light, and light
//! that changes everywhere in every frame. Further rows have other numbers of triangles, on which
//! the cost of planes does not depend. Software drivers render one sample per pixel
//! (`[picture] antialias = "off"`).

use super::BenchOptions;
use super::percentiles::Percentiles;
use super::report::{BenchReport, Row};
use super::stage::{Passes, WARM_UP, camera, look_at, picture};
use glam::{DMat4, DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_compositor::planes::{PlanesChoice, SourceBaker, bake};
use penumbra_compositor::{Compositor, CompositorSettings, FrameInput, Gpu, GpuError, Refresh};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::geodesic::{FaceLight, FaceSource, GeodesicDome, Membership};
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_scene::gate::temple_gate;
use penumbra_scene::planes::{Bake, BakeSettings, PlaneSettings, generate};
use penumbra_scene::{Material, Part, Scene, primitives};
use std::f32::consts::PI;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Numbers of segments: for the paper's 58,500 triangles, for fewer, and for more.
const SEGMENTS: [u32; 3] = [64, 16, 128];
/// Pixels along a side of the environment's picture.
const FISHEYE: u32 = 480;

/// Definition of a row.
struct Case {
    name: &'static str,
    planes: u32,
    segments: u32,
    changes: bool,
}

pub(super) fn run(
    gpu: &Gpu,
    options: &BenchOptions,
    report: &mut BenchReport,
    progress: &mut dyn FnMut(&Row),
) -> Result<(), GpuError> {
    let case = |name, planes, segments, changes| Case {
        name,
        planes,
        segments,
        changes,
    };
    let [paper, fewer, more] = SEGMENTS;
    let cases = [
        case("kakuta2007", 38, paper, false),
        case("kakuta2007", 38, paper, true),
        case("kakuta2007", 38, fewer, true),
        case("kakuta2007", 38, more, true),
        case("kakuta2004", 8, paper, false),
        case("kakuta2004", 8, paper, true),
    ];
    for case in cases.iter().filter(|case| options.wants(case.name)) {
        let row = measure(gpu, case, options)?;
        progress(&row);
        report.rows.push(row);
    }
    Ok(())
}

fn measure(gpu: &Gpu, case: &Case, options: &BenchOptions) -> Result<Row, GpuError> {
    let (width, height) = options.size.unwrap_or((640, 480));
    let scene = scene(case.segments);
    let bake = baked(gpu, &scene, case.planes)?;
    let settings = CompositorSettings {
        samples: if gpu.software { 1 } else { 4 },
        ..CompositorSettings::for_adapter(gpu.software)
    };
    let mut compositor = Compositor::new(gpu.clone(), settings, Response::srgb());
    compositor.set_scene(&scene, &penumbra_scene::casters(&scene));
    let sources = SourceBaker::new(gpu, &scene, &bake)?;
    compositor.set_bake_with_sources(Some(&bake), Some(sources))?;
    let mut sky = Sky::new();
    let (picture, camera) = (picture(width, height), camera(width, height));
    let (mut wall, mut gpu_total, mut passes) = (Vec::new(), Vec::new(), Passes::default());
    for i in 0..WARM_UP + options.frames.unwrap_or(60) {
        let lighting = sky.lighting(if case.changes { i } else { 0 });
        let start = Instant::now();
        compositor.compose(&FrameInput {
            world_from_camera: Some(pose(i)),
            lighting: Some(&lighting),
            refresh: Refresh::UpTo(0),
            planes: Some(PlanesChoice::default()),
            ..FrameInput::new(&picture, &camera)
        })?;
        gpu.wait()?;
        if i >= WARM_UP {
            wall.push(start.elapsed().as_secs_f64() * 1e3);
            let times = compositor.pass_times();
            gpu_total.push(times.iter().map(|(_, ms)| ms).sum());
            passes.add(&times);
        }
    }
    let mean = wall.iter().sum::<f64>() / wall.len().max(1) as f64;
    let triangles = scene.virtual_parts.iter().map(|p| p.mesh.indices.len() / 3);
    Ok(Row {
        case: case.name.to_owned(),
        width,
        height,
        lights: bake.lights() as u32,
        refreshed_per_frame: 0,
        planes: bake.planes.len() as u32,
        basis_images: bake.counts().0 as u32,
        light_changes: case.changes,
        triangles: triangles.sum(),
        lamps: 0,
        environment: None,
        fps: 1e3 / mean,
        wall_ms: Percentiles::from_values(&wall),
        gpu_ms: Percentiles::from_values(&gpu_total),
        processor_ms: None,
        stages: Vec::new(),
        passes: passes.medians(),
    })
}

fn baked(gpu: &Gpu, scene: &Scene, count: u32) -> Result<Bake, GpuError> {
    let settings = PlaneSettings {
        count,
        ..PlaneSettings::default()
    };
    let planes = generate(scene, &settings).map_err(|error| GpuError::Unfit {
        adapter: gpu.name.clone(),
        reason: error.to_string(),
    })?;
    bake(gpu, scene, planes, BakeSettings::default(), &mut |_, _| {
        ControlFlow::Continue(())
    })
}

/// The gate on its site.
fn scene(segments: u32) -> Scene {
    Scene {
        virtual_parts: temple_gate(segments).placed(DMat4::IDENTITY),
        phantom_parts: vec![Part {
            name: "ground".to_owned(),
            mesh: Arc::new(primitives::plane(80.0, 80.0)),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::IDENTITY,
            mirror: false,
            albedo: None,
        }],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Pose of a visitor who walks round the gate at a distance of twelve metres.
fn pose(frame: u32) -> RigidTransform {
    let angle = -1.3 + 0.005 * f64::from(frame);
    let eye = DVec3::new(12.0 * angle.cos(), 12.0 * angle.sin(), 1.7);
    look_at(eye, DVec3::new(0.0, 0.0, 2.2))
}

/// A fisheye picture of a cloudy sky with a sun.
struct Sky {
    directions: Vec<Vec3>,
    membership: Arc<Membership>,
    radiance: Arc<CubeMap>,
}

/// Cosine of half the angle of the sun's disc.
const SUN_EDGE: f32 = 0.998;
/// Direction towards the sun.
const SUN: Vec3 = Vec3::new(0.36, -0.48, 0.8);

impl Sky {
    fn new() -> Self {
        let middle = (FISHEYE as f32 - 1.0) / 2.0;
        let (mut directions, mut solid_angles) = (Vec::new(), Vec::new());
        for i in 0..FISHEYE * FISHEYE {
            let x = ((i % FISHEYE) as f32 - middle) / middle;
            let y = ((i / FISHEYE) as f32 - middle) / middle;
            let r = x.hypot(y);
            if r <= 1.0 {
                // Equidistant: the angle from the zenith grows with the radius.
                let (sin, cos) = (r * PI / 2.0).sin_cos();
                directions.push(Vec3::new(x / r.max(1e-6) * sin, y / r.max(1e-6) * sin, cos));
                let stretch = if r < 1e-6 { 1.0 } else { sin / (r * PI / 2.0) };
                solid_angles.push(stretch * (PI / 2.0 / middle).powi(2));
            }
        }
        let levels = (0..6).map(|m| vec![[0.6; 3]; 6 << (2 * (5 - m))]).collect();
        Self {
            membership: Arc::new(match GeodesicDome::new(BakeSettings::default().frequency) {
                Some(dome) => Membership::new(&dome, &directions, &solid_angles),
                None => Membership::default(),
            }),
            directions,
            radiance: Arc::new(CubeMap {
                size: 32,
                levels,
                ..CubeMap::default()
            }),
        }
    }

    /// The sun as a compact source among the faces' light, in the colour of its disc.
    fn sun(&self, brightness: f32) -> FaceSource {
        let colour = Vec3::new(1.0, 1.0, 0.9) * brightness;
        let mut sun = FaceSource {
            id: 0,
            direction: SUN,
            angular_radius: SUN_EDGE.acos(),
            ..FaceSource::default()
        };
        let table = &self.membership;
        let faces = table.ranges().zip(0..);
        let pixels = faces.flat_map(|(range, face)| range.map(move |at| (at, face)));
        let disc = pixels.filter_map(|(at, face)| {
            let (pixel, weight) = (*table.pixels.get(at)?, *table.weights.get(at)?);
            let inside = self.directions.get(pixel as usize)?.dot(SUN) > SUN_EDGE;
            inside.then_some((face, weight, colour))
        });
        sun.take(disc);
        sun
    }

    /// The light of frame `i`: clouds move, and the sun behind them brightens and fades.
    fn lighting(&mut self, i: u32) -> Lighting {
        let time = 0.3 * i as f32;
        let sun = 60.0 * (1.2 + time.sin());
        let of = |d: &Vec3| {
            let cloud = 0.5 + 0.4 * (4.0 * d.x + time).sin() * (5.0 * d.y - 0.7 * time).cos();
            let disc = if d.dot(SUN) > SUN_EDGE { sun } else { 0.0 };
            [
                0.4 * cloud + disc,
                0.5 * cloud + disc,
                0.7 * cloud + 0.9 * disc,
            ]
        };
        let compact = DomeLight {
            direction: SUN,
            irradiance: Vec3::new(1.0, 1.0, 0.9) * sun * 0.0126,
            angular_radius: 0.06,
            kind: LightKind::Compact,
            place: LightPlace::FAR,
        };
        let mut irradiance = Harmonics::default();
        irradiance.coefficients[0] = Vec3::new(0.8, 1.0, 1.4);
        let cell = DomeLight {
            direction: Vec3::Z,
            irradiance: Vec3::new(0.8, 1.0, 1.4),
            angular_radius: 1.0,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        };
        Lighting {
            captured_at: MonotonicTime::default(),
            generation: u64::from(i) + 1,
            radiance: self.radiance.clone(),
            irradiance,
            lights: vec![compact, cell],
            ground_radiance: Vec3::splat(0.3),
            faces: Some(Arc::new(FaceLight {
                frequency: BakeSettings::default().frequency,
                membership: self.membership.clone(),
                radiance: Arc::new(self.directions.iter().map(of).collect()),
                sources: vec![self.sun(sun)],
            })),
        }
    }
}
