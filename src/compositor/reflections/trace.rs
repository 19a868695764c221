//! Mirror rays: what glossy surfaces that the camera sees reflect of their neighbourhood.
//!
//! A lobe is divided into parts of equal weight, each with a ray: the camera's ray is reflected
//! about half vectors n + α s, with slopes s at the quantiles of GGX's distribution,
//! |s| = √(u / (1 − u)). What a ray meets before the ground counts as close by:
//!
//! ```text
//!   L = open · L_far  +  light  +  seen · L_picture(place)
//! ```
//!
//! L_far, environment and ground, is looked up by the composite. `light` is the mean radiance of
//! virtual surfaces and of phantoms that the camera does not see, of each over all rays. Where the
//! camera sees a phantom, `seen` is the share of the rays that meet it and `place` the mean of where
//! they do in the picture: the composite looks that up. Where they meet several faces, `light` has what the
//! picture shows at each.
//!
//! A real mirror shows the real scene already. There, `light` is what it reflects of virtual surfaces,
//! and `open` the share that remains of its picture: less where it shows one of those, or their shadow
//! on the ground.

use super::bounce::{Beam, Bounce, bounce, lifted};
use super::bvh::{LANES, Lanes, Rays};
use super::nearby::{Nearby, PERIOD};
use super::nearby_scene::{Met, NearbyScene};
use super::pixel_mean::{PixelMean, is_same};
use super::radiance::NearbyLight;
use super::view::{View, inside};
use glam::{Vec2, Vec3};
use penumbra_numerics::smoothstep;

/// Lobes narrower than this are traced by one ray.
const MIRROR: f32 = 0.015;
/// Width of a lobe, GGX's α, in units of the angle between what neighbouring points of the lattice mirror, from
/// which these are averaged. Half of a lobe's light lies within 2 α of the mirror direction, to every side: three
/// such points.
const WIDE: f32 = 0.8;
/// Share of the distance to the camera that is free if nothing hides a point.
const FREE: f32 = 1.0 - 1e-3;
/// Cosines of the angle at which the camera sees a face between which its picture replaces the face's mean
/// colour: one that is seen nearly edge-on is a few pixels wide, and those of its edges show what is beside it.
const EDGE_ON: (f32, f32) = (0.05, 0.2);
/// Length of the mean of the normals of the faces that a lobe shows below which it shows several.
const ONE_FACE: f32 = 0.9;
/// Places within a pixel, beside its centre.
pub const WITHIN_PIXEL: [Vec2; 4] = [
    Vec2::new(-0.125, -0.375),
    Vec2::new(0.375, -0.125),
    Vec2::new(-0.375, 0.125),
    Vec2::new(0.125, 0.375),
];
/// Two such places, which with the centre lie on a line that is neither a row nor a column.
pub const BESIDE_CENTRE: [Vec2; 2] = [Vec2::new(-0.25, 0.25), Vec2::new(0.25, -0.25)];
/// Angle between successive points of a spiral.
const GOLDEN: f32 = 2.399_963_2;

/// Everything that rays meet.
pub struct Tracer<'a> {
    pub scene: &'a NearbyScene,
    pub light: NearbyLight<'a>,
    pub view: View,
    /// Angle between neighbouring points, radians.
    pub spacing: f32,
}

/// The slopes for `count` rays: quantiles of GGX's distribution on a spiral.
pub fn slopes(count: usize) -> Vec<Vec2> {
    let slope = |number: usize| {
        let u = (number as f32 + 0.5) / count as f32;
        Vec2::from_angle(GOLDEN * number as f32) * (u / (1.0 - u)).sqrt()
    };
    (0..count).map(slope).collect()
}

/// The slopes of half vectors, in units of the lobe's width, of the rays for a lobe at each of the
/// points that are traced together.
#[derive(Clone, Copy)]
pub struct Lobes<'a> {
    /// At every point.
    pub fixed: &'a [Vec2],
    /// At soft points of a lattice, where those around them have others.
    pub soft: Option<[&'a [Vec2]; LANES]>,
}

/// A glossy surface that the camera sees.
struct Mirror<'a> {
    point: Vec3,
    /// From the camera, unit length.
    incident: Vec3,
    /// Unit vectors across the shading normal.
    across: (Vec3, Vec3),
    /// What its ray stands for.
    beam: Beam,
    met: Met<'a>,
    /// Of its rays.
    slopes: &'a [Vec2],
    /// Number of its rays.
    rays: f32,
    sum: Nearby,
    faces: Faces,
}

/// The sides of phantoms in the picture that rays meet: sums of their normals, and of what the picture shows.
#[derive(Default)]
struct Faces {
    normals: Vec3,
    colours: Vec3,
}

impl Faces {
    /// Whether the places of `seen` rays lie on several faces: their mean may lie on any.
    fn are_several(&self, seen: f32) -> bool {
        self.normals.length() < ONE_FACE * seen
    }
}

/// A packet of rays that not all lanes have.
struct Packet {
    rays: Rays,
    farthest: Lanes,
}

impl Packet {
    const fn new() -> Self {
        Self {
            rays: Rays {
                origin: [[0.0; LANES]; 3],
                direction: [[1.0; LANES]; 3],
            },
            farthest: [-1.0; LANES],
        }
    }

    fn set(&mut self, lane: usize, origin: Vec3, direction: Vec3, farthest: f32) {
        for axis in 0..3 {
            self.rays.origin[axis][lane] = origin[axis];
            self.rays.direction[axis][lane] = direction[axis];
        }
        self.farthest[lane] = farthest;
    }

    /// The point of a ray at a distance.
    fn point(&self, lane: usize, distance: f32) -> Vec3 {
        lane_of(&self.rays.origin, lane) + lane_of(&self.rays.direction, lane) * distance
    }

    fn is_empty(&self) -> bool {
        self.farthest.iter().all(|far| *far < 0.0)
    }
}

impl<'t> Tracer<'t> {
    /// What the surfaces behind some pixels mirror.
    pub fn trace<'a>(&'a self, lobes: Lobes<'a>, pixels: [Vec2; LANES]) -> [Nearby; LANES]
    where
        't: 'a,
    {
        let mut packet = Packet::new();
        let directions = pixels.map(|pixel| self.view.through(pixel));
        for (lane, direction) in directions.iter().enumerate() {
            packet.set(lane, self.view.eye, *direction, f32::MAX);
        }
        let found = self.scene.nearest(&packet.rays, packet.farthest);
        let mut mirrors: [Option<Mirror<'_>>; LANES] = std::array::from_fn(|lane| {
            let met = found[lane].filter(|met| met.surface.is_glossy)?;
            let incident = directions[lane].normalize();
            let from_eye = Beam {
                width: 0.0,
                angle: self.spacing,
            };
            let cosine = incident.dot(met.shading_normal);
            let beam = from_eye.reflected(met.distance, &met, cosine);
            let is_wide = met.surface.width > WIDE * beam.angle && met.surface.phantom.is_none();
            let soft = lobes
                .soft
                .filter(|_| is_wide && met.surface.width >= MIRROR);
            Some(Mirror {
                point: self.view.eye + directions[lane] * met.distance,
                beam,
                slopes: soft.map_or(lobes.fixed, |soft| soft[lane]),
                incident,
                across: met.shading_normal.any_orthonormal_pair(),
                met,
                rays: 0.0,
                faces: Faces::default(),
                sum: Nearby {
                    open: 0.0,
                    z: if met.surface.phantom.is_some() {
                        -met.distance
                    } else {
                        met.distance
                    },
                    normal: met.shading_normal,
                    is_soft: soft.is_some(),
                    ..Nearby::NOTHING
                },
            })
        });
        if mirrors.iter().all(Option::is_none) {
            return [Nearby::NOTHING; LANES];
        }
        for number in 0..lobes.fixed.len() {
            self.reflect(number, &mut mirrors);
        }
        mirrors.map(|mirror| mirror.map_or(Nearby::NOTHING, Mirror::mean))
    }

    /// The same; real mirrors by the mean over each pixel, because the picture that they show is sharp.
    pub fn trace_smoothly(&self, lobes: Lobes<'_>, pixels: [Vec2; LANES]) -> [Nearby; LANES] {
        let mut found = self.trace(lobes, pixels);
        if !found.iter().any(Nearby::is_in_real_mirror) {
            return found;
        }
        let mut count = [1.0; LANES];
        for offset in WITHIN_PIXEL {
            let more = self.trace(lobes, pixels.map(|pixel| pixel + offset));
            for (lane, more) in more.iter().enumerate() {
                if found[lane].is_in_real_mirror() && more.is_in_real_mirror() {
                    found[lane].light += more.light;
                    found[lane].open += more.open;
                    count[lane] += 1.0;
                }
            }
        }
        for (found, count) in found.iter_mut().zip(count) {
            found.light /= count;
            found.open /= count;
        }
        found
    }

    /// The same at outlines, by the mean over each pixel: there a surface turns away from the camera
    /// within a pixel and mirrors half of its surroundings, which would be a row of dots.
    pub fn trace_outlines(&self, lobes: Lobes<'_>, pixels: [Vec2; LANES]) -> [Nearby; LANES] {
        let mut found: [PixelMean; LANES] = std::array::from_fn(|_| PixelMean::default());
        for offset in WITHIN_PIXEL {
            let more = self.trace(lobes, pixels.map(|pixel| pixel + offset));
            for (found, more) in found.iter_mut().zip(more) {
                found.add(more);
            }
        }
        found.map(PixelMean::mean)
    }

    /// The means of what pixels mirror at their centres, which is `known`, and at `places` beside these that
    /// show the same surface.
    pub fn trace_finely(
        &self,
        lobes: Lobes<'_>,
        places: &[Vec2],
        pixels: [Vec2; LANES],
        known: [Nearby; LANES],
    ) -> [Nearby; LANES] {
        let mut found = known.map(PixelMean::of);
        for offset in places {
            let more = self.trace(lobes, pixels.map(|pixel| pixel + *offset));
            for ((found, more), known) in found.iter_mut().zip(more).zip(&known) {
                if is_same(&more, known) {
                    found.add(more);
                }
            }
        }
        found.map(PixelMean::mean)
    }

    /// Traces ray `number` of each mirror.
    fn reflect(&self, number: usize, mirrors: &mut [Option<Mirror<'_>>; LANES]) {
        let mut packet = Packet::new();
        for (lane, mirror) in mirrors.iter_mut().enumerate() {
            let ray = mirror.as_mut().and_then(|m| m.ray(number));
            if let (Some(mirror), Some(direction)) = (mirror, ray) {
                mirror.rays += 1.0;
                let origin = mirror.point + mirror.met.normal * self.scene.lift;
                packet.set(lane, origin, direction, self.to_ground(origin, direction));
            }
        }
        if packet.is_empty() {
            return;
        }
        let found = self.scene.nearest(&packet.rays, packet.farthest);
        let mut to_eye = Packet::new();
        let mut bounces: [Option<Bounce>; LANES] = [None; LANES];
        for (lane, mirror) in mirrors.iter_mut().enumerate() {
            // A mirror that reaches below the ground meets it at once.
            let Some(mirror) = mirror.as_mut().filter(|_| packet.farthest[lane] >= 0.0) else {
                continue;
            };
            let is_virtual = |met: &Met<'_>| met.surface.phantom.is_none();
            if mirror.is_real() && !found[lane].as_ref().is_some_and(is_virtual) {
                let far = packet.farthest[lane];
                let shows_ground = found[lane].is_none() && far < f32::MAX;
                let shadowed = shows_ground.then(|| packet.point(lane, far));
                let share = shadowed.map_or(Vec3::ONE, |p| self.light.ground_share(p));
                mirror.sum.open += share.element_sum() / 3.0;
                continue;
            }
            let Some(met) = &found[lane] else {
                // The picture shows the ground there, unless a phantom hides it.
                let point = packet.point(lane, packet.farthest[lane]);
                if packet.farthest[lane] < f32::MAX && self.view.shows(point) {
                    let from = point + Vec3::Z * self.scene.lift;
                    to_eye.set(lane, from, self.view.eye - from, FREE);
                } else {
                    mirror.sum.open += 1.0;
                }
                continue;
            };
            let direction = lane_of(&packet.rays.direction, lane);
            let point = packet.point(lane, met.distance);
            let from = point + met.normal * self.scene.lift;
            if met.surface.phantom.is_some() && met.surface.f0 == Vec3::ZERO {
                to_eye.set(lane, from, self.view.eye - from, FREE);
                continue;
            }
            mirror.sum.light += self.direct(point, met);
            bounces[lane] = bounce(met, from, direction, (mirror.part(), mirror.beam));
        }
        self.look(&to_eye, &found, mirrors);
        for is_last in [false, true] {
            self.reflect_again(&mut bounces, mirrors, is_last);
        }
    }

    /// Distance to the ground along a ray; without ground, far away.
    fn to_ground(&self, origin: Vec3, direction: Vec3) -> f32 {
        let height = self.scene.ground.filter(|_| direction.z < 0.0);
        let distance = height.map_or(f32::MAX, |height| (height - origin.z) / direction.z);
        distance.max(0.0)
    }

    /// Light of a virtual surface, or of a real mirror, that does not come from its own mirror ray.
    fn direct(&self, point: Vec3, met: &Met<'_>) -> Vec3 {
        if met.surface.phantom.is_some() {
            return Vec3::ZERO;
        }
        let surface = met.surface;
        self.light.diffuse(point, met.shading_normal, surface)
    }

    /// Adds the phantoms and the ground that mirror rays have met: as the camera sees them, or
    /// their mean radiance.
    fn look(
        &self,
        to_eye: &Packet,
        found: &[Option<Met<'_>>; LANES],
        mirrors: &mut [Option<Mirror<'_>>; LANES],
    ) {
        if to_eye.is_empty() {
            return;
        }
        let hidden = self.scene.is_hidden(&to_eye.rays, to_eye.farthest);
        for (lane, mirror) in mirrors.iter_mut().enumerate() {
            let Some(mirror) = mirror.as_mut().filter(|_| to_eye.farthest[lane] > 0.0) else {
                continue;
            };
            let point = to_eye.point(lane, 0.0);
            let towards = lane_of(&to_eye.rays.direction, lane);
            let Some(met) = &found[lane] else {
                if hidden[lane] {
                    mirror.sum.light += self.light.hidden_ground(point);
                } else {
                    mirror.sum.open += 1.0;
                }
                continue;
            };
            let is_visible = met.normal.dot(towards) > 0.0 && !hidden[lane];
            let place = self.view.place_of(point).filter(|_| is_visible);
            let facing = met.normal.dot(towards) / towards.length();
            let clear = smoothstep(EDGE_ON.0, EDGE_ON.1, facing);
            let seen = place.map_or(0.0, |(uv, _)| clear * inside(uv));
            let number = met.surface.phantom.unwrap_or_default();
            mirror.sum.light += self.light.phantom(number, met.normal) * (1.0 - seen);
            mirror.sum.seen += seen;
            mirror.faces.normals += met.normal * seen;
            if seen > 0.0 {
                mirror.faces.colours += self.light.picture_at(point).unwrap_or_default() * seen;
            }
            if let Some((uv, depth)) = place {
                // A face that is seen at an angle is narrow in the picture, and so is the lobe on it.
                mirror.sum.place += uv.extend(facing * met.distance / depth) * seen;
            }
        }
    }

    /// Adds what the surfaces that mirror rays have met reflect themselves, and leaves the reflections in
    /// glossy surfaces that those meet, of which the last has the mean of all directions.
    fn reflect_again(
        &self,
        bounces: &mut [Option<Bounce>; LANES],
        mirrors: &mut [Option<Mirror<'_>>; LANES],
        is_last: bool,
    ) {
        let mut packet = Packet::new();
        for (lane, bounce) in bounces.iter().enumerate() {
            if let Some(Bounce {
                origin, direction, ..
            }) = *bounce
            {
                packet.set(lane, origin, direction, self.to_ground(origin, direction));
            }
        }
        if packet.is_empty() {
            return;
        }
        let found = self.scene.nearest(&packet.rays, packet.farthest);
        for (lane, mirror) in mirrors.iter_mut().enumerate() {
            let (Some(mirror), Some(bounce)) = (mirror, bounces[lane].take()) else {
                continue;
            };
            let arriving = match &found[lane] {
                Some(met) => {
                    let at = packet.point(lane, met.distance);
                    if !is_last && met.surface.is_glossy && met.surface.phantom.is_none() {
                        bounces[lane] = bounce.again(met, at + met.normal * self.scene.lift);
                    }
                    self.arriving_from(met, at, bounces[lane].is_none())
                }
                None => self.arriving_from_afar(&bounce, packet.farthest[lane]),
            };
            mirror.sum.light += bounce.reflectance * arriving;
        }
    }

    /// Radiance of a surface at `at`; with what it reflects specularly if that is not followed.
    fn arriving_from(&self, met: &Met<'_>, at: Vec3, is_end: bool) -> Vec3 {
        match met.surface.phantom {
            Some(number) => self.light.phantom(number, met.normal),
            None if is_end => self.light.total(at, met.shading_normal, met.surface),
            None => self.light.diffuse(at, met.shading_normal, met.surface),
        }
    }

    /// Radiance of the ground, which lies at a distance, or of the environment.
    fn arriving_from_afar(&self, bounce: &Bounce, to_ground: f32) -> Vec3 {
        let Bounce {
            origin,
            direction,
            width,
            spread,
            ..
        } = *bounce;
        if to_ground < f32::MAX {
            self.light.ground(origin + direction * to_ground)
        } else {
            self.light.sky(origin, direction, width, spread)
        }
    }
}

impl Mirror<'_> {
    /// Direction of ray `number`; `None` below the surface, where the lobe ends.
    fn ray(&self, number: usize) -> Option<Vec3> {
        let n = self.met.shading_normal;
        let width = self.met.surface.width;
        if width < MIRROR || self.slopes.len() == 1 {
            let mirrored = self.incident.reflect(n);
            return (number == 0).then(|| lifted(mirrored, self.met.normal));
        }
        let slope = width * self.slopes[number];
        let (right, up) = self.across;
        let half = (n + right * slope.x + up * slope.y).normalize();
        let direction = self.incident.reflect(half);
        let is_above = half.dot(self.incident) < 0.0 && direction.dot(n) > 0.0;
        // The first ray is nearest to the mirror direction: no lobe is without any.
        (is_above || number == 0).then(|| lifted(direction, self.met.normal))
    }

    /// Width of the part of the lobe that each ray stands for, as GGX's α.
    fn part(&self) -> f32 {
        let sets = if self.sum.is_soft { PERIOD * PERIOD } else { 1 };
        self.met.surface.width / ((self.slopes.len() * sets) as f32).sqrt()
    }

    /// Whether it is a phantom.
    const fn is_real(&self) -> bool {
        self.met.surface.phantom.is_some()
    }

    fn mean(self) -> Nearby {
        let scale = 1.0 / self.rays.max(1.0);
        let reflectance = if self.is_real() {
            self.met.surface.f0
        } else {
            Vec3::ONE
        };
        let Nearby {
            mut light,
            open,
            mut seen,
            place,
            z,
            normal,
            is_soft,
        } = self.sum;
        if self.faces.are_several(seen) {
            light += self.faces.colours;
            seen = 0.0;
        }
        Nearby {
            light: light * scale * reflectance,
            open: open * scale,
            seen: seen * scale,
            place: place / seen.max(1e-6),
            z,
            normal,
            is_soft,
        }
    }
}

fn lane_of(vectors: &[Lanes; 3], lane: usize) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|axis| vectors[axis][lane]))
}

#[cfg(test)]
pub mod tests;
