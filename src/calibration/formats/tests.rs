use super::*;
use glam::DVec2;
use proptest::prelude::*;

fn lens(model: LensModel, coefficients: &[f64]) -> NamedLens {
    let lens = Lens::ideal(
        model,
        (640, 480),
        DVec2::new(535.25, 536.5),
        DVec2::new(320.125, 1e-7),
    );
    NamedLens {
        name: "scene".to_owned(),
        lens: with_coefficients(lens, model, coefficients),
    }
}

#[test]
fn written_file_reads_back_unchanged() {
    let brown = lens(
        LensModel::Brown,
        &[-0.28, 0.1 + 0.2, 1e-17, -1.0 / 3.0, 0.05],
    );
    let plain = lens(LensModel::Brown, &[-0.28, 0.3, 1e-17, -1.0 / 3.0]);
    let rational = lens(
        LensModel::BrownRational,
        &[1.0, 2.0, 0.1, 0.2, 3.0, 4.0, 5.0, 6.0],
    );
    let fisheye = lens(LensModel::KannalaBrandt, &[0.003, -0.1, 1e-9, 2.0]);
    for (dialect, camera) in [
        (Dialect::Opencv, &brown),
        (Dialect::Opencv, &rational),
        (Dialect::Opencv, &fisheye),
        (Dialect::Ros, &brown),
        (Dialect::Ros, &rational),
        (Dialect::Ros, &fisheye),
        (Dialect::Kalibr, &plain),
        (Dialect::Kalibr, &fisheye),
    ] {
        let text = write(dialect, std::slice::from_ref(camera)).unwrap();
        let again = read(&text, None).unwrap();
        assert_eq!(again.len(), 1, "{text}");
        assert_eq!(again[0].lens, camera.lens, "{text}");
    }
    let both = write(Dialect::Kalibr, &[plain.clone(), fisheye.clone()]).unwrap();
    let again = read(&both, None).unwrap();
    assert_eq!(
        (&again[0].lens, &again[1].lens),
        (&plain.lens, &fisheye.lens)
    );
    for camera in [brown, rational] {
        let error = write(Dialect::Kalibr, &[camera]).unwrap_err();
        assert!(matches!(error, FormatError::Inexpressible { .. }));
    }
}

#[test]
fn reads_files_of_all_three_programs() {
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: narrow_stereo\n\
        camera_matrix:\n  rows: 3\n  cols: 3\n  data: [438.0, 0.000000, 305.5, 0, 437.3, 255.4, 0.0, 0, 1]\n\
        distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.361976, 0.110510, 0.001014, 0.000505, 0.0]\n";
    let camera = read(ros, None).unwrap().remove(0);
    assert_eq!(camera.name, "narrow_stereo");
    assert_eq!(camera.lens.focal, DVec2::new(438.0, 437.3));
    assert_eq!(camera.lens.coefficients[1], 0.110_510);
    let kalibr = "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: [0.0034823894022493434, 0.0007150348452162257,\n    -0.0020532361418706202, 0.00020293673591811182]\n  distortion_model: equidistant\n  intrinsics: [190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504]\n  resolution: [512, 512]\n  rostopic: /cam0/image_raw\ncam1:\n  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.1]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n  camera_model: pinhole\n  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]\n  distortion_model: radtan\n  intrinsics: [458.6, 457.3, 367.2, 248.4]\n  resolution: [752, 480]\n";
    let cameras = read(kalibr, None).unwrap();
    assert_eq!(cameras[0].lens.model, LensModel::KannalaBrandt);
    assert_eq!(
        cameras[0].lens.coefficients[3],
        0.000_202_936_735_918_111_82
    );
    assert_eq!(
        cameras[1].lens.coefficients[..4],
        [-0.28, 0.07, 0.0002, 1.8e-5]
    );
    assert_eq!(
        (cameras[1].lens.width, cameras[1].name.as_str()),
        (752, "cam1")
    );
}

#[test]
fn reads_files_written_by_opencv() {
    let Some(folder) = penumbra_test_data::shared("data/calibration") else {
        return;
    };
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let left = read(&text("opencv_stereo_chess/left_intrinsics.yml"), None).unwrap();
    assert_eq!(left[0].lens.focal.x, 535.915_733_961_632);
    assert_eq!((left[0].lens.width, left[0].lens.height), (640, 480));
    assert_eq!(left[0].lens.coefficients[4], 0.238_391_530_808_784_86);
    let stereo = text("opencv_stereo_chess/intrinsics.yml");
    let both = read(&stereo, Some((640, 480))).unwrap();
    assert_eq!(
        (both[0].name.as_str(), both[1].name.as_str()),
        ("left", "right")
    );
    assert_eq!(both[1].lens.centre.x, 334.557_445_279_120_15);
    assert_eq!(
        read(&stereo, None).unwrap_err().to_string(),
        "key `image_width` is missing; add it (an integer number of pixels, 1 to 65536)"
    );
    let aruco = read(&text("aruco_fdcl/calibration_params.yml"), None).unwrap();
    assert_eq!(aruco[0].lens.width, 1920);
}

#[test]
fn errors_name_line_and_key() {
    let good = write(Dialect::Opencv, &[lens(LensModel::Brown, &[0.1; 5])]).unwrap();
    for (from, to, message) in [
        (
            "image_width: 640",
            "image_width: many",
            "line 3: `image_width` must be an integer number",
        ),
        ("image_width: 640\n", "", "key `image_width` is missing"),
        ("535.25", "-535.25", "`camera_matrix` must be fx"),
        ("   cols: 3", "   cols: 4", "a list of rows × cols numbers"),
        ("   rows: 5", "   rows: 6", "a list of rows × cols numbers"),
        ("1.0 ]", "1.0", "unclosed bracket"),
        (
            "fisheye_model: 0",
            "fisheye_model: 1",
            "4, 5 or 8 coefficients",
        ),
        (
            "fisheye_model: 0",
            "fisheye_model 0",
            "line 5: expected `key: value`",
        ),
        (
            "fisheye_model: 0",
            "image_width: 3",
            "line 5: duplicate key",
        ),
        ("fisheye_model: 0", "fisheye_model: &a 0", "line 5: anchors"),
        ("camera_matrix", "matrix", "no camera found"),
    ] {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        let error = read(&text, None).unwrap_err().to_string();
        assert!(error.contains(message), "{from} → {to}: {error}");
    }
    for text in ["", "# nothing", "- 1\n- 2\n", "a: 1", "[1, 2"] {
        assert!(read(text, None).is_err(), "{text}");
    }
}

proptest! {
    #[test]
    fn parser_never_panics_on_random_text(text in "[ \\-\\[\\]{}:,#'\"!%a-c0-9.\n]{0,200}") {
        let _ = read(&text, Some((640, 480)));
    }

    #[test]
    fn parser_never_panics_on_damaged_file(at in 0_usize..600, byte in any::<u8>()) {
        let good = write(Dialect::Ros, &[lens(LensModel::Brown, &[0.1; 5])]).unwrap();
        let mut bytes = good.into_bytes();
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = read(&String::from_utf8_lossy(&bytes), None);
    }
}

const OPENCV_XML: &str = r#"<?xml version="1.0"?>
<!-- written by cv::FileStorage -->
<opencv_storage>
<calibration_time>"Tue 24 Nov 2026"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    5.3591573396163199e+02 0. 3.4228315473308373e+02 0.
    5.3591573396163199e+02 2.3557082909788173e+02 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    -2.66e-01 -3.85e-02 1.78e-03 -2.81e-04 2.38e-01</data></distortion_coefficients>
<avg_reprojection_error>3.9e-01</avg_reprojection_error>
</opencv_storage>
"#;

#[test]
fn reads_xml_of_opencv() {
    let lenses = read(OPENCV_XML, None).unwrap();
    let lens = &lenses[0].lens;
    assert_eq!((lenses.len(), lens.width, lens.height), (1, 640, 480));
    assert_eq!(lens.model, LensModel::Brown);
    assert!((lens.focal.x - 535.915_733_961_632).abs() < 1e-9);
    assert!((lens.centre.y - 235.570_829_097_881_73).abs() < 1e-9);
    assert_eq!(lens.coefficients[4], 0.238);
}

#[test]
fn damaged_xml_is_refused_with_its_line() {
    for (from, to, line) in [
        ("</camera_matrix>", "</camera>", 13),
        ("<rows>3</rows>", "<rows>&three;</rows>", 8),
        ("-->", "", 2),
        ("</opencv_storage>\n", "", 21),
    ] {
        let error = read(&OPENCV_XML.replacen(from, to, 1), None).unwrap_err();
        let expected = format!("line {line}: ");
        assert!(error.to_string().starts_with(&expected), "{to}: {error}");
    }
}

const KB4: &str = r#"{"camera_type": "kb4", "intrinsics": {"fx": 190.9, "fy": 190.8, "cx": 254.9,
    "cy": 256.8, "k1": 0.0034, "k2": 0.0007, "k3": -0.002, "k4": 0.0002}}"#;

#[test]
fn reads_json_of_basalt() {
    let file = |cameras: &str| {
        format!(
            "{{\"value0\": {{\"T_imu_cam\": [], \"intrinsics\": [{cameras}],
            \"resolution\": [[512, 512], [512, 512]]}}}}"
        )
    };
    let lenses = read(&file(KB4), None).unwrap();
    let lens = &lenses[0].lens;
    assert_eq!(lens.model, LensModel::KannalaBrandt);
    assert_eq!((lens.focal.x, lens.coefficients[2]), (190.9, -0.002));
    assert_eq!((lens.width, lenses[0].name.as_str()), (512, "cam0"));
    let missing = KB4.replace(r#""k2": 0.0007, "#, "");
    let double_sphere = format!("{KB4}, {}", KB4.replace("kb4", "ds"));
    for (cameras, expected) in [
        (missing, "value0.intrinsics[0].intrinsics.k2"),
        (double_sphere, "value0.intrinsics[1].camera_type"),
        ("{".to_owned(), "not a calibration of Basalt"),
    ] {
        let error = read(&file(&cameras), None).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
