use super::*;
use crate::light::places::tests::source;
use crate::light::view::SphereAt;
use glam::{DMat4, DQuat, DVec2, Vec3};
use penumbra_camera::FisheyeLens;
use penumbra_picture::Picture;
use penumbra_rig_model::{EnvironmentCamera, RigDocument};
use penumbra_scene::{Material, Part, primitives};
use std::sync::Arc;

const SIZE: (u32, u32) = (320, 240);
const OBSERVER: DVec3 = DVec3::new(-0.3, 0.0, 0.05);
const LAMP: DVec3 = DVec3::new(0.2, 0.8, 0.3);
const RADIUS: f64 = 0.03;

/// A rig whose fisheye camera is at [`OBSERVER`].
fn rig() -> RigCalibration {
    let mut rig = RigDocument::uncalibrated(SIZE.0, SIZE.1).calibration;
    let lens = FisheyeLens {
        width: 480,
        height: 480,
        focal: 150.0,
        centre: DVec2::splat(239.5),
        distortion: [0.0; 4],
        max_theta: 1.6,
    };
    rig.environment = Some(EnvironmentCamera {
        response: rig.scene_camera.response.clone(),
        vignetting: None,
        view: EnvironmentView::Fisheye {
            lens,
            world_from_camera: RigidTransform {
                rotation: DQuat::IDENTITY,
                translation: OBSERVER,
            },
        },
        latency_nanos: 0,
        brackets_ev: Vec::new(),
    });
    rig
}

/// A camera that looks along +Y from x.
fn pose(x: f64) -> RigidTransform {
    RigidTransform {
        rotation: DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
        translation: DVec3::new(x, -0.6, 0.3),
    }
}

/// The lamp as it is seen from [`OBSERVER`].
fn lamp() -> CompactSource {
    let to = LAMP - OBSERVER;
    CompactSource {
        direction: to.normalize().as_vec3(),
        angular_radius: (RADIUS / to.length()) as f32,
        ..source(1, 0.0)
    }
}

/// A grey picture with white discs (middle, radius, pixels).
fn picture(discs: &[(DVec2, f64)]) -> Picture {
    let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    let codes = pixels.map(|(x, y)| {
        let at = DVec2::new(f64::from(x), f64::from(y));
        discs.iter().any(|(m, r)| at.distance(*m) <= *r)
    });
    let rgba = codes.flat_map(|is_lit| {
        let code = if is_lit { 255 } else { 90 };
        [code, code, code, 255]
    });
    Picture {
        width: SIZE.0,
        height: SIZE.1,
        rgba: rgba.collect(),
    }
}

/// The disc of a ball in the picture of a camera.
fn disc(rig: &RigCalibration, camera_x: f64, at: DVec3, radius: f64) -> (DVec2, f64) {
    let camera = &rig.scene_camera.camera;
    let in_camera = pose(camera_x).inverse().transform_point(at);
    let pixel = camera.project(in_camera).expect("before the camera");
    (pixel, radius * camera.focal.x / in_camera.length())
}

/// What is found from six places of the scene camera, 4 cm apart, whose pictures show these discs.
fn found(
    discs: impl Fn(&RigCalibration, f64) -> Vec<(DVec2, f64)>,
    rays: &RayCaster,
) -> Option<(LampDistance, bool)> {
    let (rig, sources) = (rig(), [lamp()]);
    let mut views = LampViews::new(&rig);
    for k in 0..6 {
        let x = 0.04 * f64::from(k);
        let scene = SceneView {
            picture: &picture(&discs(&rig, x)),
            world_from_camera: Some(pose(x)),
            camera: &rig.scene_camera.camera,
            sphere: SphereAt::Calibrated,
            captured_at: MonotonicTime::from_nanos(i64::from(k) * 100_000_000),
            exposure: None,
        };
        views.see(&scene, (&sources, OBSERVER), rays);
    }
    views.distance(&sources[0], OBSERVER)
}

#[test]
fn lamp_in_the_picture_gets_its_distance() {
    let rays = RayCaster::from_parts(&[]);
    let (found, is_certain) =
        found(|rig, x| vec![disc(rig, x, LAMP, RADIUS)], &rays).expect("seen");
    let truth = LAMP.distance(OBSERVER).recip();
    let error = (f64::from(found.inverse) - truth).abs();
    assert!(error < 0.03 * truth, "{found:?} for {truth}");
    assert!(error < 3.0 * f64::from(found.sigma), "{found:?}");
    assert!(is_certain);
}

#[test]
fn what_is_no_lamp_tells_nothing() {
    let rays = RayCaster::from_parts(&[]);
    // Beside the line on which it must be; as large as a window; one of two.
    let beside = LAMP + DVec3::Z * 0.15;
    assert_eq!(
        found(|rig, x| vec![disc(rig, x, beside, RADIUS)], &rays),
        None
    );
    assert_eq!(
        found(|rig, x| vec![disc(rig, x, LAMP, 6.0 * RADIUS)], &rays),
        None
    );
    let on_the_line = OBSERVER + (LAMP - OBSERVER) * 1.5;
    let both = |rig: &RigCalibration, x: f64| {
        let other = disc(rig, x, on_the_line, 1.5 * RADIUS);
        vec![disc(rig, x, LAMP, RADIUS), other]
    };
    assert_eq!(found(both, &rays), None);
}

#[test]
fn spot_on_a_known_surface_is_no_lamp() {
    let wall = Part {
        name: "wall".to_owned(),
        mesh: Arc::new(primitives::cuboid(Vec3::new(4.0, 0.02, 4.0))),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(DVec3::new(0.0, 0.5, -2.0)),
        mirror: false,
        albedo: None,
    };
    let rays = RayCaster::from_parts(&[wall]);
    assert_eq!(
        found(|rig, x| vec![disc(rig, x, LAMP, RADIUS)], &rays),
        None
    );
}

#[test]
fn ball_that_is_carried_tells_distances() {
    let rig = rig();
    let mut views = LampViews::new(&rig);
    let truth = LAMP.distance(OBSERVER).recip();
    let mut last = None;
    for k in 0..12 {
        let observer = OBSERVER - DVec3::X * 0.02 * f64::from(11 - k);
        let to = LAMP - observer;
        let sources = [CompactSource {
            direction: to.normalize().as_vec3(),
            ..lamp()
        }];
        let scene = SceneView {
            picture: &picture(&[]),
            world_from_camera: Some(pose(0.0)),
            camera: &rig.scene_camera.camera,
            sphere: SphereAt::Calibrated,
            captured_at: MonotonicTime::from_nanos(i64::from(k) * 100_000_000),
            exposure: None,
        };
        views.see(&scene, (&sources, observer), &RayCaster::from_parts(&[]));
        last = views.distance(&sources[0], observer);
    }
    let (found, _) = last.expect("seen from several places");
    assert!((f64::from(found.inverse) - truth).abs() < 1e-3, "{found:?}");
    assert!(found.sigma < 0.1, "{found:?}");
}
