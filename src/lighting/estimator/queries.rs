//! Queries of an estimator's state.

use super::super::lamp_distance::{Hiding, SeenLamp};
use super::super::probe::ProbeMap;
use super::*;

impl EnvironmentEstimator {
    /// Returns the mean radiance within `half_angle` radians of a direction, in the *environment
    /// camera's* units (before the gains); `None` if less than half of it is seen.
    #[must_use]
    pub fn radiance_at(&self, direction: Vec3, half_angle: f32) -> Option<[f32; 3]> {
        let direction = direction.try_normalize()?;
        let min_cosine = half_angle.cos();
        let (mut sum, mut seen, mut total) = (Vec3::ZERO, 0.0, 0.0);
        let rows = self
            .grid
            .directions
            .iter()
            .zip(&self.grid.solid_angles)
            .enumerate();
        for (i, (_, w)) in rows.filter(|(_, (d, _))| d.dot(direction) >= min_cosine) {
            sum += self.measured[i] * (w * self.coverage[i]);
            seen += w * self.coverage[i];
            total += w;
        }
        if total == 0.0 {
            let i = texel_of(self.grid.size, direction);
            return (self.coverage[i] > 0.5).then(|| self.measured[i].to_array());
        }
        (seen > 0.5 * total).then(|| (sum / seen).to_array())
    }

    /// Returns the duration of each step of the last update.
    #[must_use]
    pub const fn stage_times(&self) -> &Stages {
        &self.stages
    }

    /// Returns the compact sources of the last update, strongest first; none with the fixed grid.
    #[must_use]
    pub fn sources(&self) -> Vec<CompactSource> {
        let Dome::Adaptive(dome) = &self.dome else {
            return Vec::new();
        };
        let mut sources = dome.sources();
        if let Some(mirrored) = self.mirrored_view() {
            for source in sources.iter_mut().filter(|s| !s.is_unseen) {
                source.viewpoint = mirrored.viewpoint(source.direction.as_dvec3()).as_vec3();
            }
        }
        if let Some(observer) = self.observer() {
            for source in sources.iter_mut().filter(|s| s.distance.inverse > 0.0) {
                let to = source.direction / source.distance.inverse + source.viewpoint;
                source.position = Some(observer + to.as_dvec3());
            }
        }
        let strength = |s: &CompactSource| s.irradiance.dot(LUMINANCE);
        sources.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
        sources
    }

    /// Returns what [`Self::sources`] returns, with the shape of each.
    #[must_use]
    pub fn lamps(&self) -> Vec<SeenLamp> {
        let Dome::Adaptive(dome) = &self.dome else {
            return Vec::new();
        };
        let with_parts = |source: CompactSource| SeenLamp {
            source,
            parts: dome.parts(source.id, SeenLamp::part_count(source.angular_radius)),
            is_energy_unknown: false,
        };
        self.sources().into_iter().map(with_parts).collect()
    }

    /// Returns the linear value of a pixel of the last merged picture, environment camera units;
    /// `None` for pixels that see nothing, and for a sphere in the scene.
    #[must_use]
    pub fn merged_pixel(&self, x: i64, y: i64) -> Option<Vec3> {
        let View::Fixed(fixed) = &self.placed else {
            return None;
        };
        let (width, height) = (
            i64::from(fixed.pixels.width),
            i64::from(fixed.pixels.height),
        );
        if x < 0 || y < 0 || x >= width || y >= height {
            return None;
        }
        let i = (y * width + x) as usize;
        let seen = fixed.pixels.solid_angles[i] > 0.0;
        self.radiance.get(i).copied().filter(|_| seen)
    }

    /// Returns the ratio of the clipped pixels' true brightness to their clipped value, estimated
    /// from the shadows in the scene camera's picture.
    #[must_use]
    pub const fn shadow_factor(&self) -> Option<f32> {
        self.shadow_factor
    }

    /// Returns what may hide a lamp in a direction (unit vector, world). Dark things are darker than most of what is
    /// seen.
    pub fn hiding(&self) -> impl Fn(Vec3) -> Hiding {
        let is_seen = |i: usize| self.coverage[i] > 0.5;
        let seen = (0..self.measured.len()).filter(|i| is_seen(*i));
        let mut all: Vec<f32> = seen.map(|i| self.measured[i].dot(LUMINANCE)).collect();
        let middle = all.len() / 2;
        let median = if all.is_empty() {
            0.0
        } else {
            *all.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        move |direction| {
            let i = texel_of(self.grid.size, direction);
            match self.measured[i].dot(LUMINANCE) < median {
                _ if !is_seen(i) => Hiding::NotSeen,
                true => Hiding::DarkThing,
                false => Hiding::Nothing,
            }
        }
    }

    /// Returns the visible part of each texel of the cube, 0..=1.
    #[must_use]
    pub fn coverage(&self) -> &[f32] {
        &self.coverage
    }

    /// Returns the number of pixels (of the environment picture) that even the shortest exposure
    /// clipped in the last update.
    #[must_use]
    pub fn clipped_pixels(&self) -> usize {
        self.clipped.len()
    }

    /// Returns the share of the sphere's solid angle that even the shortest exposure clipped in the
    /// last update; 0 for a sphere in the scene camera's picture.
    #[must_use]
    pub fn clipped_share(&self) -> f32 {
        match &self.placed {
            View::Fixed(fixed) => {
                let size = |i: &u32| fixed.pixels.solid_angles.get(*i as usize);
                self.clipped.iter().filter_map(size).sum::<f32>() / (4.0 * std::f32::consts::PI)
            }
            View::Moving(_) | View::Stated(_) => 0.0,
        }
    }

    /// Returns the seconds since the least recently seen direction was seen, for a sphere in the
    /// scene camera's picture; `None` for other views.
    #[must_use]
    pub fn oldest_seconds(&self, now: MonotonicTime) -> Option<f64> {
        match &self.placed {
            View::Fixed(_) | View::Stated(_) => None,
            View::Moving(memory) => memory.oldest_seconds(now),
        }
    }

    /// Returns the state of the map from a mirrored sphere in the scene camera's picture; `None`
    /// for other views.
    #[must_use]
    pub fn probe_map(&self) -> Option<ProbeMap> {
        let (memory, grid, sphere) = self.accumulated()?;
        let (mut sum, mut above, mut total_above) = (0.0, 0.0, 0.0);
        for ((d, &w), &c) in grid
            .directions
            .iter()
            .zip(&grid.solid_angles)
            .zip(&memory.coverage)
        {
            sum += w * c;
            if d.z > 0.0 {
                above += w * c;
                total_above += w;
            }
        }
        Some(ProbeMap {
            sphere_seen_at: sphere.seen_at,
            rim_shift: sphere.rim_shift,
            seen_at: memory.mean_seen_at(&grid.solid_angles),
            coverage: sum / (4.0 * std::f32::consts::PI),
            coverage_above: above / total_above,
        })
    }

    /// Returns what a sphere in the scene camera's picture has shown; `None` for other views.
    const fn accumulated(&self) -> Option<(&RadianceAccumulator, &CubeGrid, &LastSphere)> {
        match &self.placed {
            View::Fixed(_) | View::Stated(_) => None,
            View::Moving(memory) => Some((memory, &self.grid, &self.last_sphere)),
        }
    }
}
