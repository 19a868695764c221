//! Lamps of scene files.

use super::*;

#[test]
fn reads_point_and_spot_lamps_and_names_mistakes() {
    let lamp = |rest: &str| format!("[[lamp]]\nintensity = [1, 1, 1]\n{rest}");
    let scene = read(&lamp("position_m = [0, 0, 1]")).unwrap();
    assert_eq!(scene.lamps[0].at(0.0).unwrap().cone, None);
    let cases = [
        (lamp(""), "lamp[0].position_m"),
        (
            "[[lamp]]\nposition_m = [0, 0, 1]".to_owned(),
            "lamp[0].intensity",
        ),
        ("[[lamp]]\nintensity = [1, -1, 1]".to_owned(), "from 0 up"),
        (lamp("position_m = [0, 0, inf]"), "lamp[0].position_m"),
        (
            lamp("position_m = [0, 0, 1]\nbeam_deg = 3"),
            "lamp[0].target_m",
        ),
        (
            lamp("position_m = [0, 0, 1]\ntarget_m = [0, 0, 1]"),
            "lamp[0].target_m",
        ),
        (
            lamp("position_m = [0, 0, 1]\ntarget_m = [0, 0, 0]\nbeam_deg = 40"),
            "lamp[0].cutoff_deg",
        ),
        (lamp("position_m = [0, 0, 1]\n").repeat(33), "at most 32"),
    ];
    for (text, expected) in cases {
        let found = complaint(&text);
        assert!(found.contains(expected), "{found}");
    }
}

#[test]
fn warns_of_an_enclosed_lamp() {
    let text = "[[object]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.1\nposition_m = [0, 0, 1]\n\
        [[lamp]]\nname = \"bulb\"\nintensity = [1, 1, 1]\nposition_m = [0, 0, 1.05]\n\
        [[lamp]]\nintensity = [1, 1, 1]\nposition_m = [0, 0, 1.2]\n\
        [[lamp]]\nname = \"cellar\"\nintensity = [1, 1, 1]\nposition_m = [0, 0, -1]\n[ground]\n";
    let scene = read(text).unwrap().onto(Scene::default());
    assert_eq!(
        scene.warnings,
        [
            "s.toml:9: `lamp[0].position_m`: the lamp \"bulb\" is inside the object \"ball\", which hides its light; move it out",
            "s.toml:16: `lamp[2].position_m`: the lamp \"cellar\" is below the ground, which hides its light; move it out",
        ]
    );
    assert_eq!((scene.lamps.len(), scene.virtual_parts.len()), (3, 1));
}

const AREA: &str = "[[lamp]]\nkind = \"area\"\nsize_m = [0.4, 0.2]\nposition_m = [0, 0, 1]\ntarget_m = [0, 1, 1]\n";

#[test]
fn reads_areas_in_every_unit_with_their_orientation() {
    let read = |rest: &str| read(&format!("[photometry]\nwhite_cd_m2 = 100\n{AREA}{rest}"));
    let lamp = |rest: &str| read(rest).unwrap().lamps[0].clone();
    // 0.08 m²: 50 cd/m² are 4 cd along the normal and 4π lm in total, half of the camera's white.
    let pi = std::f64::consts::PI;
    for (rest, expected) in [
        ("nit = 50".to_owned(), 0.04),
        ("candela = 4".to_owned(), 0.04),
        (format!("lumen = {}", 4.0 * pi), 0.04),
        (format!("lumen = {}\ntwo_sided = true", 4.0 * pi), 0.02),
        ("intensity = [0.04, 0.04, 0.04]".to_owned(), 0.04),
    ] {
        let found = lamp(&rest).intensity.x;
        assert!((found - expected).abs() < 1e-6, "{rest}: {found}");
    }
    let area = lamp("nit = 1").at(0.0).unwrap().area.unwrap();
    assert!(area.half_right.distance(Vec3::X * -0.2) < 1e-6, "{area:?}");
    assert!(area.half_up.distance(Vec3::Z * 0.1) < 1e-6, "{area:?}");
    let turned = lamp("nit = 1\nup = [1, 0, 0]").at(0.0).unwrap();
    assert!(turned.area.unwrap().half_up.distance(Vec3::X * 0.1) < 1e-6);
    let down = AREA.replace("target_m = [0, 1, 1]", "direction = [0, 0, -3]");
    let text = format!("{down}intensity = [1, 1, 1]\n");
    let down = super::read(&text).unwrap().lamps[0].at(0.0).unwrap();
    assert_eq!(down.direction, Vec3::NEG_Z);
    assert!(down.area.unwrap().half_up.distance(Vec3::Y * 0.1) < 1e-6);
}

#[test]
fn area_moves_with_its_object() {
    let text = format!(
        "[[object]]\nname = \"box\"\nshape = \"box\"\nsize_m = [1, 1, 1]\nposition_m = [5, 0, 0]\nrotation_deg = [90, 0, 0]\n\
         {AREA}attached_to = \"box\"\nintensity = [1, 1, 1]\nrepeat_s = 4\n\
         keys = [{{ at_s = 0 }}, {{ at_s = 2, position_m = [0, 0, 2], gain = 0.5 }}]\n"
    );
    let lamp = read(&text).unwrap().lamps[0].clone();
    let placed = lamp.at(6.0).unwrap();
    assert!(placed.position.distance(Vec3::new(5.0, 0.0, 2.0)) < 1e-5);
    assert_eq!(placed.intensity.x, 0.5);
    let first = lamp.at(0.0).unwrap();
    assert!(
        first.direction.distance(Vec3::NEG_X) < 1e-5,
        "{}",
        first.direction
    );
    let area = first.area.unwrap();
    assert!(area.half_right.distance(Vec3::Y * -0.2) < 1e-5, "{area:?}");
}

#[test]
fn texture_of_an_area_scales_its_light() {
    let folder = tempfile::tempdir().unwrap();
    let save = |name: &str, codes: [[u8; 3]; 2]| {
        let picture = image::RgbImage::from_fn(2, 1, |x, _| image::Rgb(codes[x as usize]));
        picture.save(folder.path().join(name)).unwrap();
    };
    save("half.png", [[255; 3], [0; 3]]);
    save("black.png", [[0; 3]; 2]);
    std::fs::write(folder.path().join("broken.png"), "no picture").unwrap();
    let load = |rest: &str| {
        let path = folder.path().join("s.toml");
        std::fs::write(
            &path,
            format!("[photometry]\nwhite_cd_m2 = 100\n{AREA}{rest}"),
        )
        .unwrap();
        SceneAddition::load(&path).map_err(|e| e.to_string())
    };
    // Half of it is white: half as much light.
    let lamp = load("nit = 50\ntexture = \"half.png\"").unwrap().lamps[0].clone();
    assert!((lamp.intensity.x - 0.02).abs() < 1e-6, "{}", lamp.intensity);
    assert!(lamp.screen.unwrap().texture.is_some());
    let files = files_of(&folder.path().join("s.toml"));
    assert!(files.contains(&folder.path().join("half.png")), "{files:?}");
    for (rest, expected) in [
        (
            "nit = 1\ntexture = \"gone.png\"",
            "s.toml:9: `lamp[0].texture`: there is no file",
        ),
        (
            "nit = 1\ntexture = \"broken.png\"",
            "s.toml:9: `lamp[0].texture`",
        ),
        (
            "nit = 1\ntexture = \"black.png\"",
            "black.png is entirely black",
        ),
    ] {
        let found = load(rest).unwrap_err();
        assert!(found.contains(expected), "{found}");
    }
}

#[test]
fn errors_name_mistakes_in_areas() {
    let lamp = |rest: &str| format!("{AREA}intensity = [1, 1, 1]\n{rest}");
    let without = |key: &str| {
        let lines = AREA.lines().filter(|line| !line.starts_with(key));
        format!(
            "{}\nintensity = [1, 1, 1]\n",
            lines.collect::<Vec<_>>().join("\n")
        )
    };
    for (text, expected) in [
        (
            without("size_m"),
            "s.toml:1: `lamp[0].size_m`: an area needs it",
        ),
        (without("target_m"), "`lamp[0].target_m`: an area needs it"),
        (
            without("position_m"),
            "`lamp[0].position_m`: a lamp needs it",
        ),
        (
            lamp("direction = [0, 0, 1]"),
            "s.toml:7: `lamp[0].direction`: goes with an area that has no target_m",
        ),
        (
            lamp("up = [0, 2, 0]"),
            "`lamp[0].up`: expected a direction other than",
        ),
        (lamp("up = [0, 0, 0]"), "`lamp[0].up`"),
        (
            lamp("beam_deg = 3"),
            "`lamp[0].beam_deg`: goes with a spot only",
        ),
        (lamp("nit = 3"), "`lamp[0].intensity`: a lamp needs it"),
        (
            AREA.replace("[0.4, 0.2]", "[0.4, -0.2]") + "nit = 1",
            "`lamp[0].size_m`: expected metres",
        ),
        (
            AREA.replace("[0.4, 0.2]", "[nan, 0.2]") + "nit = 1",
            "`lamp[0].size_m`: expected metres",
        ),
        (
            format!("{AREA}nit = -1"),
            "s.toml:6: `lamp[0].nit`: expected a number from 0",
        ),
        (
            format!("{AREA}nit = nan"),
            "`lamp[0].nit`: expected a number from 0",
        ),
        (
            format!("{AREA}nit = 1"),
            "`lamp[0].nit`: needs the luminance of the camera's white",
        ),
        (AREA.replace("area", "disc"), "s.toml:2"),
    ] {
        let found = complaint(&text);
        assert!(found.contains(expected), "{found}, expected {expected}");
    }
}

#[test]
fn errors_name_keys_of_other_kinds() {
    let point = "[[lamp]]\nposition_m = [0, 0, 1]\nintensity = [1, 1, 1]\n";
    for (text, expected) in [
        (
            format!("{point}texture = \"a.png\""),
            "s.toml:4: `lamp[0].texture`: goes with kind = \"area\" only",
        ),
        (
            format!("{point}kind = \"spot\""),
            "`lamp[0].target_m`: a spot needs it",
        ),
        (
            format!("{point}kind = \"point\"\ntarget_m = [0, 0, 0]"),
            "`lamp[0].target_m`: goes with a spot or an area",
        ),
    ] {
        let found = complaint(&text);
        assert!(found.contains(expected), "{found}, expected {expected}");
    }
}
