//! The example `detect` works.

#![expect(clippy::unwrap_used)]

#[path = "../examples/detect.rs"]
#[expect(dead_code, reason = "its `main` parses the command line")]
mod detect;

use penumbra_fiducials::Tag;

/// Checks numbers, corners (to 0.15 pixels), positions (to 2 mm) and orientations (to 2°).
fn assert_finds(tags: &[Tag], input: &detect::Input) {
    let found = detect::detect(input);
    assert_eq!(found.len(), tags.len());
    for (tag, found) in tags.iter().zip(found) {
        assert_eq!(found.tag.id, tag.id);
        for (point, pixel) in tag.corners().into_iter().zip(found.tag.corners) {
            let error = input.camera.project(point).unwrap().distance(pixel);
            assert!(error < 0.15, "{error} px");
        }
        let (pose, truth) = (found.camera_from_tag.unwrap(), tag.map_from_tag);
        let error = pose.translation.distance(truth.translation);
        assert!(error < 2e-3, "{error} m");
        let error = pose.rotation.angle_between(truth.rotation);
        assert!(error < 2_f64.to_radians(), "{error} rad");
    }
}

#[test]
fn example_finds_rendered_tags() {
    let (input, tags) = detect::rendered();
    assert_finds(&tags, &input);
    let line = detect::detect(&input)[0].to_string();
    assert!(line.starts_with("tag36h11 7: corners ("), "{line}");
    assert!(line.contains("; position ["), "{line}");
}

#[test]
fn example_reads_picture_from_file() {
    let (rendered, tags) = detect::rendered();
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("fiducials-example.png");
    let mut png = png::Encoder::new(
        std::fs::File::create(&path).unwrap(),
        rendered.picture.width,
        rendered.picture.height,
    );
    png.set_color(png::ColorType::Rgba);
    let mut writer = png.write_header().unwrap();
    writer.write_image_data(&rendered.picture.rgba).unwrap();
    writer.finish().unwrap();
    let mut input = detect::read(path.to_str().unwrap(), 600.0, rendered.tag_size).unwrap();
    assert_eq!(input.picture, rendered.picture);
    input.camera = rendered.camera;
    assert_finds(&tags, &input);
    let error = detect::read("no-such-file.png", 600.0, 0.06).err().unwrap();
    assert!(
        error.to_string().starts_with("no-such-file.png: "),
        "{error}"
    );
}
