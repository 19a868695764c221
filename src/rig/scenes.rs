//! Holds the rendered scene and replaces it between frames when its file changes.

use crate::context::RunContext;
use crate::error::RigError;
use crate::light::updates::SceneUpdates;
use crate::objects::{self, ObjectEditor};
use crate::planes::PlaneBakes;
use crate::reload::{Loaded, Origin, Reload, ReloadOutcome, ShowRequest};
use crate::scene_folder::ScenesOnDisk;
use crate::scene_origin::{NewestScene, RigScenes, SceneOrigin};
use crate::status::UNCALIBRATED;
use crossbeam_channel::{Receiver, bounded};
use glam::DQuat;
use penumbra_camera::PinholeCamera;
use penumbra_compositor::{Compositor, fitted, max_side};
use penumbra_interface::RigidTransform;
use penumbra_lighting::Lighting;
use penumbra_scene::Scene;
use penumbra_status::{SceneStatus, Settings};
use std::sync::{Arc, Mutex};

/// The rendered scene and the one that will replace it.
pub(super) struct Scenes {
    shown: Arc<Scene>,
    /// The next scene, whose bake is not ready yet.
    next: Option<Box<Loaded>>,
    reload: Reload,
    editor: Arc<ObjectEditor>,
    scene_updates: SceneUpdates,
    dome_rotation: DQuat,
    status: SceneStatus,
}

impl Scenes {
    /// Shows the initial scene and starts to watch its file, if it has one.
    ///
    /// # Errors
    /// The session's scene cannot be read, or the system cannot start a thread.
    pub fn new(
        context: &RunContext,
        compositor: &mut Compositor,
        scene_updates: SceneUpdates,
    ) -> Result<Self, RigError> {
        let scene = &context.setup.scene;
        compositor.set_scene(scene, &penumbra_scene::casters(scene));
        let shown = Arc::new(scene.clone());
        let mut status = SceneStatus::default();
        let editor = object_editor(context, shown.clone());
        let origin = SceneOrigin::of(&context.config.scene);
        status.file = origin.label();
        let rig_scenes = RigScenes::new(&context.source, &context.config)?;
        let newest = Arc::new(NewestScene::new(origin, rig_scenes, editor.clone()));
        let reload = Reload::start(Origin {
            requests: show_requests(context, &newest),
            newest,
            shown: shown.clone(),
            rig: context.setup.calibration.clone(),
            config: context.config.clone(),
            uploader: Arc::new(Mutex::new(compositor.uploader())),
        })?;
        publish_warnings(context, &shown, compositor);
        Ok(Self {
            shown,
            next: None,
            reload,
            editor,
            scene_updates,
            dome_rotation: DQuat::IDENTITY,
            status,
        })
    }

    /// Shows the scene with a new compositor, whose predecessor's device was lost.
    pub fn upload_to(&mut self, compositor: &mut Compositor) {
        compositor.set_scene(&self.shown, &penumbra_scene::casters(&self.shown));
        if let Some(next) = &mut self.next {
            next.upload_to(compositor);
        }
        self.reload.set_uploader(compositor.uploader());
    }

    /// Returns the rendered scene.
    pub const fn shown(&self) -> &Arc<Scene> {
        &self.shown
    }

    /// Sets the camera's pose in the newest picture, for picking objects.
    pub fn set_view(&self, pose: Option<RigidTransform>, camera: &PinholeCamera, seconds: f64) {
        self.editor.set_view(&self.shown, pose, camera, seconds);
    }

    /// Returns the status of the scene file's changes.
    pub const fn status(&self) -> &SceneStatus {
        &self.status
    }

    /// Shows a changed scene as soon as it is loaded or, with shadowing planes, as soon as its bake
    /// is ready or has failed. `lighting` is the light of the next picture.
    pub fn update(
        &mut self,
        context: &RunContext,
        settings: &Settings,
        lighting: Option<&Arc<Lighting>>,
        planes: &mut PlaneBakes,
        compositor: &mut Compositor,
    ) -> Result<(), RigError> {
        match self.reload.poll() {
            Some(ReloadOutcome::Loaded(mut loaded)) => {
                loaded.upload_to(compositor);
                self.set_next(context, loaded);
            }
            Some(ReloadOutcome::Failed(reason)) => self.reject(context, reason),
            None => (),
        }
        let wanted = self.next.as_ref().map_or(&self.shown, |next| &next.scene);
        let wanted = wanted.clone();
        let scenes = (&wanted, &self.shown);
        if planes.update(context, settings, scenes, lighting, compositor)?
            && let Some(next) = self.next.take()
        {
            let left_out = left_out(&self.shown, compositor);
            compositor.show_scene(next.uploaded);
            self.scene_updates.set_scene(next.light);
            let old = std::mem::replace(&mut self.shown, next.scene);
            objects::shown(&context.status, next.edits);
            if !next.is_edit {
                self.status.loads += 1;
                self.status.file = next.origin.label();
                context.status.update(|s| {
                    let warnings = old.warnings.iter().chain(&left_out);
                    warnings.for_each(|text| s.clear_warning(text));
                });
                publish_warnings(context, &self.shown, compositor);
            }
        }
        if self.dome_rotation != planes.dome_rotation() {
            self.dome_rotation = planes.dome_rotation();
            self.scene_updates
                .set_dome_rotation(self.dome_rotation.as_quat());
        }
        Ok(())
    }

    fn set_next(&mut self, context: &RunContext, loaded: Box<Loaded>) {
        self.clear_failure(context);
        self.next = Some(match self.next.take() {
            Some(older) => Box::new(loaded.over(*older)),
            None => loaded,
        });
    }

    fn reject(&mut self, context: &RunContext, reason: String) {
        self.clear_failure(context);
        tracing::warn!("{reason}; the previous scene is kept");
        context.status.update(|s| s.warn(&reason));
        self.status.reason = Some(reason);
    }

    /// Clears the warning of an earlier failure.
    fn clear_failure(&mut self, context: &RunContext) {
        if let Some(reason) = self.status.reason.take() {
            context.status.update(|s| s.clear_warning(&reason));
        }
    }
}

/// Offers the folder of scenes to users; returns their requests.
fn show_requests(context: &RunContext, newest: &Arc<NewestScene>) -> Receiver<ShowRequest> {
    let (sender, requests) = bounded(1);
    let closed = (!context.setup.calibrated).then(|| UNCALIBRATED.to_owned());
    let (config, status) = (&context.config, &context.status);
    let folder = ScenesOnDisk::new(config, status, closed, Arc::clone(newest), sender);
    context.status.set_scene_control(folder);
    requests
}

/// Creates the editor of the objects' places and hands requests to it.
fn object_editor(context: &RunContext, scene: Arc<Scene>) -> Arc<ObjectEditor> {
    let distortion = context.config.registration.distortion;
    let editor = ObjectEditor::new(&context.status, distortion, scene);
    context.status.set_object_control(editor.clone());
    editor
}

/// Returns warnings about textures that the adapter cannot hold; the compositor scales them.
fn large_textures(scene: &Scene, compositor: &Compositor) -> Vec<String> {
    let max = max_side(&compositor.gpu().device);
    let mut warnings: Vec<String> = Vec::new();
    for part in &scene.virtual_parts {
        for texture in part.material.textures() {
            let size = (texture.width, texture.height);
            let (width, height) = fitted(size, max);
            let text = format!(
                "{}: a texture of {}x{} is scaled to {width}x{height}, because this adapter's \
                 limit is {max}",
                part.name, size.0, size.1
            );
            if size != (width, height) && !warnings.contains(&text) {
                warnings.push(text);
            }
        }
    }
    warnings
}

/// Returns warnings about the parts whose surfaces are too rough for shadows on them.
fn without_shadows<'a>(
    scene: &'a Scene,
    compositor: &'a Compositor,
) -> impl Iterator<Item = String> + 'a {
    let parts = compositor.without_shadows().iter();
    let parts = parts.filter_map(|part| scene.virtual_parts.get(*part));
    parts.map(|part| {
        format!(
            "{}: the surface is too rough for shadows on it at this quality, and is shown without; smooth \
             the mesh, give it fewer triangles, or set picture.quality = \"best\"",
            part.name
        )
    })
}

/// Returns warnings about what the compositor leaves out of a scene that it shows.
fn left_out(scene: &Scene, compositor: &Compositor) -> Vec<String> {
    let mut warnings = large_textures(scene, compositor);
    warnings.extend(without_shadows(scene, compositor));
    warnings
}

/// Publishes the warnings of a scene.
fn publish_warnings(context: &RunContext, scene: &Scene, compositor: &Compositor) {
    let left_out = left_out(scene, compositor);
    for text in scene.warnings.iter().chain(&left_out) {
        tracing::warn!("{text}");
        context.status.update(|s| s.warn(text));
    }
}
