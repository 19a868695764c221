//! `penumbra calibrate`.

use crate::program::{Desk, text};
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_interface::RigidTransform;

/// The lens of a webcam with 320×240 pixels.
fn lens() -> Lens {
    let size = (320, 240);
    let (focal, centre) = (DVec2::splat(270.0), DVec2::new(163.0, 118.0));
    let mut lens = Lens::ideal(LensModel::Brown, size, focal, centre);
    lens.coefficients[0] = -0.15;
    lens
}

/// Returns the brightness of a board of 8×6 squares of 30 mm, i.e. 7×5 inner corners.
fn brightness(p: DVec2) -> f64 {
    let (x, y) = (p.x / 0.03, p.y / 0.03);
    let inside = |v: f64, max: f64| (0.0..max).contains(&v);
    if !inside(x, 8.0) || !inside(y, 6.0) {
        return if inside(x + 1.0, 10.0) && inside(y + 1.0, 8.0) {
            220.0
        } else {
            110.0
        };
    }
    if (x.floor() + y.floor()) % 2.0 == 0.0 {
        25.0
    } else {
        220.0
    }
}

/// Renders the board through the lens, as a PNG file. `pose` is camera from board.
fn picture(lens: &Lens, pose: RigidTransform) -> Vec<u8> {
    let board_from_camera = pose.inverse();
    let camera = board_from_camera.translation;
    let mut pixels = Vec::new();
    for i in 0..lens.width * lens.height {
        let mut sum = 0.0;
        for k in 0..9 {
            let within = DVec2::new(f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0) / 3.0;
            let pixel = DVec2::new(f64::from(i % lens.width), f64::from(i / lens.width)) + within;
            let ray = board_from_camera.rotation * lens.unproject(pixel).unwrap();
            let t = -camera.z / ray.z;
            sum += if t > 0.0 {
                brightness((camera + ray * t).truncate())
            } else {
                110.0
            };
        }
        pixels.push((sum / 9.0) as u8);
    }
    let grey = image::GrayImage::from_raw(lens.width, lens.height, pixels).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    grey.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Writes sixteen pictures of the board from all sides.
fn desk_with_pictures() -> Desk {
    let desk = Desk::new();
    for i in 0..16 {
        let (a, b) = (f64::from(i % 4) / 1.5 - 1.0, f64::from(i / 4) / 1.5 - 1.0);
        let tilt = DQuat::from_rotation_x(0.55 * b) * DQuat::from_rotation_y(-0.55 * a);
        let rotation = tilt * DQuat::from_rotation_z(0.2 * a * b + 0.1);
        let middle = DVec3::new(0.12, 0.09, 0.0);
        let at = DVec3::new(0.085 * a, 0.065 * b, 0.42 + 0.04 * a);
        let pose = RigidTransform::new(rotation, at - rotation * middle);
        desk.put(&format!("pictures/{i:02}.png"), picture(&lens(), pose));
    }
    desk
}

#[test]
fn intrinsics_from_pictures_writes_a_calibration_and_a_report() {
    let desk = desk_with_pictures();
    let arguments = "calibrate intrinsics --pictures pictures --board chess:7x5:0.03 \
                     --device webcam --serial A1 --out scene_camera.json";
    let printed = desk.works(arguments);
    assert!(
        printed.contains("px RMS") && printed.contains("16 pictures"),
        "{printed}"
    );
    let found = desk.json("scene_camera.json");
    let focal = found["focal"][0].as_f64().unwrap();
    assert!((focal / 270.0 - 1.0).abs() < 0.005, "{focal}");
    let sigma = found["sigma"]["fx"].as_f64().unwrap();
    assert!(
        sigma > 0.0 && (focal - 270.0).abs() < 5.0 * sigma,
        "{focal} ± {sigma}"
    );
    assert_eq!(found["device"]["serial"], "A1");
    assert!(found["date"].as_str().unwrap().ends_with('Z'));
    assert_ne!(found["quality"]["grade"], "refused");
    let report = text(&desk.read("scene_camera.html"));
    assert!(report.contains("<svg") && report.contains("Before and after"));
    let again = desk.run(arguments);
    assert!(text(&again.stderr).contains("exists already"));

    // Converts to each other format and back.
    desk.works("calibrate convert scene_camera.json --to opencv --out a.yml");
    desk.works("calibrate convert a.yml --to ros --out b.yaml");
    desk.works("calibrate convert b.yaml --to penumbra --out c.json");
    for key in ["focal", "centre", "distortion", "image_size"] {
        assert_eq!(desk.json("c.json")[key], found[key], "{key}");
    }
}

#[test]
fn wrong_board_writes_no_calibration() {
    let desk = desk_with_pictures();
    for (board, expected) in [
        ("chess:8x5:0.03", "has 7×5 inner corners"),
        ("chess:6x4:0.03", "has 7×5 inner corners"),
        ("charuco:8x6:0.03:0.02", "shows the board"),
    ] {
        let output = desk.run(&format!(
            "calibrate intrinsics --pictures pictures --board {board} --out a.json --force"
        ));
        let printed = text(&output.stderr);
        assert!(
            !output.status.success() && printed.contains(expected),
            "{printed}"
        );
        assert_eq!(printed.lines().count(), 1, "{printed}");
        assert!(!desk.path("a.json").exists());
    }
}

#[test]
fn board_is_written_at_true_scale() {
    let desk = Desk::new();
    let printed = desk.works("calibrate board --board chess:9x6:0.025 --out board.pdf");
    assert!(printed.contains("275 x 204 mm"), "{printed}");
    assert!(desk.read("board.pdf").starts_with(b"%PDF-1.4"));
    desk.works("calibrate board --out board.svg");
    desk.works("calibrate board --board aprilgrid:6x6:0.03:0.3 --out tags.pdf");
    desk.works("calibrate board --board charuco:8x5:0.03:0.022:6x6_250 --out markers.svg");
    desk.works("calibrate board --out board.png --dpi 100");
    assert!(desk.read("board.png").starts_with(b"\x89PNG"));
    for (arguments, expected) in [
        ("--out board.gif", "name a .pdf, .svg or .png"),
        ("--out board.pdf", "exists already"),
        (
            "--board charuco:8x5:0.03:0.02:9x9_50 --out a.pdf",
            "unknown family of tags",
        ),
        ("--board chess:9x6:25 --out a.pdf", "25 mm is 0.025"),
    ] {
        let output = desk.run(&format!("calibrate board {arguments}"));
        let printed = text(&output.stderr);
        assert!(
            !output.status.success() && printed.contains(expected),
            "{printed}"
        );
    }
}

#[test]
fn rejects_session_without_a_board() {
    let desk = Desk::new();
    // The report of the first refusal does not make the second try ask for --force.
    for _ in 0..2 {
        let output =
            desk.run("calibrate intrinsics --session DESK --board chess:9x6:0.025 --out a.json");
        let printed = text(&output.stderr);
        assert!(
            !output.status.success() && printed.contains("shows the board"),
            "{printed}"
        );
        assert_eq!(desk.names("."), ["a.refused.html"]);
    }
}

#[test]
fn lists_tags_of_a_printed_board_with_their_corners() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("sheets")).unwrap();
    desk.works("calibrate board --board aprilgrid:3x2:0.03:0.3 --out sheets/tags.png --dpi 100");
    let printed =
        desk.works("calibrate tags --pictures sheets --family kalibr36h11 --out tags.csv");
    assert!(printed.contains("tags.png: 6 tags"), "{printed}");
    let table = text(&desk.read("tags.csv"));
    assert_eq!(table.lines().count(), 7, "{table}");
    // The lower left tag has number 0; the sheet's margin is 4.5 mm, the squares' edge 9 mm.
    let first = table.lines().nth(1).unwrap();
    let fields: Vec<&str> = first.split(',').collect();
    assert_eq!((fields[1], fields[2]), ("kalibr36h11", "0"));
    let x: f64 = fields[3].parse().unwrap();
    assert!((x - (0.0135 / 0.0254 * 100.0 - 0.5)).abs() < 1.0, "{first}");
    let output = desk.run("calibrate tags --pictures sheets --family 9x9_50 --out b.csv");
    assert!(text(&output.stderr).contains("unknown family of tags"));
}

/// Markers of 5×5 bits that are in no built-in dictionary.
const MARKERS: [&str; 8] = [
    "1010111000101101001001110",
    "0111001011100010110101001",
    "1100010110011101010001011",
    "0001101110110001011010010",
    "1111000001010111000110100",
    "1001011001101010111100001",
    "0110100111000111100101100",
    "1101110010001001101011011",
];

#[test]
fn a_board_of_an_own_dictionary_is_printed_and_detected() {
    let desk = Desk::new();
    let numbered = MARKERS.iter().enumerate();
    let markers: Vec<_> = numbered
        .map(|(i, bits)| format!("marker_{i}: \"{bits}\""))
        .collect();
    let yaml = format!(
        "%YAML:1.0\n---\nnmarkers: 8\nmarkersize: 5\n{}\n",
        markers.join("\n")
    );
    desk.put("mine.yml", &yaml);
    std::fs::create_dir(desk.path("sheets")).unwrap();
    let board = "charuco:5x3:0.03:0.022:mine.yml";
    desk.works(&format!(
        "calibrate board --board {board} --out sheets/board.png --dpi 100"
    ));
    desk.works("calibrate tags --pictures sheets --family mine.yml --out tags.csv");
    let table = text(&desk.read("tags.csv"));
    let found: Vec<_> = table
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(2).unwrap())
        .collect();
    assert_eq!(found, ["0", "1", "2", "3", "4", "5", "6"], "{table}");
    assert!(table.contains(",mine,"), "{table}");
    // By the configuration, which gives the name.
    desk.put(
        "rig.toml",
        "[registration]\ndictionaries = [\"mine.yml\"]\n",
    );
    desk.works("check-config rig.toml");
    desk.put("broken.yml", yaml.replace("marker_3", "marker_9"));
    desk.put(
        "rig.toml",
        "[registration]\ndictionaries = [\"mine.yml\", \"broken.yml\"]\n",
    );
    let refused = desk.refuses("check-config rig.toml");
    assert!(
        refused.contains("registration.dictionaries[1]"),
        "{refused}"
    );
    assert!(
        refused.contains("broken.yml: marker_3: is missing"),
        "{refused}"
    );
}
