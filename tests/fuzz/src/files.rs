//! Files that a user writes or brings: configuration, scenes, models, descriptions of rigs.

use penumbra_config::Config;
use penumbra_rig_model::RigDocument;
use penumbra_scene::gltf_file::load_gltf_playing;
use penumbra_scene::{Part, Playing, Scene, SceneAddition, load_ply};
use std::path::Path;
use tempfile::TempDir;

/// Files that scenes and models may name.
const COMPANIONS: [(&str, &[u8]); 3] = [
    ("wood.png", include_bytes!("../companions/wood.png")),
    ("box.gltf", include_bytes!("../companions/box.gltf")),
    ("triangle.ply", include_bytes!("../companions/triangle.ply")),
];
/// The files of a rig, one of which is the input.
const RIG_FILES: [&str; 8] = [
    "rig.json",
    "calibration/environment.json",
    "calibration/latency.json",
    "calibration/scene_camera.json",
    "calibration/environment_camera.json",
    "calibration/markers.json",
    "calibration/radiometric.json",
    "calibration/tracker.json",
];

thread_local! {
    static FOLDER: Option<TempDir> = folder();
}

fn folder() -> Option<TempDir> {
    let folder = tempfile::tempdir().ok()?;
    for (name, content) in COMPANIONS {
        std::fs::write(folder.path().join(name), content).ok()?;
    }
    Some(folder)
}

/// Writes `data` to a file beside [`COMPANIONS`] and gives its path to `read`.
fn in_folder(name: &str, data: &[u8], read: impl FnOnce(&Path)) {
    FOLDER.with(|folder| {
        let Some(folder) = folder else {
            panic!("there is no temporary folder");
        };
        let path = folder.path().join(name);
        match std::fs::write(&path, data) {
            Ok(()) => read(&path),
            Err(error) => panic!("{name}: {error}"),
        }
    });
}

/// Checks that a message of an error is one line that begins with the file's name.
fn assert_clear(error: &dyn std::error::Error, file: &str) {
    let message = error.to_string();
    assert!(!message.contains('\n'), "{message}");
    assert!(message.contains(file), "{message}");
}

/// Checks what drawing relies on.
fn assert_drawable(parts: &[Part]) {
    for part in parts {
        let count = part.mesh.vertices.len();
        assert!(part.mesh.indices.iter().all(|i| (*i as usize) < count));
        assert!(part.mesh.vertices.iter().all(|v| v.position.is_finite()));
        assert!(part.mesh.vertices.iter().all(|v| v.normal.is_finite()));
        assert!(part.world_from_part.is_finite());
    }
}

/// A configuration file.
pub fn config(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    if let Err(error) = Config::from_text(text, "rig.toml") {
        assert_clear(&error, "rig.toml");
    }
}

/// A scene file; it may name the models and the picture beside it.
pub fn scene(data: &[u8]) {
    in_folder("scene.toml", data, |path| match SceneAddition::load(path) {
        Ok(addition) => {
            let scene = addition.onto(Scene::default());
            assert_drawable(&scene.virtual_parts);
            assert_drawable(&scene.phantom_parts);
        }
        Err(error) => assert_clear(&error, ""),
    });
}

/// A glTF or GLB model; it may name the files beside it.
pub fn gltf(data: &[u8]) {
    in_folder("model.gltf", data, |path| {
        match load_gltf_playing(path, Playing::First) {
            Ok(model) => assert_drawable(&model.placed(penumbra_scene::z_up_from_y_up())),
            Err(error) => assert_clear(&error, "model.gltf"),
        }
    });
}

/// A PLY model.
pub fn ply(data: &[u8]) {
    match load_ply(data, "model.ply") {
        Ok(mesh) => {
            let count = mesh.vertices.len();
            assert!(mesh.indices.iter().all(|i| (*i as usize) < count));
        }
        Err(error) => assert_clear(&error, "model.ply"),
    }
}

/// `rig.json`, or a calibration file beside it: the first byte chooses.
pub fn rig(data: &[u8]) {
    let Some((choice, content)) = data.split_first() else {
        return;
    };
    let file = RIG_FILES[usize::from(*choice) % RIG_FILES.len()];
    let find = |name: &str| (name == file).then_some(content);
    let read = if file == "rig.json" {
        RigDocument::from_session(&find)
    } else {
        RigDocument::without_rig_json((640, 480), &find)
    };
    match read {
        // Models that it names are not there.
        Ok(rig) => drop(rig.scene(&find)),
        Err(error) => assert_clear(&error, file.rsplit('/').next().unwrap_or(file)),
    }
}
