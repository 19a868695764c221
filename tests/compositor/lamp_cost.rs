//! Cost of lamps by their number. Prints times and checks nothing, as times depend on the machine.
//! `cargo nextest run -p penumbra --test compositor lamp_cost --run-ignored all --no-capture`

use crate::stage::{Stage, cell, flat, lighting, looking_from, part};
use glam::{DVec3, Vec3};
use penumbra_scene::{PlacedArea, PlacedLamp, primitives};
use std::collections::BTreeMap;

/// Composed pictures per number of lamps; the fastest counts, as the machine may be busy.
const PICTURES: usize = 12;

/// Lamps distributed over the entire table, every second one a spot.
fn lamps(count: usize) -> Vec<PlacedLamp> {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    (0..count)
        .map(|i| {
            let r = 0.6 * ((i as f32 + 0.5) / count as f32).sqrt();
            let (sin, cos) = (golden * i as f32).sin_cos();
            PlacedLamp {
                position: Vec3::new(r * cos, r * sin, 0.3),
                direction: Vec3::NEG_Z,
                intensity: Vec3::splat(0.6 / count as f32),
                cone: (i % 2 == 1).then_some((0.3, 0.5)),
                area: None,
            }
        })
        .collect()
}

fn desk() -> Stage {
    let mut stage = Stage::new(640, 480)
        .with_virtual(part(
            primitives::sphere(0.05, 48, 24),
            DVec3::new(-0.1, 0.0, 0.05),
        ))
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.08, 0.08, 0.12)),
            DVec3::new(0.1, 0.05, 0.0),
        ))
        .with_phantom(part(
            primitives::cuboid(Vec3::splat(0.06)),
            DVec3::new(0.0, -0.15, 0.0),
        ))
        .lit(lighting(vec![cell(Vec3::Z, Vec3::new(2.0, 1.8, 1.5))], 0.0));
    stage.picture = flat(640, 480, [90, 80, 70]);
    stage.pose = Some(looking_from(DVec3::new(0.05, -0.7, 0.6), DVec3::ZERO));
    stage
}

/// Minimum milliseconds of each pass.
fn cost(stage: &Stage) -> BTreeMap<&'static str, f64> {
    let mut compositor = stage.compositor();
    let mut minimum = BTreeMap::new();
    for _ in 0..PICTURES {
        let _ = stage.compose_with(&mut compositor);
        for (pass, ms) in compositor.pass_times() {
            let known = minimum.entry(pass).or_insert(f64::INFINITY);
            *known = ms.min(*known);
        }
    }
    minimum
}

/// Rectangles above the table, facing straight down.
fn areas(count: usize) -> Vec<PlacedLamp> {
    let area = |mut lamp: PlacedLamp| {
        lamp.cone = None;
        lamp.area = Some(PlacedArea {
            half_right: Vec3::X * 0.1,
            half_up: Vec3::Y * 0.08,
            two_sided: false,
            screen: 0,
        });
        lamp
    };
    lamps(count).into_iter().map(area).collect()
}

#[test]
#[ignore = "prints times, and takes a minute"]
fn cost_of_lamps_by_number() {
    const PASSES: [&str; 5] = [
        "lamp_map",
        "tiles",
        "phantom_shadow",
        "virtual_light",
        "composite",
    ];
    type Lamps = fn(usize) -> Vec<PlacedLamp>;
    let kinds: [(&str, Lamps); 2] = [("lamps", lamps), ("areas", areas)];
    // Hard and soft shadows.
    for (soft, (kind, lamps)) in [1, 4]
        .into_iter()
        .flat_map(|soft| kinds.map(|kind| (soft, kind)))
    {
        for count in [0, 1, 2, 4, 8, 16, 32] {
            if count > 8 && kind == "areas" {
                continue;
            }
            let mut stage = desk();
            stage.settings.soft_samples = soft;
            stage.lamps = lamps(count);
            let cost = cost(&stage);
            let each = PASSES.map(|p| format!("{p} {:.1}", cost.get(p).unwrap_or(&0.0)));
            let sum: f64 = cost
                .iter()
                .filter(|c| *c.0 != "lamp_map")
                .map(|c| c.1)
                .sum();
            println!(
                "{soft} look-ups, {count} {kind}: {sum:.1} ms; {}",
                each.join(", ")
            );
        }
    }
}
