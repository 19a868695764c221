#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::disallowed_methods
)]
//! Bakes are stored and loaded unchanged; everything else is refused.

use super::*;
use crate::mesh::{Material, Part};
use crate::planes::{
    BakeSettings, Basis, Image, PlaneSettings, ReceiverImage, ShadowingPlane, generate,
};
use crate::primitives;
use crate::scene::Scene;
use glam::{DMat4, DVec3, Vec3};
use proptest::prelude::*;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, SystemTime};

fn scene() -> Scene {
    let part = |mesh| Part {
        name: "box".into(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(DVec3::X),
        mirror: false,
        albedo: None,
    };
    Scene {
        virtual_parts: vec![part(primitives::cuboid(Vec3::ONE))],
        phantom_parts: vec![part(primitives::plane(4.0, 4.0))],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

fn planes() -> Vec<ShadowingPlane> {
    generate(&scene(), &PlaneSettings::default()).unwrap()
}

fn bake() -> Bake {
    static BAKE: LazyLock<Bake> = LazyLock::new(new_bake);
    BAKE.clone()
}

fn new_bake() -> Bake {
    let settings = BakeSettings {
        resolution: 8,
        frequency: 2,
        samples: 3,
    };
    let planes = planes();
    let image = |i: u32| match i % 4 {
        0 => Image::Black,
        1 => Image::White,
        _ => Image::Stored(i % 5),
    };
    let receiver = |i: usize| ReceiverImage {
        normals: (0..64 * (i % 2) as i16).map(|n| [n, -n * 300]).collect(),
        depths: (0..64 * (i % 2) as u16).map(|n| n * 900).collect(),
    };
    Bake {
        key: key(&scene(), &PlaneSettings::default(), &settings),
        settings,
        receivers: (0..planes.len()).map(receiver).collect(),
        images: (0..40 * planes.len() as u32)
            .map(|i| Basis {
                past_all: image(i),
                past_phantoms: image(i / 3),
            })
            .collect(),
        texels: (0..64 * 5).map(|i| (i * 7 % 256) as u8).collect(),
        planes,
    }
}

/// A file with a correct checksum and arbitrary content.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.truncate(bytes.len() - 4);
    let sum = crc32fast::hash(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

#[test]
fn stored_bake_loads_unchanged() {
    let bake = bake();
    assert_eq!(from_bytes(&to_bytes(&bake).unwrap()).unwrap(), bake);
    let empty = Bake {
        planes: Vec::new(),
        receivers: Vec::new(),
        images: Vec::new(),
        texels: Vec::new(),
        ..bake
    };
    assert_eq!(from_bytes(&to_bytes(&empty).unwrap()).unwrap(), empty);
}

#[test]
fn refuses_every_truncation() {
    let bytes = to_bytes(&bake()).unwrap();
    for length in 0..bytes.len() {
        let text = from_bytes(&bytes[..length]).unwrap_err().to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        if length > HEADER + CHECKSUM {
            from_bytes(&sealed(bytes[..length].to_vec())).unwrap_err();
        }
    }
}

#[test]
fn refuses_every_flipped_bit() {
    let bytes = to_bytes(&bake()).unwrap();
    for bit in 0..8 * bytes.len() {
        let mut bytes = bytes.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert!(from_bytes(&bytes).is_err(), "bit {bit}");
    }
}

#[test]
fn error_names_another_version() {
    let mut bytes = to_bytes(&bake()).unwrap();
    bytes[8] = 9;
    let text = from_bytes(&sealed(bytes)).unwrap_err().to_string();
    assert!(text.contains("version 9"), "{text}");
}

proptest! {
    // With a correct checksum only the reader's own checks protect the program.
    #[test]
    fn forged_content_never_panics_and_loads_only_if_consistent(
        at in any::<prop::sample::Index>(),
        with in prop::collection::vec(any::<u8>(), 1..9),
        cut in any::<prop::sample::Index>(),
    ) {
        let bake = bake();
        let mut raw = content::write(&bake);
        let start = at.index(raw.len());
        for (byte, new) in raw[start..].iter_mut().zip(&with) {
            *byte = *new;
        }
        raw.truncate(raw.len() - cut.index(3 * raw.len()).min(raw.len()) / 2);
        if let Ok(read) = content::read(&raw, bake.key)
            && content::check(&read).is_ok()
        {
            prop_assert_eq!(read.images.len(), 40 * read.planes.len());
        }
    }

    #[test]
    fn forged_files_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400), with_header: bool) {
        static HEAD: LazyLock<Vec<u8>> = LazyLock::new(|| to_bytes(&bake()).unwrap()[..HEADER].to_vec());
        let mut file = if with_header {
            HEAD.clone()
        } else {
            Vec::new()
        };
        file.extend(bytes);
        file.extend([0; 4]);
        prop_assert!(from_bytes(&sealed(file)).is_err());
    }
}

#[test]
fn refuses_to_write_an_inconsistent_bake() {
    let broken: [fn(&mut Bake); 6] = [
        |b| b.settings.resolution = 6,
        |b| b.settings.frequency = 0,
        |b| drop(b.receivers.pop()),
        |b| b.texels.truncate(3),
        |b| b.images[0].past_all = Image::Stored(5),
        |b| b.planes[0].centre.x = f64::NAN,
    ];
    for spoil in broken {
        let mut bake = bake();
        spoil(&mut bake);
        assert!(matches!(to_bytes(&bake), Err(StoreError::Unfit { .. })));
    }
}

#[test]
fn key_depends_on_everything_that_a_bake_depends_on_and_nothing_else() {
    let settings = BakeSettings::default();
    let layout = PlaneSettings::default();
    let default = key(&scene(), &layout, &settings);
    assert_eq!(default, key(&scene(), &layout, &settings));
    let changes: [fn(&mut Scene, &mut PlaneSettings, &mut BakeSettings); 10] = [
        |s, _, _| s.virtual_parts[0].world_from_part.w_axis.x += 1e-9,
        |s, _, _| {
            Arc::make_mut(&mut s.virtual_parts[0].mesh).vertices[3]
                .position
                .y += 1e-6
        },
        |s, _, _| {
            Arc::make_mut(&mut s.phantom_parts[0].mesh)
                .indices
                .swap(0, 1)
        },
        |s, _, _| drop(s.phantom_parts.pop()),
        |s, _, _| s.phantom_parts[0].name = "ground".into(),
        |s, _, _| s.planes = planes()[..1].to_vec(),
        |_, p, _| p.count += 1,
        |_, p, _| p.offset_m += 1e-9,
        |_, _, b| b.samples = 2,
        |_, _, b| b.resolution = 64,
    ];
    for (i, change) in changes.iter().enumerate() {
        let (mut scene, mut layout, mut settings) = (scene(), layout, settings);
        change(&mut scene, &mut layout, &mut settings);
        assert_ne!(default, key(&scene, &layout, &settings), "change {i}");
    }
    let mut painted = scene();
    painted.virtual_parts[0].name = "red box".into();
    Arc::make_mut(&mut painted.virtual_parts[0].material).roughness = 0.1;
    assert_eq!(default, key(&painted, &layout, &settings));
}

#[test]
fn cache_stores_replaces_and_removes() {
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("a/b");
    let bake = bake();
    let path = cache_path(&below, &bake.key);
    assert!(load(&path, &bake.key).unwrap().is_none());
    save(&path, &bake).unwrap();
    save(&path, &bake).unwrap();
    assert_eq!(load(&path, &bake.key).unwrap().unwrap(), bake);
    assert!(load(&path, &[7; 32]).unwrap().is_none());
    assert_eq!(std::fs::read_dir(&below).unwrap().count(), 1);
    std::fs::write(&path, b"penubake and then nonsense").unwrap();
    assert!(load(&path, &bake.key).unwrap().is_none());
    // A folder in place of a file is an error of the operating system.
    let text = save(&below, &bake).unwrap_err().to_string();
    assert!(text.contains("writing failed"), "{text}");
}

#[test]
fn removes_the_least_recently_used_bakes_first() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, age: u64| {
        let path = folder.path().join(name);
        std::fs::write(&path, [0; 100]).unwrap();
        let file = std::fs::File::options().append(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(age))
            .unwrap();
    };
    put("old.bake", 300);
    put("new.bake", 10);
    put("middle.bake", 100);
    put("notes.txt", 9000);
    put("x.1-0.unfinished", 9000);
    put("x.1-1.unfinished", 10);
    assert_eq!(trim(folder.path(), 250).unwrap(), 2);
    let mut left: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    left.sort();
    assert_eq!(
        left,
        ["middle.bake", "new.bake", "notes.txt", "x.1-1.unfinished"]
    );
    assert_eq!(trim(&folder.path().join("none"), 0).unwrap(), 0);
}

#[test]
fn default_folder_follows_the_systems_cache_folders() {
    let by = |all: &'static [(&str, &str)]| {
        cache::folder_by(|name| all.iter().find(|v| v.0 == name).map(|v| v.1.into()))
    };
    assert_eq!(by(&[]), None);
    let expect = |found: Option<std::path::PathBuf>, path: &str| {
        assert_eq!(found.as_deref(), Some(Path::new(path)))
    };
    expect(by(&[("HOME", "/home/x")]), "/home/x/.cache/penumbra/bakes");
    expect(
        by(&[("XDG_CACHE_HOME", "/c"), ("HOME", "/home/x")]),
        "/c/penumbra/bakes",
    );
    expect(
        by(&[("XDG_CACHE_HOME", "c"), ("HOME", "/home/x")]),
        "/home/x/.cache/penumbra/bakes",
    );
    expect(
        by(&[("CACHE_DIRECTORY", "/v/a:/v/b"), ("XDG_CACHE_HOME", "/c")]),
        "/v/a/bakes",
    );
}
