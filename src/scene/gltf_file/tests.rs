use super::*;
use glam::DVec3;
use proptest::prelude::*;
use serde_json::{Value, json};

/// Positions of a unit tetrahedron, then its indices (u16), then padding: 60 bytes.
fn tetrahedron() -> Vec<u8> {
    let corners = [
        [0.0f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let indices = [0u16, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3];
    let mut bytes: Vec<u8> = corners
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    bytes.extend(indices.iter().flat_map(|i| i.to_le_bytes()));
    bytes
}

fn document() -> Value {
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "rock", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 1.0],
            "metallicFactor": 0.75, "roughnessFactor": 0.5}, "emissiveFactor": [0.5, 0.5, 0.5],
            "doubleSided": true, "extensions": {
                "KHR_materials_specular": {"specularFactor": 0.5},
                "KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}}],
        "buffers": [{"byteLength": 72}],
        "bufferViews": [{"buffer": 0, "byteLength": 48},
                        {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 4,
             "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 12}]
    })
}

fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(binary);
    out
}

fn load(document: &Value) -> Result<Model, SceneError> {
    load_gltf_bytes(&glb(document, &tetrahedron()), "rock.glb", &|_| {
        Err("no such file".into())
    })
}

fn complaint(document: &Value) -> String {
    let text = load(document).unwrap_err().to_string();
    assert!(
        text.starts_with("rock.glb: ") && text.lines().count() == 1,
        "{text}"
    );
    text
}

fn volume(mesh: &Mesh) -> f32 {
    crate::check::triangles(mesh)
        .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
        .sum()
}

#[test]
fn converts_mesh_to_z_up_with_flat_normals() {
    let model = load(&document()).unwrap();
    let part = &model.parts[0];
    assert_eq!(part.name, "rock");
    assert_eq!(part.mesh.indices.len(), 12);
    // Flat faces share no corners.
    assert_eq!(part.mesh.vertices.len(), 12);
    assert!((volume(&part.mesh) - 1.0 / 6.0).abs() < 1e-6);
    let top = part
        .mesh
        .vertices
        .iter()
        .map(|v| v.position.z)
        .fold(0.0, f32::max);
    let back = part
        .mesh
        .vertices
        .iter()
        .map(|v| v.position.y)
        .fold(0.0, f32::min);
    assert_eq!((top, back), (1.0, -1.0));
    for t in part.mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|i| part.mesh.vertices[t[i] as usize]);
        let face = (b.position - a.position)
            .cross(c.position - a.position)
            .normalize();
        assert!((face - a.normal).length() < 1e-6);
    }
}

#[test]
fn reads_material_with_extensions() {
    let material = load(&document()).unwrap().parts[0].material.clone();
    assert_eq!(material.base_colour, Vec4::new(0.5, 0.25, 0.125, 1.0));
    assert_eq!(
        (material.metallic, material.roughness, material.specular),
        (0.75, 0.5, 0.5)
    );
    assert_eq!(material.emissive, Vec3::splat(2.0));
    assert!(material.double_sided);
}

/// The document with two materials of this KHR_materials_specular.
fn with_specular(extension: &Value) -> Value {
    let mut d = document();
    d["materials"][0]["extensions"]["KHR_materials_specular"] = extension.clone();
    let material = d["materials"][0].clone();
    d["materials"] = json!([material, material]);
    let mut primitive = d["meshes"][0]["primitives"][0].clone();
    let first = primitive.clone();
    primitive["material"] = json!(1);
    d["meshes"][0]["primitives"] = json!([first, primitive]);
    d
}

#[test]
fn grey_specular_colour_scales_the_specular_factor() {
    let d = with_specular(&json!({"specularFactor": 0.5, "specularColorFactor": [0.5, 0.5, 0.5]}));
    let model = load(&d).unwrap();
    assert_eq!(model.parts[0].material.specular, 0.25);
    assert_eq!(model.warnings, Vec::<String>::new());
}

#[test]
fn one_warning_names_the_ignored_specular_properties() {
    let mut d = with_specular(&json!({
        "specularFactor": 0.5, "specularColorFactor": [1.0, 0.5, 0.0],
        "specularTexture": {"index": 0}, "specularColorTexture": {"index": 0}}));
    d["images"] = json!([{"uri": "missing.png"}]);
    d["textures"] = json!([{"source": 0}]);
    let model = load(&d).unwrap();
    let luminance = 0.2126 + 0.5 * 0.7152;
    assert!((model.parts[0].material.specular - 0.5 * luminance).abs() < 1e-6);
    assert_eq!(
        model.warnings,
        [
            "rock.glb: KHR_materials_specular: specularColorTexture, specularTexture, \
          the hue of specularColorFactor ignored; bake the reflection into metallic and roughness"
        ]
    );
    let d = with_specular(&json!({"specularColorFactor": [2.0, 2.0, 2.0]}));
    let model = load(&d).unwrap();
    assert_eq!(model.parts[0].material.specular, 1.0);
    assert_eq!(model.warnings.len(), 1);
    assert!(model.warnings[0].contains("specularColorFactor above 1 ignored"));
}

#[test]
fn nodes_inherit_their_parents_transforms() {
    let mut d = document();
    d["nodes"] = json!([
        {"children": [1, 2], "translation": [10.0, 0.0, 0.0]},
        {"mesh": 0, "translation": [0.0, 2.0, 0.0], "scale": [2.0, 2.0, 2.0]},
        {"mesh": 0, "scale": [-1.0, 1.0, 1.0]}]);
    let model = load(&d).unwrap();
    let raised = model.parts[0].model_from_part.transform_point3(DVec3::Z);
    // glTF (0, 1, 0) · 2 + (10, 2, 0) = (10, 4, 0), which is (10, 0, 4) here.
    assert!(
        raised.distance(DVec3::new(10.0, 0.0, 4.0)) < 1e-6,
        "{raised}"
    );
    // A mirrored copy shares its mesh; who draws it turns its triangles round.
    let mirrored = &model.parts[1];
    assert!(mirrored.model_from_part.determinant() < 0.0 && volume(&mirrored.mesh) > 0.0);
    let placed = model.placed(DMat4::from_translation(DVec3::Y));
    assert_eq!(placed.len(), 2);
    assert_eq!(placed[0].world_from_part.w_axis.y, 1.0);
}

#[test]
fn strips_and_fans_become_triangles() {
    assert_eq!(
        as_triangles(Mode::TriangleStrip, vec![0, 1, 2, 3]),
        [0, 1, 2, 1, 3, 2]
    );
    assert_eq!(
        as_triangles(Mode::TriangleFan, vec![0, 1, 2, 3]),
        [1, 2, 0, 2, 3, 0]
    );
    assert_eq!(as_triangles(Mode::Triangles, vec![0, 1, 2, 3]), [0, 1, 2]);
}

#[test]
fn reads_data_uris_and_sparse_accessors() {
    let mut d = document();
    // Three zero bytes and the little-endian 1.0 of a sparse value: index 3, then (0, 0, 1).
    d["buffers"] = json!([{"byteLength": 72}, {"byteLength": 16,
        "uri": "data:application/octet-stream;base64,AwAAAAAAAAAAAAAAAABAQA=="}]);
    d["bufferViews"].as_array_mut().unwrap().extend([
        json!({"buffer": 1, "byteLength": 4}),
        json!({"buffer": 1, "byteOffset": 4, "byteLength": 12}),
    ]);
    d["accessors"][0]["sparse"] = json!({"count": 1,
        "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}});
    let mesh = load(&d).unwrap().parts[0].mesh.clone();
    // Corner 3 moved from glTF z = 1 to z = 3, our y = −3.
    let back = mesh
        .vertices
        .iter()
        .map(|v| v.position.y)
        .fold(0.0, f32::min);
    assert_eq!(back, -3.0);
}

fn textured(uv: [f32; 2], extra: Value) -> (Value, Vec<u8>) {
    let mut png = Vec::new();
    image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 0, 255, 255])
        .unwrap()
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .unwrap();
    let mut binary = tetrahedron();
    for _ in 0..4 {
        binary.extend(uv.iter().flat_map(|x| x.to_le_bytes()));
    }
    let at = binary.len();
    binary.extend(&png);
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut d = document();
    d["buffers"][0]["byteLength"] = json!(binary.len());
    d["bufferViews"].as_array_mut().unwrap().extend([
        json!({"buffer": 0, "byteOffset": 72, "byteLength": 32}),
        json!({"buffer": 0, "byteOffset": at, "byteLength": png.len()}),
    ]);
    d["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({"bufferView": 2, "componentType": 5126, "type": "VEC2", "count": 4}));
    d["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(2);
    d["images"] = json!([{"bufferView": 3, "mimeType": "image/png"}]);
    d["textures"] = json!([{"source": 0}]);
    let mut texture = json!({"index": 0});
    if extra.is_object() {
        texture["extensions"] = json!({"KHR_texture_transform": extra});
    }
    d["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = texture;
    d["materials"][0]["normalTexture"] = json!({"index": 0, "scale": 0.5});
    (d, binary)
}

fn load_textured(d: &Value, binary: &[u8]) -> Result<Model, SceneError> {
    load_gltf_bytes(&glb(d, binary), "rock.glb", &|_| Err("no such file".into()))
}

#[test]
fn textures_are_decoded_once_and_normal_maps_have_tangents() {
    let (d, binary) = textured([0.25, 0.5], Value::Null);
    let model = load_textured(&d, &binary).unwrap();
    let material = &model.parts[0].material;
    let base = material.base_colour_texture.as_ref().unwrap();
    assert_eq!((base.width, base.height), (2, 1));
    assert_eq!(base.rgba, [255, 0, 0, 255, 0, 0, 255, 255]);
    assert!(Arc::ptr_eq(base, material.normal_texture.as_ref().unwrap()));
    assert_eq!(material.normal_scale, 0.5);
    for v in &model.parts[0].mesh.vertices {
        assert!((v.tangent.truncate().length() - 1.0).abs() < 1e-5);
        assert!(v.tangent.truncate().dot(v.normal).abs() < 1e-5);
        assert_eq!(v.uv, Vec2::new(0.25, 0.5));
    }
}

#[test]
fn applies_texture_transforms_to_coordinates() {
    // The matrix of the extension's own text: translation · rotation · scale, with
    // rotation [[cos, sin], [−sin, cos]].
    let half_pi = std::f32::consts::FRAC_PI_2;
    let (d, binary) = textured(
        [0.25, 0.5],
        json!({"offset": [10.0, 20.0], "rotation": half_pi, "scale": [2.0, 4.0]}),
    );
    let model = load_textured(&d, &binary).unwrap();
    let uv = model.parts[0].mesh.vertices[0].uv;
    // Scaled: (0.5, 2); turned: (2, −0.5); moved: (12, 19.5).
    assert!((uv - Vec2::new(12.0, 19.5)).length() < 1e-5, "{uv}");
}

type Change = fn(&mut Value);

/// Changes of a document that make it hostile, and a word of their messages.
const HOSTILE: [(Change, &str); 16] = [
    (
        |d| {
            d["accessors"][0] = json!({"componentType": 5126, "type": "VEC3",
                "count": 50_000_000, "min": [0, 0, 0], "max": [1, 1, 1],
                "sparse": {"count": 1, "indices": {"bufferView": 0, "componentType": 5121},
                           "values": {"bufferView": 0}}})
        },
        "no data",
    ),
    (
        |d| d["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(u32::MAX),
        "POSITION",
    ),
    (|d| d["accessors"][0]["count"] = json!(5), "reaches past"),
    (
        |d| d["accessors"][0]["byteOffset"] = json!(u64::MAX),
        "reaches past",
    ),
    (
        |d| d["accessors"][1]["count"] = json!(4_000_000_000u64),
        "too large",
    ),
    (
        |d| d["bufferViews"][0]["byteLength"] = json!(u64::MAX),
        "past its buffer",
    ),
    (|d| d["buffers"][0]["byteLength"] = json!(1000), "too short"),
    (
        |d| d["buffers"][0]["uri"] = json!("../secret.bin"),
        "outside",
    ),
    (|d| d["buffers"][0]["uri"] = json!("/etc/passwd"), "outside"),
    (|d| d["buffers"][0]["uri"] = json!("%2e%2e/x"), "outside"),
    (
        |d| d["buffers"][0]["uri"] = json!("file:///etc/passwd"),
        "outside",
    ),
    (
        |d| d["buffers"][0]["uri"] = json!("gone.bin"),
        "no such file",
    ),
    (
        |d| d["nodes"] = json!([{"mesh": 0, "children": [0]}]),
        "not a tree",
    ),
    (
        |d| d["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
        "draco",
    ),
    (|d| d["nodes"][0] = json!({}), "no triangles"),
    (|d| d["images"] = json!([{}]), ""),
];

#[test]
fn refuses_hostile_documents_with_one_line() {
    for (change, expected) in HOSTILE {
        let mut d = document();
        change(&mut d);
        if expected.is_empty() {
            // An unused image without data is no error.
            load(&d).unwrap();
        } else {
            let text = complaint(&d);
            assert!(text.contains(expected), "{text}");
        }
    }
}

#[test]
fn refuses_invalid_geometry() {
    let refuse = |change: fn(&mut Vec<u8>), expected: &str| {
        let mut binary = tetrahedron();
        change(&mut binary);
        let error = load_gltf_bytes(&glb(&document(), &binary), "rock.glb", &|_| {
            Err(String::new())
        });
        let text = error.unwrap_err().to_string();
        assert!(text.contains(expected), "{text}");
    };
    refuse(|b| b[48] = 9, "index 9");
    refuse(
        |b| b[..4].copy_from_slice(&f32::NAN.to_le_bytes()),
        "finite",
    );
    refuse(
        |b| b[..4].copy_from_slice(&f32::INFINITY.to_le_bytes()),
        "finite",
    );
    refuse(|b| b[..48].fill(0), "no area");
}

#[test]
fn refuses_links_out_of_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (inside, outside) = (folder.path().join("in"), folder.path().join("out.bin"));
    std::fs::create_dir(&inside).unwrap();
    std::fs::write(&outside, tetrahedron()).unwrap();
    let mut d = document();
    d["buffers"][0]["uri"] = json!("data.bin");
    std::fs::write(inside.join("rock.gltf"), d.to_string()).unwrap();
    let load = || load_gltf(&inside.join("rock.gltf"));
    assert!(load().unwrap_err().to_string().contains("data.bin"));
    std::fs::write(inside.join("data.bin"), tetrahedron()).unwrap();
    assert_eq!(load().unwrap().parts.len(), 1);
    #[cfg(unix)]
    {
        std::fs::remove_file(inside.join("data.bin")).unwrap();
        std::os::unix::fs::symlink(&outside, inside.join("data.bin")).unwrap();
        assert!(load().unwrap_err().to_string().contains("outside"));
    }
}

#[test]
fn error_names_a_missing_file() {
    let text = load_gltf(Path::new("/nowhere/x.glb"))
        .unwrap_err()
        .to_string();
    assert!(text.contains("/nowhere/x.glb"), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn flipped_and_cut_bytes_never_panic(
        flips in prop::collection::vec((0usize..4096, any::<u8>()), 0..4),
        cut in prop::option::of(0usize..4096),
    ) {
        let (d, binary) = textured([0.25, 0.5], Value::Null);
        let mut bytes = glb(&d, &binary);
        let count = bytes.len();
        for (at, byte) in flips {
            bytes[at % count] = byte;
        }
        bytes.truncate(cut.unwrap_or(count));
        if let Ok(model) = load_gltf_bytes(&bytes, "rock.glb", &|_| Err("none".into())) {
            for part in &model.parts {
                prop_assert!(check_mesh(&part.mesh).is_ok());
                prop_assert!(part.mesh.vertices.iter().all(|v| v.normal.is_normalized()));
            }
        }
    }

    #[test]
    fn strange_numbers_in_the_document_never_panic(place in 0usize..200, with in 0usize..6) {
        let strange = [json!(-1), json!(u32::MAX), json!(u64::MAX), json!(1e300), json!([]), json!("")];
        let (mut d, binary) = textured([0.25, 0.5], json!({"rotation": 1.0}));
        let mut left = place;
        replace_nth_leaf(&mut d, &mut left, &strange[with]);
        let _ = load_textured(&d, &binary);
    }
}

fn replace_nth_leaf(value: &mut Value, left: &mut usize, with: &Value) {
    match value {
        Value::Array(items) => items
            .iter_mut()
            .for_each(|v| replace_nth_leaf(v, left, with)),
        Value::Object(items) => items
            .values_mut()
            .for_each(|v| replace_nth_leaf(v, left, with)),
        _ => {
            if *left == 0 {
                *value = with.clone();
            }
            *left = left.wrapping_sub(1);
        }
    }
}

/// A published model; `None` where the shared data is missing.
fn published(file: &str) -> Option<Model> {
    let folder = penumbra_test_data::shared("data/models")?;
    Some(load_gltf(&folder.join(file)).unwrap())
}

#[test]
fn published_models_have_their_triangles_and_height() {
    // Triangles and height as the files' accessor counts, bounds and nodes give them.
    let cases = [
        ("Duck/Duck.glb", 1, 4212, 1.5404),
        ("BoxTextured/BoxTextured.glb", 1, 12, 1.0),
        ("Suzanne/Suzanne.gltf", 1, 3936, 1.9248),
        ("WaterBottle/WaterBottle.gltf", 1, 4510, 0.2604),
        ("torii/scene.gltf", 7, 14_844, 5.3013),
        ("suzi.glb", 1, 15_744, 1.3383),
    ];
    for (file, parts, triangles, height) in cases {
        let Some(model) = published(file) else {
            return;
        };
        let count: usize = model.parts.iter().map(|p| p.mesh.indices.len() / 3).sum();
        assert_eq!((model.parts.len(), count), (parts, triangles), "{file}");
        let heights = model.parts.iter().flat_map(|p| {
            let place = |v: &Vertex| p.model_from_part.transform_point3(v.position.as_dvec3()).z;
            p.mesh.vertices.iter().map(place).collect::<Vec<_>>()
        });
        let (low, high) = heights.fold((f64::MAX, f64::MIN), |(l, h), z| (l.min(z), h.max(z)));
        assert!((high - low - height).abs() < 1e-3, "{file}: {}", high - low);
    }
}

#[test]
fn recomputed_tangents_equal_those_of_a_published_model() {
    let file = "WaterBottle/WaterBottle.gltf";
    let Some(model) = published(file) else {
        return;
    };
    let part = &model.parts[0];
    let material = &part.material;
    assert!(material.occlusion_texture.is_some() && material.emissive_texture.is_some());
    let mut mesh = (*part.mesh).clone();
    recompute_tangents(&mut mesh);
    let agree = |(a, b): &(&Vertex, &Vertex)| {
        let angle = a.tangent.truncate().dot(b.tangent.truncate());
        angle > 0.95 && a.tangent.w == b.tangent.w
    };
    let count = mesh
        .vertices
        .iter()
        .zip(&part.mesh.vertices)
        .filter(agree)
        .count();
    assert!(
        count * 100 > mesh.vertices.len() * 95,
        "{count} of {}",
        mesh.vertices.len()
    );
}

#[test]
fn reads_lamps_with_their_poses() {
    let mut d = document();
    d["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    d["extensions"] = json!({"KHR_lights_punctual": {"lights": [
        {"type": "point", "color": [1.0, 0.5, 0.25], "intensity": 40.0},
        {"type": "spot", "intensity": 10.0, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 30.0}]}});
    let light = |i: usize| json!({"KHR_lights_punctual": {"light": i}});
    // glTF's +Y is up; a spot shines along its own -Z, here turned downwards.
    d["nodes"] = json!([
        {"name": "rock", "mesh": 0},
        {"name": "bulb", "translation": [1.0, 2.0, 3.0], "extensions": light(0)},
        {"name": "spot", "rotation": [-0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()], "extensions": light(1)},
        {"name": "sun", "extensions": light(2)}]);
    d["scenes"] = json!([{"nodes": [0, 1, 2, 3]}]);
    let read =
        |d: &Value| load_gltf_bytes(&glb(d, &tetrahedron()), "m.glb", &|_| Err("none".into()));
    let model = read(&d).unwrap();
    assert_eq!((model.parts.len(), model.lamps.len()), (1, 3));
    let place = DMat4::from_translation(DVec3::X * 10.0);
    let bulb = model.lamps[0].placed(place, 20.0).at(0.0).unwrap();
    assert!(bulb.position.distance(Vec3::new(11.0, -3.0, 2.0)) < 1e-6);
    assert_eq!(
        (bulb.intensity, bulb.cone),
        (Vec3::new(2.0, 1.0, 0.5), None)
    );
    let spot = model.lamps[1].placed(place, 20.0).at(0.0).unwrap();
    assert!(spot.direction.distance(Vec3::NEG_Z) < 1e-6, "{spot:?}");
    assert_eq!(spot.intensity, Vec3::splat(0.5));
    // Along glTF's -Z, which is +Y here, with 30 lux, at any scale.
    for scale in [1.0, 5.0] {
        let place = place * DMat4::from_scale(DVec3::splat(scale));
        let sun = model.lamps[2].placed(place, 20.0).at(0.0).unwrap();
        let away = Vec3::X * 10.0 - sun.position;
        assert!(away.normalize().distance(Vec3::Y) < 1e-6, "{away}");
        assert!((sun.intensity.x / away.length_squared() - 1.5).abs() < 1e-5);
    }
    for (at, light) in [
        (0, json!({"type": "point", "intensity": -1.0})),
        (0, json!({"type": "beam"})),
        (
            1,
            json!({"type": "spot", "spot": {"innerConeAngle": 0.6, "outerConeAngle": 0.5}}),
        ),
        (1, json!({"type": "spot"})),
    ] {
        let mut broken = d.clone();
        broken["extensions"]["KHR_lights_punctual"]["lights"][at] = light;
        let message = read(&broken).unwrap_err().to_string();
        assert!(
            message.starts_with("m.glb") && message.lines().count() == 1,
            "{message}"
        );
    }
    let mut dangling = d.clone();
    dangling["nodes"][1]["extensions"] = light(7);
    assert!(read(&dangling).is_err());
    dangling["extensions"] = json!({});
    assert!(read(&dangling).is_err());
}

/// The rock with an animation: `output` numbers for each key of `property`, `input` seconds.
fn animated(property: &str, how: &str, input: &[f32], output: &[f32], shape: &str) -> Vec<u8> {
    let mut d = document();
    let mut binary = tetrahedron();
    let per = if shape == "VEC4" { 4 } else { 3 };
    for (values, shape, count) in [
        (input, "SCALAR", input.len()),
        (output, shape, output.len() / per),
    ] {
        let (offset, length) = (binary.len(), 4 * values.len());
        binary.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        let views = d["bufferViews"].as_array_mut().unwrap();
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": length}));
        let view = views.len() - 1;
        let accessors = d["accessors"].as_array_mut().unwrap();
        accessors.push(
            json!({"bufferView": view, "componentType": 5126, "type": shape,
            "count": count, "min": [0.0], "max": [9.0]}),
        );
    }
    d["buffers"][0]["byteLength"] = json!(binary.len());
    // The rock hangs on an arm, one up in glTF's axes, that moves.
    d["nodes"] = json!([
        {"name": "arm", "translation": [0.0, 1.0, 0.0], "children": [1]},
        {"name": "rock", "mesh": 0, "translation": [1.0, 0.0, 0.0]}]);
    d["animations"] = json!([{"name": "swing",
        "samplers": [{"input": 2, "output": 3, "interpolation": how}],
        "channels": [{"sampler": 0, "target": {"node": 0, "path": property}}]}]);
    glb(&d, &binary)
}

fn play(bytes: &[u8], playing: Playing<'_>) -> Result<Model, SceneError> {
    load_bytes(bytes, "rock.glb", &|_| Err("no such file".into()), playing)
}

fn origin(model: &Model, seconds: f64) -> DVec3 {
    let motion = model.part_motions[0].as_ref().unwrap();
    motion.at(seconds).transform_point3(DVec3::ZERO)
}

#[test]
fn animation_equals_its_closed_form() {
    // Steps: 1 up, then 3 up, repeats after 2 s. Y up is Z up here.
    let steps = [0.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0];
    let bytes = animated("translation", "STEP", &[0.0, 1.0, 2.0], &steps, "VEC3");
    let model = play(&bytes, Playing::Named("swing")).unwrap();
    for (seconds, up) in [(0.5, 1.0), (1.5, 3.0), (2.5, 1.0)] {
        assert!(origin(&model, seconds).distance(DVec3::new(1.0, 0.0, up)) < 1e-6);
    }
    // A quarter turn about glTF's Y, our Z, in 2 s, evenly.
    let half = std::f32::consts::FRAC_PI_8;
    let (s, c) = (2.0 * half).sin_cos();
    let turn = [0.0, 0.0, 0.0, 1.0, 0.0, s, 0.0, c];
    let bytes = animated("rotation", "LINEAR", &[0.0, 2.0], &turn, "VEC4");
    let model = play(&bytes, Playing::First).unwrap();
    for i in 0..20 {
        let angle = 0.5 * std::f64::consts::FRAC_PI_2 * (0.1 * f64::from(i));
        let expected = DVec3::new(angle.cos(), angle.sin(), 1.0);
        let at = origin(&model, 0.1 * f64::from(i));
        assert!(at.distance(expected) < 1e-6, "{i}: {at} {expected}");
    }
    // x = t³ with its slopes as tangents.
    let cubic = |t: f32| {
        [
            [3.0 * t * t, 0.0, 0.0],
            [t * t * t, 1.0, 0.0],
            [3.0 * t * t, 0.0, 0.0],
        ]
    };
    let keys = [0.0, 0.5, 2.0];
    let output: Vec<f32> = keys.iter().flat_map(|t| cubic(*t)).flatten().collect();
    let bytes = animated("translation", "CUBICSPLINE", &keys, &output, "VEC3");
    let model = play(&bytes, Playing::First).unwrap();
    for i in 0..20 {
        let t = 0.1 * f64::from(i);
        let x = origin(&model, t).x;
        assert!((x - 1.0 - t.powi(3)).abs() < 1e-5, "{t}: {x}");
    }
}

#[test]
fn unselected_or_missing_animation_moves_nothing() {
    let bytes = animated("translation", "LINEAR", &[0.0], &[0.0, 5.0, 0.0], "VEC3");
    for (playing, plays) in [(Playing::Nothing, true), (Playing::Named("wave"), false)] {
        let model = play(&bytes, playing).unwrap();
        assert_eq!(
            (model.plays, model.part_motions[0].is_none()),
            (plays, true)
        );
        assert_eq!(model.animations, ["swing"]);
        let at = model.parts[0].model_from_part.w_axis.truncate();
        assert!(at.distance(DVec3::new(1.0, 0.0, 1.0)) < 1e-6);
    }
}

#[test]
fn unknown_words_of_animations_are_errors() {
    for (path, way, reason) in [
        ("twist", "LINEAR", "its path is unknown"),
        ("translation", "SWIFT", "interpolation: Invalid value"),
    ] {
        let bytes = animated(path, way, &[0.0, 1.0], &[0.0; 6], "VEC3");
        let message = play(&bytes, Playing::First).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn errors_of_animations_name_node_and_reason() {
    let two = [0.0, 1.0];
    let cases = [
        (
            animated("translation", "LINEAR", &[1.0, 0.5], &[0.0; 6], "VEC3"),
            "do not increase",
        ),
        (
            animated("translation", "LINEAR", &[f32::NAN, 1.0], &[0.0; 6], "VEC3"),
            "do not increase",
        ),
        (
            animated("translation", "LINEAR", &two, &[f32::INFINITY; 6], "VEC3"),
            "not finite",
        ),
        (
            animated("translation", "CUBICSPLINE", &two, &[0.0; 6], "VEC3"),
            "more or fewer",
        ),
        (
            animated("translation", "LINEAR", &two, &[0.0; 8], "VEC4"),
            "wrong shape",
        ),
        (
            animated("rotation", "LINEAR", &two, &[0.0; 8], "VEC4"),
            "unit quaternion",
        ),
        (
            animated(
                "scale",
                "LINEAR",
                &two,
                &[1.0, 1.0, 1.0, 1.0, 0.0, 1.0],
                "VEC3",
            ),
            "becomes zero",
        ),
    ];
    for (bytes, expected) in cases {
        let message = play(&bytes, Playing::First).unwrap_err().to_string();
        assert!(
            message.contains("animation `swing`: node `arm`"),
            "{message}"
        );
        assert!(
            message.contains(expected) && message.lines().count() == 1,
            "{message}"
        );
        assert!(
            play(&bytes, Playing::Nothing).is_ok(),
            "the animation is not selected"
        );
    }
}

#[test]
fn lists_named_files_without_reading_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.gltf");
    let text = json!({"asset": {"version": "2.0"},
        "buffers": [{"byteLength": 1, "uri": "far%20away.bin"}, {"byteLength": 1}],
        "images": [{"uri": "data:image/png;base64,AAAA"}, {"uri": "t.png"}, {"uri": "../x.png"}]});
    std::fs::write(&path, text.to_string()).unwrap();
    let expected = ["far away.bin", "t.png"].map(|name| folder.path().join(name));
    assert_eq!(files_of_gltf(&path), expected);
    assert!(files_of_gltf(&folder.path().join("none.glb")).is_empty());
}
