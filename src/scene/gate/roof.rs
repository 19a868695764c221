//! The roof: hip-and-gable (irimoya), of round tiles over flat ones.

use super::Detail;
use super::solids::{Solids, circle, rectangle};
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Half of the roof's width (along the ridge) and depth at the eaves.
pub(super) const EAVES: Vec2 = Vec2::new(3.0, 2.15);
/// Height of the eaves' upper side, metres.
const EAVES_Z: f32 = 3.56;
/// Height from the eaves to the ridge, metres.
const RISE: f32 = 1.72;
/// Share of the rise that is linear; the rest is a parabola, so that the roof is concave.
const STRAIGHT: f32 = 0.36;
/// Lift of the corners, metres.
const CORNER_LIFT: f32 = 0.24;
/// Distance of the gables from the centre, metres.
const GABLE: f32 = 1.95;
/// Distance of the upper roof's end from the centre, metres.
const VERGE: f32 = 2.2;
/// Depth of the skirt roof beneath the gables.
const SKIRT: f32 = EAVES.x - GABLE;
/// Thickness of the roof's boards and flat tiles, metres.
const THICKNESS: f32 = 0.09;
/// Distance between rows of round tiles, metres.
const ROW: f32 = 0.16;
/// Radius of a round tile, metres.
const TILE: f32 = 0.052;

/// Height of the roof's surface at `depth` metres from an eave.
fn slope(depth: f32) -> f32 {
    let share = depth / EAVES.y;
    EAVES_Z + RISE * (STRAIGHT * share + (1.0 - STRAIGHT) * share * share)
}

/// Point of the roof's surface at (x, y), `depth` metres from the nearest eave.
pub(super) fn surface(x: f32, y: f32, depth: f32) -> Vec3 {
    let lift = CORNER_LIFT * ((x / EAVES.x).abs().powi(5) * (y / EAVES.y).abs().powi(5));
    Vec3::new(x, y, slope(depth) + lift)
}

/// Rotation of a part built for the front (towards −Y) or the right side to the opposite side.
type Turn = fn(Vec3) -> Vec3;
const FRONT: Turn = |p| p;
const BACK: Turn = |p| Vec3::new(-p.x, -p.y, p.z);

/// A point of the front roof, `along` the eave and `depth` up from it.
fn front(along: f32, depth: f32) -> Vec3 {
    surface(along, depth - EAVES.y, depth)
}

/// A point of the right-hand roof, `along` its eave towards +Y.
fn right(along: f32, depth: f32) -> Vec3 {
    surface(EAVES.x - depth, along, depth)
}

/// The tiled parts.
pub(super) fn tiles(detail: Detail) -> Solids {
    let mut out = Solids::default();
    for turn in [FRONT, BACK] {
        shells(&mut out, detail, turn);
        rows(&mut out, detail, turn);
    }
    hips(&mut out, detail);
    ridge(&mut out, detail);
    out
}

fn shells(out: &mut Solids, detail: Detail, turn: Turn) {
    let down = Vec3::NEG_Z * THICKNESS;
    let n = detail.along;
    let spread = |u: f32| 2.0 * u - 1.0;
    // The skirts narrow along the hips; the upper roof overlaps the front one by a little.
    out.plate(2 * n, n, down, |u, v| {
        turn(front(spread(u) * (EAVES.x - v * SKIRT), v * SKIRT))
    });
    out.plate(2 * n, n, down, |u, v| {
        turn(right(spread(u) * (EAVES.y - v * SKIRT), v * SKIRT))
    });
    let upper = |v: f32| SKIRT - 0.01 + v * (EAVES.y - SKIRT + 0.01);
    out.plate(n, n, down, |u, v| turn(front(spread(u) * VERGE, upper(v))));
}

fn rows(out: &mut Solids, detail: Detail, turn: Turn) {
    let count = (EAVES.x / ROW) as i32;
    for i in -count..=count {
        let x = i as f32 * ROW;
        if x.abs() <= GABLE {
            row(out, detail, turn, |d| front(x, d), 0.0, EAVES.y);
            continue;
        }
        row(out, detail, turn, |d| front(x, d), 0.0, EAVES.x - x.abs());
        if x.abs() < VERGE {
            row(out, detail, turn, |d| front(x, d), SKIRT, EAVES.y);
        }
    }
    let count = (EAVES.y / ROW) as i32;
    for i in -count..=count {
        let y = i as f32 * ROW;
        let top = (EAVES.y - y.abs()).min(SKIRT);
        row(out, detail, turn, |d| right(y, d), 0.0, top);
    }
}

/// A row of round tiles up the roof, with the disc that ends it at the eave.
fn row(
    out: &mut Solids,
    detail: Detail,
    turn: Turn,
    place: impl Fn(f32) -> Vec3,
    from: f32,
    to: f32,
) {
    if to - from < 0.12 {
        return;
    }
    let steps = ((to - from) / EAVES.y * 2.0 * detail.along as f32)
        .ceil()
        .max(2.0) as usize;
    let at = |i: usize| from + (to - from) * i as f32 / steps as f32;
    let path: Vec<Vec3> = (0..=steps).map(|i| turn(place(at(i)))).collect();
    out.sweep(&path, Vec3::Z, &circle(TILE, detail.tile), |_| 1.0);
    if from == 0.0 {
        let out_of_eave = (path[0] - path[1]).normalize_or(Vec3::X) * 0.035;
        let disc = circle(TILE * 1.35, 2 * detail.tile);
        out.sweep(&[path[0] + out_of_eave, path[0]], Vec3::Z, &disc, |_| 1.0);
    }
}

/// Section of a ridge: upright, with a round top.
fn ridge_section(half_width: f32, height: f32, segments: u32) -> Vec<Vec2> {
    let mut out = vec![Vec2::new(-half_width, 0.0), Vec2::new(half_width, 0.0)];
    let top = height - half_width;
    let cap = |i: u32| Vec2::from_angle(PI * i as f32 / segments as f32) * half_width * 0.8;
    out.push(Vec2::new(half_width, top));
    out.extend((0..=segments).map(|i| cap(i) + Vec2::Y * top));
    out.push(Vec2::new(-half_width, top));
    out
}

/// Ridges down the hips and the gables.
fn hips(out: &mut Solids, detail: Detail) {
    let n = detail.along as usize;
    let section = ridge_section(0.085, 0.2, detail.tile);
    for (sx, sy) in [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)] {
        let hip = |i: usize| {
            let depth = (SKIRT + 0.08) * (1.0 - i as f32 / n as f32) - 0.02;
            let p = surface(
                sx * (EAVES.x - depth),
                sy * (EAVES.y - depth),
                depth.max(0.0),
            );
            // The lower end is raised.
            p + Vec3::Z * 0.05 * (i as f32 / n as f32).powi(6)
        };
        let path: Vec<Vec3> = (0..=n).map(hip).collect();
        out.sweep(&path, Vec3::Z, &section, |_| 1.0);
        ornament(out, path[n], path[n] - path[n - 1], 0.8);
        let verge = |i: usize| {
            let depth = EAVES.y - 0.1 - (EAVES.y - 0.1 - SKIRT + 0.25) * i as f32 / n as f32;
            surface(sx * (VERGE - 0.14), sy * (EAVES.y - depth), depth)
        };
        let path: Vec<Vec3> = (0..=n).map(verge).collect();
        out.sweep(&path, Vec3::Z, &section, |_| 1.0);
        ornament(out, path[n], path[n] - path[n - 1], 0.9);
    }
}

/// The shield that ends a ridge (onigawara).
fn ornament(out: &mut Solids, at: Vec3, ahead: Vec3, size: f32) {
    let ahead = ahead.reject_from(Vec3::Z).normalize_or(Vec3::X);
    let shield = [
        (-0.15, -0.05),
        (0.15, -0.05),
        (0.17, 0.1),
        (0.13, 0.24),
        (0.07, 0.3),
        (0.0, 0.36),
        (-0.07, 0.3),
        (-0.13, 0.24),
        (-0.17, 0.1),
    ]
    .map(|(x, y)| Vec2::new(x, y) * size);
    out.sweep(
        &[at - ahead * 0.02, at + ahead * 0.06],
        Vec3::Z,
        &shield,
        |_| 1.0,
    );
}

/// The main ridge with its fishtail ornaments (shibi).
fn ridge(out: &mut Solids, detail: Detail) {
    // Longer than a slope.
    let n = detail.along as usize + 3;
    let z = slope(EAVES.y) - 0.03;
    let along = |i: usize| {
        let x = VERGE * (2.0 * i as f32 / n as f32 - 1.0);
        // It sags in the centre, as the eaves do.
        Vec3::new(x, 0.0, z + 0.07 * (x / VERGE).powi(2))
    };
    let path: Vec<Vec3> = (0..=n).map(along).collect();
    out.sweep(
        &path,
        Vec3::Z,
        &ridge_section(0.13, 0.4, detail.tile),
        |_| 1.0,
    );
    for side in [-1.0, 1.0] {
        fishtail(
            out,
            detail,
            Vec3::new(side * (VERGE - 0.12), 0.0, z + 0.3),
            side,
        );
        ornament(
            out,
            Vec3::new(side * VERGE, 0.0, z + 0.12),
            Vec3::X * side,
            0.85,
        );
    }
}

/// A horn that rises from the ridge's end and curls inwards.
fn fishtail(out: &mut Solids, detail: Detail, foot: Vec3, side: f32) {
    let n = detail.along.max(6) as usize;
    let at = |i: usize| {
        let t = i as f32 / n as f32;
        let angle = t * 1.75;
        foot + Vec3::new(
            side * (0.12 * angle.sin() - 0.3 * t * t),
            0.0,
            0.62 * (angle * 0.9).sin(),
        )
    };
    let path: Vec<Vec3> = (0..=n).map(at).collect();
    let section: Vec<Vec2> = circle(1.0, 2 * detail.tile)
        .iter()
        .map(|p| Vec2::new(p.x * 0.19, p.y * 0.1))
        .collect();
    out.sweep(&path, Vec3::Y, &section, |i| {
        let t = i as f32 / n as f32;
        1.0 - 0.8 * t.powf(1.6)
    });
}

/// White boards that close the gables.
pub(super) fn gables(out: &mut Solids, detail: Detail) {
    let n = 2 * detail.along;
    for side in [-1.0, 1.0] {
        let half = EAVES.y - SKIRT;
        let foot = slope(SKIRT) - THICKNESS;
        let wall = |u: f32, v: f32| {
            let y = side * half * (2.0 * u - 1.0);
            let top = slope(EAVES.y - y.abs()) - THICKNESS * 0.5;
            Vec3::new(
                side * (GABLE + 0.02),
                y,
                foot - 0.02 + (top - foot + 0.02) * v,
            )
        };
        out.plate(n, 1, Vec3::X * side * -0.06, wall);
    }
}

/// The wooden parts: rafters, fascia boards, bargeboards.
pub(super) fn wood(out: &mut Solids, tips: &mut Solids, detail: Detail) {
    for turn in [FRONT, BACK] {
        let count = (EAVES.x / 0.2) as i32;
        for i in -count..=count {
            let x = i as f32 * 0.2;
            let deep = (EAVES.x - x.abs() - 0.02).min(1.15);
            rafter(out, tips, turn, |d| front(x, d), deep);
        }
        let count = (EAVES.y / 0.2) as i32;
        for i in -count..=count {
            let y = i as f32 * 0.2;
            let deep = (EAVES.y - y.abs() - 0.02).min(1.1);
            rafter(out, tips, turn, |d| right(y, d), deep);
        }
        fascia(out, detail, |u| turn(front(u * EAVES.x * 0.99, 0.05)));
        fascia(out, detail, |u| turn(right(u * EAVES.y * 0.99, 0.05)));
        let n = detail.along as usize;
        for side in [-1.0, 1.0] {
            let at = |i: usize| {
                let depth = SKIRT - 0.1 + (EAVES.y - SKIRT + 0.1) * i as f32 / n as f32;
                turn(front(side * (VERGE - 0.03), depth)) - Vec3::Z * (THICKNESS + 0.07)
            };
            let path: Vec<Vec3> = (0..=n).map(at).collect();
            out.sweep(&path, Vec3::Z, &rectangle(0.03, 0.09), |_| 1.0);
        }
    }
}

fn fascia(out: &mut Solids, detail: Detail, at: impl Fn(f32) -> Vec3) {
    let n = 2 * detail.along as usize;
    let drop = Vec3::Z * (THICKNESS + 0.035);
    let path: Vec<Vec3> = (0..=n)
        .map(|i| at(2.0 * i as f32 / n as f32 - 1.0) - drop)
        .collect();
    out.sweep(&path, Vec3::Z, &rectangle(0.04, 0.04), |_| 1.0);
}

/// A rafter beneath the eave, with its painted end.
fn rafter(out: &mut Solids, tips: &mut Solids, turn: Turn, place: impl Fn(f32) -> Vec3, deep: f32) {
    if deep < 0.2 {
        return;
    }
    let drop = Vec3::Z * (THICKNESS + 0.105);
    let path: Vec<Vec3> = (0..4)
        .map(|i| turn(place(0.1 + (deep - 0.1) * i as f32 / 3.0)) - drop)
        .collect();
    let section = rectangle(0.035, 0.045);
    out.sweep(&path, Vec3::Z, &section, |_| 1.0);
    let ahead = (path[0] - path[1]).normalize_or(Vec3::X);
    tips.sweep(
        &[path[0] + ahead * 0.012, path[0] + ahead * 0.001],
        Vec3::Z,
        &section,
        |_| 1.02,
    );
}
