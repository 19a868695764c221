//! The light of lamps on small bumps without a proxy: a synthetic height field in known light,
//! compared with its ground truth under the lamp.
//!
//! `cargo test --test compositor relief -- --nocapture` prints the table.

use crate::stage::{Stage, cell, lighting, looking_from, sun};
use glam::{DVec2, DVec3, Vec3};
use penumbra_compositor::Compositor;
use penumbra_lighting::{BrightestLight, DomeLight};
use penumbra_picture::Picture;
use penumbra_scene::{LampResponse, PlacedLamp};
use std::f32::consts::PI;

const WIDTH: u32 = 128;
const HEIGHT: u32 = 96;

/// The surface in front of the camera.
#[derive(Clone, Copy)]
struct Bumps {
    /// Reflectance of the squares of either colour.
    albedo: [f32; 2],
}

impl Bumps {
    /// Normal of a field of bumps and hollows 5 cm apart, no steeper than 15°.
    fn normal(x: f64, y: f64) -> Vec3 {
        const WAVE: f64 = std::f64::consts::TAU / 0.05;
        const STEEP: f64 = 0.26;
        let (sx, cx) = (WAVE * x).sin_cos();
        let (sy, cy) = (WAVE * y).sin_cos();
        DVec3::new(STEEP * sx * cy, STEEP * cx * sy, 1.0)
            .normalize()
            .as_vec3()
    }

    fn reflects(self, x: f64, y: f64) -> f32 {
        let odd = ((x / 0.08).floor() + (y / 0.08).floor()).rem_euclid(2.0) == 1.0;
        self.albedo[usize::from(odd)]
    }

    /// Linear light under `lights`, white = 1.
    fn shown(self, x: f64, y: f64, lights: &[DomeLight]) -> Vec3 {
        let n = Self::normal(x, y);
        let each = lights
            .iter()
            .map(|l| l.irradiance * n.dot(l.direction).max(0.0));
        each.sum::<Vec3>() * self.reflects(x, y) / PI
    }
}

/// The points of the table that pixels show.
fn points(stage: &Stage) -> Vec<DVec2> {
    let pose = stage.pose.unwrap();
    let pixels = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| (u, v)));
    pixels
        .map(|(u, v)| {
            let at = DVec2::new(f64::from(u), f64::from(v));
            let ray = pose.rotation * stage.camera.unproject(at);
            let foot = pose.translation - ray * (pose.translation.z / ray.z);
            foot.truncate()
        })
        .collect()
}

fn rendered(stage: &Stage, bumps: Bumps, lights: &[DomeLight]) -> Picture {
    let codes = |p: &DVec2| {
        let light = bumps.shown(p.x, p.y, lights).to_array();
        let [r, g, b] = light.map(|v| stage.response.code_from_linear(v));
        [r, g, b, 255]
    };
    Picture {
        width: WIDTH,
        height: HEIGHT,
        rgba: points(stage).iter().flat_map(codes).collect(),
    }
}

fn towards(azimuth: f32, height: f32) -> Vec3 {
    let (sin, cos) = azimuth.to_radians().sin_cos();
    let (up, out) = height.to_radians().sin_cos();
    Vec3::new(out * cos, out * sin, up)
}

/// Agreement of the added light with the ground truth.
#[derive(Clone, Copy, Debug)]
struct Agreement {
    /// Correlation over all pixels.
    correlation: f64,
    /// Root mean square error, as a fraction of the ground truth's mean.
    error: f64,
}

fn agreement(added: &[f64], truth: &[f64]) -> Agreement {
    let count = truth.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / count;
    let (a, t) = (mean(added), mean(truth));
    let product = |x: &[f64], y: &[f64], mx: f64, my: f64| {
        x.iter()
            .zip(y)
            .map(|(x, y)| (x - mx) * (y - my))
            .sum::<f64>()
            / count
    };
    let (aa, tt) = (product(added, added, a, a), product(truth, truth, t, t));
    Agreement {
        correlation: product(added, truth, a, t) / (aa * tt).sqrt().max(1e-12),
        error: (product(added, added, 0.0, 0.0) - 2.0 * product(added, truth, 0.0, 0.0)
            + product(truth, truth, 0.0, 0.0))
        .sqrt()
            / t,
    }
}

/// Elevation of the lights above the horizon, degrees; low, so that opposite lights are nearly
/// antiparallel.
const ELEVATION: f32 = 25.0;

/// Mean reflectance of both surfaces, which is all that the proxy contains.
const MEAN: f32 = 0.5;

/// The flat proxy, from above.
fn table() -> Stage {
    let mut stage = Stage::new(WIDTH, HEIGHT);
    stage.pose = Some(looking_from(DVec3::new(0.0, -0.05, 0.6), DVec3::ZERO));
    stage.scene.phantom_parts[0].albedo = Some(Vec3::splat(MEAN));
    stage
}

/// Agreement of flat blending, the paper's response and the intrinsic response, for a lamp
/// `azimuth` degrees from the sun.
fn responses(on: &mut Compositor, bumps: Bumps, azimuth: f32, sky: f32) -> [Agreement; 3] {
    let mut lights = vec![sun(towards(0.0, ELEVATION), Vec3::splat(3.0))];
    if sky > 0.0 {
        lights.push(cell(Vec3::Z, Vec3::splat(sky)));
    }
    let mut stage = table().lit(lighting(lights.clone(), 0.0));
    stage.picture = rendered(&stage, bumps, &lights);
    let to = towards(azimuth, ELEVATION);
    let strength = 1.0;
    // Distant: the same irradiance everywhere.
    stage.lamps = vec![PlacedLamp {
        position: to * 100.0,
        direction: -to,
        intensity: Vec3::splat(strength * 1e4),
        cone: None,
        area: None,
    }];
    let lamp = [sun(to, Vec3::splat(strength))];
    let truth: Vec<f64> = points(&stage)
        .iter()
        .map(|p| f64::from(bumps.shown(p.x, p.y, &lamp).y))
        .collect();
    let green = |picture: &Picture| -> Vec<f64> {
        let linear = |p: &[u8]| stage.response.linear_from_rgb([p[0], p[1], p[2]])[1];
        let pixels = picture.rgba.chunks_exact(4);
        pixels.map(|p| f64::from(linear(p))).collect()
    };
    let before = green(&stage.picture);
    let brightest = BrightestLight::from_lights(&lights).vector();
    let flat = (LampResponse::Paper, Vec3::ZERO);
    let paper = (LampResponse::Paper, brightest);
    let intrinsic = (LampResponse::Intrinsic, Vec3::ZERO);
    [flat, paper, intrinsic].map(|(response, brightest)| {
        let mut stage = stage.clone();
        stage.lamp_response = response;
        stage.brightest = brightest;
        let after = green(&stage.compose_with(on));
        let added: Vec<f64> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
        agreement(&added, &truth)
    })
}

const PLAIN: Bumps = Bumps { albedo: [MEAN; 2] };
const CHEQUERED: Bumps = Bumps {
    albedo: [0.35, 0.65],
};

#[test]
fn papers_response_reproduces_relief_beside_and_opposite_to_the_sun() {
    let on = &mut table().compositor();
    println!("| surface | sky | lamp beside the sun | flat | paper | intrinsic |");
    println!("|---|---|---|---|---|---|");
    for (name, bumps) in [("plain", PLAIN), ("chequered", CHEQUERED)] {
        for sky in [0.0, 0.6] {
            for azimuth in [0.0, 45.0, 90.0, 180.0] {
                let cells = responses(on, bumps, azimuth, sky)
                    .map(|j| format!("{:+.2}, {:.0} %", j.correlation, 100.0 * j.error));
                println!("| {name} | {sky} | {azimuth}° | {} |", cells.join(" | "));
            }
        }
    }
    for sky in [0.0, 0.6] {
        let [flat, paper, intrinsic] = responses(on, PLAIN, 0.0, sky);
        // The proxy is flat: blending adds no relief.
        assert!(flat.correlation.abs() < 0.1, "{flat:?}");
        assert!(paper.correlation > 0.95 && intrinsic.correlation > 0.95);
        assert!(intrinsic.error < 0.5 * flat.error, "{intrinsic:?} {flat:?}");
        let [flat, paper, intrinsic] = responses(on, PLAIN, 180.0, sky);
        assert!(flat.correlation.abs() < 0.1, "{flat:?}");
        assert!(paper.correlation > 0.8, "{paper:?}");
        // Multiplied, the relief remains lit from the sun's side.
        assert!(intrinsic.correlation < -0.8, "{intrinsic:?}");
    }
}

/// A picture does not distinguish paint from relief: inverted, dark squares become bright.
#[test]
fn intrinsic_response_is_correct_on_paint_and_the_inverse_is_not() {
    let on = &mut table().compositor();
    let [_, paper, intrinsic] = responses(on, CHEQUERED, 180.0, 0.6);
    assert!(paper.correlation < -0.1 && intrinsic.correlation > 0.1);
    let [flat, _, intrinsic] = responses(on, CHEQUERED, 0.0, 0.0);
    assert!(intrinsic.correlation > 0.95 && intrinsic.error < 0.3 * flat.error);
}
