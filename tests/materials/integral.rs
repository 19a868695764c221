//! Specular reflection of glossy surfaces, by plain sums over all texels of a map.

use glam::Vec3;
use penumbra_lighting::CubeMap;
use penumbra_lighting::box_chain::box_level;
use penumbra_lighting::compact_source_specular::reflected;
use penumbra_lighting::cube::{CubeGrid, face_direction};
use penumbra_lighting::lobes::{
    Family, Levels, LongLobe, own_width, phong_exponent, tilted, widths,
};
use penumbra_lighting::prefilter::gathered;

/// The normal of a surface and the direction to the viewer.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub n: Vec3,
    pub v: Vec3,
}

impl View {
    pub fn n_dot_v(&self) -> f32 {
        self.n.dot(self.v)
    }

    pub fn mirror(&self) -> Vec3 {
        self.n * (2.0 * self.n_dot_v()) - self.v
    }
}

/// BRDF times n·l with F0 = F90 = 1, or a specular colour of 1, directly from the papers' formulas.
pub fn reflectance(family: Family, parameter: f32, view: &View, l: Vec3) -> f64 {
    let (n_l, n_v) = (f64::from(view.n.dot(l)), f64::from(view.n_dot_v()));
    if n_l <= 0.0 {
        return 0.0;
    }
    match family {
        Family::Phong => {
            let e = f64::from(phong_exponent(parameter));
            let cos = f64::from(view.mirror().dot(l)).clamp(0.0, 1.0);
            (e + 2.0) / std::f64::consts::TAU * cos.powf(e) * n_l
        }
        Family::Ggx => {
            let a2 = f64::from(parameter).powi(4);
            let h = (l + view.v).normalize();
            let n_h = f64::from(view.n.dot(h));
            // 1 − (n·h)² as |n × h|², which keeps narrow lobes exact.
            let sin2 = f64::from(view.n.cross(h).length_squared());
            let d = a2 / (std::f64::consts::PI * (n_h * n_h * a2 + sin2).powi(2));
            let root = |x: f64| (x * x * (1.0 - a2) + a2).sqrt();
            let masking = 0.5 / (n_l * root(n_v) + n_v * root(n_l));
            d * masking * n_l
        }
    }
}

/// Integrates over a map's texels; those near the lobe's centre are subdivided finer than the lobe.
pub struct Integrator {
    grid: CubeGrid,
}

impl Integrator {
    pub fn new(size: u32) -> Self {
        Self {
            grid: CubeGrid::new(size),
        }
    }

    /// ∫ L f (n·l) dl for each of `maps`, which have this grid's texels.
    pub fn integrals(
        &self,
        family: Family,
        parameter: f32,
        view: &View,
        maps: &[Vec<Vec3>],
    ) -> Vec<[f64; 3]> {
        let width = own_width(family, parameter);
        let texel = 1.6 / self.grid.size as f32;
        let mut sums = vec![[0.0; 3]; maps.len()];
        for (i, d) in self.grid.directions.iter().enumerate() {
            let near = d.distance(view.mirror()) < 8.0 * width + 2.0 * texel;
            let parts = if near {
                ((3.0 * texel / width).ceil() as u32).clamp(1, 24)
            } else {
                1
            };
            let weight = self.mean(i, parts, |l| reflectance(family, parameter, view, l))
                * f64::from(self.grid.solid_angles[i]);
            if weight == 0.0 {
                continue;
            }
            for (sum, map) in sums.iter_mut().zip(maps) {
                for (s, l) in sum.iter_mut().zip(map[i].to_array()) {
                    *s += weight * f64::from(l);
                }
            }
        }
        sums
    }

    /// Mean over a texel, subdivided into `parts²`.
    fn mean(&self, i: usize, parts: u32, f: impl Fn(Vec3) -> f64) -> f64 {
        if parts == 1 {
            return f(self.grid.directions[i]);
        }
        let n = self.grid.size as usize;
        let (face, y, x) = (i / (n * n), i / n % n, i % n);
        let at = |k: usize, part: u32| {
            (k as f64 + (f64::from(part) + 0.5) / f64::from(parts)) / n as f64
        };
        let all = (0..parts * parts)
            .map(|k| f(face_direction(face, at(x, k % parts), at(y, k / parts)).as_vec3()));
        all.sum::<f64>() / f64::from(parts * parts)
    }
}

/// The same from a prefiltered map, as the program computes it; with round lobes alone unless `long`.
pub fn prefiltered(
    map: &CubeMap,
    levels: &Levels,
    (family, p): (Family, f32),
    view: &View,
    long: bool,
) -> Vec3 {
    let response = family.response(view.n_dot_v(), p);
    let d = tilted(view.mirror(), view.n, response.tilt);
    let mut level = levels.level(response.width);
    let mut light = gathered(map, family, level, d);
    if family == Family::Ggx && long {
        let alpha = own_width(family, p);
        let lobe = LongLobe::of(
            view.n_dot_v(),
            alpha,
            widths(map.size, map.levels.len()).next().unwrap_or(1.0),
        );
        let level_of_parts = levels.level(lobe.width);
        let parts = lobe.parts(alpha, view.n, view.v);
        let highest = map.levels.len() as f32 - 1.0;
        let part = |(l, share, up): (Vec3, f32, f32)| {
            let level = (level_of_parts + up).min(highest);
            gathered(map, family, level, l) * share
        };
        let row: Vec3 = parts.into_iter().map(part).sum();
        light = light.lerp(row, lobe.share);
        level += (level_of_parts - level) * lobe.share;
    }
    let lobe = (family, p, level);
    let [scaled, added] = reflected(&map.compact_sources, lobe, view.n, view.v);
    light * (response.scale + response.bias) + scaled + added
}

/// The same from the chain of box-filtered maps: Phong by the paper, GGX with its own albedo.
pub fn boxed(map: &CubeMap, family: Family, p: f32, view: &View) -> Vec3 {
    let albedo = match family {
        Family::Phong => 1.0,
        Family::Ggx => {
            let response = family.response(view.n_dot_v(), p);
            response.scale + response.bias
        }
    };
    let level = box_level(family, p, map.size, map.levels.len());
    gathered(map, family, level, view.mirror()) * albedo
}
