use super::super::super::cover::corners;
use super::*;
use glam::DQuat;
use penumbra_camera::{DepthOfField, ExposureMotion};
use penumbra_picture::Picture;

fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 320,
        height: 240,
        focal: DVec2::splat(300.0),
        centre: DVec2::new(159.5, 119.5),
        distortion: [0.0; 5],
    }
}

fn cube(at: DVec3, side: f64) -> Corners {
    let ends = [DVec3::splat(-0.5 * side), DVec3::splat(0.5 * side)];
    corners(ends.into_iter(), DMat4::from_translation(at)).unwrap()
}

/// The field of a camera at the origin that looks along +Z, and the largest blur.
fn field(look: Look, boxes: &[BlurredBox]) -> (BlurField, f64) {
    let picture = Picture::default();
    let camera = camera();
    let input = FrameInput {
        world_from_camera: Some(RigidTransform::IDENTITY),
        look,
        ..FrameInput::new(&picture, &camera)
    };
    let mut field = BlurField::default();
    let extent = field.update(&camera, &input, boxes, None);
    (field, extent)
}

fn at(field: &BlurField, x: u32, y: u32) -> Blur {
    field.cells[(y / CELL) as usize * field.across + (x / CELL) as usize]
}

#[test]
fn rotation_of_the_camera_moves_everything_alike() {
    let look = Look {
        motion: Some(ExposureMotion {
            seconds: 0.01,
            rotation: DVec3::Y * 0.02,
            translation: DVec3::ZERO,
        }),
        ..Look::default()
    };
    let (field, extent) = field(look, &[]);
    let [dx, dy, ..] = at(&field, 160, 120);
    assert!((dx + 6.0).abs() < 0.05 && dy.abs() < 0.05, "{dx} {dy}");
    assert!(extent > 6.0 && extent < 9.0, "{extent}");
}

#[test]
fn moving_part_is_blurred_by_its_own_motion_and_beside_its_outline() {
    let step = |x: f64| DMat4::from_translation(DVec3::X * x);
    let part = BlurredBox {
        corners: cube(DVec3::Z, 0.2),
        moved: Some([step(-0.02), step(0.02)]),
    };
    let still = BlurredBox {
        corners: cube(DVec3::new(0.4, 0.0, 1.0), 0.1),
        moved: None,
    };
    let look = Look {
        motion: Some(ExposureMotion::at_rest(0.01)),
        ..Look::default()
    };
    let (field, extent) = field(look, &[part, still]);
    // 4 cm at one metre and a focal length of 300 pixels.
    assert!((at(&field, 160, 120)[0] - 12.0).abs() < 0.1);
    // No cell sees the box nearer than its front.
    assert!((12.0..=12.0 / 0.9).contains(&extent), "{extent}");
    assert_eq!(at(&field, 160 + 36, 120)[0], at(&field, 160, 120)[0]);
    assert_eq!(at(&field, 280, 120), [0.0; 4]);
    assert_eq!(at(&field, 160, 20), [0.0; 4]);
}

#[test]
fn circle_of_confusion_is_that_of_the_nearest_part() {
    let look = Look {
        depth_of_field: Some(DepthOfField {
            aperture: 0.01,
            focus: 2.0,
        }),
        ..Look::default()
    };
    let parts = [cube(DVec3::Z * 2.0, 0.01), cube(DVec3::Z, 0.1)];
    let parts = parts.map(|corners| BlurredBox {
        corners,
        moved: None,
    });
    let (field, _) = field(look, &parts);
    let [_, _, radius, _] = at(&field, 160, 120);
    assert!((radius - 0.75).abs() < 0.01, "{radius}");
}

#[test]
fn nothing_is_blurred_without_motion_and_aperture() {
    let parts = [BlurredBox {
        corners: cube(DVec3::Z, 0.1),
        moved: None,
    }];
    assert_eq!(field(Look::default(), &parts).1, 0.0);
    let rest = Look {
        motion: Some(ExposureMotion::at_rest(0.02)),
        ..Look::default()
    };
    assert_eq!(field(rest, &parts).1, 0.0);
}

#[test]
fn box_of_any_orientation_is_hit_at_its_middle() {
    let turn = DMat4::from_quat(DQuat::from_rotation_y(0.6)) * DMat4::from_scale(DVec3::splat(0.3));
    let placed = DMat4::from_translation(DVec3::Z * 1.5) * turn;
    let ends = [DVec3::splat(-0.5), DVec3::splat(0.5)].into_iter();
    let slab = Slab::new(&corners(ends, placed).unwrap());
    let (unit, from) = (slab.unit_from_world, slab.origin);
    let depth = mean_depth(unit * -from, unit * DVec3::Z).unwrap();
    assert!((depth - 1.5).abs() < 1e-9, "{depth}");
    let beside = unit * DVec2::splat(0.5).extend(1.0);
    assert_eq!(mean_depth(unit * -from, beside), None);
}

#[test]
fn shadow_of_a_moving_part_has_its_motion_on_the_ground() {
    // Two metres above the ground, looking down; the light stands 45° high in +X.
    let pose = RigidTransform {
        rotation: DQuat::from_rotation_x(std::f64::consts::PI),
        translation: DVec3::Z * 2.0,
    };
    let step = |t: f64| DMat4::from_translation(DVec3::new(0.02, 0.0, -0.01) * t);
    let part = BlurredBox {
        corners: cube(DVec3::new(0.6, 0.0, 0.5), 0.1),
        moved: Some([step(-0.5), step(0.5)]),
    };
    let (picture, camera) = (Picture::default(), camera());
    let input = FrameInput {
        world_from_camera: Some(pose),
        look: Look {
            motion: Some(ExposureMotion::at_rest(0.01)),
            ..Look::default()
        },
        brightest: glam::Vec3::new(0.4, 0.0, 0.4),
        ..FrameInput::new(&picture, &camera)
    };
    let mut field = BlurField::default();
    field.update(&camera, &input, &[part], Some(0.0));
    // The shadow lies at x = 0.1 m; a fall of 1 cm moves it by another centimetre: 3 cm at 2 m.
    let [dx, dy, ..] = at(&field, 160 + 15, 120);
    assert!((dx - 4.5).abs() < 1e-4 && dy.abs() < 1e-4, "{dx} {dy}");
    assert_eq!(at(&field, 20, 120), [0.0; 4]);
}
