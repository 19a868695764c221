//! The texels of pages: points of surfaces with their normals.

use crate::layout::{BORDERED, Layout, PAGE, Page, Plane, Receiver, TEXELS, texel_centre};
use glam::{IVec2, Vec2, Vec3};

/// Distance, in texels, by which texels may lie outside their triangles: bilinear interpolation
/// reads them.
const OUTSIDE: f32 = 1.5;

/// The texels of one page, row by row with the border.
#[derive(Clone, Debug)]
pub struct PageTexels {
    /// World, metres.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Whether a texel lies on the surface, or near enough to be read.
    pub is_used: Vec<bool>,
    /// The normal of all texels, if it is the same.
    pub plane: Option<Vec3>,
    /// Number of texels along each axis over which what changes slowly with place and normal may be
    /// interpolated.
    pub stride: usize,
}

/// Finds the texels of a page. `normals`: of the receiver's vertices, world; `receiver`: the one
/// to which the page belongs.
pub fn texels(layout: &Layout, page: &Page, receiver: &Receiver, normals: &[Vec3]) -> PageTexels {
    let mut texels = PageTexels {
        positions: vec![Vec3::ZERO; TEXELS],
        normals: vec![Vec3::Z; TEXELS],
        is_used: vec![false; TEXELS],
        plane: None,
        stride: 1,
    };
    let mut nearest = [f32::INFINITY; TEXELS];
    let frames = &layout.frames[page.receiver];
    let length = (1 << page.level) as f32 * layout.texel;
    let first_of = |chart: usize| texel_centre(layout, page, &frames[chart], IVec2::ZERO);
    for (c, t) in &page.triangles {
        let (chart, first) = (&receiver.charts[*c], first_of(*c));
        let corners = receiver.surface().corners(*t);
        let flat = Flat::new(corners.map(|p| (chart.axis.project(p) - first) / length));
        let at = 3 * *t as usize;
        let own = [0, 1, 2].map(|k| normals[receiver.indices[at + k] as usize]);
        let plane = Plane::through(corners);
        for (texel, index) in flat.near() {
            let (outside, weights) = flat.weights(texel.as_vec2());
            if outside >= nearest[index] || outside > OUTSIDE {
                continue;
            }
            nearest[index] = outside;
            texels.is_used[index] = true;
            let point = if outside > 0.0 {
                // Beyond its edges a face may continue inside another object.
                flat.inside(weights)
            } else {
                texel.as_vec2()
            };
            texels.positions[index] = plane.point_at(chart, first + point * length);
            let n = own[0] * weights[0] + own[1] * weights[1] + own[2] * weights[2];
            texels.normals[index] = n.normalize_or(own[0]);
        }
    }
    texels.flatten();
    if let (Some(_), Some((c, t))) = (texels.plane, page.triangles.first()) {
        let (chart, first) = (&receiver.charts[*c], first_of(*c));
        let plane = Plane::through(receiver.surface().corners(*t));
        for (index, texel) in all_texels().filter(|(k, _)| !texels.is_used[*k]) {
            let flat = first + texel.as_vec2() * length;
            texels.positions[index] = plane.point_at(chart, flat);
        }
    } else {
        texels.extend();
    }
    let strides = STRIDES.into_iter();
    let mut fine = strides.filter(|stride| texels.is_even_over(*stride, length));
    texels.stride = fine.next().unwrap_or(1);
    texels
}

/// All texels of a page with its border: index and coordinates.
fn all_texels() -> impl Iterator<Item = (usize, IVec2)> {
    (0..TEXELS).map(|k| {
        let (x, y) = (k % BORDERED, k / BORDERED);
        (k, IVec2::new(x as i32 - 1, y as i32 - 1))
    })
}

/// Difference of unit normals up to which they count as the same.
const SAME_NORMAL: f32 = 1e-4;

impl PageTexels {
    /// Finds out whether the texels lie in a plane, and if they do, extends it to the unused ones.
    fn flatten(&mut self) {
        let used = |k: &usize| self.is_used[*k];
        let Some(first) = (0..TEXELS).find(used) else {
            return;
        };
        let (origin, normal) = (self.positions[first], self.normals[first]);
        let is_same = |k: usize| {
            let height = (self.positions[k] - origin).dot(normal).abs();
            let across = self.positions[k].distance(origin);
            self.normals[k].distance(normal) < SAME_NORMAL && height <= SAME_NORMAL * across
        };
        if (0..TEXELS).filter(used).all(is_same) {
            self.plane = Some(normal);
            for k in (0..TEXELS).filter(|k| !self.is_used[*k]) {
                self.normals[k] = normal;
            }
        }
    }
}

/// Lengths of [`PageTexels::stride`] that are tried, longest first.
const STRIDES: [usize; 4] = [9, 6, 3, 2];
/// Difference of an interpolated place from the true one, in texels, and of a normal, up to which a
/// surface counts as even.
const EVEN: (f32, f32) = (1.6, 0.12);

/// The texels, along one axis, between which texel `at` is interpolated in steps of `stride`, and its
/// place between them, from 0 to 1.
#[inline(always)]
pub fn between(at: usize, stride: usize) -> ([usize; 2], f32) {
    const LAST: usize = BORDERED - 1;
    let low = (at / stride).min((LAST - 1) / stride) * stride;
    let high = (low + stride).min(LAST);
    ([low, high], (at - low) as f32 / (high - low) as f32)
}

impl PageTexels {
    /// Gives texels beyond the edge of a surface the place and the normal of the nearest one on it.
    fn extend(&mut self) {
        let mut is_known = self.is_used.clone();
        loop {
            let unknown = (0..TEXELS).filter(|k| !is_known[*k]);
            let nearest = |k: usize| neighbours(k).find(|n| is_known[*n]).map(|n| (k, n));
            let found: Vec<(usize, usize)> = unknown.filter_map(nearest).collect();
            if found.is_empty() {
                return;
            }
            for (k, known) in found {
                self.positions[k] = self.positions[known];
                self.normals[k] = self.normals[known];
                is_known[k] = true;
            }
        }
    }

    /// Whether places and normals of the used texels, `length` metres long, can be interpolated in
    /// steps of `stride`.
    fn is_even_over(&self, stride: usize, length: f32) -> bool {
        let mix = |values: &[Vec3], k: usize| {
            let ([left, right], fx) = between(k % BORDERED, stride);
            let ([top, bottom], fy) = between(k / BORDERED, stride);
            let row = |y: usize| values[y * BORDERED + left].lerp(values[y * BORDERED + right], fx);
            row(top).lerp(row(bottom), fy)
        };
        let is_near = |k: usize| {
            let moved = mix(&self.positions, k).distance(self.positions[k]);
            let turned = mix(&self.normals, k).distance(self.normals[k]);
            moved <= EVEN.0 * length && turned <= EVEN.1
        };
        let mut used = (0..TEXELS).filter(|k| self.is_used[*k]);
        self.plane.is_some() || used.all(is_near)
    }
}

/// The texels beside texel `k`, those with a common side first.
fn neighbours(k: usize) -> impl Iterator<Item = usize> {
    const SIDES: [[i32; 2]; 8] = [
        [-1, 0],
        [1, 0],
        [0, -1],
        [0, 1],
        [-1, -1],
        [1, -1],
        [-1, 1],
        [1, 1],
    ];
    let at = [k % BORDERED, k / BORDERED].map(|at| at as i32);
    let side = BORDERED as i32;
    SIDES.into_iter().filter_map(move |[x, y]| {
        let (x, y) = (at[0] + x, at[1] + y);
        let is_inside = (0..side).contains(&x) && (0..side).contains(&y);
        is_inside.then_some((y * side + x) as usize)
    })
}

/// A cone that holds all normals of a page.
#[derive(Clone, Copy, Debug)]
pub struct Cone {
    axis: Vec3,
    /// Sine of the angle between its axis and its surface, 1 for wider ones.
    sine: f32,
}

impl Cone {
    /// The cone about the used normals of a page.
    pub fn of(page: &PageTexels) -> Self {
        let normals = page.normals.iter().zip(&page.is_used);
        let normals = normals.filter_map(|(n, used)| used.then_some(*n));
        let axis = normals.clone().sum::<Vec3>().normalize_or_zero();
        let cosine = normals.fold(1.0, |least: f32, n| least.min(n.dot(axis)));
        let is_wide = cosine <= 0.0;
        let sine = if is_wide {
            1.0
        } else {
            (1.0 - cosine * cosine).max(0.0).sqrt()
        };
        Self { axis, sine }
    }

    /// Whether no surface with a normal in the cone faces a direction.
    #[inline(always)]
    pub fn is_behind(&self, direction: Vec3) -> bool {
        const ROUNDING: f32 = 1e-5;
        self.sine < 1.0 && self.axis.dot(direction) < -self.sine - ROUNDING
    }
}

/// A triangle in texel coordinates.
struct Flat {
    corners: [Vec2; 3],
    area: f32,
}

impl Flat {
    fn new(corners: [Vec2; 3]) -> Self {
        let [a, b, c] = corners;
        Self {
            corners,
            area: (b - a).perp_dot(c - a),
        }
    }

    /// The texels of the page about the triangle, with their indices.
    fn near(&self) -> impl Iterator<Item = (IVec2, usize)> + use<> {
        let [a, b, c] = self.corners;
        let low = (a.min(b).min(c) - OUTSIDE)
            .ceil()
            .max(Vec2::splat(-1.0))
            .as_ivec2();
        let last = Vec2::splat(PAGE as f32);
        let high = (a.max(b).max(c) + OUTSIDE).floor().min(last).as_ivec2();
        (low.y..=high.y).flat_map(move |y| {
            (low.x..=high.x).map(move |x| {
                (
                    IVec2::new(x, y),
                    (x + 1) as usize + BORDERED * (y + 1) as usize,
                )
            })
        })
    }

    /// The point nearest to one on the edge, with barycentric coordinates `on_edge`, that lies half a
    /// texel inside; in a slender triangle, well inside.
    fn inside(&self, on_edge: [f32; 3]) -> Vec2 {
        let [a, b, c] = self.corners;
        let edges = [c - b, a - c, b - a];
        let inset = edges.map(|edge| (0.5 * edge.length() / self.area.abs().max(1e-9)).min(0.25));
        let mut weights = [0, 1, 2].map(|k| on_edge[k].max(inset[k]));
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        a * weights[0] + b * weights[1] + c * weights[2]
    }

    /// Distance of a point outside the triangle, 0 inside, and the barycentric coordinates of the
    /// nearest point inside.
    fn weights(&self, p: Vec2) -> (f32, [f32; 3]) {
        let [a, b, c] = self.corners;
        let inside = [(b, c), (c, a), (a, b)].map(|(u, v)| (v - u).perp_dot(p - u) / self.area);
        if inside.iter().all(|w| *w >= 0.0) {
            return (0.0, inside);
        }
        let mut best = (f32::INFINITY, [1.0, 0.0, 0.0]);
        for k in 0..3 {
            let (u, v) = (self.corners[k], self.corners[(k + 1) % 3]);
            let along = ((p - u).dot(v - u) / (v - u).length_squared().max(1e-20)).clamp(0.0, 1.0);
            let distance = p.distance(u.lerp(v, along));
            if distance < best.0 {
                let mut weights = [0.0; 3];
                weights[k] = 1.0 - along;
                weights[(k + 1) % 3] = along;
                best = (distance, weights);
            }
        }
        best
    }
}
