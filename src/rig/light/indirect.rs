//! Updates the indirect light of scenes with moving parts.
//!
//! Solving for it takes as long as several frames. So it is solved on its own thread, for the
//! positions of the parts in the middle of the interval in which the result is shown. A result
//! becomes active [`PERIOD`] after its start, and is waited for if necessary: the instant depends
//! on the session's time alone, so that replays are identical.

use glam::{DMat4, DVec3};
use penumbra_interface::threads;
use penumbra_lighting::Lighting;
use penumbra_scene::{IndirectLight, IndirectLightSolver, Part, PlacedLamp, RealSurfaces, Scene};
use std::thread::JoinHandle;

/// Time between two solutions, seconds.
const PERIOD: f64 = 0.5;

/// Displacement of a part that requires a new solution, as a share of the longest edge of the
/// bounding box of all virtual parts.
const FAR_ENOUGH: f64 = 0.02;

/// Indirect light, updated as parts move; see the module.
pub(crate) struct IndirectLightUpdater {
    solver: Option<IndirectLightSolver>,
    /// The virtual lights of the scene and what carries them.
    lights: Scene,
    /// Their state at the last update.
    lamps: Vec<PlacedLamp>,
    /// The scene and its casters, if parts of it move.
    moving: Option<Moving>,
    next: Option<Next>,
}

/// A solution in progress.
struct Next {
    /// Start of the solution, seconds after the session began.
    begun: f64,
    finding: JoinHandle<Option<IndirectLightSolver>>,
}

struct Moving {
    scene: Scene,
    casters: Vec<Part>,
    /// Bounding boxes of the moving parts, in the parts' coordinates.
    boxes: Vec<[DVec3; 2]>,
    /// Displacement that requires a new solution, metres.
    far_enough: f64,
}

impl IndirectLightUpdater {
    /// Creates an updater for `scene` in its initial state; `casters` are its virtual parts.
    pub fn new(scene: &Scene, casters: &[Part]) -> Self {
        Self {
            solver: IndirectLightSolver::new(scene, casters),
            lights: Scene {
                lamps: scene.lamps.clone(),
                motions: scene.motions.clone(),
                ..Scene::default()
            },
            lamps: Vec::new(),
            moving: Moving::new(scene, casters),
            next: None,
        }
    }

    /// Continues from the state for the previous scene.
    pub fn follow(&mut self, before: &Self) {
        if let (Some(solver), Some(before)) = (&mut self.solver, &before.solver) {
            solver.follow(before);
        }
    }

    /// Updates the light to `seconds` after the session began, approximately: see the module.
    pub fn update(&mut self, seconds: f64, lighting: &Lighting, real: RealSurfaces<'_>) {
        let Some(solver) = &mut self.solver else {
            return;
        };
        if !solver.is_outdated(lighting) {
            return;
        }
        self.lights.lamps_at(seconds, &mut self.lamps);
        // Time starts again with each loop of a recording.
        let due = |next: &mut Next| !(0.0..PERIOD).contains(&(seconds - next.begun));
        if let Some(next) = self.next.take_if(due)
            && let Ok(Some(mut found)) = next.finding.join()
        {
            found.follow(solver);
            *solver = found;
        }
        solver.update(lighting, real, &self.lamps);
        if self.next.is_none()
            && let Some(moving) = &mut self.moving
        {
            self.next = moving.begin(seconds);
        }
    }

    /// Returns the latest solution.
    pub fn light(&self) -> Option<&IndirectLight> {
        self.solver.as_ref().map(IndirectLightSolver::light)
    }
}

impl Moving {
    /// Returns `None` if no part moves.
    fn new(scene: &Scene, casters: &[Part]) -> Option<Self> {
        let bounds = |part: &Part, place: DMat4| {
            let all = part.mesh.vertices.iter().map(|v| v.position.as_dvec3());
            let all = all.map(|p| place.transform_point3(p));
            let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
            all.fold(none, |[low, high], p| [low.min(p), high.max(p)])
        };
        let all = casters
            .iter()
            .map(|part| bounds(part, part.world_from_part));
        let [low, high] = all.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        let movers = scene.motions.parts.iter();
        let boxes: Option<Vec<_>> = movers
            .map(|mover| Some(bounds(casters.get(mover.index)?, DMat4::IDENTITY)))
            .collect();
        let boxes = boxes.filter(|boxes| !boxes.is_empty())?;
        Some(Self {
            boxes,
            far_enough: FAR_ENOUGH * (high - low).max_element(),
            scene: scene.clone(),
            casters: casters.to_vec(),
        })
    }

    /// Starts the solution for the period after `seconds`, if parts have moved far enough.
    fn begin(&mut self, seconds: f64) -> Option<Next> {
        if !self.go_to(seconds + 1.5 * PERIOD) {
            return None;
        }
        let (scene, casters) = (self.scene.clone(), self.casters.clone());
        let find = move || IndirectLightSolver::new(&scene, &casters);
        let finding = threads::spawn_background("indirect light", find);
        // If the system cannot start a thread, the latest solution stays.
        finding.ok().map(|finding| Next {
            begun: seconds,
            finding,
        })
    }

    /// Moves all parts to their positions at `seconds` if a part has moved far enough since the
    /// last move. Returns whether it did.
    fn go_to(&mut self, seconds: f64) -> bool {
        let mut movers = self.scene.motions.parts.iter().zip(&self.boxes);
        let far = movers.any(|(mover, ends)| {
            let Some(part) = self.casters.get(mover.index) else {
                return false;
            };
            let (now, then) = (mover.motion.at(seconds), part.world_from_part);
            let mut corners = (0..8).map(|i| {
                let pick = |axis: usize| ends[i >> axis & 1][axis];
                DVec3::new(pick(0), pick(1), pick(2))
            });
            let far = |c: DVec3| now.transform_point3(c).distance(then.transform_point3(c));
            corners.any(|c| far(c) > self.far_enough)
        });
        if far {
            self.scene.place_at(seconds);
            for (caster, part) in self.casters.iter_mut().zip(&self.scene.virtual_parts) {
                caster.world_from_part = part.world_from_part;
            }
        }
        far
    }
}

#[cfg(test)]
mod tests;
