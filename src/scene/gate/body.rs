//! The parts below the roof: platform, columns, beams, brackets, walls, doors.

use super::Detail;
use super::solids::{Solids, rectangle};
use glam::{Vec2, Vec3};

/// Height of the platform's upper side, metres.
const FLOOR: f32 = 0.48;
/// Half of the platform's width and depth, metres.
const PLATFORM: Vec2 = Vec2::new(2.75, 1.85);
/// Coordinates of the column axes, metres.
const ACROSS: [f32; 4] = [-2.05, -0.8, 0.8, 2.05];
const DEEP: [f32; 3] = [-1.2, 0.0, 1.2];
/// Height of the columns' tops, metres.
const TOP: f32 = 2.98;
const COLUMN: f32 = 0.15;

/// Platform, steps and the columns' bases.
pub(super) fn stone(detail: Detail) -> Solids {
    let mut out = Solids::default();
    let level = |out: &mut Solids, half: Vec2, from: f32, to: f32| {
        out.cuboid((-half).extend(from), half.extend(to));
    };
    level(&mut out, PLATFORM + 0.06, 0.0, 0.09);
    level(&mut out, PLATFORM - 0.05, 0.09, FLOOR - 0.1);
    level(&mut out, PLATFORM + 0.03, FLOOR - 0.1, FLOOR);
    pillars(&mut out);
    for side in [-1.0, 1.0] {
        steps(&mut out, side);
    }
    for (x, y) in columns() {
        let base =
            [(1.75, 0.0), (1.75, 0.03), (1.35, 0.07), (1.2, 0.08)].map(|(r, z)| (r * COLUMN, z));
        out.turned(Vec3::new(x, y, FLOOR - 0.005), &base, detail.column);
    }
    out
}

/// Upright stones between the platform's foot and its rim.
fn pillars(out: &mut Solids) {
    let half = PLATFORM - 0.03;
    let mut post = |x: f32, y: f32| {
        let at = Vec3::new(x, y, 0.0);
        out.cuboid(
            at + Vec3::new(-0.08, -0.03, 0.085),
            at + Vec3::new(0.08, 0.03, FLOOR - 0.095),
        );
    };
    for i in 0..7 {
        let x = (i as f32 / 3.0 - 1.0) * (half.x - 0.08);
        post(x, half.y);
        post(x, -half.y);
    }
    for i in 1..5 {
        let y = (i as f32 / 2.5 - 1.0) * half.y;
        for x in [-half.x, half.x] {
            out.cuboid(
                Vec3::new(x - 0.03, y - 0.08, 0.085),
                Vec3::new(x + 0.03, y + 0.08, FLOOR - 0.095),
            );
        }
    }
}

fn steps(out: &mut Solids, side: f32) {
    for i in 0..3 {
        let top = FLOOR * (3 - i) as f32 / 4.0;
        let near = PLATFORM.y + 0.02;
        let far = near + 0.28 * (i + 1) as f32;
        let (a, b) = (side * near, side * far);
        out.cuboid(
            Vec3::new(-0.85, a.min(b), 0.0),
            Vec3::new(0.85, a.max(b), top),
        );
    }
    for x in [-0.97, 0.97] {
        // A slanting side wall of the steps.
        let (near, far) = (PLATFORM.y + 0.02, PLATFORM.y + 0.95);
        let path = [
            Vec3::new(x, side * near, 0.0),
            Vec3::new(x, side * far, 0.0),
        ];
        let up = [
            Vec2::new(-0.11, 0.0),
            Vec2::new(0.11, 0.0),
            Vec2::new(0.11, 1.0),
            Vec2::new(-0.11, 1.0),
        ];
        let tall = |end: usize, p: Vec2| Vec2::new(p.x, p.y * if end == 0 { FLOOR } else { 0.1 });
        out.tapered(path, up.map(|p| tall(0, p)), up.map(|p| tall(1, p)));
    }
}

fn columns() -> impl Iterator<Item = (f32, f32)> {
    ACROSS
        .into_iter()
        .flat_map(|x| DEEP.into_iter().map(move |y| (x, y)))
}

/// Columns, beams and brackets.
pub(super) fn timber(out: &mut Solids, detail: Detail) {
    for (x, y) in columns() {
        column(out, x, y, detail);
        if y != 0.0 || x.abs() > 1.0 {
            bracket(out, x, y);
        }
    }
    beams(out);
    doorway(out);
}

/// A column with entasis (widest at a third of its height) and a rounded top.
fn column(out: &mut Solids, x: f32, y: f32, detail: Detail) {
    let foot = Vec3::new(x, y, FLOOR + 0.06);
    let height = TOP - foot.z;
    let profile: Vec<(f32, f32)> = (0..=detail.along)
        .map(|i| {
            let t = i as f32 / detail.along as f32;
            let swell = 1.0 + 0.05 * (1.0 - ((t - 0.33) / 0.67).powi(2))
                - 0.12 * (t - 0.4).max(0.0).powi(2);
            (
                COLUMN * swell * if i == detail.along { 0.86 } else { 1.0 },
                height * t.powf(0.9),
            )
        })
        .collect();
    out.turned(foot, &profile, detail.column);
}

fn beams(out: &mut Solids) {
    let end = COLUMN * 1.9;
    for y in DEEP {
        let at = |x: f32, z: f32| Vec3::new(x, y, z);
        out.beam(
            at(ACROSS[0] - end, TOP - 0.16),
            at(ACROSS[3] + end, TOP - 0.16),
            0.12,
            0.2,
        );
        out.beam(
            at(ACROSS[0] - 0.5, TOP + 0.62),
            at(ACROSS[3] + 0.5, TOP + 0.62),
            0.15,
            0.17,
        );
    }
    for x in ACROSS {
        let at = |y: f32, z: f32| Vec3::new(x, y, z);
        out.beam(
            at(DEEP[0] - end, TOP - 0.18),
            at(DEEP[2] + end, TOP - 0.18),
            0.11,
            0.19,
        );
        out.beam(
            at(DEEP[0] - 0.42, TOP + 0.61),
            at(DEEP[2] + 0.42, TOP + 0.61),
            0.14,
            0.16,
        );
    }
    for y in [DEEP[0] - 0.36, DEEP[2] + 0.36] {
        out.beam(
            Vec3::new(-2.55, y, TOP + 0.54),
            Vec3::new(2.55, y, TOP + 0.54),
            0.13,
            0.15,
        );
    }
    for x in [ACROSS[0] - 0.36, ACROSS[3] + 0.36] {
        out.beam(
            Vec3::new(x, -1.7, TOP + 0.535),
            Vec3::new(x, 1.7, TOP + 0.535),
            0.13,
            0.15,
        );
    }
}

/// Bearing block, crossed arms, and a small block on each of their ends.
fn bracket(out: &mut Solids, x: f32, y: f32) {
    let at = |dx: f32, dy: f32, z: f32| Vec3::new(x + dx, y + dy, TOP + z);
    block(out, at(0.0, 0.0, -0.01), 0.17, 0.19);
    for across in [true, false] {
        arm(
            out,
            at(0.0, 0.0, 0.25),
            if across { Vec3::X } else { Vec3::Y },
            0.44,
        );
    }
    for (dx, dy) in [
        (0.0, 0.0),
        (0.36, 0.0),
        (-0.36, 0.0),
        (0.0, 0.36),
        (0.0, -0.36),
    ] {
        block(out, at(dx, dy, 0.325), 0.095, 0.13);
    }
}

/// A block whose lower half tapers.
fn block(out: &mut Solids, foot: Vec3, half: f32, height: f32) {
    let level = |z: f32, scale: f32| (foot + Vec3::Z * z * height, scale);
    let levels = [
        level(0.0, 0.7),
        level(0.2, 0.78),
        level(0.42, 1.0),
        level(1.0, 1.0),
    ];
    out.stack(&levels, &rectangle(half, half));
}

/// A bracket arm: boat-shaped from the side.
fn arm(out: &mut Solids, middle: Vec3, along: Vec3, half: f32) {
    let side = Vec3::Z.cross(along);
    let outline = [
        (-0.62, -0.085),
        (0.62, -0.085),
        (0.8, -0.065),
        (0.93, -0.02),
        (1.0, 0.04),
        (1.0, 0.085),
        (-1.0, 0.085),
        (-1.0, 0.04),
        (-0.93, -0.02),
        (-0.8, -0.065),
    ]
    .map(|(x, z): (f32, f32)| Vec2::new(x * half, z));
    // Swept sideways, so that the outline's X axis lies along the arm.
    let path = [middle + side * 0.06, middle - side * 0.06];
    out.sweep(&path, Vec3::Z, &outline, |_| 1.0);
}

fn doorway(out: &mut Solids) {
    let sides = [ACROSS[1] + COLUMN, ACROSS[2] - COLUMN];
    for x in sides {
        let inwards = -x.signum() * 0.07;
        out.cuboid(
            Vec3::new(x.min(x + inwards), -0.08, FLOOR),
            Vec3::new(x.max(x + inwards), 0.08, 2.5),
        );
    }
    out.cuboid(Vec3::new(-0.8, -0.09, 2.42), Vec3::new(0.8, 0.09, 2.56));
    out.cuboid(
        Vec3::new(-0.8, -0.07, FLOOR),
        Vec3::new(0.8, 0.07, FLOOR + 0.07),
    );
    for [from, to] in [[ACROSS[0], ACROSS[1]], [ACROSS[2], ACROSS[3]]] {
        for z in [FLOOR + 0.06, 1.12, 2.3] {
            out.cuboid(
                Vec3::new(from, -0.07, z - 0.06),
                Vec3::new(to, 0.07, z + 0.06),
            );
        }
    }
    for x in [ACROSS[0], ACROSS[3]] {
        for z in [FLOOR + 0.06, 1.12, 2.3] {
            out.cuboid(
                Vec3::new(x - 0.065, DEEP[0], z - 0.06),
                Vec3::new(x + 0.065, DEEP[2], z + 0.06),
            );
        }
    }
}

/// White walls between the columns, and between the brackets.
pub(super) fn plaster(out: &mut Solids) {
    for [from, to] in [[ACROSS[0], ACROSS[1]], [ACROSS[2], ACROSS[3]]] {
        out.cuboid(
            Vec3::new(from, -0.04, FLOOR),
            Vec3::new(to, 0.04, TOP - 0.2),
        );
    }
    out.cuboid(
        Vec3::new(-0.75, -0.04, 2.54),
        Vec3::new(0.75, 0.04, TOP - 0.2),
    );
    for x in [ACROSS[0], ACROSS[3]] {
        out.cuboid(
            Vec3::new(x - 0.04, DEEP[0], FLOOR),
            Vec3::new(x + 0.04, DEEP[2], TOP - 0.2),
        );
        out.cuboid(
            Vec3::new(x - 0.03, DEEP[0], TOP - 0.08),
            Vec3::new(x + 0.03, DEEP[2], TOP + 0.55),
        );
    }
    for y in [DEEP[0], DEEP[2]] {
        out.cuboid(
            Vec3::new(ACROSS[0], y - 0.03, TOP - 0.07),
            Vec3::new(ACROSS[3], y + 0.03, TOP + 0.56),
        );
    }
}

/// Upright green bars before the side walls' windows.
pub(super) fn lattice() -> Solids {
    let mut out = Solids::default();
    for [from, to] in [[ACROSS[0], ACROSS[1]], [ACROSS[2], ACROSS[3]]] {
        let (from, to) = (from + COLUMN, to - COLUMN);
        for i in 1..=10 {
            let x = from + (to - from) * i as f32 / 11.0;
            let at = |z: f32| Vec3::new(x, 0.0, z);
            // Set on edge, as in the historic temples.
            let turned = [(0.0, -0.055), (0.03, 0.0), (0.0, 0.055), (-0.03, 0.0)]
                .map(|(x, y)| Vec2::new(x, y));
            out.stack(&[(at(1.17), 1.0), (at(2.25), 1.0)], &turned);
        }
    }
    out
}

/// Two leaves, open inwards, with their studs.
pub(super) fn doors(detail: Detail) -> (Solids, Solids) {
    let (mut leaves, mut studs) = (Solids::default(), Solids::default());
    for side in [-1.0, 1.0] {
        let hinge = Vec3::new(side * (0.8 - COLUMN - 0.09), 0.1, FLOOR + 0.08);
        let along = Vec3::new(side * 0.12, 0.99, 0.0).normalize();
        let (width, height) = (0.56, 1.85);
        let middle = Vec3::Z * (height / 2.0);
        leaves.sweep(
            &[hinge + middle, hinge + along * width + middle],
            Vec3::Z,
            &rectangle(0.03, height / 2.0),
            |_| 1.0,
        );
        let out_of = Vec3::Z.cross(along);
        for row in 0..5 {
            for column in 0..4 {
                let at = hinge
                    + along * width * (column as f32 + 0.6) / 4.2
                    + Vec3::Z * height * (row as f32 + 0.5) / 5.0;
                for face in [-1.0, 1.0] {
                    let path = [
                        at + out_of * face * 0.028,
                        at + out_of * face * 0.045,
                        at + out_of * face * 0.055,
                    ];
                    studs.sweep(
                        &path,
                        Vec3::Z,
                        &super::solids::circle(0.03, detail.tile),
                        |i| [1.0, 0.8, 0.35][i],
                    );
                }
            }
        }
    }
    (leaves, studs)
}
