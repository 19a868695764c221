use super::*;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use proptest::prelude::*;

fn message(angles_degrees: [f64; 3], position_metres: [f64; 3]) -> Message {
    Message {
        camera: 1,
        angles_degrees,
        position_metres,
        lens: Lens::default(),
    }
}

#[test]
fn bytes_are_as_in_the_manual() {
    // A.3.1 and B: -180° is A60000, 180° is 5A0000; 1 mm is 64.
    let bytes = message([-180.0, 180.0, 0.0], [0.001, -0.001, 131.0]).encode();
    assert_eq!(bytes[..2], [0xd1, 1]);
    assert_eq!(bytes[2..8], [0xa6, 0, 0, 0x5a, 0, 0]);
    assert_eq!(bytes[11..17], [0, 0, 64, 0xff, 0xff, 0xc0]);
    let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    assert_eq!(sum, 0x40);
    assert_eq!(Message::decode(&bytes).unwrap().encode(), bytes);
}

#[test]
fn pan_turns_right_tilt_up_and_roll_clockwise() {
    let turned = |angles, axis| message(angles, [0.0; 3]).pose(Axes::default()).rotation * axis;
    let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-12;
    assert!(near(turned([0.0; 3], DVec3::Y), DVec3::Y));
    assert!(near(turned([90.0, 0.0, 0.0], DVec3::Y), DVec3::X));
    assert!(near(turned([0.0, 90.0, 0.0], DVec3::Y), DVec3::Z));
    // Clockwise from behind: the camera's right side goes down.
    assert!(near(turned([0.0, 0.0, 90.0], DVec3::X), DVec3::NEG_Z));
    // Pan is about the vertical for any tilt.
    assert!(near(turned([90.0, 90.0, 0.0], DVec3::Z), DVec3::NEG_X));
}

#[test]
fn an_optical_frame_becomes_a_studio_frame() {
    // A camera at the origin that looks along the world's +Y with its top up.
    let world_from_camera = RigidTransform::new(
        DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2),
        DVec3::ZERO,
    );
    assert!((world_from_camera.rotation * DVec3::Z - DVec3::Y).length() < 1e-12);
    let studio = optical_to_studio(world_from_camera);
    let message = Message::from_pose(1, studio, Axes::default(), Lens::default());
    assert!(
        message
            .angles_degrees
            .iter()
            .all(|angle| angle.abs() < 1e-9)
    );
}

#[test]
fn printed_axes_parse_to_the_same_axes() {
    for text in ["pan,tilt,roll,x,y,z", "-tilt,pan,roll,z,-y,x"] {
        assert_eq!(Axes::parse(text).unwrap().to_string(), text);
    }
    for text in [
        "",
        "pan,tilt,roll,x,y",
        "pan,pan,roll,x,y,z",
        "x,tilt,roll,pan,y,z",
        "pan,tilt,roll,x,y,z,w",
    ] {
        assert_eq!(Axes::parse(text), None, "{text}");
    }
    let axes = Axes::parse("-tilt,pan,roll,z,-y,x").unwrap();
    let pose = message([-20.0, 10.0, 3.0], [3.0, -2.0, 1.0]).pose(axes);
    let plain = message([10.0, 20.0, 3.0], [1.0, 2.0, 3.0]).pose(Axes::default());
    assert!((pose.translation - plain.translation).length() < 1e-12);
    assert!(pose.rotation.angle_between(plain.rotation) < 1e-9);
}

#[test]
fn sent_messages_decode() {
    let receiver = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let sender = FreedSender::new(receiver.local_addr().unwrap(), 7).unwrap();
    let pose = RigidTransform::new(DQuat::from_rotation_z(0.3), DVec3::new(1.0, 2.0, 1.5));
    sender.send(pose, Lens { zoom: 5, focus: 6 }).unwrap();
    let mut bytes = [0; 64];
    receiver
        .set_read_timeout(Some(std::time::Duration::from_secs(5)))
        .unwrap();
    assert_eq!(receiver.recv(&mut bytes).unwrap(), D1_LEN);
    let message = Message::decode(bytes.first_chunk().unwrap()).unwrap();
    assert_eq!(
        (message.camera, message.lens.zoom, message.lens.focus),
        (7, 5, 6)
    );
    let back = message.pose(Axes::default());
    assert!(back.rotation.angle_between(pose.rotation) < 1e-6);
    // Without a receiver, messages are lost and `send` succeeds.
    drop(receiver);
    for _ in 0..3 {
        sender.send(pose, Lens::default()).unwrap();
    }
}

proptest! {
    #[test]
    fn poses_survive_encoding(pan in -179.0..179.0, tilt in -89.0..89.0, roll in -179.0..179.0,
                              x in -100.0..100.0, z in -100.0..100.0) {
        let rotation = message([pan, tilt, roll], [0.0; 3]).pose(Axes::default()).rotation;
        let pose = RigidTransform::new(rotation, DVec3::new(x, -x, z));
        for axes in ["pan,tilt,roll,x,y,z", "-roll,tilt,-pan,-z,y,x"] {
            let axes = Axes::parse(axes).unwrap();
            let bytes = Message::from_pose(1, pose, axes, Lens::default()).encode();
            let back = Message::decode(&bytes).unwrap().pose(axes);
            prop_assert!(back.rotation.angle_between(pose.rotation) < 2e-6);
            prop_assert!((back.translation - pose.translation).length() < 2e-5);
        }
    }

    #[test]
    fn straight_up_and_down_survive_encoding(pan in -179.0..179.0, up in any::<bool>()) {
        let tilt = if up { 90.0 } else { -90.0 };
        let pose = message([pan, tilt, 0.0], [0.0; 3]).pose(Axes::default());
        let again = Message::from_pose(1, pose, Axes::default(), Lens::default());
        let back = again.pose(Axes::default());
        prop_assert!(back.rotation.angle_between(pose.rotation) < 1e-4);
    }

    #[test]
    fn a_changed_byte_is_refused(place in 0usize..D1_LEN, change in 1u8..=255) {
        let mut bytes = message([10.0, 20.0, 30.0], [1.0, 2.0, 3.0]).encode();
        bytes[place] = bytes[place].wrapping_add(change);
        prop_assert_eq!(Message::decode(&bytes), None);
    }
}
