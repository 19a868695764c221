//! What the shown scene is read from: a scene file, a model, or the rig's own files.

use crate::error::RigError;
use crate::objects::ObjectEditor;
use crate::setup::rig_document;
use crate::source::{RigFiles, Source};
use bytes::Bytes;
use glam::{DMat4, DVec4};
use penumbra_config::Config;
use penumbra_rig_model::RigDocument;
use penumbra_scene::scene_file::{displaced_text, files_of, files_of_model, model_text};
use penumbra_scene::{Scene, SceneAddition, SceneChoice, z_up_from_y_up};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What the shown scene is read from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum SceneOrigin {
    /// The rig's own files.
    Session,
    /// Nothing virtual is shown.
    Nothing,
    /// A scene file.
    File(PathBuf),
    /// A model, alone.
    Model(PathBuf),
}

impl SceneOrigin {
    /// Returns the origin that the configuration chooses.
    pub fn of(choice: &SceneChoice) -> Self {
        match choice {
            SceneChoice::Session => Self::Session,
            SceneChoice::None => Self::Nothing,
            SceneChoice::File(path) => Self::File(path.clone()),
        }
    }

    /// Returns its files, whether they exist or not.
    pub fn files(&self) -> Vec<PathBuf> {
        match self {
            Self::Session | Self::Nothing => Vec::new(),
            Self::File(path) => files_of(path),
            Self::Model(path) => files_of_model(path),
        }
    }

    /// Returns its file for the status.
    pub fn label(&self) -> Option<String> {
        match self {
            Self::Session | Self::Nothing => None,
            Self::File(path) | Self::Model(path) => Some(path.display().to_string()),
        }
    }

    /// Reads the scene.
    ///
    /// # Errors
    /// A file cannot be read or is invalid.
    pub fn load(&self, rig: &RigScenes) -> Result<Scene, RigError> {
        let addition = match self {
            Self::Session => return rig.own(),
            Self::Nothing => return rig.real(),
            Self::File(path) => SceneAddition::load(path)?,
            Self::Model(path) => SceneAddition::load_model(path)?,
        };
        Ok(addition.onto(rig.real()?))
    }
}

/// A scene as files, to be saved.
#[derive(Clone, Debug, Default)]
pub(super) struct SavedScene {
    /// The text of the scene file.
    pub text: String,
    /// The model that it names, where that is not in a folder.
    pub model: Option<Bytes>,
}

impl SceneOrigin {
    /// Returns the scene with its objects displaced by a world transform each. `stem` is the name of
    /// the file without its ending, for a model beside it.
    ///
    /// # Errors
    /// The message for the user: the scene cannot be stated by a scene file.
    fn saved(
        &self,
        rig: &RigScenes,
        displacements: &[DMat4],
        stem: &str,
    ) -> Result<SavedScene, String> {
        let name = |path: &Path| {
            path.file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned()
        };
        match self {
            Self::Session => rig.saved(displacements, stem),
            Self::Nothing => Err("nothing virtual is shown".to_owned()),
            Self::File(path) => {
                let text = std::fs::read_to_string(path);
                let text = text.map_err(|e| format!("{}: {e}", path.display()))?;
                saved(&path.display().to_string(), &text, displacements)
            }
            Self::Model(path) => {
                let text = model_text(&name(path));
                saved(&path.display().to_string(), &text, displacements)
            }
        }
    }
}

/// The newest scene: what it is read from, and where users have put its objects. It is saved from
/// here while another thread prepares it, because that can take seconds.
pub(super) struct NewestScene {
    origin: Mutex<SceneOrigin>,
    /// The scenes of the rig's own files.
    pub rig_scenes: RigScenes,
    /// Displaces the objects.
    pub editor: Arc<ObjectEditor>,
}

impl NewestScene {
    pub fn new(origin: SceneOrigin, rig_scenes: RigScenes, editor: Arc<ObjectEditor>) -> Self {
        Self {
            origin: Mutex::new(origin),
            rig_scenes,
            editor,
        }
    }

    pub fn origin(&self) -> SceneOrigin {
        self.lock().clone()
    }

    /// Reads the scene of `origin` and makes it the newest; returns it with its objects where users
    /// have put them, and the number of their newest change.
    ///
    /// # Errors
    /// A file cannot be read or is invalid; the previous scene stays.
    pub fn load(&self, origin: SceneOrigin) -> Result<(u64, Arc<Scene>), RigError> {
        let scene = Arc::new(origin.load(&self.rig_scenes)?);
        let mut newest = self.lock();
        let keeps_edits = origin == *newest;
        *newest = origin;
        Ok(self.editor.set_base(scene, keeps_edits))
    }

    /// Returns the files that state the scene; see [`SceneOrigin::saved`].
    ///
    /// # Errors
    /// The message for the user: the scene cannot be stated by a scene file.
    pub fn saved(&self, stem: &str) -> Result<SavedScene, String> {
        let newest = self.lock();
        let displacements = self.editor.displacements();
        newest.saved(&self.rig_scenes, &displacements, stem)
    }

    fn lock(&self) -> MutexGuard<'_, SceneOrigin> {
        self.origin.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn saved(name: &str, text: &str, displacements: &[DMat4]) -> Result<SavedScene, String> {
    let text = displaced_text(name, text, displacements).map_err(|e| e.to_string())?;
    Ok(SavedScene { text, model: None })
}

/// Tolerance of a transform that a scene file can state.
const SIMILAR: f64 = 1e-6;

/// Whether a transform scales alike along all axes, without shear or reflection.
fn is_similarity(transform: DMat4) -> bool {
    let axes = [transform.x_axis, transform.y_axis, transform.z_axis].map(DVec4::truncate);
    let [x, y, z] = axes;
    let scale = x.length();
    let is_square = [x.dot(y), y.dot(z), z.dot(x)]
        .iter()
        .all(|d| d.abs() < SIMILAR);
    let is_even = [y, z].iter().all(|a| (a.length() - scale).abs() < SIMILAR);
    is_square && is_even && x.cross(y).dot(z) > 0.0
}

/// The scenes that the rig's own files describe.
pub(super) struct RigScenes {
    files: RigFiles,
    document: RigDocument,
}

impl RigScenes {
    /// Reads the description of the rig.
    ///
    /// # Errors
    /// A file of the rig is invalid.
    pub fn new(source: &Source, config: &Config) -> Result<Self, RigError> {
        Ok(Self {
            files: source.files(),
            document: rig_document(source, config)?,
        })
    }

    /// Whether they describe something virtual.
    pub fn has_own(&self) -> bool {
        self.document.object.is_some() || !self.document.virtual_lights.is_empty()
    }

    /// Returns its own virtual object as a scene file and the model that it names, `stem.glb`.
    fn saved(&self, displacements: &[DMat4], stem: &str) -> Result<SavedScene, String> {
        let document = &self.document;
        if !document.virtual_lights.is_empty() {
            return Err("the lamps of rig.json cannot be saved to a scene file".to_owned());
        }
        let Some(object) = &document.object else {
            return Err("nothing virtual is shown".to_owned());
        };
        let bytes = self
            .files
            .all()
            .iter()
            .rev()
            .find(|f| f.name == object.file);
        let bytes = bytes.filter(|_| object.file.to_ascii_lowercase().ends_with(".glb"));
        let Some(bytes) = bytes else {
            return Err(format!("{}: only a .glb can be saved", object.file));
        };
        let world_from_model = object.world_from_glb * z_up_from_y_up().transpose();
        if !is_similarity(world_from_model) {
            return Err("rig.json scales its object differently along its axes".to_owned());
        }
        let displacement = displacements.first().copied().unwrap_or_default();
        let text = model_text(&format!("{stem}.glb"));
        let by = [displacement * world_from_model];
        let saved = saved("rig.json", &text, &by)?;
        Ok(SavedScene {
            model: Some(bytes.data.clone()),
            ..saved
        })
    }

    /// Returns the phantoms with the rig's own virtual object and lamps.
    fn own(&self) -> Result<Scene, RigError> {
        self.chosen(&SceneChoice::Session)
    }

    /// Returns the phantoms alone.
    fn real(&self) -> Result<Scene, RigError> {
        self.chosen(&SceneChoice::None)
    }

    fn chosen(&self, choice: &SceneChoice) -> Result<Scene, RigError> {
        let files = |name: &str| self.files.get(name);
        Ok(self.document.chosen_scene(choice, &files)?)
    }
}
