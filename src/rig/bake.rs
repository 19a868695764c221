//! Bakes the shadowing planes of a scene: planes, cache key, images. Used by `penumbra bake` and by
//! a rig that needs a bake.

use crate::error::RigError;
use crate::setup::RigSetup;
use crate::source::Source;
use glam::DMat4;
use penumbra_compositor::Gpu;
use penumbra_compositor::planes::{Progress, bake, repair};
use penumbra_config::{Config, PlanesConfig};
use penumbra_scene::SceneChoice;
use penumbra_scene::planes::Bake;
use penumbra_scene::planes::renew::renew;
use penumbra_scene::planes::store::{cache_path, default_cache_folder, key};
use penumbra_scene::planes::{PlaneSettings, generate};
use penumbra_scene::{Scene, SceneAddition, load_gltf};
use penumbra_session::Session;
use std::path::{Path, PathBuf};

/// The settings and the cache key of a bake.
#[derive(Clone, Debug)]
pub struct BakePlan {
    planes: PlaneSettings,
    /// Cache key of the bake.
    pub key: [u8; 32],
}

impl BakePlan {
    /// Creates the plan for `scene`.
    #[must_use]
    pub fn new(scene: &Scene, config: &PlanesConfig) -> Self {
        let planes = plane_settings(config);
        let key = key(scene, &planes, &config.bake_settings());
        Self { planes, key }
    }

    /// Returns the path of the bake in the cache; `None` for a user without a home folder.
    #[must_use]
    pub fn cache_file(&self, config: &PlanesConfig) -> Option<PathBuf> {
        let folder = config.cache.clone().or_else(default_cache_folder)?;
        Some(cache_path(&folder, &self.key))
    }

    /// Generates planes around the objects in `scene` (none without virtual objects) and renders
    /// all basis images.
    ///
    /// # Errors
    /// No planes can be generated from the model, the graphics device was lost or is out of memory,
    /// or `progress` ended the bake.
    pub fn bake(
        self,
        gpu: &Gpu,
        scene: &Scene,
        config: &PlanesConfig,
        progress: &mut Progress<'_>,
    ) -> Result<Bake, RigError> {
        let planes = generate(scene, &self.planes)?;
        tracing::info!(
            "baking {} shadowing planes; the next start reads them from the cache",
            planes.len()
        );
        let mut bake = bake(gpu, scene, planes, config.bake_settings(), progress)?;
        bake.key = self.key;
        Ok(bake)
    }
}

fn plane_settings(config: &PlanesConfig) -> PlaneSettings {
    PlaneSettings {
        count: config.count,
        clusters: config.clusters,
        offset_m: config.offset,
        receiver: config.receiver.into(),
    }
}

/// Bakes `scene` from `old`, the bake of `old_scene`, and renders only changed images. Such a bake
/// has planes of its own and is not cached; its key is zero.
///
/// # Errors
/// As for [`BakePlan::new`] and [`BakePlan::bake`].
pub fn bake_changes(
    gpu: &Gpu,
    (old_scene, old): (&Scene, &Bake),
    scene: &Scene,
    config: &PlanesConfig,
    progress: &mut Progress<'_>,
) -> Result<Bake, RigError> {
    let renewal = renew(old, old_scene, scene, &plane_settings(config))?;
    let (planes, images) = renewal.counts();
    tracing::info!("the scene has changed: baking {planes} new planes, {images} images");
    Ok(repair(gpu, scene, old, &renewal, progress)?)
}

/// Returns the scene of a file: a scene file or a glTF model, with phantoms and ground of `session`
/// if one is given; or the scene of a session.
///
/// # Errors
/// The file is of another kind or cannot be read, or the scene has no virtual objects or has moving
/// ones.
pub fn scene_to_bake(
    path: &Path,
    session: Option<&Path>,
    config: &Config,
) -> Result<Scene, RigError> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let scene = match (extension.to_str(), session) {
        (Some("mcap"), None) => scene_of_session(path, SceneChoice::Session, config)?,
        (Some("toml"), None) => SceneAddition::load(path)?.onto(Scene::default()),
        (Some("toml"), Some(session)) => {
            scene_of_session(session, SceneChoice::File(path.to_owned()), config)?
        }
        (Some("glb" | "gltf"), session) => Scene {
            virtual_parts: load_gltf(path)?.placed(DMat4::IDENTITY),
            ..match session {
                Some(session) => scene_of_session(session, SceneChoice::None, config)?,
                None => Scene::default(),
            }
        },
        _ => {
            return Err(RigError::NoScene {
                path: path.to_owned(),
            });
        }
    };
    if scene.virtual_parts.is_empty() {
        return Err(RigError::NoVirtualObjects {
            path: path.to_owned(),
        });
    }
    if let Some(part) = scene
        .motions
        .parts
        .first()
        .and_then(|m| scene.virtual_parts.get(m.index))
    {
        return Err(RigError::MovingObject {
            path: path.to_owned(),
            part: part.name.clone(),
        });
    }
    Ok(scene)
}

fn scene_of_session(
    session: &Path,
    scene: SceneChoice,
    config: &Config,
) -> Result<Scene, RigError> {
    let source = Source::Recorded(Session::open(session)?);
    let config = Config {
        scene,
        ..config.clone()
    };
    Ok(RigSetup::read(&source, &config)?.scene)
}
