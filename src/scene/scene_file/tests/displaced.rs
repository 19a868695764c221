//! Saved displacements: the written scene is the displaced one.

use super::*;
use crate::edit::Edit;

/// Objects in every notation, lamps on them, and a moved model.
const SCENE: &str = r##"# my scene
[model]
position_m = [1.0, 2.0, 0.0]
rotation_deg = [40.0, TILT, 0.0]

[[object]] # the still one
name = "still"
shape = "box"
size_m = [0.2, 0.1, 0.1]
scale = [1.0, 2.0, 1.0] # tall

[[object]]
name = "angles"
shape = "cone"
radius_m = 0.1
height_m = 0.2
position_m = [0.3, 0.0, 0.0]
rotation_deg = [30.0, 10.0, 5.0]
repeat_s = 4.0
keys = [{ at_s = 0.0, rotation_deg = [30.0, 10.0, 5.0] }, { at_s = 4.0, position_m = [0.0, 0.5, 0.0], rotation_deg = [390.0, 10.0, 5.0], scale = 1.5 }]

[[object]]
name = "quaternions"
shape = "sphere"
radius_m = 0.1

[[object.keys]]
at_s = 1.0
rotation_wxyz = [1.0, 0.0, 0.0, 0.0]

[[object.keys]]
at_s = 2.0
position_m = [0.0, 0.0, 0.4]
rotation_wxyz = [0.0, 0.0, 1.0, 0.0]

[[object]]
name = "other"
shape = "torus"
radius_m = 0.1
tube_radius_m = 0.02
rotation_wxyz = [0.0, 1.0, 0.0, 0.0]

[[lamp]]
attached_to = "still"
position_m = [0.0, 0.0, 0.5]
intensity = [1.0, 1.0, 1.0]

[[lamp]]
attached_to = "angles"
position_m = [0.0, 0.1, 0.5]
intensity = [1.0, 1.0, 1.0]
"##;

fn edits() -> Vec<Edit> {
    let edit = |i: f64| Edit {
        offset: DVec3::new(0.1 * i, -0.2, 0.05 * i),
        turn: 0.7 * i,
        scale: 1.0 + 0.5 * i,
    };
    [1.0, 2.0, 3.0, 0.5].map(edit).to_vec()
}

fn scene(text: &str) -> Scene {
    read(text).unwrap().onto(Scene::default())
}

/// Compares places of parts and lamps at several times.
fn assert_same(expected: &Scene, found: &Scene) {
    for seconds in [0.0, 1.0, 1.7, 2.5, 6.3] {
        let (mut a, mut b) = (expected.clone(), found.clone());
        a.place_at(seconds);
        b.place_at(seconds);
        for (a, b) in a.virtual_parts.iter().zip(&b.virtual_parts) {
            let apart = (a.world_from_part - b.world_from_part).to_cols_array();
            let most = apart.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            assert!(most < 1e-7, "{} at {seconds} s: {most}", a.name);
        }
        let lamps = |scene: &Scene| {
            let mut lamps = Vec::new();
            scene.lamps_at(seconds, &mut lamps);
            lamps.iter().map(|l| l.position).collect::<Vec<_>>()
        };
        for (a, b) in lamps(expected).iter().zip(&lamps(found)) {
            assert!(a.distance(*b) < 1e-6, "lamp at {seconds} s: {a} {b}");
        }
    }
}

#[test]
fn a_saved_scene_shows_the_displaced_objects() {
    let text = SCENE.replace("TILT", "0.0");
    let base = scene(&text);
    let by = base.displacements(&edits());
    let saved = displaced_text("s.toml", &text, &by).unwrap();
    assert!(saved.starts_with("# my scene\n[model]\n"), "{saved}");
    assert!(
        saved.contains("# tall") && saved.contains("# the still one"),
        "{saved}"
    );
    assert_same(&base.edited(&edits()), &scene(&saved));
    // A full turn from key to key remains one.
    assert!(saved.contains("repeat_s = 4.0"), "{saved}");
    let same = base.displacements(&[]);
    assert_eq!(displaced_text("s.toml", &text, &same).unwrap(), text);
}

#[test]
fn in_a_tilted_model_angles_become_quaternions_or_are_refused() {
    let text = SCENE.replace("TILT", "20.0");
    let base = scene(&text);
    let mut edits = edits();
    let by = base.displacements(&edits);
    let refused = displaced_text("s.toml", &text, &by)
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("object[1].keys[0].rotation_deg"),
        "{refused}"
    );
    // Moved and scaled only, it can be saved; the others are turned, too.
    edits[1].turn = 0.0;
    let by = base.displacements(&edits);
    let saved = displaced_text("s.toml", &text, &by).unwrap();
    assert_same(&base.edited(&edits), &scene(&saved));
    let few = displaced_text("s.toml", &text, &by[..2]).unwrap_err();
    assert!(few.to_string().contains("2 objects"), "{few}");
}

#[test]
fn names_of_models_are_quoted() {
    assert_eq!(model_text("a.glb"), "[[object]]\nfile = \"a.glb\"\n");
    let odd = model_text("it's \"odd\".glb");
    let file: SceneFile = TomlText::new("s.toml", odd).parse().unwrap();
    assert_eq!(file.object[0].file.as_deref(), Some("it's \"odd\".glb"));
}
