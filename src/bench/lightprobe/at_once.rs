//! Lighting on a separate thread while the previous picture is rendered, as in a rig; each picture
//! is still rendered in the light of its own instant.

use super::{BenchError, BenchOptions, Case, Passes, Percentiles, Rig, Row, Stills, WARM_UP};
use super::{estimator, processor_nanos, time};
use penumbra_camera::PinholeCamera;
use penumbra_compositor::Gpu;
use penumbra_interface::threads;
use penumbra_lighting::{Bracket, EnvironmentEstimator, EnvironmentInput, Lighting};
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Instant;

/// Number of pictures that are rendered in advance and repeated.
const STILLS: u32 = 30;

/// Estimates the lighting of each instant.
struct Reader {
    estimator: EnvironmentEstimator,
    camera: PinholeCamera,
    stills: Arc<Stills>,
}

impl Reader {
    fn light(&mut self, i: u32) -> Result<Arc<Lighting>, BenchError> {
        let (pose, picture) = &self.stills[(i % STILLS) as usize];
        let brackets = [Bracket { picture, ev: 0.0 }];
        Ok(self.estimator.update(&EnvironmentInput {
            scene: Some((*pose, &self.camera)),
            ..EnvironmentInput::new(&brackets, time(i))
        })?)
    }

    /// Runs until the receiver is dropped, because an ended thread is no longer counted.
    fn run(mut self, lights: &SyncSender<Result<Arc<Lighting>, BenchError>>) {
        let mut all = (0..).map(|i| self.light(i));
        while let Some(light) = all.next()
            && lights.send(light).is_ok()
        {}
    }
}

pub(super) fn measure(gpu: &Gpu, case: Case, options: &BenchOptions) -> Result<Row, BenchError> {
    let size = options.size.unwrap_or((640, 480));
    let mut rig = Rig::new(gpu, case, size)?;
    let mut row = rig.row(case, size);
    row.environment = Some("mirrored sphere in the picture, light in parallel");
    let stills = Arc::new(rig.room.stills(STILLS));
    let count = WARM_UP + options.frames.unwrap_or(60);
    let (send, lights) = sync_channel(1);
    let reader = Reader {
        estimator: estimator(&rig.room, case.lights)?,
        camera: rig.room.camera.clone(),
        stills: stills.clone(),
    };
    let thread = threads::spawn("light", move || reader.run(&send))
        .map_err(|source| BenchError::Thread { source })?;
    let (mut wall, mut gpu_total, mut passes) = (Vec::new(), Vec::new(), Passes::default());
    let (mut before, mut start) = (0, Instant::now());
    for i in 0..count {
        let Ok(light) = lights.recv() else { break };
        rig.room
            .picture
            .clone_from(&stills[(i % STILLS) as usize].1);
        rig.compose(i, &*light?)?;
        gpu.wait()?;
        if i >= WARM_UP {
            wall.push(start.elapsed().as_secs_f64() * 1e3);
            let times = rig.compositor.pass_times();
            gpu_total.push(times.iter().map(|(_, ms)| ms).sum());
            passes.add(&times);
        } else {
            before = processor_nanos();
        }
        start = Instant::now();
    }
    let spent = processor_nanos().saturating_sub(before) as f64 * 1e-6;
    drop(lights);
    let _ = thread.join();
    row.fps = 1e3 * wall.len() as f64 / wall.iter().sum::<f64>().max(1e-9);
    row.wall_ms = Percentiles::from_values(&wall);
    row.gpu_ms = Percentiles::from_values(&gpu_total);
    row.processor_ms = Some(spent / wall.len().max(1) as f64).filter(|ms| *ms > 0.0);
    row.passes = passes.medians();
    Ok(row)
}
