//! Irradiance of indirect light on the ground.

use super::compact_sources::CompactSources;
use super::directions::Directions;
use super::lamplight::Lamplight;
use super::obstacles::{FirstHit, Obstacles};
use super::region::Region;
use super::result::{GROUND_SIDE, GroundBrightness, IndirectLight};
use super::sampling::cosine_direction;
use super::shares::{DistantLight, GroundShares, TileShares};
use super::surfels::{ReflectingPoint, Surfels};
use crate::lamps::PlacedLamp;
use glam::{Vec2, Vec3};
use penumbra_interface::threads;
use penumbra_lighting::DomeLight;
use std::f32::consts::{PI, TAU};

/// Number of rays from each ground texel that gather indirect light.
const GATHERED: usize = 48;
/// Least width of the lobe in which a point of a virtual object mirrors lamps onto the ground, radians: in a narrower
/// one, few rays meet the highlight of the sun on a metal ball, which the eye sees as spots on the ground.
const LAMPS: f32 = 0.2;
/// Largest share of the light of virtual objects that the ground reflects. A picture in which it is brighter than its
/// light allows, because a lamp was clipped, would let light between objects and the ground grow without end.
const MOST_REFLECTED: f32 = 1.0;
/// Texels that a thread looks from at a time.
const CHUNK: usize = 64;
/// Texels along a side of the squares on which the light of virtual lights is found once: it only
/// counts for what the ground reflects.
const LAMP_SQUARE: u32 = 2;
/// Texels of the grid along a side of those that are found where something moves, and rays are cast
/// again every half second.
const COARSER: u32 = 2;

/// A grid of texels on the ground around the objects.
pub(super) struct GroundGrid {
    texels: Vec<Texel>,
    /// Shares of light from afar and of virtual lights alone.
    direct: Vec<Vec3>,
    /// Irradiance of the texels of the whole grid by light from afar, without virtual objects.
    before: Vec<Vec3>,
    /// Radiance of the texels of the whole grid, without virtual objects.
    pub radiance: Vec<Vec3>,
    /// Their places; world, metres.
    places: Vec<Vec2>,
    compact: CompactSources,
    /// At the centres of squares of texels.
    lamplight: Lamplight,
    side: u32,
    /// Which texels of the whole grid lie below an object that stands on the ground.
    inside: Vec<bool>,
}

struct Texel {
    /// Directions in which virtual objects block the light, one bit each.
    behind_virtual: u128,
    /// Directions in which phantoms block the light.
    behind_real: u128,
    /// Visible virtual surfaces and the tiles of phantoms that they hide, all with equal form factors.
    virtual_points: Vec<(ReflectingPoint, Option<u32>)>,
    /// Tiles of phantoms that are visible without virtual objects, with equal form factors.
    phantoms: Vec<u32>,
    window: f32,
    /// Whether it lies inside an object: phantoms block the light from everywhere, or most of its rays meet the
    /// backs of virtual surfaces.
    is_inside: bool,
}

impl GroundGrid {
    pub fn new(
        obstacles: &Obstacles,
        surfels: &Surfels,
        directions: &Directions,
        region: &Region,
        moves: bool,
    ) -> Self {
        let side = match (&obstacles.floor, moves) {
            (None, _) => 0,
            (Some(_), false) => GROUND_SIDE,
            (Some(_), true) => GROUND_SIDE / COARSER,
        };
        let places = |side: u32| {
            (0..side * side).map(move |i| {
                let at = Vec2::new((i % side) as f32, (i / side) as f32) + 0.5;
                region.ground_at(at / side as f32)
            })
        };
        let points: Vec<Vec3> = places(side).collect();
        let texels = threads::map(&points, CHUNK, |i, point| {
            texel(*point, i as u32, obstacles, surfels, directions, region)
        });
        let inside = texels.iter().map(|texel| texel.is_inside).collect();
        let whole = if side > 0 { GROUND_SIDE } else { 0 };
        let compact = points.iter().map(|point| (*point, Vec3::Z));
        let centres = places(side / LAMP_SQUARE).map(|point| (point, Vec3::Z));
        Self {
            direct: vec![Vec3::ONE; (whole * whole) as usize],
            before: vec![Vec3::ZERO; (whole * whole) as usize],
            radiance: vec![Vec3::ZERO; (whole * whole) as usize],
            places: places(whole).map(Vec3::truncate).collect(),
            compact: CompactSources::new(compact, region.offset()),
            texels,
            lamplight: Lamplight::new(centres, region.offset()),
            inside: expanded(side, inside),
            side,
        }
    }

    /// Takes over how bright the ground is, `mean` on average.
    pub fn look(&mut self, mean: Vec3, brightness: &GroundBrightness) {
        for (radiance, place) in self.radiance.iter_mut().zip(&self.places) {
            *radiance = mean * brightness.at(*place);
        }
    }

    /// The shares without virtual objects and virtual lights.
    pub fn unchanged(&self) -> GroundShares {
        GroundShares(self.direct.clone())
    }

    /// Computes the shares under a new state of the dome and of the virtual lights. The light that virtual
    /// objects reflect onto the ground stays in them as it was gathered last.
    pub fn update(
        &mut self,
        directions: &Directions,
        lamps: &[PlacedLamp],
        obstacles: &Obstacles,
        shares: &mut GroundShares,
    ) {
        self.lamplight.update(lamps, obstacles);
        self.compact.update(&directions.compact, obstacles);
        let on_ground = |light: &DomeLight| light.irradiance * light.direction.z.max(0.0);
        let open = directions.irradiance_of_cells(Vec3::Z, u128::MAX)
            + directions.compact.iter().map(on_ground).sum::<Vec3>();
        let is_lit = open.min_element() > 1e-6;
        let per_irradiance = if is_lit { open.recip() } else { Vec3::ZERO };
        let squares = self.side / LAMP_SQUARE;
        let found = |(i, texel): (usize, &Texel)| {
            let compact = self.compact.at(i);
            let irradiance = directions.irradiance_of_cells(Vec3::Z, !texel.behind_real);
            let irradiance = irradiance + compact.before;
            let before = irradiance.element_sum();
            let lost = texel.behind_virtual & !texel.behind_real;
            let lost = directions.irradiance_of_cells(Vec3::Z, lost);
            let lost = (lost + compact.before - compact.now).element_sum();
            let left = if before > 0.0 {
                1.0 - lost / before
            } else {
                1.0
            };
            let (x, y) = (i as u32 % self.side, i as u32 / self.side);
            let square = y / LAMP_SQUARE * squares + x / LAMP_SQUARE;
            let lamps = self.lamplight.at(square as usize) * per_irradiance;
            (Vec3::splat(left) + lamps, irradiance)
        };
        let (direct, before) = self.texels.iter().enumerate().map(found).unzip();
        let direct = expanded(self.side, direct);
        let each = shares.0.iter_mut().zip(self.direct.iter().zip(&direct));
        each.for_each(|(share, (then, now))| *share = (*share + (*now - *then)).max(Vec3::ZERO));
        (self.direct, self.before) = (direct, expanded(self.side, before));
    }

    /// Computes the irradiance on every texel, and the shares of all its light.
    pub fn gather(
        &self,
        surfels: &Surfels,
        tiles: &TileShares,
        light: &DistantLight<'_>,
        (shares, out): (&mut GroundShares, &mut IndirectLight),
    ) {
        let factor = |texel: &Texel| texel.window * PI / GATHERED as f32;
        let before = |tile: u32| light.phantom_radiance(tile);
        let now = |tile: u32| tiles.radiance(tile, light);
        // Tiles that are hidden now are in `phantoms` too, so their present light is subtracted.
        let change = |texel: &Texel| {
            let gained = texel.virtual_points.iter().map(|(point, tile)| {
                surfels.radiance(point, (0.0, LAMPS), shares, tiles, light)
                    - tile.map_or(Vec3::ZERO, now)
            });
            let dimmed = texel.phantoms.iter().map(|s| now(*s) - before(*s));
            (gained.sum::<Vec3>() + dimmed.sum::<Vec3>()) * factor(texel)
        };
        let reflected = |radiance: &dyn Fn(u32) -> Vec3| {
            let each = |texel: &Texel| {
                texel.phantoms.iter().map(|s| radiance(*s)).sum::<Vec3>() * factor(texel)
            };
            self.smoothed(self.texels.iter().map(each).collect())
        };
        out.change.ground = self.smoothed(self.texels.iter().map(change).collect());
        out.real.ground = reflected(&before);
        out.real_now.ground = reflected(&now);
        let each = self.direct.iter().zip(&out.change.ground);
        let before = self.before.iter().zip(&out.real.ground);
        let each = each.zip(before).zip(&self.radiance);
        let each = each.map(|(((direct, change), (far, near)), radiance)| {
            let before = (*far + *near).max(*radiance * PI / MOST_REFLECTED);
            (*direct + *change / before.max(Vec3::splat(1e-6))).max(Vec3::ZERO)
        });
        shares.0.clear();
        shares.0.extend(each);
        out.nearby.ground.clone_from(&shares.0);
    }

    /// Smooths twice with a tent over 3×3 texels: each texel has few rays. What lies below an object does
    /// not count.
    fn smoothed(&self, found: Vec<Vec3>) -> Vec<Vec3> {
        let once = |raw: &[Vec3]| -> Vec<Vec3> {
            let side = raw.len().isqrt() as u32;
            let texels = 0..side * side;
            texels
                .map(|i| smooth((raw, &self.inside), side, i % side, i / side))
                .collect()
        };
        once(&once(&expanded(self.side, found)))
    }
}

/// Values of the whole grid from those that were found, `side` in a row.
fn expanded<T: Copy>(side: u32, found: Vec<T>) -> Vec<T> {
    if side == 0 || side == GROUND_SIDE {
        return found;
    }
    let of = |i: u32| {
        let (x, y) = (i % GROUND_SIDE / COARSER, i / GROUND_SIDE / COARSER);
        found[(y * side + x) as usize]
    };
    (0..GROUND_SIDE * GROUND_SIDE).map(of).collect()
}

fn smooth((raw, inside): (&[Vec3], &[bool]), side: u32, x: u32, y: u32) -> Vec3 {
    let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
    for (dx, dy) in (0..9).map(|k| (k % 3, k / 3)) {
        let (u, v) = ((x + dx).wrapping_sub(1), (y + dy).wrapping_sub(1));
        let i = (v.wrapping_mul(side).wrapping_add(u)) as usize;
        if u < side && v < side && !inside[i] {
            let w = [1.0, 2.0, 1.0][dx as usize] * [1.0, 2.0, 1.0][dy as usize];
            sum += raw[i] * w;
            weight += w;
        }
    }
    sum / f32::max(weight, 1.0)
}

fn texel(
    point: Vec3,
    index: u32,
    obstacles: &Obstacles,
    surfels: &Surfels,
    directions: &Directions,
    region: &Region,
) -> Texel {
    let origin = point + Vec3::Z * region.offset();
    let (mut upwards, mut behind_virtual, mut behind_real) = (0, 0, 0);
    for (i, d) in directions.all.iter().enumerate().filter(|(_, d)| d.z > 0.0) {
        upwards |= 1 << i;
        match obstacles.first_hit(origin, *d) {
            FirstHit::Virtual(_) => {
                behind_virtual |= 1 << i;
                let both = obstacles.hidden_tile(origin, *d).is_some();
                behind_real |= u128::from(both) << i;
            }
            FirstHit::Phantom(_) => behind_real |= 1 << i,
            FirstHit::Ground(_) | FirstHit::Sky => (),
        }
    }
    let azimuth = TAU * (f64::from(index) * 0.618_033_988_749_895).fract() as f32;
    let (mut virtual_points, mut phantoms) = (Vec::new(), Vec::new());
    let mut backs = 0;
    for d in (0..GATHERED).map(|k| cosine_direction(k, GATHERED, azimuth)) {
        match obstacles.first_hit(origin, d) {
            FirstHit::Virtual(hit) => {
                let hidden = obstacles.hidden_tile(origin, d);
                phantoms.extend(hidden);
                let point = surfels.reflecting_point(&hit, d, obstacles, region);
                let is_back = point.as_ref().is_some_and(|p| !surfels.is_front(p, &hit));
                backs += usize::from(is_back);
                virtual_points.extend(point.map(|p| (p, hidden)));
            }
            FirstHit::Phantom(tile) => phantoms.push(tile),
            FirstHit::Ground(_) | FirstHit::Sky => (),
        }
    }
    Texel {
        behind_virtual,
        behind_real,
        virtual_points,
        phantoms,
        window: region.window(point),
        is_inside: 2 * backs > GATHERED || upwards == behind_real,
    }
}
