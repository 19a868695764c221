//! The case of DiVerdi and Höllerer 2004 (30 frames/s on hardware of 2004): 640×480, a mirrored
//! sphere in the scene camera's picture, from which the environment is measured and filtered for
//! each picture, for GGX and Phong lobes; moving virtual spots, each with its shadow; and an
//! automatic exposure that darkens the picture. The light in the room changes with every picture.
//!
//! Lighting and picture are computed one after the other, unlike in a rig, so that all of the work
//! is measured. Rows differ in the number of lamps; two more have an environment camera instead of
//! the sphere, and eight dome lights, whose shadows the paper does not have. In the last row the
//! lighting is computed while the previous picture is rendered.

use super::percentiles::Percentiles;
use super::report::{BenchReport, PassTime, Row};
use super::stage::{Passes, WARM_UP, camera};
use super::{BenchError, BenchOptions, thread_time};
use penumbra_camera::Response;
use penumbra_compositor::exposure::AutoLimits;
use penumbra_compositor::{Compositor, CompositorSettings, Exposure, FrameInput, Gpu, Refresh};
use penumbra_interface::MonotonicTime;
use penumbra_lighting::{
    Bracket, EnvironmentEstimator, EnvironmentInput, EnvironmentSettings, Lighting,
};
use penumbra_picture::Picture;
use penumbra_scene::lamps::MAX_LAMPS;
use room::{Room, Stills, View};
use std::sync::Arc;
use std::time::Instant;

mod at_once;
mod room;

/// Frame rate of the camera, Hz.
const RATE: f64 = 30.0;

/// Definition of a row.
#[derive(Clone, Copy)]
struct Case {
    view: View,
    lamps: usize,
    lights: usize,
}

pub(super) fn run(
    gpu: &Gpu,
    options: &BenchOptions,
    report: &mut BenchReport,
    progress: &mut dyn FnMut(&Row),
) -> Result<(), BenchError> {
    let ball = |lamps, lights| Case {
        view: View::Ball,
        lamps,
        lights,
    };
    let counts = [1, 2, 4, 8, 16, 32].into_iter();
    let mut cases: Vec<Case> = counts
        .filter(|n| *n <= MAX_LAMPS)
        .map(|n| ball(n, 0))
        .collect();
    cases.push(Case {
        view: View::Fisheye,
        ..ball(1, 0)
    });
    cases.push(ball(1, 8));
    for case in cases {
        let row = measure(gpu, case, options)?;
        progress(&row);
        report.rows.push(row);
    }
    let row = at_once::measure(gpu, ball(1, 0), options)?;
    progress(&row);
    report.rows.push(row);
    Ok(())
}

fn measure(gpu: &Gpu, case: Case, options: &BenchOptions) -> Result<Row, BenchError> {
    let (width, height) = options.size.unwrap_or((640, 480));
    let mut rig = Rig::new(gpu, case, (width, height))?;
    let mut row = rig.row(case, (width, height));
    let (mut wall, mut gpu_total) = (Vec::new(), Vec::new());
    let (mut stages, mut passes) = (Passes::default(), Passes::default());
    let mut processor = Vec::new();
    for i in 0..WARM_UP + options.frames.unwrap_or(60) {
        rig.room.show(i);
        let before = processor_nanos();
        let start = Instant::now();
        let light = rig.light(i)?;
        let lit = start.elapsed();
        rig.compose(i, &light)?;
        gpu.wait()?;
        let all = start.elapsed();
        if i < WARM_UP {
            continue;
        }
        processor.push(processor_nanos().saturating_sub(before) as f64 * 1e-6);
        wall.push(all.as_secs_f64() * 1e3);
        let times = rig.compositor.pass_times();
        gpu_total.push(times.iter().map(|(_, ms)| ms).sum());
        passes.add(&times);
        let each = rig.estimator.stage_times().times().iter();
        let mut each: Vec<_> = each
            .map(|(name, t)| (*name, t.as_secs_f64() * 1e3))
            .collect();
        each.extend([
            ("light", lit.as_secs_f64() * 1e3),
            ("compose", (all - lit).as_secs_f64() * 1e3),
        ]);
        stages.add(&each);
    }
    row.fps = 1e3 * wall.len() as f64 / wall.iter().sum::<f64>().max(1e-9);
    row.wall_ms = Percentiles::from_values(&wall);
    row.gpu_ms = Percentiles::from_values(&gpu_total);
    row.processor_ms = Some(Percentiles::from_values(&processor).p50).filter(|ms| *ms > 0.0);
    (row.stages, row.passes) = (stages.medians(), passes.medians());
    Ok(row)
}

/// Measurements.
struct Rig {
    room: Room,
    estimator: EnvironmentEstimator,
    compositor: Compositor,
    triangles: usize,
}

/// The estimator of the room's lighting.
fn estimator(room: &Room, lights: usize) -> Result<EnvironmentEstimator, BenchError> {
    let settings = EnvironmentSettings {
        lights,
        phong: true,
        ..EnvironmentSettings::default()
    };
    let view = room.environment_view();
    Ok(EnvironmentEstimator::new(
        &view,
        &Response::srgb(),
        settings,
        None,
    )?)
}

impl Rig {
    fn new(gpu: &Gpu, case: Case, (width, height): (u32, u32)) -> Result<Self, BenchError> {
        let room = Room::new(case.view, camera(width, height), case.lamps);
        let estimator = estimator(&room, case.lights)?;
        let settings = CompositorSettings {
            samples: if gpu.software { 1 } else { 4 },
            ..CompositorSettings::for_adapter(gpu.software)
        };
        let mut compositor = Compositor::new(gpu.clone(), settings, Response::srgb());
        let scene = room.scene();
        compositor.set_scene(&scene, &penumbra_scene::casters(&scene));
        let parts = scene.virtual_parts.iter();
        Ok(Self {
            triangles: parts.map(|p| p.mesh.indices.len() / 3).sum(),
            room,
            estimator,
            compositor,
        })
    }

    /// Returns a row without times.
    fn row(&self, case: Case, (width, height): (u32, u32)) -> Row {
        Row {
            case: "lightprobe".to_owned(),
            width,
            height,
            lights: case.lights as u32,
            refreshed_per_frame: u32::from(case.lights > 0),
            planes: 0,
            basis_images: 0,
            light_changes: true,
            triangles: self.triangles,
            lamps: case.lamps as u32,
            environment: Some(case.view.label()),
            fps: 0.0,
            wall_ms: Percentiles::default(),
            gpu_ms: Percentiles::default(),
            processor_ms: None,
            stages: Vec::<PassTime>::new(),
            passes: Vec::new(),
        }
    }

    fn light(&mut self, i: u32) -> Result<Arc<Lighting>, BenchError> {
        let pose = self.room.pose(i);
        let picture: &Picture = self.room.environment_picture();
        let brackets = [Bracket { picture, ev: 0.0 }];
        Ok(self.estimator.update(&EnvironmentInput {
            scene: Some((pose, &self.room.camera)),
            ..EnvironmentInput::new(&brackets, time(i))
        })?)
    }

    fn compose(&mut self, i: u32, light: &Lighting) -> Result<(), BenchError> {
        self.room.move_lamps(i);
        self.compositor.compose(&FrameInput {
            world_from_camera: Some(self.room.pose(i)),
            lighting: Some(light),
            lamps: &self.room.lamps,
            refresh: Refresh::InTurn(1),
            exposure: Exposure::Automatic {
                limits: AutoLimits {
                    darkest: -3.0,
                    brightest: 0.0,
                    key: 0.02,
                    adaptation_seconds: 0.0,
                },
                seconds: f64::from(i) / RATE,
            },
            ..FrameInput::new(&self.room.picture, &self.room.camera)
        })?;
        Ok(())
    }
}

/// Processor time of all threads of this process; 0 if the system does not report it.
fn processor_nanos() -> u64 {
    thread_time::current().values().sum()
}

fn time(i: u32) -> MonotonicTime {
    MonotonicTime::default().offset_nanos((f64::from(i) / RATE * 1e9) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The case measures the environment at the sphere, the light changes, the lamp brightens the
    /// picture and the exposure darkens it.
    #[test]
    fn light_probe_case_measures_the_light_and_lowers_the_exposure() {
        let gpu = Gpu::open(None).unwrap();
        let case = Case {
            view: View::Ball,
            lamps: 1,
            lights: 0,
        };
        let mut rig = Rig::new(&gpu, case, (320, 240)).unwrap();
        let mut seen = Vec::new();
        for i in 0..4 {
            rig.room.show(i);
            let light = rig.light(i).unwrap();
            // The lobes of the first picture are complete: their update is not spread over
            // pictures.
            let (ggx, phong) = (&light.radiance.levels, &light.radiance.phong);
            assert_eq!((ggx.len(), phong.len()), (5, 4));
            assert!(ggx.iter().chain(phong).flatten().all(|t| t[1] > 0.01));
            seen.push(light.irradiance.irradiance(glam::Vec3::Z));
            rig.compose(i, &light).unwrap();
        }
        let truth = rig.room.irradiance(3);
        let error = (seen[3] - truth) / truth;
        assert!(error.abs().max_element() < 0.15, "{} {truth}", seen[3]);
        assert!(seen.is_sorted_by(|a, b| a != b), "{seen:?}");
        gpu.wait().unwrap();
        let stops = rig.compositor.exposure().stops;
        assert!((-3.0..-0.3).contains(&stops), "{stops}");
    }
}
