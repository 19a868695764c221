//! Moves, turns and scales virtual objects on request. Rays through the picture's pixels are cast here,
//! because the rig knows the lens and the camera's pose.

use glam::{DMat4, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_config::Distortion;
use penumbra_interface::RigidTransform;
use penumbra_scene::edit::{EDIT_SCALES, Edit, MAX_OFFSET};
use penumbra_scene::{RayCaster, Scene};
use penumbra_status::SharedStatus;
use penumbra_status::objects::{
    ObjectAnswer, ObjectControl, ObjectPlace, ObjectRefusal, ObjectRequest,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum distance of a point to which an object is dragged, metres.
const MAX_DISTANCE: f64 = 100.0;

/// The requested places of the objects, and the newest picture's view of them.
pub(super) struct ObjectEditor {
    status: Arc<SharedStatus>,
    distortion: Distortion,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// The scene of the files, without edits.
    base: Arc<Scene>,
    edits: Vec<Edit>,
    /// Number of changes requested.
    requested: u64,
    /// The newest picture.
    view: Option<View>,
    /// Surfaces of the real scene, of the scene for which they were prepared.
    real: Option<(Arc<Scene>, Arc<RayCaster>)>,
}

/// What the newest picture shows.
#[derive(Clone)]
struct View {
    scene: Arc<Scene>,
    /// The lens of the composed picture.
    camera: PinholeCamera,
    world_from_camera: RigidTransform,
    seconds: f64,
}

/// A ray in the world.
#[derive(Clone, Copy)]
struct Ray {
    origin: DVec3,
    direction: DVec3,
}

impl ObjectEditor {
    pub fn new(status: &Arc<SharedStatus>, distortion: Distortion, base: Arc<Scene>) -> Arc<Self> {
        let editor = Self {
            status: Arc::clone(status),
            distortion,
            state: Mutex::new(State {
                edits: vec![Edit::default(); base.object_list().len()],
                base,
                ..State::default()
            }),
        };
        editor.publish(&editor.lock());
        Arc::new(editor)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets what the newest picture shows; without a pose nothing can be picked.
    pub fn set_view(
        &self,
        scene: &Arc<Scene>,
        pose: Option<RigidTransform>,
        camera: &PinholeCamera,
        seconds: f64,
    ) {
        let mut camera = camera.clone();
        if self.distortion == Distortion::Undistorted {
            camera.distortion = [0.0; 5];
        }
        self.lock().view = pose.map(|world_from_camera| View {
            scene: Arc::clone(scene),
            camera,
            world_from_camera,
            seconds,
        });
    }

    /// Replaces the scene of the files; returns it with the requested edits, and their number. Its
    /// objects keep their edits if `keeps_edits` and there are as many.
    pub fn set_base(&self, base: Arc<Scene>, keeps_edits: bool) -> (u64, Arc<Scene>) {
        let mut state = self.lock();
        let count = base.object_list().len();
        if state.edits.len() != count || !keeps_edits {
            state.edits = vec![Edit::default(); count];
        }
        state.base = base;
        let edited = Arc::new(state.base.edited(&state.edits));
        self.publish(&state);
        (state.requested, edited)
    }

    /// Returns the scene with the requested edits and their number, if that is not `shown`.
    pub fn newer_than(&self, shown: u64) -> Option<(u64, Arc<Scene>)> {
        let state = self.lock();
        let (requested, base, edits) = (state.requested, state.base.clone(), state.edits.clone());
        drop(state);
        (requested != shown).then(|| (requested, Arc::new(base.edited(&edits))))
    }

    /// Returns the displacement of each object from its place in the scene's files, world.
    pub fn displacements(&self) -> Vec<DMat4> {
        let state = self.lock();
        let (base, edits) = (state.base.clone(), state.edits.clone());
        drop(state);
        base.displacements(&edits)
    }

    fn publish(&self, state: &State) {
        let list = places(state);
        self.status.update(|s| {
            s.objects.requested = state.requested;
            s.objects.list = list;
        });
    }

    fn ray(&self, view: &View, [u, v]: [f64; 2]) -> Ray {
        let camera = &view.camera;
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let direction = camera.unproject(DVec2::new(u, v) * size - 0.5);
        Ray {
            origin: view.world_from_camera.translation,
            direction: view.world_from_camera.rotation * direction,
        }
    }

    /// Returns the point of the real scene that a ray hits.
    fn real_point(&self, view: &View, ray: Ray) -> Option<DVec3> {
        let mut state = self.lock();
        let known = state
            .real
            .as_ref()
            .filter(|(scene, _)| Arc::ptr_eq(scene, &view.scene));
        let rays = if let Some((_, rays)) = known {
            rays.clone()
        } else {
            let rays = Arc::new(RayCaster::from_phantoms(&view.scene));
            state.real = Some((view.scene.clone(), rays.clone()));
            rays
        };
        drop(state);
        let hit = rays.nearest(ray.origin, ray.direction)?;
        (hit.distance < MAX_DISTANCE).then_some(hit.point)
    }

    fn change(
        &self,
        index: usize,
        request: &ObjectRequest,
        real: Option<DVec3>,
    ) -> Result<(), ObjectRefusal> {
        let mut state = self.lock();
        let Some(edit) = state.edits.get(index).copied() else {
            let reason = format!("there is no object {index}");
            return Err(ObjectRefusal::Invalid {
                field: "object",
                reason,
            });
        };
        let mut offset = request.offset_m.map_or(edit.offset, DVec3::from_array);
        if let Some(grabbed) = request.grabbed_m {
            let Some(real) = real else {
                let reason =
                    "no real surface is known there; drag it to the ground or to a phantom";
                return Err(ObjectRefusal::Invalid {
                    field: "at",
                    reason: reason.to_owned(),
                });
            };
            offset += real - DVec3::from_array(grabbed);
        }
        let edit = Edit {
            offset,
            turn: request.turn_deg.map_or(edit.turn, f64::to_radians),
            scale: request.scale.unwrap_or(edit.scale),
        };
        check(edit)?;
        if state.edits[index] != edit {
            state.edits[index] = edit;
            state.requested += 1;
        }
        self.publish(&state);
        Ok(())
    }
}

impl ObjectControl for ObjectEditor {
    fn carry_out(&self, request: &ObjectRequest) -> Result<ObjectAnswer, ObjectRefusal> {
        let view = self.lock().view.clone();
        let ray = match (request.at, &view) {
            (None, _) => None,
            (Some(at), Some(view)) => Some((view, self.ray(view, at))),
            (Some(_), None) => {
                let reason =
                    "the camera's pose is unknown, so no place in the picture is known".to_owned();
                return Err(ObjectRefusal::Unavailable { reason });
            }
        };
        let real = ray.and_then(|(view, ray)| self.real_point(view, ray));
        let object = match request.object {
            Some(index) => {
                self.change(index, request, real)?;
                Some(index)
            }
            None => ray.and_then(|(view, ray)| picked(view, ray, real)),
        };
        Ok(ObjectAnswer {
            object,
            real_m: real.map(|p| p.to_array()),
            objects: self.status.snapshot().objects,
        })
    }
}

/// Returns the object that a ray hits, unless a real surface is in front of it.
fn picked(view: &View, ray: Ray, real: Option<DVec3>) -> Option<usize> {
    let mut scene = (*view.scene).clone();
    scene.place_at(view.seconds);
    let hit = RayCaster::from_parts(&scene.virtual_parts).nearest(ray.origin, ray.direction)?;
    // Objects stand on real surfaces.
    let is_hidden = real.is_some_and(|p| p.distance(ray.origin) < hit.distance - 1e-3);
    let holds =
        |object: &penumbra_scene::edit::SceneObject| object.parts.contains(&(hit.surface as usize));
    let object = scene.object_list().iter().position(holds)?;
    (!is_hidden).then_some(object)
}

fn check(edit: Edit) -> Result<(), ObjectRefusal> {
    let invalid = |field, reason: String| Err(ObjectRefusal::Invalid { field, reason });
    if !edit.offset.is_finite() || edit.offset.abs().max_element() > MAX_OFFSET {
        return invalid(
            "offset_m",
            format!("expected at most {MAX_OFFSET} m per axis"),
        );
    }
    if !edit.turn.is_finite() {
        return invalid("turn_deg", "expected a number".to_owned());
    }
    if !EDIT_SCALES.contains(&edit.scale) {
        let (low, high) = EDIT_SCALES.into_inner();
        return invalid(
            "scale",
            format!(
                "{} is out of range; choose a number from {low} to {high}",
                edit.scale
            ),
        );
    }
    Ok(())
}

fn places(state: &State) -> Vec<ObjectPlace> {
    let objects = state.base.object_list();
    let named = objects.into_iter().zip(&state.edits);
    let place = |(object, edit): (penumbra_scene::edit::SceneObject, &Edit)| ObjectPlace {
        name: object.name,
        offset_m: edit.offset.to_array(),
        turn_deg: edit.turn.to_degrees(),
        scale: edit.scale,
    };
    named.map(place).collect()
}

/// Publishes the number of the change that the newest picture shows.
pub(super) fn shown(status: &SharedStatus, number: u64) {
    status.update(|s| s.objects.shown = number);
}
