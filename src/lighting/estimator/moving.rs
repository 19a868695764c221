//! A mirrored sphere in the scene camera's own picture (Supan 2006, section III, first set-up).

use super::super::memory::{Observation, confidence};
use super::super::outline::refine;
use super::*;
use penumbra_camera::SphereInCamera;

/// Pictures between evaluations of the scene's shadows.
const SHADOW_INTERVAL: u64 = 8;

/// The sphere in a picture.
struct PlacedSphere {
    view: PlacedView,
    /// Displacement of its rim from the prediction, pixels.
    rim_shift: Option<f64>,
}

impl EnvironmentEstimator {
    pub(super) fn observe_moving(
        &mut self,
        brackets: &[Bracket],
        input: &EnvironmentInput,
    ) -> Result<SeparatedSources, EnvironmentError> {
        if let Some(placed) = self.place_sphere(brackets, input) {
            check_sizes(brackets, placed.view.size())?;
            if self.observe_sphere(&placed.view, brackets, input) {
                let view = placed.view.mirrored_view();
                self.last_sphere
                    .record(input.captured_at, placed.rim_shift, view);
            }
        }
        self.stages.done("gather");
        let View::Moving(memory) = &mut self.placed else {
            return Ok(SeparatedSources::default());
        };
        if memory.is_empty() {
            return Err(EnvironmentError::NoScenePose);
        }
        self.measured.clone_from(&memory.radiance);
        self.coverage.clone_from(&memory.coverage);
        let full = self.measured.clone();
        let (seen, neighbours) = memory.seen(&self.grid.solid_angles);
        let samples = SampleGrid {
            directions: &self.grid.directions,
            solid_angles: seen,
            layout: Layout::Cube(neighbours),
        };
        let sources = find(&mut self.finder, samples, &full, &self.settings);
        let mut residual = full.clone();
        subtract_sources(&sources, seen, &mut residual);
        self.stages.done("sources");
        Ok((sources, residual, full))
    }

    /// Finds the sphere in this picture, with an unreliable margin of its rim excluded.
    fn place_sphere(&self, brackets: &[Bracket], input: &EnvironmentInput) -> Option<PlacedSphere> {
        let scene = input.scene?;
        let parallax = self.settings.parallax;
        let view = self.view.as_ref()?;
        let (Some(ball), EnvironmentView::SphereInScene { sphere }) = (input.sphere_position, view)
        else {
            let view = PlacedView::new(view, Some(scene), parallax)?;
            return Some(PlacedSphere {
                view,
                rim_shift: None,
            });
        };
        let (world_from_camera, camera) = scene;
        let camera_from_world = world_from_camera.inverse();
        let predicted = SphereInCamera {
            centre: camera_from_world.transform_point(ball.centre_in_world),
            radius: sphere.radius,
            sigma: ball.sigma,
        };
        let base = brackets.iter().find(|b| b.ev == 0.0)?;
        let found = refine(base.picture, camera, &predicted);
        let mut sphere = sphere.clone();
        sphere.centre_in_world = world_from_camera.transform_point(found.centre);
        let pixel = |ball: &SphereInCamera| camera.project(ball.centre);
        let shift = pixel(&predicted).zip(pixel(&found));
        Some(PlacedSphere {
            view: PlacedView::within_rim(&sphere, scene, found.sigma, parallax)?,
            rim_shift: shift.map(|(predicted, found)| predicted.distance(found)),
        })
    }

    /// Accumulates what the sphere shows in this picture; returns whether it shows anything.
    fn observe_sphere(
        &mut self,
        view: &PlacedView,
        brackets: &[Bracket],
        input: &EnvironmentInput,
    ) -> bool {
        let pixels = PixelDirections::around_mirror(view, input.hidden);
        let (radiance, clipped) = (&mut self.radiance, &mut self.clipped);
        merge(
            &self.merger,
            brackets,
            &pixels,
            self.per_reflectance,
            radiance,
            clipped,
        );
        self.update_shadow_factor(view, &pixels, brackets, input);
        let factor = self.shadow_factor;
        boost(
            &self.settings.clipped,
            &pixels,
            &mut self.radiance,
            &self.clipped,
            input,
            factor,
        );
        let samples = view.samples_for(self.grid.size);
        let table = GatherTable::new(view, &pixels.solid_angles, self.grid.size, samples);
        table.apply(&self.radiance, &mut self.measured);
        self.update_confidence(view, &table);
        let View::Moving(memory) = &mut self.placed else {
            return false;
        };
        let seen = Observation {
            radiance: &self.measured,
            coverage: &table.coverage,
            confidence: &self.confidence,
        };
        memory.accumulate(&seen, input.captured_at, self.settings.memory_seconds)
    }

    /// Computes the confidence of each texel of this picture.
    fn update_confidence(&mut self, view: &PlacedView, table: &GatherTable) {
        table.shares(&self.clipped, &mut self.clipped_mask, &mut self.confidence);
        let rows = self.confidence.iter_mut().zip(&table.coverage);
        for ((clipped, &covered), (d, &w)) in
            rows.zip(self.grid.directions.iter().zip(&self.grid.solid_angles))
        {
            let stretch = view.pixel_angle(d.as_dvec3()).filter(|_| covered > 0.0);
            *clipped = stretch.map_or(0.0, |s| confidence(w, s as f32, *clipped));
        }
    }

    /// Estimates the brightness of clipped sources from the shadows in the scene's picture, at
    /// intervals: the first estimate is taken as it is, later ones are smoothed.
    fn update_shadow_factor(
        &mut self,
        view: &PlacedView,
        pixels: &PixelDirections,
        brackets: &[Bracket],
        input: &EnvironmentInput,
    ) {
        let due = self.shadow_factor.is_none() || self.generation.is_multiple_of(SHADOW_INTERVAL);
        let measured = input.measured_ground_irradiance.is_some();
        let (Some((world_from_camera, camera)), false) = (input.scene, measured) else {
            return;
        };
        if self.clipped.is_empty() || !due {
            return;
        }
        let ground = Ground {
            height: self.settings.ground_height,
            world_from_camera,
            camera,
            hidden: input.hidden,
            hider: input.occluder_radiance.map_or(0.0, |l| l.dot(LUMINANCE)),
        };
        let scales = scales(brackets);
        let luminance_at = |x: u32, y: u32| {
            let square = (0..9).map(|k| (y + k / 3 - 1) * camera.width + x + k % 3 - 1);
            let mut sum = 0.0;
            for i in square {
                let (value, clipped) = self.merger.pixel(brackets, &scales, i as usize);
                if clipped {
                    return None;
                }
                sum += value.dot(LUMINANCE) / 9.0;
            }
            Some(sum)
        };
        let found = clipped_factor(
            view,
            pixels,
            &self.radiance,
            &self.clipped,
            &ground,
            luminance_at,
        );
        self.shadow_factor = match (self.shadow_factor, found) {
            (Some(old), Some(new)) => Some(old * (new / old).powf(0.4)),
            (old, new) => new.or(old),
        };
    }
}
