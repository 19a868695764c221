//! `penumbra webcam`, up to the picture that it composes: the guest has no graphics adapter.

use crate::setup::start;
use penumbra_guest::program::succeeds;
use penumbra_guest::recording::{Streams, assert_in_order, read, stream};
use penumbra_guest::rig::{SCENE, ready};
use std::path::Path;
use std::time::Duration;

/// Prepares a webcam's rig and records its camera for a few seconds.
fn recorded(name: &str, camera: &[&str]) -> Streams {
    ready();
    let folder = Path::new("/tmp").join(name);
    let mut arguments = vec!["webcam", "--prepare-only", "--folder"];
    arguments.push(folder.to_str().unwrap());
    arguments.extend(camera);
    let said = succeeds(&arguments);
    assert!(said.contains("sheet.pdf: print it on"), "{said}");
    // A copy, as the configuration advises; the guest's disk is small.
    let text = std::fs::read_to_string(folder.join("rig.toml")).unwrap();
    let config = folder.join("my-rig.toml");
    std::fs::write(&config, text + "\n[recording]\nreserve_mb = 10\n").unwrap();
    succeeds(&["check-config", config.to_str().unwrap()]);
    let recorder = start(name, &config, &["--duration", "5"]);
    let output = recorder.program.output();
    let status = recorder.program.end(Duration::from_secs(30));
    assert!(status.success(), "{status}\n{output}");
    read(&recorder.file)
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn pictures_of_a_named_webcam_have_the_rigs_size() {
    let streams = recorded("webcam", &["--camera", SCENE]);
    let images = stream(&streams, "/scene_camera/image");
    assert!(images.len() > 20, "{} pictures", images.len());
    assert_in_order("/scene_camera/image", images);
    let message = &images[images.len() - 1].data;
    let is_jpeg = |bytes: &[u8]| bytes == [0xff, 0xd8, 0xff];
    let begin = message.windows(3).position(is_jpeg).unwrap();
    let picture = turbojpeg::decompress_to_yuv(&message[begin..]).unwrap();
    assert_eq!((picture.width, picture.height), (1280, 720));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn first_camera_is_taken_without_a_name() {
    let streams = recorded("webcam-auto", &[]);
    let is_image = |topic: &&String| topic.starts_with("/scene_camera/image");
    let topic = streams.keys().find(is_image).unwrap();
    let images = stream(&streams, topic);
    assert!(images.len() > 10, "{} pictures", images.len());
    assert_in_order(topic, images);
}
