//! `penumbra bake`.

use crate::program::Desk;

/// Two boxes on the ground.
const SCENE: &str = "[ground]\nsize_m = 4.0\n[[object]]\nshape = \"box\"\nsize_m = [0.4, 0.3, 0.2]\n\
                     [[object]]\nshape = \"box\"\nsize_m = [0.1, 0.1, 0.5]\nposition_m = [0.4, 0.0, 0.0]\n";

#[test]
fn bakes_a_scene_and_prints_a_summary() {
    let desk = Desk::new();
    desk.put("scene.toml", SCENE);
    let options = "--planes 8 --lights 40 --resolution 32 --adapter llvmpipe";
    let printed = desk.works(&format!("bake scene.toml {options} --out a.bake --json"));
    let done: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let count = |name: &str| done[name].as_u64().unwrap();
    assert!((2..=8).contains(&count("planes")), "{done}");
    assert!(count("planes_on_real_surfaces") >= 1, "{done}");
    assert_eq!(count("lights"), 40);
    let all = count("basis_images") + count("basis_images_dropped");
    assert_eq!(all, 40 * count("planes"));
    // Upright planes receive no light from behind.
    assert!(count("basis_images_dropped") > 0, "{done}");
    assert_eq!(count("bytes"), desk.read("a.bake").len() as u64);
    // A second bake is identical.
    desk.works(&format!("bake scene.toml {options} --out b.bake"));
    assert!(desk.read("a.bake") == desk.read("b.bake"));
    let printed = desk.works(&format!("bake scene.toml {options} --out b.bake --force"));
    assert!(
        printed.contains("black images") && printed.contains("b.bake"),
        "{printed}"
    );
}

#[test]
fn bakes_go_to_the_cache_of_the_configuration() {
    let desk = Desk::new();
    desk.put("scene.toml", SCENE);
    desk.put(
        "rig.toml",
        "[planes]\ncount = 4\nresolution = 16\ncache = \"kept\"\n",
    );
    let printed = desk.works("bake scene.toml --config rig.toml --adapter llvmpipe");
    let names = desk.names("kept");
    assert_eq!(names.len(), 1, "{names:?}");
    assert!(printed.contains(&names[0]), "{printed}");
}

#[test]
fn bakes_object_and_phantoms_of_a_session() {
    let desk = Desk::new();
    let options = "--planes 6 --resolution 16 --adapter llvmpipe --json";
    let printed = desk.works(&format!("bake DESK {options} --out desk.bake"));
    let done: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert!(
        done["planes_on_real_surfaces"].as_u64() >= Some(1),
        "{done}"
    );
}

#[test]
fn refuses_impossible_bakes_in_one_line() {
    let desk = Desk::new();
    desk.put("empty.toml", "[ground]\nsize_m = 1.0\n");
    desk.put("photo.jpg", "x");
    desk.put("existing.bake", "x");
    desk.put("scene.toml", SCENE);
    let printed = desk.refuses("bake empty.toml --out a.bake");
    assert!(
        printed.contains("empty.toml: has no virtual objects"),
        "{printed}"
    );
    let printed = desk.refuses("bake photo.jpg --out a.bake");
    assert!(printed.contains("expected a scene file"), "{printed}");
    let printed = desk.refuses("bake DESK --session DESK --out a.bake");
    assert!(printed.contains("--session"), "{printed}");
    let printed = desk.refuses("bake scene.toml --out existing.bake");
    assert!(printed.contains("exists already"), "{printed}");
    let printed = desk.refuses("bake gone.glb --out a.bake");
    assert!(printed.contains("gone.glb"), "{printed}");
    let output = desk.run("bake scene.toml --lights 48");
    let printed = crate::program::text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{printed}");
    assert!(
        printed.contains("expected one of [40, 160, 360, 640]"),
        "{printed}"
    );
}
