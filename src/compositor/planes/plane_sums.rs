//! The sums of one plane's basis images on the processor, for drivers that run there and execute
//! compute shaders slowly; twin of `planes_plan` and `planes_sum`, whose equations it follows.

use super::normal_table::{NormalTable, Place, normal_from_octahedron};
use super::options::Limits;
use glam::{Vec2, Vec3, Vec4};
use penumbra_scene::planes::{Basis, Image, Layer, Receiver, ReceiverImage, ShadowingPlane};
use std::collections::HashMap;

/// Texels that are summed at a time; their sums stay in the first cache.
pub(super) const BLOCK: usize = 512;

/// Images that are added at a time, which saves loads and stores of the sums.
const AT_ONCE: usize = 4;

/// The light of a frame.
#[derive(Clone, Copy)]
pub(super) struct FaceLights<'a> {
    /// Directions to the faces, bake.
    pub faces: &'a [Vec3],
    /// Irradiance of each on a surface that faces it.
    pub luminance: &'a [Vec3],
    /// Asum by normal.
    pub asum: &'a NormalTable,
}

/// The work of one plane for a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Job {
    /// Whether the sums changed.
    pub is_due: bool,
    /// Whether they began from zero.
    recompute: bool,
    /// Number of images that were summed.
    pub images: usize,
    /// Number of lights that were skipped.
    pub skipped: usize,
}

/// Changes of light to be summed, past casters of one kind: of stored images by number, and of
/// lights that no texel sees.
#[derive(Default)]
struct Changes {
    stored: Vec<(u32, Vec3)>,
    black: Vec<(usize, Vec3)>,
}

/// A normal of the plane's receiver.
struct ByNormal {
    normal: Vec3,
    place: Place,
    /// One over Asum; 0 where there is no light to lose.
    inverse: Vec4,
    /// Light of black images, past all casters and past phantoms.
    black: [Vec4; 2],
}

/// A plane with its sums.
pub(super) struct PlaneSums {
    is_flat: bool,
    /// Images of each light.
    basis: Vec<Basis>,
    /// Weight of each light on the plane.
    reach: Vec<f32>,
    /// The luminance from which the sums were made.
    applied: Vec<Vec3>,
    is_new: bool,
    /// Past all casters, and on the real layer past phantoms.
    changes: [Changes; 2],
    /// 2 on the real layer, else 1.
    kinds: usize,
    normals: Vec<ByNormal>,
    /// For each texel, which of the normals it has.
    normal_of: Vec<u32>,
    /// Blocks of texels that some surface looks up.
    is_needed: Vec<bool>,
    /// For each block red, green and blue of the lost light; past all casters, past phantoms.
    lost: [Vec<f32>; 2],
    pub job: Job,
}

impl PlaneSums {
    /// Sums of a plane of a bake with `side²` texels, whose lights lie in the directions `faces`.
    pub fn new(
        plane: &ShadowingPlane,
        receiver: &ReceiverImage,
        (basis, faces): (&[Basis], &[Vec3]),
        (side, asum): (usize, &NormalTable),
    ) -> Self {
        let is_flat = plane.receiver == Receiver::Plane;
        let own = plane.normal().as_vec3();
        let texels = side * side;
        let (normals, normal_of) = if is_flat {
            (vec![own], vec![0; texels])
        } else {
            palette(&receiver.normals, texels)
        };
        let kinds = if plane.layer == Layer::Real { 2 } else { 1 };
        let reach = |(face, basis): (&Vec3, &Basis)| match (basis.past_all, basis.past_phantoms) {
            _ if is_flat => own.dot(*face).max(0.0),
            // Surfaces behind a plane may have any orientation; here none faces the light.
            (Image::Black, Image::Black) => 0.0,
            _ => 1.0,
        };
        let by_normal = |normal: Vec3| ByNormal {
            normal,
            place: asum.place(normal),
            inverse: Vec4::ZERO,
            black: [Vec4::ZERO; 2],
        };
        let lost = |kind: usize| if kind < kinds { 3 * texels } else { 0 };
        Self {
            is_flat,
            reach: faces.iter().zip(basis).map(reach).collect(),
            applied: vec![Vec3::ZERO; basis.len()],
            basis: basis.to_vec(),
            is_new: true,
            changes: [(); 2].map(|()| Changes::default()),
            kinds,
            normals: normals.into_iter().map(by_normal).collect(),
            normal_of,
            is_needed: vec![false; texels.div_ceil(BLOCK)],
            lost: [0, 1].map(|kind| vec![0.0; lost(kind)]),
            job: Job::default(),
        }
    }

    /// Whether any texel is looked up.
    pub fn serves(&self) -> bool {
        self.is_needed.contains(&true)
    }

    /// Forgets which texels are looked up, and the sums.
    pub fn forget(&mut self) {
        self.is_needed.fill(false);
        self.is_new = true;
    }

    /// Has `texel` summed from now on.
    pub fn need(&mut self, texel: usize) {
        if let Some(needed) = self.is_needed.get_mut(texel / BLOCK) {
            *needed = true;
        }
    }

    /// Brings the sums up to date with the `lights`, and writes the shares of the light on an open
    /// surface that arrive, for each texel past all casters and on the real layer past phantoms.
    pub fn update(
        &mut self,
        lights: FaceLights<'_>,
        limits: Limits,
        images: &[u8],
        shares: &mut [Vec4],
    ) {
        self.job = Job::default();
        if !self.serves() {
            return;
        }
        self.plan(lights.luminance, limits);
        if self.job.is_due {
            self.sum_by_normal(lights);
            self.sum_blocks(images, shares);
        }
    }

    /// Lists the images to be summed (Kakuta 2004, section 4): lights of negligible share are
    /// skipped, a plane whose light has hardly changed keeps its sums, otherwise differences are
    /// summed.
    fn plan(&mut self, luminance: &[Vec3], limits: Limits) {
        let gives = |(s, reach): (&Vec3, &f32)| s.element_sum() * reach;
        let total: f32 = luminance.iter().zip(&self.reach).map(gives).sum();
        let aim = |s: &Vec3, reach: f32| {
            let gives = s.element_sum() * reach;
            let counts = gives > 0.0 && gives >= limits.skip_below * total;
            (if counts { *s } else { Vec3::ZERO }, gives > 0.0, counts)
        };
        let (mut error, mut differ, mut count, mut skipped) = (0.0, 0, 0, 0);
        let min_change = limits.min_change * total;
        for ((s, reach), applied) in luminance.iter().zip(&self.reach).zip(&self.applied) {
            let (light, shines, counts) = aim(s, *reach);
            count += usize::from(counts);
            skipped += usize::from(shines && !counts);
            let change = (light - applied).abs().element_sum() * reach;
            error += change;
            differ += usize::from(change > min_change);
        }
        self.job.skipped = skipped;
        if error <= limits.recompute_above * total && !self.is_new {
            return;
        }
        self.job.is_due = true;
        self.job.recompute = 2 * differ > count || self.is_new;
        self.is_new = false;
        self.changes.iter_mut().for_each(Changes::clear);
        for (i, s) in luminance.iter().enumerate().take(self.reach.len()) {
            let (light, _, _) = aim(s, self.reach[i]);
            let kept = if self.job.recompute {
                Vec3::ZERO
            } else {
                self.applied[i]
            };
            let change = light - kept;
            let matters = change.abs().element_sum() * self.reach[i] > min_change;
            if matters || self.job.recompute {
                self.applied[i] = light;
                self.list(i, change);
            }
        }
    }

    /// Lists the change of light `i`. Images that lose no light need not be summed.
    fn list(&mut self, i: usize, change: Vec3) {
        let Basis {
            past_all,
            past_phantoms,
        } = self.basis[i];
        if change == Vec3::ZERO || (past_all, past_phantoms) == (Image::White, Image::White) {
            return;
        }
        self.job.images += 1;
        for (changes, image) in self.changes.iter_mut().zip([past_all, past_phantoms]) {
            match image {
                Image::Stored(number) => changes.stored.push((number, change / 255.0)),
                Image::Black => changes.black.push((i, change)),
                Image::White => {}
            }
        }
    }

    /// Finds Asum and the light of black images by normal.
    fn sum_by_normal(&mut self, lights: FaceLights<'_>) {
        let faces = lights.faces.iter().zip(lights.luminance);
        for by in &mut self.normals {
            let asum = if self.is_flat {
                let facing = |(l, s): (&Vec3, &Vec3)| *s * by.normal.dot(*l).max(0.0);
                faces.clone().map(facing).sum::<Vec3>().extend(0.0)
            } else {
                lights.asum.at(by.place)
            };
            let is_lit = asum.cmpgt(Vec4::splat(1e-9));
            by.inverse = Vec4::select(is_lit, asum.max(Vec4::splat(1e-12)).recip(), Vec4::ZERO);
            for (sum, changes) in by.black.iter_mut().zip(&self.changes) {
                if self.job.recompute {
                    *sum = Vec4::ZERO;
                }
                for (i, change) in &changes.black {
                    let facing = by.normal.dot(lights.faces[*i]).max(0.0);
                    *sum += (*change * facing).extend(0.0);
                }
            }
        }
    }

    /// Sums the stored images block by block.
    fn sum_blocks(&mut self, images: &[u8], shares: &mut [Vec4]) {
        let (one, kinds) = (self.normal_of.len(), self.kinds);
        let blocks = self.normal_of.chunks(BLOCK);
        let blocks = blocks.zip(shares.chunks_mut(kinds * BLOCK)).enumerate();
        let is_needed = &self.is_needed;
        for (b, (normal_of, shares)) in blocks.filter(|(b, _)| is_needed[*b]) {
            let (first, n) = (b * BLOCK, normal_of.len());
            for kind in 0..kinds {
                let lost = &mut self.lost[kind][3 * first..][..3 * n];
                if self.job.recompute {
                    lost.fill(0.0);
                }
                for some in self.changes[kind].stored.chunks(AT_ONCE) {
                    // Those that lack are the first one again, without light.
                    let mut texels = [&images[..0]; AT_ONCE];
                    let mut light = [[0.0; 3]; AT_ONCE];
                    for k in 0..AT_ONCE {
                        let (image, s) = some[if k < some.len() { k } else { 0 }];
                        texels[k] = &images[image as usize * one + first..][..n];
                        light[k] = if k < some.len() {
                            s.to_array()
                        } else {
                            [0.0; 3]
                        };
                    }
                    add(lost, texels, light);
                }
                let to = shares[kind..].iter_mut().step_by(kinds);
                share(lost, kind, normal_of, &self.normals, to);
            }
        }
    }
}

impl Changes {
    fn clear(&mut self) {
        self.stored.clear();
        self.black.clear();
    }
}

/// Adds images, each times its light, to the sums of a block.
fn add(lost: &mut [f32], images: [&[u8]; AT_ONCE], light: [[f32; 3]; AT_ONCE]) {
    let n = lost.len() / 3;
    let (r, rest) = lost.split_at_mut(n);
    let (g, b) = rest.split_at_mut(n);
    let [i0, i1, i2, i3] = images;
    let (i0, i1, i2, i3) = (&i0[..n], &i1[..n], &i2[..n], &i3[..n]);
    let [s0, s1, s2, s3] = light;
    // Written out for the compiler's vectors.
    for k in 0..n {
        let (t0, t1) = (f32::from(i0[k]), f32::from(i1[k]));
        let (t2, t3) = (f32::from(i2[k]), f32::from(i3[k]));
        r[k] += (t0 * s0[0] + t1 * s1[0]) + (t2 * s2[0] + t3 * s3[0]);
        g[k] += (t0 * s0[1] + t1 * s1[1]) + (t2 * s2[1] + t3 * s3[1]);
        b[k] += (t0 * s0[2] + t1 * s1[2]) + (t2 * s2[2] + t3 * s3[2]);
    }
}

/// Fraction of the possible light that arrives at each texel of a block; 1 where there is no light
/// to lose.
fn share<'a>(
    lost: &[f32],
    kind: usize,
    normal_of: &[u32],
    normals: &[ByNormal],
    shares: impl Iterator<Item = &'a mut Vec4>,
) {
    let n = normal_of.len();
    let (r, rest) = lost.split_at(n);
    let (g, b) = rest.split_at(n);
    for (k, share) in shares.take(n).enumerate() {
        let by = &normals[normal_of[k] as usize];
        let lost = Vec4::new(r[k], g[k], b[k], 0.0) + by.black[kind];
        *share = (Vec4::ONE - lost * by.inverse).clamp(Vec4::ZERO, Vec4::ONE);
    }
}

/// The different normals of a receiver, and which of them each texel has.
fn palette(codes: &[[i16; 2]], texels: usize) -> (Vec<Vec3>, Vec<u32>) {
    let mut known: HashMap<[i16; 2], u32> = HashMap::new();
    let mut normals = Vec::new();
    let unpack = |v: i16| (f32::from(v) / 32767.0).max(-1.0);
    let number = |k: usize| {
        let code = codes.get(k).copied().unwrap_or_default();
        *known.entry(code).or_insert_with(|| {
            normals.push(normal_from_octahedron(Vec2::from(code.map(unpack))));
            normals.len() as u32 - 1
        })
    };
    let normal_of = (0..texels).map(number).collect();
    (normals, normal_of)
}

#[cfg(test)]
mod tests;
