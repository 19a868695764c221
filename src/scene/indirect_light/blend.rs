//! Blends the indirect light of two instants.

use super::result::{IndirectLight, Irradiance, NearbyRadiance, OnReal};
use super::surface_grid::SurfaceIrradiance;
use glam::Vec3;
use std::sync::Arc;

/// Marks the generations of blends, which never equal those of the solver.
const BLENDED: u64 = 1 << 63;
/// Maximum number of recycled blends: in use by the compositor, waiting for it, being prepared.
const MAX_RECYCLED: usize = 4;

/// Blends pairs of solutions into recycled buffers.
#[derive(Debug, Default)]
pub struct IndirectLightBlender {
    count: u64,
    recycled: Vec<Arc<IndirectLight>>,
}

impl IndirectLightBlender {
    /// Returns the linear blend of `from` (`weight` 0) and `to` (`weight` 1): one of them itself
    /// at the ends and where they cover different regions, otherwise with a new generation.
    pub fn blend(
        &mut self,
        from: &Arc<IndirectLight>,
        to: &Arc<IndirectLight>,
        weight: f32,
    ) -> Arc<IndirectLight> {
        let is_same_region =
            (from.low, from.high, from.on_ground) == (to.low, to.high, to.on_ground);
        let are_solved = from.generation != 0 && to.generation != 0;
        if weight >= 1.0 || from.generation == to.generation || !is_same_region || !are_solved {
            return Arc::clone(to);
        }
        if weight <= 0.0 {
            return Arc::clone(from);
        }
        let is_free = |buffer: &mut Arc<IndirectLight>| Arc::get_mut(buffer).is_some();
        let mut blend = match self.recycled.iter_mut().position(is_free) {
            Some(at) => self.recycled.swap_remove(at),
            None => Arc::new(IndirectLight::clone(to)),
        };
        self.count += 1;
        // Only this function holds the buffer, so nothing is copied.
        let out = Arc::make_mut(&mut blend);
        (out.low, out.high, out.on_ground) = (to.low, to.high, to.on_ground);
        out.generation = BLENDED | self.count;
        blend_on_real(&from.change, &to.change, weight, &mut out.change);
        blend_on_real(&from.real, &to.real, weight, &mut out.real);
        blend_irradiance(&from.real_now, &to.real_now, weight, &mut out.real_now);
        blend_surfaces(
            &from.on_virtual,
            &to.on_virtual,
            weight,
            &mut out.on_virtual,
        );
        blend_nearby(&from.nearby, &to.nearby, weight, &mut out.nearby);
        if self.recycled.len() < MAX_RECYCLED {
            self.recycled.push(Arc::clone(&blend));
        }
        blend
    }
}

fn blend_on_real(from: &OnReal, to: &OnReal, weight: f32, out: &mut OnReal) {
    blend_values(&from.ground, &to.ground, weight, &mut out.ground);
    blend_surfaces(&from.surfaces, &to.surfaces, weight, &mut out.surfaces);
}

fn blend_surfaces(
    from: &SurfaceIrradiance,
    to: &SurfaceIrradiance,
    weight: f32,
    out: &mut SurfaceIrradiance,
) {
    if Arc::ptr_eq(&from.grid, &to.grid) {
        out.grid.clone_from(&to.grid);
        blend_values(&from.values, &to.values, weight, &mut out.values);
    } else {
        out.clone_from(to);
    }
}

fn blend_irradiance(from: &Irradiance, to: &Irradiance, weight: f32, out: &mut Irradiance) {
    blend_values(&from.ground, &to.ground, weight, &mut out.ground);
    for (k, out) in out.volume.iter_mut().enumerate() {
        blend_values(&from.volume[k], &to.volume[k], weight, out);
    }
}

fn blend_nearby(from: &NearbyRadiance, to: &NearbyRadiance, weight: f32, out: &mut NearbyRadiance) {
    if !Arc::ptr_eq(&from.surfels, &to.surfels) || from.phantoms.len() != to.phantoms.len() {
        out.clone_from(to);
        return;
    }
    out.surfels.clone_from(&to.surfels);
    blend_values(&from.diffuse, &to.diffuse, weight, &mut out.diffuse);
    blend_values(&from.total, &to.total, weight, &mut out.total);
    let sides = from.phantoms.iter().zip(&to.phantoms);
    out.phantoms.clear();
    out.phantoms
        .extend(sides.map(|(a, b)| std::array::from_fn(|side| a[side].lerp(b[side], weight))));
    blend_values(&from.ground, &to.ground, weight, &mut out.ground);
}

fn blend_values(from: &[Vec3], to: &[Vec3], weight: f32, out: &mut Vec<Vec3>) {
    out.clear();
    out.extend(from.iter().zip(to).map(|(a, b)| a.lerp(*b, weight)));
}

#[cfg(test)]
mod tests {
    use super::super::ground_map::GroundMap;
    use super::*;

    fn light(generation: u64, value: f32) -> Arc<IndirectLight> {
        let irradiance = Irradiance {
            ground: vec![Vec3::splat(value); 4],
            volume: std::array::from_fn(|k| vec![Vec3::splat(value + k as f32); 3]),
        };
        let on_real = || OnReal {
            ground: irradiance.ground.clone(),
            surfaces: SurfaceIrradiance::default(),
        };
        Arc::new(IndirectLight {
            generation,
            low: Vec3::ZERO,
            high: Vec3::ONE,
            on_ground: GroundMap::default(),
            change: on_real(),
            real: on_real(),
            real_now: irradiance.clone(),
            on_virtual: SurfaceIrradiance::default(),
            nearby: NearbyRadiance {
                phantoms: vec![[Vec3::splat(value); 6]],
                ground: vec![Vec3::splat(value)],
                ..NearbyRadiance::default()
            },
        })
    }

    #[test]
    fn blend_is_linear_and_recycles_its_buffers() {
        let (from, mut to, mut blender) = (
            light(1, 1.0),
            light(2, 3.0),
            IndirectLightBlender::default(),
        );
        Arc::make_mut(&mut to).nearby.surfels = Arc::clone(&from.nearby.surfels);
        let blend = blender.blend(&from, &to, 0.25);
        assert_eq!(blend.change.ground, vec![Vec3::splat(1.5); 4]);
        assert_eq!(blend.real_now.volume[5], vec![Vec3::splat(6.5); 3]);
        assert_eq!(blend.nearby.ground, vec![Vec3::splat(1.5)]);
        assert_eq!(blender.blend(&from, &to, 0.0).generation, 1);
        assert_eq!(blender.blend(&from, &to, 1.0).generation, 2);
        let (address, generation) = (Arc::as_ptr(&blend), blend.generation);
        drop(blend);
        let next = blender.blend(&from, &to, 0.5);
        assert_eq!(Arc::as_ptr(&next), address);
        assert!(next.generation > generation);
    }

    #[test]
    fn other_region_or_unsolved_light_is_not_blended() {
        let (from, mut to) = (light(1, 1.0), light(2, 3.0));
        Arc::make_mut(&mut to).high = Vec3::splat(2.0);
        let mut blender = IndirectLightBlender::default();
        assert_eq!(blender.blend(&from, &to, 0.5).generation, 2);
        assert_eq!(
            blender
                .blend(&light(0, 0.0), &light(1, 1.0), 0.5)
                .generation,
            1
        );
    }
}
