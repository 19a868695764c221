//! A status server with a synthetic moving picture, without cameras or GPU.

use glam::Vec3;
use penumbra_config::ExposureMode;
use penumbra_config::Technique;
use penumbra_interface::DeviceKind;
use penumbra_lighting::{DomeLight, LightKind, LightPlace};
use penumbra_picture::Picture;
use penumbra_status::planes::{PlanesState, PlanesStatus};
use penumbra_status::registration::RegistrationSource;
use penumbra_status::snapshot::{
    Device, DeviceState, PoseAnswer, Resolution, SessionState, WhiteBalanceEstimate,
    WhiteBalanceMethod, WhiteMatch,
};
use penumbra_status::{Settings, SharedStatus, Snapshot, StatusServer, environment_preview};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 480;

/// A server and the thread that updates it; both end when this is dropped.
pub struct Show {
    pub address: SocketAddr,
    pub shared: Arc<SharedStatus>,
    /// While set, the rig composes no picture, so that no setting takes effect.
    pub held: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    feeder: Option<JoinHandle<()>>,
    _runtime: tokio::runtime::Runtime,
}

impl Show {
    /// Starts the server on any free loopback port.
    pub fn start() -> Self {
        Self::start_at(SocketAddr::from(([127, 0, 0, 1], 0)))
    }

    /// Starts the server at an address.
    pub fn start_at(listen: SocketAddr) -> Self {
        let shared = SharedStatus::new(Settings::default());
        let server = StatusServer::bind(listen, None, Arc::clone(&shared)).expect("a free port");
        let address = server.local_addr();
        let runtime = tokio::runtime::Runtime::new().expect("a runtime");
        runtime.spawn(server.serve(std::future::pending()));
        let stop = Arc::new(AtomicBool::new(false));
        let held = Arc::new(AtomicBool::new(false));
        let fed = (Arc::clone(&shared), Arc::clone(&stop), Arc::clone(&held));
        let feed = move || feed(&fed.0, &fed.1, &fed.2);
        let feeder = penumbra_interface::threads::spawn("feeder", feed).expect("a thread");
        Self {
            address,
            shared,
            held,
            stop,
            feeder: Some(feeder),
            _runtime: runtime,
        }
    }
}

impl Drop for Show {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(feeder) = self.feeder.take() {
            let _ = feeder.join();
        }
    }
}

fn feed(shared: &SharedStatus, stop: &AtomicBool, held: &AtomicBool) {
    let settings = shared.settings_receiver();
    shared.publish_snapshot(example_snapshot());
    shared.publish_environment_preview(Arc::new(sky(256)));
    for frame in 0_u64.. {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        if held.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(20));
            continue;
        }
        let requested = settings.borrow().clone();
        let visible = requested.virtual_object_visible;
        let wobble = 1.0 + 0.12 * (frame as f64 / 9.0).sin() + 0.05 * (frame as f64 * 1.7).sin();
        let scale = wobble * f64::from(requested.light_count) / 64.0;
        shared.update(|s| advance(s, frame, scale, requested));
        if shared.wants_pair() {
            let mut pair = rolling_ball(frame, visible);
            pair.rgba.extend(rolling_ball(frame, false).rgba);
            pair.height *= 2;
            shared.publish_pair(Arc::new(pair));
        }
        if shared.wants_picture() {
            shared.publish_picture(Arc::new(rolling_ball(frame, visible)));
        }
        std::thread::sleep(Duration::from_millis(33));
    }
}

fn advance(s: &mut Snapshot, frame: u64, scale: f64, requested: Settings) {
    let stages = [
        ("decode", 2.1),
        ("environment", 6.4),
        ("upload", 0.7),
        ("composite", 14.0),
        ("total", 24.0),
    ];
    for (name, ms) in stages {
        s.stages
            .record(name, Duration::from_secs_f64(ms * 1e-3 * scale));
    }
    let passes = [
        ("shadow_maps", 4.2),
        ("shadow_buffer", 6.9),
        ("combine", 1.6),
    ];
    for (name, ms) in passes {
        s.stages
            .record_gpu(name, Duration::from_secs_f64(ms * 1e-3 * scale));
    }
    s.frames.arrived = frame + 1;
    s.frames.composed = frame + 1;
    s.frames.skipped = frame / 90;
    s.frames.per_second = 29.6 / scale.max(0.5);
    s.session.progress = Some((frame % 300) as f64 / 300.0);
    s.session.loops = frame / 300;
    s.lighting.dome_lights = requested.light_count;
    let planes = requested.technique == Technique::ShadowingPlanes;
    s.planes.state = if planes {
        PlanesState::Ready
    } else {
        PlanesState::Off
    };
    if planes {
        let changed = frame.is_multiple_of(4);
        s.planes.count_picture(if changed { 37 } else { 0 }, 0);
    }
    if requested.exposure_mode == ExposureMode::Manual {
        s.exposure.ev = requested.exposure_ev;
        s.exposure.target_ev = requested.exposure_ev;
    }
    s.settings = requested;
    for device in &mut s.devices {
        device.received = frame + 1;
        device.last_age_ms = Some(12.0);
        device.per_second = 30.0;
    }
}

/// Status of a rig in which every card of the dashboard has contents.
pub fn example_snapshot() -> Snapshot {
    let mut s = Snapshot::default();
    s.session.name = "desk.mcap".to_owned();
    s.session.enter(SessionState::Replaying);
    s.resolution = Resolution {
        width: WIDTH,
        height: HEIGHT,
    };
    s.adapter.name = "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned();
    s.adapter.backend = "Vulkan".to_owned();
    s.adapter.kind = "Cpu".to_owned();
    s.pairing.environment_skew_ms = Some(8.3);
    s.pairing.environment_skew_p50_ms = Some(8.3);
    s.pairing.environment_skew_p99_ms = Some(16.1);
    s.pairing.pose_skew_ms = Some(4.1);
    s.pairing.pose = PoseAnswer::Interpolated;
    s.registration.source = RegistrationSource::Tracker;
    s.lighting.compact_lights = 6;
    s.lighting.compact_sources = 2;
    s.lighting.age_ms = Some(8.3);
    s.lighting.clipped_fraction = Some(0.0042);
    s.lighting.exposures_disagree = Some(0.018);
    s.lighting.picture_difference = Some(0.031);
    s.lighting.picture_difference_sigma = Some(0.024);
    s.lighting.dominant_direction = Some([0.36, 0.48, 0.8]);
    s.planes = planes();
    white_balance(&mut s);
    s.devices = devices();
    s.warn("environment camera: sources are clipped; record bracketed exposures to measure them");
    s
}

/// Values as in Kakuta et al. 2007.
fn planes() -> PlanesStatus {
    PlanesStatus {
        planes: 38,
        planes_seen: 21,
        lights: 40,
        lights_skipped: 3,
        basis_images: 1387,
        basis_images_dropped: 133,
        bake_seconds: Some(4.2),
        bake_bytes: 12_300_000,
        ..PlanesStatus::default()
    }
}

fn white_balance(s: &mut Snapshot) {
    let gains = [1.312, 1.0, 0.744];
    let estimate = |method, gains| WhiteBalanceEstimate {
        method,
        gains,
        uncertainty: [0.004, 0.003, 0.006],
    };
    let b = &mut s.white_balance;
    b.method = WhiteBalanceMethod::Chart;
    b.gains = gains;
    b.uncertainty = Some([0.004, 0.003, 0.006]);
    b.disagreement = Some(0.013);
    b.estimates = vec![
        estimate(WhiteBalanceMethod::Chart, gains),
        estimate(WhiteBalanceMethod::Automatic, [1.329, 1.003, 0.739]),
    ];
    b.white = Some(WhiteMatch {
        scene: [0.61, 0.60, 0.58],
        environment_before: [0.465, 0.601, 0.781],
        environment_after: [0.610, 0.601, 0.581],
    });
}

fn devices() -> Vec<Device> {
    let mut scene = Device::new("scene/camera", DeviceKind::SceneCamera);
    scene.enter(DeviceState::Streaming, None);
    let mut environment = Device::new("environment/camera", DeviceKind::EnvironmentCamera);
    environment.enter(DeviceState::Streaming, None);
    environment.dropped = 3;
    let mut tracker = Device::new("/dev/ttyUSB0", DeviceKind::Tracker);
    tracker.enter(
        DeviceState::Silent,
        Some("/dev/ttyUSB0: silent for 1200 ms; check its cable and power"),
    );
    vec![scene, environment, tracker]
}

/// Renders a ball that rolls back and forth on a plane, with a soft shadow.
fn rolling_ball(frame: u64, visible: bool) -> Picture {
    let phase = frame as f64 / 20.0;
    let centre = (
        320.0 + 170.0 * phase.sin(),
        240.0 + 14.0 * (2.0 * phase).cos(),
    );
    let pixel = |i: u32| {
        let (x, y) = (f64::from(i % WIDTH), f64::from(i / WIDTH));
        shade(x, y, centre, visible)
    };
    let rgba = (0..WIDTH * HEIGHT).flat_map(pixel).collect();
    Picture {
        width: WIDTH,
        height: HEIGHT,
        rgba,
    }
}

fn shade(x: f64, y: f64, centre: (f64, f64), visible: bool) -> [u8; 4] {
    let (dx, dy) = ((x - centre.0) / 70.0, (y - centre.1) / 70.0);
    let r2 = dx * dx + dy * dy;
    let wall = y < 210.0;
    let mut light = if wall {
        0.75 - y / 900.0
    } else {
        0.42 + y / 1100.0
    };
    if visible && r2 < 1.0 {
        let facing = (0.75 - 0.5 * dx - 0.6 * dy) * (1.0 - r2 * 0.45);
        return tint(facing.clamp(0.08, 1.0), [1.0, 0.62, 0.28]);
    }
    if visible && !wall {
        let (sx, sy) = ((x - centre.0 - 34.0) / 105.0, (y - centre.1 - 72.0) / 36.0);
        light *= 1.0 - 0.6 * (-1.6 * (sx * sx + sy * sy)).exp();
    }
    tint(
        light,
        if wall {
            [0.82, 0.86, 0.92]
        } else {
            [0.95, 0.88, 0.76]
        },
    )
}

fn tint(light: f64, colour: [f64; 3]) -> [u8; 4] {
    let [r, g, b] = colour.map(|c| (255.0 * light * c).clamp(0.0, 255.0) as u8);
    [r, g, b, 255]
}

/// Renders the preview of a sky with a sun and a lamp above a brown ground, with its dome lights.
fn sky(height: u32) -> Picture {
    let sun = Vec3::new(0.36, 0.48, 0.8);
    let lamp = Vec3::new(0.5, -0.8, 0.33).normalize();
    let radiance = |d: Vec3| {
        let sky = Vec3::new(0.35, 0.5, 0.8) * (0.9 - 0.5 * d.z) + glow(d, sun, 60.0) * 9.0;
        let ground = Vec3::new(0.2, 0.15, 0.11) * (1.0 + 0.5 * d.z);
        let base = if d.z > 0.0 { sky } else { ground };
        base + Vec3::new(1.0, 0.7, 0.4) * glow(d, lamp, 300.0) * 6.0
    };
    let light = |direction: Vec3, strength: f32, kind| DomeLight {
        direction,
        irradiance: Vec3::splat(strength),
        angular_radius: 0.1,
        kind,
        place: LightPlace::FAR,
    };
    let rows = [(0.2_f32, 14_u32), (0.6, 12), (1.0, 8), (1.4, 3)];
    let cells = rows.iter().flat_map(|(up, count)| {
        (0..*count).map(move |i| {
            let around = (i as f32 + up) * std::f32::consts::TAU / *count as f32;
            Vec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin())
        })
    });
    let mut lights: Vec<_> = cells.map(|d| light(d, 0.1, LightKind::Cell)).collect();
    lights.push(light(sun, 1.6, LightKind::Compact));
    lights.push(light(lamp, 0.5, LightKind::Compact));
    environment_preview(height, radiance, &lights)
}

fn glow(d: Vec3, towards: Vec3, sharpness: f32) -> f32 {
    (sharpness * (d.dot(towards) - 1.0)).exp()
}
