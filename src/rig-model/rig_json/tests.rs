use super::*;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::{EnvironmentView, Response};
use penumbra_scene::VirtualLightKind;
use proptest::prelude::*;
use serde_json::{Value, json};

/// A small rig with everything in it.
fn rig() -> Value {
    let pose = json!({"position": [1.0, 2.0, 3.0], "quaternion_wxyz": [0.0, 1.0, 0.0, 0.0]});
    json!({
        "name": "bench",
        "scene_camera": {
            "image_size": [640, 480], "K": [[700.0, 0, 320.0], [0, 701.0, 240.0], [0, 0, 1]],
            "lens_distortion": [0.1, 0.2, 0.3, 0.4, 0.5], "latency_s": 0.01,
            "response": {"gamma": 2.0}
        },
        "environment_camera": {
            "kind": "fisheye", "image_size": [480, 480], "brackets_ev": [-4, -8],
            "T_world_cam": pose, "response": "linear",
            "projection": {"model": "equidistant", "f": 150.0, "cx": 241.0, "cy": 239.0,
                           "max_theta_rad": 1.6, "k1": 0.01, "k4": -0.02}
        },
        "mirror_sphere": {"center_world": [0.1, 0.2, 0.3], "radius": 0.04,
                          "reflectance_rgb": [0.9, 0.8, 0.7], "in_scene_camera_images": true},
        "tracker": {"latency_s": 0.008, "T_world_source": pose, "T_sensor_cam": pose,
                    "fastrak": {"units": "centimetres"}},
        "object": {"glb": "object/object.glb", "T_world_object": pose},
        "phantoms": [{"name": "box", "ply": "phantoms/box.ply", "ply_frame": "phantom",
                      "pose": pose, "albedo_linear_rgb": [0.5, 0.5, 0.5]}],
        "ground_plane": {"normal": [0, 0, 1], "offset": 0.25, "size_m": 8.0},
        "photometric_chart": {"scene": "a.png", "environment": "b.png",
                              "patches_xywh": [[1, 2, 3, 4]],
                              "reflectance_linear_rgb": [[0.1, 0.2, 0.3]]},
        "markers": [{"family": "tag36h11", "id": 7, "size_m": 0.06, "T_world_marker": pose}],
        "virtual_lights": {"lights": [
            {"name": "spot", "kind": "spot", "intensity": [1, 2, 3], "cutoff_deg": 90.0,
             "beam_deg": 45.0, "keys": [{"t": 0.5, "pos": [1, 2, 3], "target": [0, 0, 0]}]}]}
    })
}

/// Descriptions in which every key stands at least once.
pub(super) fn complete_rigs() -> Vec<Value> {
    let (mut sphere, mut moving) = (rig(), rig());
    let matrix = json!([[700.0, 0, 320.0], [0, 700.0, 240.0], [0, 0, 1]]);
    sphere["environment_camera"] = json!({
        "kind": "sphere", "image_size": [640, 480], "K": matrix, "lens_distortion": "none",
        "T_world_cam": {"matrix_row_major": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        "mirror_sphere": {"center_world": [0.1, 0.2, 0.3], "radius": 0.04}, "response": "srgb"
    });
    sphere["scene_camera"]["lens_distortion"] = json!({"k1": 0.1, "p2": 0.01});
    sphere["virtual_lights"]["lights"][0] = json!({"kind": "point", "intensity": [1, 2, 3],
        "keys": [{"t": 0, "pos": [1, 2, 3], "gain": 0.5}]});
    moving["mirror_sphere"] = json!({"radius": 0.04,
        "marker": {"family": "tag36h11", "id": 9, "center": [0, 0, 0.05], "size_m": 0.03}});
    moving["phantoms"][0]["mirror"] = json!(true);
    moving["notes"] = json!("other keys are ignored");
    let minimal = json!({"scene_camera": {"image_size": [640, 480], "K": matrix}});
    vec![rig(), sphere, moving, minimal]
}

fn parse(value: &Value) -> Result<RigDocument, RigJsonError> {
    RigDocument::parse(value.to_string().as_bytes())
}

/// The error message after removing the member at `path`.
fn message_without(path: &[&str]) -> String {
    let mut value = rig();
    let (last, above) = path.split_last().unwrap();
    let mut node = &mut value;
    for step in above {
        node = match step.parse::<usize>() {
            Ok(i) => &mut node[i],
            Err(_) => &mut node[*step],
        };
    }
    node.as_object_mut().unwrap().remove(*last).unwrap();
    parse(&value).unwrap_err().to_string()
}

#[test]
fn reads_every_part_of_the_file() {
    let rig = parse(&rig()).unwrap();
    let scene = &rig.calibration.scene_camera;
    assert_eq!((scene.camera.width, scene.camera.height), (640, 480));
    assert_eq!(scene.camera.focal, DVec2::new(700.0, 701.0));
    assert_eq!(scene.camera.distortion, [0.1, 0.2, 0.3, 0.4, 0.5]);
    assert_eq!(scene.latency_nanos, 10_000_000);
    assert_eq!(scene.response, Response::gamma(2.0));
    let environment = rig.calibration.environment.as_ref().unwrap();
    assert_eq!(environment.brackets_ev, [-4.0, -8.0]);
    assert_eq!(environment.response, Response::linear());
    let EnvironmentView::Fisheye {
        lens,
        world_from_camera,
    } = &environment.view
    else {
        panic!("{:?}", environment.view);
    };
    assert_eq!(lens.distortion, [0.01, 0.0, 0.0, -0.02]);
    assert_eq!((lens.focal, lens.max_theta), (150.0, 1.6));
    // Rotation by 180° about x: y and z change sign.
    let p = world_from_camera.transform_point(DVec3::new(1.0, 1.0, 1.0));
    assert!(p.distance(DVec3::new(2.0, 1.0, 2.0)) < 1e-12);
    let tracker = rig.calibration.tracker.as_ref().unwrap();
    assert_eq!(
        (tracker.metres_per_unit, tracker.latency_nanos),
        (0.01, 8_000_000)
    );
    assert_eq!(rig.ground.unwrap().offset, 0.25);
    assert_eq!(rig.phantoms[0].albedo, Some(Vec3::splat(0.5)));
    assert_eq!(rig.markers[0].id, 7);
    let VirtualLightKind::Spot { beam, cutoff } = rig.virtual_lights[0].kind else {
        panic!("no spot");
    };
    assert!((cutoff - 2.0 * beam).abs() < 1e-12);
}

#[test]
fn object_frame_has_its_up_axis_along_z() {
    let placement = parse(&rig()).unwrap().object.unwrap();
    // glTF's up axis is the object's +Z, which this pose points down.
    let up = placement.world_from_glb.transform_vector3(DVec3::Y);
    assert!(up.distance(DVec3::NEG_Z) < 1e-12, "{up}");
}

#[test]
fn missing_key_is_named_by_its_complete_path() {
    for path in [
        &["scene_camera"][..],
        &["scene_camera", "K"],
        &["scene_camera", "image_size"],
        &["environment_camera", "kind"],
        &["environment_camera", "T_world_cam"],
        &["environment_camera", "projection"],
        &["environment_camera", "projection", "f"],
        &["environment_camera", "projection", "max_theta_rad"],
        &["mirror_sphere", "radius"],
        &["tracker", "T_world_source"],
        &["tracker", "T_sensor_cam"],
        &["object", "glb"],
        &["photometric_chart", "patches_xywh"],
        &["virtual_lights", "lights", "0", "intensity"],
    ] {
        let text = message_without(path);
        let name = path.join(".").replace(".0.", "[0].");
        assert!(text.contains(&format!("`{name}` is missing")), "{text}");
        assert!(
            !text.contains("see the documentation"),
            "no hint for {name}"
        );
        assert_eq!(text.lines().count(), 1);
    }
}

#[test]
fn reads_file_with_scene_camera_alone() {
    let mut value = rig();
    let root = value.as_object_mut().unwrap();
    root.retain(|key, _| key == "scene_camera");
    let rig = parse(&value).unwrap();
    assert!(rig.calibration.environment.is_none() && rig.calibration.tracker.is_none());
    assert!(rig.phantoms.is_empty() && rig.object.is_none() && rig.ground.is_none());
}

/// Pointer to a value, the wrong value (JSON), and a part of the message; empty if the value is valid.
const WRONG_VALUES: &[(&str, &str, &str)] = &[
    ("/scene_camera/K/0/0", "-1.0", "scene_camera.K"),
    ("/scene_camera/image_size/0", "0", "scene_camera.image_size"),
    ("/scene_camera/image_size/1", "1000000", "image_size[1]"),
    ("/scene_camera/latency_s", "8", ""),
    ("/scene_camera/latency_s", "11", "scene_camera.latency_s"),
    (
        "/environment_camera/kind",
        r#""cube""#,
        "expected `fisheye` or `sphere`",
    ),
    (
        "/environment_camera/projection/model",
        r#""stereographic""#,
        "equidistant",
    ),
    (
        "/environment_camera/projection/max_theta_rad",
        "180",
        "radians",
    ),
    (
        "/environment_camera/T_world_cam/quaternion_wxyz/1",
        "2.0",
        "unit quaternion",
    ),
    ("/tracker/fastrak/units", r#""cubits""#, "centimetres"),
    (
        "/environment_camera/projection/f",
        "1e-300",
        "1 to 1e6 pixels",
    ),
    ("/scene_camera/K/0/0", "1e-300", "fx and fy from 1"),
    ("/mirror_sphere/radius", "0", "above 0"),
    (
        "/phantoms/0/ply_frame",
        r#""moon""#,
        "phantoms[0].ply_frame",
    ),
    (
        "/photometric_chart/patches_xywh/0",
        "[1, 2, 3]",
        "4 entries",
    ),
    ("/ground_plane/normal", "[0, 0, 0]", "ground_plane.normal"),
    (
        "/virtual_lights/lights/0/intensity/1",
        "-1.0",
        "lights[0].intensity`: must be three numbers, each at least 0",
    ),
    (
        "/virtual_lights/lights/0/intensity/1",
        "null",
        "intensity[1]",
    ),
    (
        "/virtual_lights/lights/0/kind",
        r#""tube""#,
        "expected `point` or `spot`",
    ),
    (
        "/virtual_lights/lights/0/cutoff_deg",
        "20.0",
        "at least beam_deg",
    ),
    (
        "/virtual_lights/lights/0/cutoff_deg",
        "200.0",
        "at most 180",
    ),
    (
        "/virtual_lights/lights/0/keys/0/target",
        "[1, 2, 3]",
        "keys[0]`: must have a target other than",
    ),
    ("/virtual_lights/lights/0/keys", "[]", "at least one key"),
    (
        "/virtual_lights/lights/0/keys",
        r#"[{"t": 1, "pos": [0, 0, 1], "target": [0, 0, 0]}, {"t": 1, "pos": [0, 0, 1], "target": [0, 0, 0]}]"#,
        "in the order of their times",
    ),
    (
        "/virtual_lights/lights/0/keys/0",
        r#"{"t": 1, "pos": [0, 0, 1], "target": [0, 0, 0], "gain": -1}"#,
        "keys[0].gain`: invalid value: floating point `-1.0`, expected a number of at least 0",
    ),
];

#[test]
fn rejects_wrong_values_by_path_and_reason() {
    for (pointer, value, expected) in WRONG_VALUES {
        let mut document = rig();
        *document.pointer_mut(pointer).unwrap() = serde_json::from_str(value).unwrap();
        match parse(&document) {
            Err(e) => assert!(
                !expected.is_empty() && e.to_string().contains(expected),
                "{e}"
            ),
            Ok(_) => assert!(expected.is_empty(), "{pointer} was accepted"),
        }
    }
}

#[test]
fn rejects_lists_that_are_too_long() {
    let mut document = rig();
    let lights = &mut document["virtual_lights"]["lights"];
    *lights = json!(vec![lights[0].clone(); 33]);
    let message = parse(&document).unwrap_err().to_string();
    assert!(
        message.contains("virtual_lights.lights`: invalid length"),
        "{message}"
    );
    assert!(message.contains("at most 32 entries"), "{message}");
}

/// Each message is one line with the file, the path, what was found and what belongs there.
#[test]
fn messages_name_file_path_finding_and_expectation() {
    let cases = [
        (
            "/scene_camera/latency_s",
            json!("late"),
            "`scene_camera.latency_s`: invalid type: string \"late\", expected seconds, at most 10",
        ),
        (
            "/scene_camera/image_size/0",
            json!(640.5),
            "`scene_camera.image_size[0]`: invalid type: floating point `640.5`, expected a whole \
             number between 0 and 16384",
        ),
        (
            "/markers/0/size_m",
            json!(-0.06),
            "`markers[0].size_m`: invalid value: floating point `-0.06`, expected a number above 0 \
             (and at most 1e6)",
        ),
        (
            "/scene_camera/lens_distortion",
            json!([0.1, 0.2, 0.3]),
            "`scene_camera.lens_distortion`: invalid length 3, expected a list of 4 to 5 entries",
        ),
        (
            "/scene_camera/response",
            json!("log"),
            "`scene_camera.response`: unknown variant `log`, expected one of `srgb`, `linear`, \
             `gamma`",
        ),
        (
            "/environment_camera/T_world_cam",
            json!({}),
            "key `environment_camera.T_world_cam.position` is missing; add it (matrix_row_major, \
             or position and quaternion_wxyz)",
        ),
        (
            "/scene_camera",
            json!(null),
            "`scene_camera`: invalid type: null, expected an object with image_size and K",
        ),
    ];
    for (pointer, value, expected) in cases {
        let mut document = rig();
        *document.pointer_mut(pointer).unwrap() = value;
        let message = parse(&document).unwrap_err().to_string();
        assert_eq!(message, format!("rig.json: {expected}"));
    }
}

#[test]
fn rejects_repeated_keys_and_text_after_the_object() {
    let message = |bytes: &[u8]| RigDocument::parse(bytes).unwrap_err().to_string();
    let twice = message(br#"{"name": "a", "name": "b"}"#);
    assert!(twice.contains("duplicate field `name`"), "{twice}");
    let text = format!("{}\n}}", rig());
    let after = message(text.as_bytes());
    assert!(after.starts_with("rig.json: line 2, column 1: "), "{after}");
    assert!(after.ends_with("; correct the JSON"), "{after}");
}

#[test]
fn rejects_camera_pose_that_scales_or_mirrors() {
    for diagonal in [[2.0, 2.0, 2.0], [1.0, 1.0, -1.0]] {
        let mut value = rig();
        let [x, y, z] = diagonal;
        value["tracker"]["T_sensor_cam"] = json!({"matrix_row_major":
            [[x, 0, 0, 0], [0, y, 0, 0], [0, 0, z, 0], [0, 0, 0, 1]]});
        let text = parse(&value).unwrap_err().to_string();
        assert!(text.contains("tracker.T_sensor_cam"), "{text}");
    }
}

#[test]
fn selects_configured_view_of_environment() {
    let is_sphere = |rig: &RigDocument| {
        let view = rig.calibration.environment.as_ref().map(|e| &e.view);
        matches!(view, Some(EnvironmentView::SphereInScene { .. }))
    };
    let chosen = |source, recorded| {
        let mut document = parse(&rig()).unwrap();
        document.select_environment(source, recorded).unwrap();
        is_sphere(&document)
    };
    assert!(!chosen(EnvironmentSource::Auto, true));
    assert!(chosen(EnvironmentSource::Auto, false));
    assert!(!chosen(EnvironmentSource::Camera, false));
    assert!(chosen(EnvironmentSource::SphereInScene, true));
    let mut hidden = rig();
    hidden["mirror_sphere"]["in_scene_camera_images"] = json!(false);
    let mut hidden = parse(&hidden).unwrap();
    assert!(
        hidden
            .select_environment(EnvironmentSource::SphereInScene, true)
            .is_err()
    );
}

/// A sphere on a marker that is among `markers` stands still; on another it moves about.
#[test]
fn places_sphere_by_marker() {
    let mut value = rig();
    value.as_object_mut().unwrap().remove("environment_camera");
    let quarter = json!([
        [0, -1, 0, 1.0],
        [1, 0, 0, 2.0],
        [0, 0, 1, 3.0],
        [0, 0, 0, 1]
    ]);
    value["markers"] = json!([{"family": "tag36h11", "id": 4, "size_m": 0.05,
        "T_world_marker": {"matrix_row_major": quarter}}]);
    value["mirror_sphere"] = json!({"radius": 0.035, "marker":
        {"family": "tag36h11", "id": 4, "center": [0.1, 0.0, -0.035]}});
    let fixed = parse(&value).unwrap();
    let centre = fixed.mirror_sphere.unwrap().centre_in_world;
    assert!(
        centre.distance(DVec3::new(1.0, 2.1, 2.965)) < 1e-9,
        "{centre}"
    );
    assert_eq!(fixed.calibration.sphere_marker, None);
    value["mirror_sphere"]["marker"]["id"] = json!(5);
    let text = parse(&value).unwrap_err().to_string();
    assert!(text.contains("mirror_sphere.marker.size_m"), "{text}");
    value["mirror_sphere"]["marker"]["size_m"] = json!(0.04);
    let mut carried = parse(&value).unwrap();
    let marker = carried.calibration.sphere_marker.clone().unwrap();
    assert_eq!((marker.id, marker.size), (5, 0.04));
    assert_eq!(marker.centre_in_marker, DVec3::new(0.1, 0.0, -0.035));
    carried
        .select_environment(EnvironmentSource::SphereInScene, true)
        .unwrap();
    value["mirror_sphere"]["marker"]["family"] = json!("tag99");
    let text = parse(&value).unwrap_err().to_string();
    assert!(text.contains("mirror_sphere.marker.family"), "{text}");
}

#[test]
fn reads_rigs_of_ground_truth() {
    let Some(truth) = penumbra_test_data::shared("truth") else {
        return;
    };
    for name in [
        "desk",
        "desk-sphere",
        "courtyard",
        "desk-marker",
        "desk-lamp",
    ] {
        let bytes = std::fs::read(truth.join(name).join("rig.json")).unwrap();
        let rig = RigDocument::parse(&bytes).unwrap();
        assert_eq!(rig.calibration.name, name);
        let sphere = matches!(name, "desk-sphere" | "desk-marker");
        assert_eq!(rig.mirror_sphere.is_some(), sphere);
        let inches = if sphere { 0.01 } else { 0.0254 };
        assert_eq!(rig.calibration.tracker.unwrap().metres_per_unit, inches);
        assert_eq!(rig.calibration.chart.unwrap().patches.len(), 24);
        assert_eq!(rig.markers.len(), if name == "desk-marker" { 3 } else { 0 });
        assert_eq!(
            rig.virtual_lights.len(),
            if name == "desk-lamp" { 2 } else { 0 }
        );
    }
}

proptest! {
    #[test]
    fn damaged_bytes_never_panic(at in 0usize..4000, byte: u8, cut in 0usize..4000) {
        let mut bytes = rig().to_string().into_bytes();
        if let Some(b) = bytes.get_mut(at) {
            *b = byte;
        }
        bytes.truncate(cut.max(1));
        let _ = RigDocument::parse(&bytes);
    }

    #[test]
    fn strange_values_never_panic(place in 0usize..200, kind in 0usize..8) {
        let strange = [
            json!(null), json!([]), json!({}), json!(-1e308), json!("x"), json!(true),
            json!([[[[1]]]]), json!(u64::MAX),
        ];
        let mut value = rig();
        let mut left = place;
        replace_nth(&mut value, &mut left, &strange[kind]);
        let _ = parse(&value);
    }
}

/// Replaces the n-th value of a document in reading order.
fn replace_nth(value: &mut Value, left: &mut usize, with: &Value) {
    if *left == 0 {
        *value = with.clone();
    }
    *left = left.wrapping_sub(1);
    match value {
        Value::Array(items) => items.iter_mut().for_each(|v| replace_nth(v, left, with)),
        Value::Object(items) => items.values_mut().for_each(|v| replace_nth(v, left, with)),
        _ => {}
    }
}

#[test]
fn matrix_and_quaternion_may_not_contradict_each_other() {
    let matrix = json!([[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    let pose = |position: [f64; 3], quaternion: [f64; 4]| {
        let mut rig = rig();
        rig["tracker"]["T_sensor_cam"] = json!({
            "matrix_row_major": matrix, "position": position, "quaternion_wxyz": quaternion
        });
        RigDocument::parse(rig.to_string().as_bytes()).map_err(|e| e.to_string())
    };
    pose([0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]).unwrap();
    pose([0.5, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]).unwrap();
    let text = pose([0.5, 0.0, 0.0], [0.8, 0.6, 0.0, 0.0]).unwrap_err();
    let expected = "matrix_row_major and quaternion_wxyz contradict each other; remove one";
    assert!(text.contains(expected), "{text}");
    let text = pose([0.6, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]).unwrap_err();
    assert!(text.contains("matrix_row_major and position"), "{text}");
}
