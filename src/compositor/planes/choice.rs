//! Chooses for each texel of the surface cache the two planes from which it takes its light, once
//! for a bake and a scene: pictures then look up two planes, not all of them.

use super::receiver::MAX_DEPTH_CODE;
use super::visible_planes::VisiblePlane;
use glam::{Vec2, Vec3, Vec4, Vec4Swizzles};
use penumbra_interface::threads;
use penumbra_scene::planes::ReceiverImage;
use penumbra_surface_cache::{Layer, ReceiverPage};

/// The planes of a bake with the depths that they see.
pub(super) struct Planes<'a> {
    /// Those of the real layer come first.
    pub all: &'a [VisiblePlane],
    /// Number of planes of the real layer.
    pub real: usize,
    /// Of each plane: `side²` depths, or none where the receiver is the plane itself.
    pub depths: &'a [Vec<u16>],
    pub side: usize,
}

/// A plane that serves a texel, as a look-up between four of the plane's texels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LookUp {
    /// The first of the four among the texels of all planes of the layer.
    pub first: u32,
    /// Share of the way to the others, right and down.
    pub part: [f32; 2],
    pub weight: f32,
}

/// The two planes of a texel. What their weights lack to 1 is unshadowed.
pub(super) type Served = [LookUp; 2];

/// Pages that a thread serves at a time.
const CHUNK: usize = 32;

/// The two planes of each texel of each page.
pub(super) fn choose(planes: &Planes<'_>, pages: &[ReceiverPage]) -> Vec<Vec<Served>> {
    let mut served: Vec<Vec<Served>> = vec![Vec::new(); pages.len()];
    let chunks = served.chunks_mut(CHUNK).zip(pages.chunks(CHUNK)).collect();
    threads::for_each(chunks, |(served, pages): (&mut [_], &[_])| {
        for (served, page) in served.iter_mut().zip(pages) {
            *served = planes.serve(page);
        }
    });
    served
}

/// A plane with its coordinates at a point and its weight there.
#[derive(Clone, Copy, Default)]
struct Candidate {
    at: Vec2,
    plane: usize,
    weight: f32,
}

impl Planes<'_> {
    fn serve(&self, page: &ReceiverPage) -> Vec<Served> {
        let layer = match page.layer {
            Layer::Phantom(_) => 0..self.real,
            Layer::Virtual(_) => self.real..self.all.len(),
        };
        let near: Vec<usize> = layer.clone().filter(|k| self.may_serve(*k, page)).collect();
        let texels = page.texels.positions.iter().zip(&page.texels.normals);
        let texels = texels.zip(&page.texels.is_used);
        texels
            .map(|((p, n), used)| {
                if *used {
                    self.serve_point(&near, layer.start, (*p, *n))
                } else {
                    Served::default()
                }
            })
            .collect()
    }

    /// Whether the slab of plane `k` touches the page's bounds.
    fn may_serve(&self, k: usize, page: &ReceiverPage) -> bool {
        let plane = &self.all[k];
        let centre = (0.5 * (page.bounds.low + page.bounds.high)).extend(1.0);
        let extent = 0.5 * (page.bounds.high - page.bounds.low);
        let overlaps = |row: [f32; 4], low: f32, high: f32| {
            let row = Vec4::from(row);
            let (at, by) = (row.dot(centre), row.xyz().abs().dot(extent));
            at + by > low && at - by < high
        };
        let tolerance = plane.scale[2];
        overlaps(plane.u, 0.0, 1.0)
            && overlaps(plane.v, 0.0, 1.0)
            && overlaps(plane.behind, -tolerance, plane.normal[3] + tolerance)
    }

    fn serve_point(&self, near: &[usize], first_plane: usize, (p, n): (Vec3, Vec3)) -> Served {
        let mut best = [Candidate::default(); 3];
        let mut covered = 0.0_f32;
        for k in near {
            let Some((inside, candidate)) = self.weigh(*k, p, n) else {
                continue;
            };
            covered = covered.max(inside);
            let place = best.iter().position(|b| candidate.weight > b.weight);
            if let Some(place) = place {
                best[place..].rotate_right(1);
                best[place] = candidate;
            }
        }
        let [first, second, third] = best;
        // Where the second and the third plane change places, neither has any weight.
        let weights = [first, second].map(|c| c.weight - third.weight);
        let sum = weights[0] + weights[1];
        let shares = if sum > 1e-6 * first.weight {
            weights.map(|w| w / sum)
        } else {
            [1.0, 0.0]
        };
        [(first, shares[0]), (second, shares[1])].map(|(c, share)| {
            let plane = c.plane.saturating_sub(first_plane);
            self.look_up(plane, c.at, share * covered)
        })
    }

    /// The look-up `at` a point of a plane of a layer, not beyond the centres of its outer texels.
    fn look_up(&self, plane: usize, at: Vec2, weight: f32) -> LookUp {
        if weight <= 0.0 {
            return LookUp::default();
        }
        let last = (self.side - 1) as f32;
        let at = (at * self.side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
        let low = at.floor().min(Vec2::splat(last - 1.0));
        let first = (plane * self.side + low.y as usize) * self.side + low.x as usize;
        LookUp {
            first: first as u32,
            part: (at - low).to_array(),
            weight,
        }
    }

    /// How far a point is from the border of plane `k`, 0 to 1, and the plane's weight there;
    /// `None` where it does not represent the point. Twin of `fit_of` and `weight_of` in
    /// `lib/planes.wgsl`.
    fn weigh(&self, k: usize, p: Vec3, n: Vec3) -> Option<(f32, Candidate)> {
        let plane = &self.all[k];
        let (point, [fine, fade, tolerance, _]) = (p.extend(1.0), plane.scale);
        let row = |row: [f32; 4]| Vec4::from(row).dot(point);
        let (at, behind) = (Vec2::new(row(plane.u), row(plane.v)), row(plane.behind));
        let edge = at.min(Vec2::ONE - at).min_element();
        let inside = (edge / fade).clamp(0.0, 1.0);
        let slab = plane.normal[3];
        let within = behind > -tolerance && behind < slab + tolerance;
        let facing = (n.dot(Vec4::from(plane.normal).xyz()) * 1.1 - 0.1).clamp(0.0, 1.0);
        if !within || facing <= 0.0 || inside <= 0.0 {
            return None;
        }
        let matches = if plane.kind[1] == 1 {
            1.0
        } else {
            let off = (behind - self.depth(k, at) * slab).abs();
            let t = ((off - tolerance) / (2.0 * tolerance)).clamp(0.0, 1.0);
            let hit = 1.0 - t * t * (3.0 - 2.0 * t);
            hit.max(1e-3 * tolerance / (tolerance + off))
        };
        let weight = inside * (facing.powi(4) + 1e-6) * matches * fine.powi(4);
        let plane = k;
        Some((inside, Candidate { at, plane, weight }))
    }

    /// Depth of the receiver of plane `k`, as a share of its slab, between four texels.
    fn depth(&self, k: usize, at: Vec2) -> f32 {
        let (depths, side) = (&self.depths[k], self.side);
        let at = at * side as f32 - 0.5;
        let low = at.floor();
        let part = at - low;
        let texel = |x: f32, y: f32| {
            let inside = |v: f32| v.clamp(0.0, (side - 1) as f32) as usize;
            let code = depths.get(inside(y) * side + inside(x));
            f32::from(code.copied().unwrap_or(ReceiverImage::NOTHING)) / MAX_DEPTH_CODE
        };
        let row = |y: f32| {
            let (left, right) = (texel(low.x, y), texel(low.x + 1.0, y));
            left + (right - left) * part.x
        };
        let (top, bottom) = (row(low.y), row(low.y + 1.0));
        top + (bottom - top) * part.y
    }
}
