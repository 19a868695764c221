use super::*;
use crate::planes::{Layer, Receiver};
use penumbra_camera::linear_from_srgb;

mod displaced;
mod lamps;

fn read(text: &str) -> Result<SceneAddition, SceneError> {
    SceneAddition::read(&TomlText::new("s.toml", text), Path::new(""))
}

fn complaint(text: &str) -> String {
    let text = read(text).unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

#[test]
fn reads_the_documented_example() {
    let text: String = include_str!("../scene_file.rs")
        .lines()
        .take_while(|line| line.starts_with("//!"))
        .map(|line| line.trim_start_matches("//!").trim_start_matches(' '))
        .skip_while(|line| !line.starts_with("```toml"))
        .skip(1)
        .take_while(|line| !line.starts_with("```"))
        .map(|line| line.replace("file = \"teapot.glb\" ", "shape = \"torus\" "))
        // The sizes of the shape are commented out in favour of the file.
        .map(|line| match line.strip_prefix("# ") {
            Some(rest) if rest.starts_with("radius") || rest.starts_with("tube") => rest.to_owned(),
            _ => line,
        })
        .collect::<Vec<_>>()
        .join("\n");
    let scene = read(&text).unwrap();
    assert_eq!((scene.objects.len(), scene.phantoms.len()), (2, 1));
    assert_eq!(
        (scene.motions.parts.len(), scene.motions.lamps.len()),
        (1, 1)
    );
    let teapot = &scene.objects[0];
    assert_eq!(teapot.name, "teapot");
    assert_eq!(teapot.material.roughness, 0.4);
    assert!((teapot.material.base_colour.x - linear_from_srgb(192.0 / 255.0)).abs() < 1e-6);
    let phong = scene.objects[1].material.phong.unwrap();
    assert_eq!((phong.specular, phong.exponent), (Vec3::splat(0.3), 50.0));
    assert_eq!(scene.objects[1].material.base_colour.x, 0.4);
    assert_eq!(scene.phantoms[0].albedo, Some(Vec3::splat(0.5)));
    assert_eq!(scene.ground.unwrap().size, 8.0);
    let lamp = scene.lamps[0].at(5.0).unwrap();
    let (beam, cutoff) = lamp.cone.unwrap();
    assert_eq!((scene.lamps.len(), lamp.intensity), (3, Vec3::ZERO));
    let lamp = scene.lamps[0].at(8.0).unwrap();
    assert_eq!(lamp.intensity, Vec3::splat(0.3));
    let plane = &scene.planes[0];
    assert_eq!((scene.planes.len(), plane.layer), (1, Layer::Real));
    assert_eq!((plane.normal(), plane.half_size.x), (DVec3::Z, 0.5));
    assert!((beam.to_degrees() - 20.0).abs() < 1e-4 && (cutoff.to_degrees() - 30.0).abs() < 1e-4);
}

#[test]
fn yaw_rotates_about_z_pitch_about_y_roll_about_x() {
    let turned = |angles: &str, v: DVec3| {
        let text =
            format!("[[object]]\nshape = \"sphere\"\nradius_m = 1\nrotation_deg = {angles}\n");
        read(&text).unwrap().objects[0]
            .world_from_part
            .transform_vector3(v)
    };
    assert!(turned("[90, 0, 0]", DVec3::X).distance(DVec3::Y) < 1e-12);
    assert!(turned("[0, 90, 0]", DVec3::X).distance(DVec3::NEG_Z) < 1e-12);
    assert!(turned("[0, 0, 90]", DVec3::Y).distance(DVec3::Z) < 1e-12);
    // Roll first, yaw last.
    assert!(turned("[90, 0, 90]", DVec3::Y).distance(DVec3::Z) < 1e-12);
}

#[test]
fn reads_all_shapes_with_their_poses() {
    let scene = read(
        "[[object]]\nshape = \"plane\"\nsize_m = [1, 2]\n[[object]]\nshape = \"box\"\nsize_m = [1, 2, 3]\n\
         [[object]]\nshape = \"cylinder\"\nradius_m = 1\nheight_m = 2\nsegments = 8\n\
         [[object]]\nshape = \"cone\"\nradius_m = 1\nheight_m = 2\nsegments = 8\n\
         [[object]]\nshape = \"sphere\"\nradius_m = 1\nscale = [1, 2, 3]\n\
         [[object]]\nshape = \"torus\"\nradius_m = 1\ntube_radius_m = 0.5\nposition_m = [1, 2, 3]\n",
    )
    .unwrap();
    let counts: Vec<usize> = scene
        .objects
        .iter()
        .map(|p| p.mesh.indices.len() / 3)
        .collect();
    assert_eq!(counts, [2, 12, 32, 16, 2 * 64 * 31, 2 * 64 * 32]);
    let scaled = scene.objects[4]
        .world_from_part
        .transform_vector3(DVec3::ONE);
    assert_eq!(scaled, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(
        scene.objects[5].world_from_part.w_axis.truncate(),
        DVec3::new(1.0, 2.0, 3.0)
    );
}

#[test]
fn few_lines_of_many_triangles_are_refused() {
    let sphere = "shape = \"sphere\"\nradius_m = 1\nsegments = 1024\n";
    let object = format!("[[object]]\n{sphere}");
    assert_eq!(read(&object).unwrap().objects.len(), 1);
    for second in [object.clone(), format!("[[phantom]]\n{sphere}")] {
        let error = read(&(object.clone() + &second)).unwrap_err().to_string();
        let expected = "the shapes of this file have more than 2000000 triangles together";
        assert!(
            error.starts_with("s.toml:6: ") && error.contains(expected),
            "{error}"
        );
    }
    let gate = "[[object]]\nshape = \"temple-gate\"\nsegments = 1024\n";
    let triangles = |p: &Part| p.mesh.indices.len() / 3;
    let largest = read(gate).map(|scene| scene.objects.iter().map(triangles).sum::<usize>());
    assert!(largest.is_err() || largest.is_ok_and(|n| n < 2_000_000));
}

/// Texts and their messages.
const MISTAKES: [(&str, &str); 14] = [
    (
        "[[object]]\nshape = \"box\"\nsise_m = [1, 1, 1]\n",
        "s.toml:3: unknown key `object[0].sise_m`; did you mean `size_m` (in metres)?",
    ),
    (
        "[[object]]\nshape = \"box\"\nsize_m = [1, 1]\n",
        "s.toml:3: `object[0].size_m`: expected the size of a box: [x, y, z], metres",
    ),
    (
        "[[object]]\nshape = \"sphere\"\n",
        "s.toml:1: `object[0].radius_m`: a sphere needs it, in metres",
    ),
    (
        "[[object]]\n[[object]]\nname = \"x\"\n",
        "s.toml:1: `object[0]`: expected either `file` or `shape` (plane, box, cylinder, cone, sphere, torus, temple-gate)",
    ),
    (
        "[[object]]\nfile = \"gone.glb\"\n",
        "s.toml:2: `object[0].file`: there is no file gone.glb; expected a .glb, .gltf or .ply",
    ),
    (
        "[[object]]\nfile = \"gone.glb\"\nradius_m = 1\n",
        "s.toml:3: `object[0].radius_m`: goes with `shape` only; use `scale` for a file",
    ),
    (
        "[[object]]\nshape = \"sphere\"\nradius_m = 1\nscale = 0\n",
        "s.toml:4: `object[0].scale`: expected a number from 0.0001 to 10000, or three of them",
    ),
    (
        "[[object]]\nshape = \"sphere\"\nradius_m = 1\nmaterial = { base_colour = \"red\" }\n",
        "s.toml:4: `object[0].material.base_colour`: expected \"#rrggbb\" (sRGB) or three linear numbers from 0 up, found \"red\"",
    ),
    (
        "[[object]]\nshape = \"sphere\"\nradius_m = 1\n[object.material]\nmetallic = 2\n",
        "s.toml:5: `object[0].material.metallic`: expected a number from 0 to 1, found 2",
    ),
    (
        "[[object]]\nshape = \"sphere\"\nradius_m = 1\nmirror = true\n",
        "s.toml:4: `object[0].mirror`: goes with [[phantom]] only; use `material` for an object",
    ),
    (
        "[[phantom]]\nshape = \"sphere\"\nradius_m = 1\nmaterial = {}\n",
        "s.toml:4: `phantom[0].material`: goes with [[object]] only; a phantom shows no colour of its own",
    ),
    (
        "[ground]\nheight = 1\n",
        "s.toml:2: unknown key `ground.height`; did you mean `height_m` (in metres)?",
    ),
    (
        "[[object]]\nshape = \"torus\"\nradius_m = 1\ntube_radius_m = 1\n",
        "s.toml:4: `object[0].tube_radius_m`: expected less than radius_m",
    ),
    (
        "[[object]]\nshape = \"sphere\"\nradius_m = nan\n",
        "s.toml:3: `object[0].radius_m`: expected metres from 0.0001 to 100000, found NaN",
    ),
];

#[test]
fn errors_name_file_line_and_key() {
    for (text, expected) in MISTAKES {
        assert_eq!(complaint(text), expected);
    }
}

#[test]
fn scene_file_replaces_the_virtual_objects() {
    let mut session = Scene::default();
    session.add_ground(&GroundPlane {
        normal: DVec3::Z,
        offset: 0.0,
        size: 8.0,
        albedo: None,
    });
    session.virtual_parts = read("[[object]]\nshape = \"sphere\"\nradius_m = 1\n")
        .unwrap()
        .objects;
    let text = "[[object]]\nname = \"new\"\nshape = \"box\"\nsize_m = [1, 1, 1]\n[[phantom]]\nshape = \"box\"\nsize_m = [1, 1, 1]\n[ground]\nheight_m = 0.5\n";
    let scene = read(text).unwrap().onto(session.clone());
    assert_eq!(scene.virtual_parts.len(), 1);
    assert_eq!(scene.virtual_parts[0].name, "new");
    assert_eq!(scene.ground_height, Some(0.5));
    assert_eq!(scene.phantom_parts.len(), 2);
    let alone = read("session_phantoms = false\n").unwrap().onto(session);
    assert!(alone.phantom_parts.is_empty() && alone.ground_height.is_none());
}

#[test]
fn finds_models_in_the_scene_files_folder() {
    let folder = tempfile::tempdir().unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    std::fs::write(folder.path().join("a.ply"), ply).unwrap();
    std::fs::write(folder.path().join("b.glb"), "glTF nonsense").unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, "[[object]]\nfile = \"a.ply\"\n").unwrap();
    assert_eq!(
        SceneAddition::load(&path).unwrap().objects[0]
            .mesh
            .indices
            .len(),
        3
    );
    std::fs::write(&path, "[[object]]\nfile = \"b.glb\"\n").unwrap();
    let text = SceneAddition::load(&path).unwrap_err().to_string();
    assert!(text.contains("b.glb: not a usable glTF"), "{text}");
}

#[test]
fn planes_by_hand_have_axes_and_covered_parts() {
    let text = "[ground]\nsize_m = 4.0\n\
        [[object]]\nshape = \"box\"\nsize_m = [1, 1, 1]\n\
        [[object]]\nshape = \"box\"\nsize_m = [1, 1, 1]\nposition_m = [5, 0, 0]\n\
        [[plane]]\ncentre_m = [0, -0.6, 0.5]\nnormal = [0, -2, 0]\nsize_m = [1, 2]\ndepth_m = 0.2\n\
        [[plane]]\ncentre_m = [0, 0, 0.01]\nnormal = [0, 0, 1]\nsize_m = [3, 3]\ndepth_m = 0.05\nlayer = \"real\"\n";
    let scene = read(text).unwrap().onto(Scene::default());
    let [ground, wall] = scene.planes.as_slice() else {
        panic!("{:?}", scene.planes)
    };
    assert_eq!(
        (ground.layer, ground.receiver),
        (Layer::Real, Receiver::Plane)
    );
    assert_eq!((ground.right, ground.up), (DVec3::X, DVec3::Y));
    assert_eq!(
        (wall.layer, wall.receiver),
        (Layer::Virtual, Receiver::Surface)
    );
    assert_eq!((wall.right, wall.up), (DVec3::X, DVec3::Z));
    assert_eq!((wall.normal(), wall.half_size.y), (DVec3::NEG_Y, 1.0));
    assert_eq!(
        (ground.parts.as_slice(), wall.parts.as_slice()),
        (&[0][..], &[0][..])
    );
}

#[test]
fn errors_name_mistakes_in_planes() {
    let whole = [
        ("centre_m", "[0, 0, 0]"),
        ("normal", "[0, 0, 1]"),
        ("size_m", "[1, 1]"),
        ("depth_m", "0.1"),
    ];
    let with = |key: &str, value: &str| {
        let lines = whole
            .iter()
            .filter(|(k, _)| *k != key)
            .map(|(k, v)| format!("{k} = {v}\n"));
        let own = if value.is_empty() {
            String::new()
        } else {
            format!("{key} = {value}\n")
        };
        format!("[[plane]]\n{own}{}", lines.collect::<String>())
    };
    read(&with("up", "[1, 0, 0]")).unwrap();
    for (key, value, expected) in [
        ("centre_m", "", "plane[0].centre_m"),
        ("centre_m", "[nan, 0, 0]", "plane[0].centre_m"),
        ("normal", "[0, 0, 0]", "plane[0].normal"),
        ("up", "[0, 0, -1]", "plane[0].up"),
        ("size_m", "[1, 0]", "plane[0].size_m"),
        ("depth_m", "-1", "plane[0].depth_m"),
        ("layer", "\"air\"", "real"),
        ("receiver", "\"air\"", "surface"),
        ("centre", "[0, 0, 0]", "centre"),
    ] {
        let found = complaint(&with(key, value));
        assert!(found.contains(expected), "{key}: {found}");
    }
}

#[test]
fn temple_gate_has_several_parts() {
    let scene =
        read("[[object]]\nname = \"gate\"\nshape = \"temple-gate\"\nscale = 0.1\nsegments = 12\n")
            .unwrap();
    let names: Vec<_> = scene.objects.iter().map(|p| p.name.as_str()).collect();
    assert!(
        names.contains(&"gate/roof") && names.contains(&"gate/platform"),
        "{names:?}"
    );
}

#[test]
fn model_pose_moves_objects_and_planes() {
    let text = |model: &str| {
        format!(
            "{model}\n[[object]]\nshape = \"box\"\nsize_m = [1, 1, 1]\nposition_m = [1, 0, 0]\n\
             [[plane]]\ncentre_m = [1, 0, 0.5]\nnormal = [1, 0, 0]\nsize_m = [1, 1]\ndepth_m = 1"
        )
    };
    let own = read(&text("")).unwrap();
    let moved = read(&text(
        "[model]\nposition_m = [0, 2, 0]\nrotation_deg = [90, 0, 0]",
    ))
    .unwrap();
    let origin = |s: &SceneAddition| s.objects[0].world_from_part.transform_point3(DVec3::ZERO);
    assert!(origin(&own).distance(DVec3::X) < 1e-12);
    assert!(origin(&moved).distance(DVec3::new(0.0, 3.0, 0.0)) < 1e-12);
    let plane = &moved.planes[0];
    assert!(plane.centre.distance(DVec3::new(0.0, 3.0, 0.5)) < 1e-12);
    assert!(plane.normal().distance(DVec3::Y) < 1e-12);
    for (model, place) in [
        ("[model]\nscale = 2", "model.scale"),
        ("[model]\nposition_m = [0, inf, 0]", "model.position_m"),
        (
            "[model]\nrotation_wxyz = [1, 1, 0, 0]",
            "model.rotation_wxyz",
        ),
    ] {
        let text = complaint(&text(model));
        assert!(text.contains(place), "{text}");
    }
}

#[test]
fn errors_name_mistakes_in_phong_materials() {
    let ball = |material: &str| {
        complaint(&format!(
            "[[object]]\nshape = \"sphere\"\nradius_m = 1\nmaterial.{material}"
        ))
    };
    let phong = |rest: &str| {
        ball(&format!(
            "phong = {{ diffuse = [0.5, 0.5, 0.5], specular = [0.1, 0.2, 0.3], {rest} }}"
        ))
    };
    for (text, expected) in [
        (
            phong("exponent = -1"),
            "s.toml:4: `object[0].material.phong.exponent`: expected a number from 0 to 10000, found -1",
        ),
        (
            phong("exponent = nan"),
            "s.toml:4: `object[0].material.phong.exponent`: expected a number from 0 to 10000, found NaN",
        ),
        (
            ball("phong = { specular = [0.1, 0.1, 0.1] }"),
            "s.toml:4: `object[0].material.phong.exponent`: phong needs it: 0 to 10000",
        ),
        (
            ball("phong = { exponent = 3 }"),
            "s.toml:4: `object[0].material.phong.specular`: phong needs it: a colour from 0 to 1",
        ),
        (
            ball("phong = { diffuse = [0.5, 0.5, 0.5], specular = [0.1, 0.7, 0.1], exponent = 3 }"),
            "s.toml:4: `object[0].material.phong.specular`: with the diffuse share of [0.500, 0.500, 0.500] it reflects 1.200 times the incident light in green; their sum must be at most 1",
        ),
        (
            ball("phong = { diffuse = [nan, 0.5, 0.5], specular = [0.1, 0.7, 0.1], exponent = 3 }"),
            "s.toml:4: `object[0].material.phong.diffuse`: expected \"#rrggbb\" (sRGB) or three linear numbers from 0 up",
        ),
        (
            ball("phong.specular = [-0.1, 0.7, 0.1]"),
            "s.toml:4: `object[0].material.phong.specular`: expected \"#rrggbb\" (sRGB) or three linear numbers from 0 up",
        ),
        (
            phong("shininess = 3"),
            "s.toml:4: unknown key `object[0].material.phong.shininess`; known here: diffuse, specular, exponent",
        ),
        (
            ball("roughness = 0.5\nmaterial.phong = { specular = [0, 0, 0], exponent = 3 }"),
            "s.toml:4: `object[0].material.roughness`: goes without `phong`, which has diffuse, specular and exponent; leave one out",
        ),
    ] {
        assert!(text.starts_with(expected), "{text}\n{expected}");
    }
}

#[test]
fn reads_moving_attached_and_photometric_lamps() {
    let scene = read(
        "[photometry]\nwhite_cd_m2 = 200.0\n[model]\nposition_m = [1, 0, 0]\n\
         [[object]]\nname = \"post\"\nshape = \"box\"\nsize_m = [1, 1, 1]\nposition_m = [0, 2, 0]\n\
         rotation_deg = [90, 0, 0]\nscale = 2.0\n\
         [[lamp]]\nattached_to = \"post\"\nposition_m = [0.5, 0, 1]\ncandela = 100\n\
         keys = [{}, { at_s = 2.0, position_m = [0.5, 0, 2], gain = 3.0 }]\nrepeat_s = 4.0\n\
         [[lamp]]\nposition_m = [0, 0, 1]\nlumen = 1000\nkelvin = 2700\n\
         [[lamp]]\nposition_m = [0, 0, 1]\ntarget_m = [0, 0, 0]\nlumen = 1000\ncolour = [1, 0, 0]\n\
         beam_deg = 60\ncutoff_deg = 60",
    )
    .unwrap();
    let luminance = |v: Vec3| v.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let at = |i: usize, t: f64| scene.lamps[i].at(t).unwrap();
    assert!(at(0, 0.0).position.distance(Vec3::new(1.0, 3.0, 2.0)) < 1e-6);
    assert!(at(0, 2.0).position.distance(Vec3::new(1.0, 3.0, 4.0)) < 1e-6);
    assert_eq!(at(0, 5.0).intensity, at(0, 1.0).intensity);
    assert!((luminance(at(0, 2.0).intensity) - 1.5).abs() < 1e-4);
    // 1000 lm in all directions are 1000 / 4π cd; into a cone of 60° 1000 / (2π · (1 − cos 60°)).
    let tau = std::f32::consts::TAU;
    assert!((luminance(at(1, 0.0).intensity) - 1000.0 / (2.0 * tau) / 200.0).abs() < 1e-3);
    assert!((luminance(at(2, 0.0).intensity) - 1000.0 / (tau * 0.5) / 200.0).abs() < 1e-3);
    assert!(at(2, 0.0).intensity.y == 0.0 && at(1, 0.0).intensity.z < at(1, 0.0).intensity.x);
    let lamp = |rest: &str| format!("[[lamp]]\nposition_m = [0, 0, 1]\n{rest}");
    let lit = |rest: &str| lamp(&format!("intensity = [1, 1, 1]\n{rest}"));
    for (text, place) in [
        (lamp("candela = 1"), "[photometry]"),
        (lamp("candela = -1"), "lamp[0].candela"),
        (lamp("lumen = nan"), "lamp[0].lumen"),
        (lit("candela = 1"), "lamp[0].intensity"),
        (lit("kelvin = 2700"), "lamp[0].kelvin"),
        (lit("attached_to = \"cup\""), "\"cup\""),
        (lit("repeat_s = 0"), "lamp[0].repeat_s"),
        (
            lit("keys = [{ at_s = 1.0 }, { at_s = 1.0 }]"),
            "lamp[0].keys",
        ),
        (lit("keys = [{ at_s = -1.0 }]"), "lamp[0].keys[0].at_s"),
        (lit("keys = [{ gain = -1.0 }]"), "lamp[0].keys[0].gain"),
        (
            lit("keys = [{ gain = 1.0 }, { at_s = 1, target_m = [0, 0, 0] }]"),
            "lamp[0].keys",
        ),
        (
            "[photometry]\nwhite_cd_m2 = 0".to_owned(),
            "photometry.white_cd_m2",
        ),
        (
            "[photometry]\nwhite_cd_m2 = 1\nev100 = 1".to_owned(),
            "photometry.ev100",
        ),
    ] {
        let message = complaint(&text);
        assert!(message.contains(place), "{text}: {message}");
    }
}

#[test]
fn reads_textures_from_the_scene_files_folder() {
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbaImage::from_pixel(2, 2, image::Rgba([128, 255, 128, 255]));
    picture.save(folder.path().join("bumps.png")).unwrap();
    std::fs::write(folder.path().join("notes.png"), "no picture").unwrap();
    std::fs::write(
        folder.path().join("flat.ply"),
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    )
    .unwrap();
    let read = |shape: &str, rest: &str| {
        let text = format!("[[object]]\n{shape}\nmaterial.{rest}");
        SceneAddition::read(&TomlText::new("s.toml", text), folder.path())
    };
    let plane = "shape = \"plane\"\nsize_m = [1, 1]";
    let scene = read(
        plane,
        "normal_texture = \"bumps.png\"\nmaterial.normal_scale = 0.5",
    )
    .unwrap();
    let material = &scene.objects[0].material;
    assert_eq!(material.normal_texture.as_ref().unwrap().rgba[1], 255);
    assert_eq!(material.normal_scale, 0.5);
    for (shape, rest, expected) in [
        (
            plane,
            "normal_texture = \"gone.png\"",
            "s.toml:4: `object[0].material.normal_texture`: there is no file ",
        ),
        (
            plane,
            "emissive_texture = \"notes.png\"",
            "s.toml:4: `object[0].material.emissive_texture`: ",
        ),
        (
            "file = \"flat.ply\"",
            "base_colour_texture = \"bumps.png\"",
            "s.toml:3: `object[0].material.base_colour_texture`: its mesh has no texture coordinates",
        ),
        (
            plane,
            "normal_scale = nan",
            "s.toml:4: `object[0].material.normal_scale`: expected a number from -100 to 100, found NaN",
        ),
    ] {
        let text = read(shape, rest).unwrap_err().to_string();
        assert!(text.starts_with(expected), "{text}\n{expected}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}

#[test]
fn textures_outside_the_folder_of_the_scene_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    std::fs::create_dir_all(scene.join("pictures")).unwrap();
    let picture = image::RgbaImage::from_pixel(2, 2, image::Rgba([128, 255, 128, 255]));
    picture.save(folder.path().join("private.png")).unwrap();
    picture.save(scene.join("pictures/own.png")).unwrap();
    let absolute = folder.path().join("private.png").display().to_string();
    let read = |texture: &str| {
        let text = format!(
            "[[object]]\nshape = \"plane\"\nsize_m = [1, 1]\nmaterial.emissive_texture = {texture:?}"
        );
        SceneAddition::read(&TomlText::new("s.toml", text), &scene)
    };
    read("pictures/own.png").unwrap();
    for outside in ["../private.png", &absolute] {
        let text = read(outside).unwrap_err().to_string();
        assert!(
            text.contains("lies outside the folder of the scene file"),
            "{text}"
        );
    }
}

fn along(keys: &str) -> String {
    format!("[[object]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 1\n{keys}\n")
}

#[test]
fn keys_without_values_use_those_of_the_object() {
    let text = along(
        "position_m = [0, 0, 1]\nscale = 2\nrepeat_s = 4\neasing = \"linear\"\n\
         keys = [{ at_s = 0 }, { at_s = 2, position_m = [4, 0, 1], rotation_deg = [360, 0, 0] }]\n\
         [model]\nposition_m = [0, 10, 0]\n\
         [[lamp]]\nattached_to = \"ball\"\nintensity = [1, 1, 1]\nposition_m = [1, 0, 0]",
    );
    let scene = read(&text).unwrap();
    let motion = &scene.motions.parts[0].motion;
    assert_eq!(scene.objects[0].world_from_part, motion.at(0.0));
    let expected = DMat4::from_translation(DVec3::new(2.0, 10.0, 1.0))
        * DMat4::from_rotation_z(std::f64::consts::PI)
        * DMat4::from_scale(DVec3::splat(2.0));
    for seconds in [1.0, 5.0] {
        assert!(motion.at(seconds).abs_diff_eq(expected, 1e-12));
    }
    let (mut scene, lamps) = (scene.onto(Scene::default()), &mut Vec::new());
    scene.lamps_at(1.0, lamps);
    // Two metres from the centre, as the object is scaled; behind it, as it is rotated.
    assert!(lamps[0].position.distance(Vec3::new(0.0, 10.0, 1.0)) < 1e-6);
    scene.place_at(1.0);
    assert!(
        scene.virtual_parts[0]
            .world_from_part
            .abs_diff_eq(expected, 1e-12)
    );
}

#[test]
fn errors_name_invalid_keys_with_their_line() {
    let keys = |keys: &str| along(&format!("keys = [{keys}]"));
    let phantom = |rest: &str| format!("[[phantom]]\nshape = \"sphere\"\nradius_m = 1\n{rest}");
    let cases = [
        (keys("{ at_s = 1 }, { at_s = 1 }"), "object[0].keys[1].at_s"),
        (keys("{ at_s = nan }"), "from 0 to 1000000"),
        (keys("{ at_s = -1 }"), "object[0].keys[0].at_s"),
        (
            keys("{ position_m = [nan, 0, 0] }"),
            "object[0].keys[0].position_m",
        ),
        (
            keys("{ rotation_deg = [0, inf, 0] }"),
            "three finite angles",
        ),
        (keys("{ rotation_wxyz = [0, 0, 0, 0] }"), "unit quaternion"),
        (keys("{ scale = 0 }"), "from 0.0001 to 10000"),
        (keys("{ scale = [1, -1, 1] }"), "from 0.0001 to 10000"),
        (keys("{ at = 1 }"), "did you mean"),
        (
            keys("{ rotation_deg = [1, 0, 0] }, { at_s = 1, rotation_wxyz = [1, 0, 0, 0] }"),
            "either all keys",
        ),
        (along("easing = \"linear\""), "object[0].easing"),
        (along("repeat_s = 3"), "goes with `keys`"),
        (
            along("repeat_s = 1\nkeys = [{ at_s = 2 }]"),
            "object[0].repeat_s",
        ),
        (
            along("easing = \"bouncy\"\nkeys = [{}]"),
            "object[0].easing",
        ),
        (along("animation = true"), "object[0].animation"),
        (along("animation = 3"), "name of an animation"),
        (phantom("keys = [{ at_s = 0 }]"), "phantom[0].keys"),
        (phantom("animation = true"), "phantom[0].animation"),
    ];
    for (text, expected) in cases {
        let found = complaint(&text);
        assert!(found.contains(expected), "{found}");
        assert!(found.starts_with("s.toml:"), "{found}");
    }
}

#[test]
fn reads_the_bundled_scenes() {
    let folder = penumbra_test_data::repository("config");
    let read = |name: &str| SceneAddition::load(&folder.join(name)).unwrap();
    assert_eq!(read("lamp.toml").objects.len(), 2);
    let moving = read("moving.toml");
    assert_eq!(
        (moving.motions.parts.len(), moving.motions.lamps.len()),
        (2, 1)
    );
}

/// A triangle as PLY.
const TRIANGLE: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[test]
fn a_model_alone_is_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("triangle.ply");
    std::fs::write(&path, TRIANGLE).unwrap();
    let scene = SceneAddition::load_model(&path).unwrap();
    assert_eq!((scene.objects.len(), scene.groups.len()), (1, 1));
    assert!(scene.session_phantoms);
    std::fs::write(&path, "ply\nnonsense").unwrap();
    let text = SceneAddition::load_model(&path).unwrap_err().to_string();
    assert!(text.contains("triangle.ply"), "{text}");
}

#[cfg(unix)]
#[test]
fn files_outside_of_the_folder_are_found() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("scenes");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(parent.path().join("a.ply"), TRIANGLE).unwrap();
    std::fs::write(folder.join("a.ply"), TRIANGLE).unwrap();
    std::os::unix::fs::symlink("../a.ply", folder.join("link.ply")).unwrap();
    let scene = folder.join("s.toml");
    let outside = |model: &str| {
        std::fs::write(&scene, format!("[[object]]\nfile = \"{model}\"\n")).unwrap();
        file_outside(&scene).is_some()
    };
    assert!(!outside("a.ply"));
    assert!(!outside("gone.ply"));
    assert!(outside("../a.ply"));
    assert!(outside("../gone.ply"));
    assert!(outside("link.ply"));
    assert!(outside(&parent.path().join("a.ply").display().to_string()));
    assert!(file_outside(&folder.join("link.ply")).is_some());
}
