//! The kernel's own virtual cameras.

use super::open;
use penumbra_guest::rig::vivid;
use penumbra_guest::v4l2::{
    VIVID_BUFFER_ERROR, VIVID_DISCONNECT, VIVID_FATAL_ERROR, VIVID_LOST_PERCENT,
};
use rustix::io::Errno;

#[test]
#[ignore = "needs the guest: make test-devices"]
fn streams_from_two_cameras_at_once() {
    let nodes = vivid();
    assert_eq!(nodes.len(), 2);
    let stream = |node| {
        open(node, 640, 480, b"YUYV")
            .stream()
            .unwrap()
            .take(15)
            .len()
    };
    let threads: Vec<_> = nodes
        .into_iter()
        .map(|n| std::thread::spawn(move || stream(n)))
        .collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), 15);
    }
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn vivid_produces_requested_faults() {
    let node = &vivid()[0];
    let camera = open(node, 320, 180, b"YUYV");
    let mut stream = camera.stream().unwrap();
    stream.take(2);
    camera.set(VIVID_BUFFER_ERROR, 1).unwrap();
    assert!(stream.take(6).iter().any(|frame| frame.damaged));
    camera.set(VIVID_LOST_PERCENT, 50).unwrap();
    let frames = stream.take(20);
    camera.set(VIVID_LOST_PERCENT, 0).unwrap();
    assert!(
        frames[19].sequence - frames[0].sequence > 19,
        "no frame was lost"
    );
    camera.set(VIVID_FATAL_ERROR, 1).unwrap();
    assert_eq!(stream.error_within(6), Some(Errno::IO));
    drop(stream);

    let mut stream = camera.stream().unwrap();
    stream.take(2);
    camera.set(VIVID_DISCONNECT, 1).unwrap();
    assert_eq!(stream.error_within(6), Some(Errno::NODEV));
    drop(stream);
    drop(camera); // closing the last handle reconnects it
    open(node, 320, 180, b"YUYV").stream().unwrap().take(3);
}
