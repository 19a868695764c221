//! From a scene to its bake: planes, what the bake is known by, images. The same for
//! `penumbra bake` and for a rig that needs one.

use crate::error::RigError;
use crate::setup::RigSetup;
use crate::source::Source;
use glam::DMat4;
use penumbra_compositor::Gpu;
use penumbra_compositor::planes::{Progress, bake, mend};
use penumbra_config::{Config, PlanesConfig};
use penumbra_scene::SceneChoice;
use penumbra_scene::planes::Bake;
use penumbra_scene::planes::renew::renew;
use penumbra_scene::planes::store::{cache_path, default_cache_folder, key};
use penumbra_scene::planes::{PlaneSettings, generate};
use penumbra_scene::{Scene, SceneAddition, load_gltf};
use penumbra_session::Session;
use std::path::{Path, PathBuf};

/// What is to be baked, before anything is drawn.
#[derive(Clone, Debug)]
pub struct BakePlan {
    planes: PlaneSettings,
    /// What the bake is known by.
    pub key: [u8; 32],
}

impl BakePlan {
    /// The plan for `scene`.
    #[must_use]
    pub fn new(scene: &Scene, config: &PlanesConfig) -> Self {
        let planes = plane_settings(config);
        let key = key(scene, &planes, &config.bake_settings());
        Self { planes, key }
    }

    /// Where such a bake is kept; `None` for a user without a home.
    #[must_use]
    pub fn cache_file(&self, config: &PlanesConfig) -> Option<PathBuf> {
        let folder = config.cache.clone().or_else(default_cache_folder)?;
        Some(cache_path(&folder, &self.key))
    }

    /// Puts planes around what is in `scene`, none where nothing is virtual, and draws all basis
    /// images.
    ///
    /// # Errors
    /// A model that no planes can be made from; the graphics device was lost, or has no room; `progress` ended it.
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

/// The bake of `scene`, where `old` is that of `old_scene`: only what has changed is drawn. Such
/// a bake has planes of its own and is not kept; its key is zero.
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
    Ok(mend(gpu, scene, old, &renewal, progress)?)
}

/// The scene that a file describes: a scene file or a glTF model, with phantoms and ground of
/// `session` where one is given; or a session with all that it brings.
///
/// # Errors
/// A file of another kind; what cannot be read; a scene with nothing virtual in it.
pub fn scene_to_bake(
    path: &Path,
    session: Option<&Path>,
    config: &Config,
) -> Result<Scene, RigError> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    let scene = match (extension.to_str(), session) {
        (Some("mcap"), None) => of_session(path, SceneChoice::Session, config)?,
        (Some("toml"), None) => SceneAddition::load(path)?.onto(Scene::default()),
        (Some("toml"), Some(session)) => {
            of_session(session, SceneChoice::File(path.to_owned()), config)?
        }
        (Some("glb" | "gltf"), session) => Scene {
            virtual_parts: load_gltf(path)?.placed(DMat4::IDENTITY),
            ..match session {
                Some(session) => of_session(session, SceneChoice::None, config)?,
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
        return Err(RigError::NothingVirtual {
            path: path.to_owned(),
        });
    }
    if let Some(part) = scene
        .motions
        .parts
        .first()
        .and_then(|m| scene.virtual_parts.get(m.index))
    {
        return Err(RigError::Moves {
            path: path.to_owned(),
            part: part.name.clone(),
        });
    }
    Ok(scene)
}

fn of_session(session: &Path, scene: SceneChoice, config: &Config) -> Result<Scene, RigError> {
    let source = Source::Recorded(Session::open(session)?);
    let config = Config {
        scene,
        ..config.clone()
    };
    Ok(RigSetup::read(&source, &config)?.scene)
}
