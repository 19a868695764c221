//! `penumbra photo`, on path-traced photographs whose truth is known.

use crate::program::Desk;
use penumbra_picture::Picture;
use std::path::{Path, PathBuf};

fn photograph(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/photo");
    folder.join(name).display().to_string()
}

/// The arguments of the photographs with the ball, in `exposures` exposures.
pub fn pictures(exposures: usize) -> String {
    let names = (1..=exposures).map(|k| photograph(&format!("ball{k}.jpg")));
    let names: Vec<String> = std::iter::once(photograph("empty.jpg"))
        .chain(names)
        .collect();
    names.join(" ")
}

/// Returns the numbers in a line of output.
fn numbers(printed: &str, line: &str) -> Vec<f64> {
    let found = printed.lines().find(|l| l.starts_with(line));
    let found = found.unwrap_or_else(|| panic!("no line {line}: {printed}"));
    found
        .split(|c: char| !(c.is_ascii_digit() || c == '.'))
        .filter_map(|word| word.trim_end_matches('.').parse().ok())
        .collect()
}

/// The objects that the truth shows.
const TRUTH: &str = r#"
[[object]]
name = "cube"
shape = "box"
size_m = [0.06, 0.06, 0.06]
rotation_deg = [35.0, 0.0, 0.0]
material = { base_colour = [0.5, 0.5, 0.5], metallic = 0.0, roughness = 1.0, specular = 0.0 }

[[object]]
name = "gold"
shape = "sphere"
radius_m = 0.025
position_m = [0.09, -0.02, 0.025]
material = { base_colour = [0.95, 0.78, 0.48], metallic = 1.0, roughness = 0.2 }
"#;

/// Mean difference of two pictures where `empty` and `truth` differ, codes, and the number of pixels.
fn difference(composite: &Picture, truth: &Picture, empty: &Picture) -> (f64, usize) {
    let pixels = |p: &Picture| -> Vec<[i32; 3]> {
        let rgb = p.rgba.chunks_exact(4);
        rgb.map(|p| [0, 1, 2].map(|c| i32::from(p[c]))).collect()
    };
    let apart = |a: &[i32; 3], b: &[i32; 3]| -> i32 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).max().unwrap()
    };
    let (composite, truth, empty) = (pixels(composite), pixels(truth), pixels(empty));
    let changed = (0..truth.len()).filter(|&i| apart(&truth[i], &empty[i]) > 24);
    let differences: Vec<i32> = changed.map(|i| apart(&truth[i], &composite[i])).collect();
    let sum: i32 = differences.iter().sum();
    (f64::from(sum) / differences.len() as f64, differences.len())
}

#[test]
fn composite_of_photographs_is_the_photograph_of_the_real_things() {
    let desk = Desk::new();
    desk.put("truth.toml", TRUTH);
    let printed = desk.works(&format!(
        "photo {} --ball-diameter 80mm --tilt 28 --scene truth.toml --found found.png -o out.png",
        pictures(4)
    ));
    // The ball's image by the renderer's own geometry.
    let ball = numbers(&printed, "ball:");
    assert!(
        (ball[0] - 220.0).abs() < 1.5 && (ball[1] - 179.0).abs() < 1.5,
        "{printed}"
    );
    assert!((ball[2] - 25.8).abs() < 1.5, "{printed}");
    assert!(printed.contains("measured from 4 exposures"), "{printed}");
    let shadow = numbers(&printed, "check:");
    assert!((shadow[0] - shadow[1]).abs() < 3.0, "{printed}");
    let read = |path: PathBuf| Picture::from_file_bytes(&std::fs::read(path).unwrap()).unwrap();
    let composite = read(desk.path("out.png"));
    let truth = read(photograph("truth.jpg").into());
    let empty = read(photograph("empty.jpg").into());
    let (without, pixels) = difference(&empty, &truth, &empty);
    let (mean, _) = difference(&composite, &truth, &empty);
    assert!(pixels > 3000, "{pixels}");
    assert!(
        mean < 0.3 * without,
        "{mean} codes, {without} without objects"
    );
    let found = read(desk.path("found.png"));
    assert_eq!((found.width, found.height), (480, 360));
    // With one exposure the shadow tells how bright the lamps are, and how the ground lies.
    let printed = desk.works(&format!(
        "photo {} --ball-diameter 80mm --scene truth.toml -o one.png",
        pictures(1)
    ));
    let ground = numbers(&printed, "ground: from where the ball's shadow falls");
    assert!((ground[0] - 28.0).abs() < 3.0, "{printed}");
    let (mean, _) = difference(&read(desk.path("one.png")), &truth, &empty);
    assert!(
        mean < 0.4 * without,
        "{mean} codes, {without} without objects"
    );
}

/// Where the renderer's camera sees a point on the table, pixels; metres from the ball's foot.
fn on_the_table(x: f64, y: f64) -> [f64; 2] {
    let (sin, cos) = 28f64.to_radians().sin_cos();
    let focal = 240.0 / 31f64.to_radians().tan();
    let to = [x - 0.03, y + 0.62 * cos, -(0.62 * sin + 0.04)];
    let depth = to[1] * cos - to[2] * sin;
    let down = -(to[1] * sin + to[2] * cos);
    [239.5 + focal * to[0] / depth, 179.5 + focal * down / depth]
}

/// `--ground` of a sheet of 30 × 21 cm that lies aslant on the table.
pub fn sheet() -> String {
    let (sin, cos) = 0.44f64.sin_cos();
    let corners = [(-0.15, -0.1), (0.15, -0.1), (0.15, 0.11), (-0.15, 0.11)]
        .map(|(u, v)| on_the_table(u * cos - v * sin, u * sin + v * cos));
    let numbers: Vec<String> = corners
        .iter()
        .flatten()
        .map(|n| format!("{n:.1}"))
        .collect();
    numbers.join(",")
}

#[test]
fn ground_is_that_of_a_rectangle_on_it() {
    let desk = Desk::new();
    let printed = desk.works(&format!(
        "photo {} --ball-diameter 80mm --ground {} -o out.png",
        pictures(2),
        sheet()
    ));
    assert!(printed.contains("ground: from the rectangle"), "{printed}");
    let [tilt, roll, error] = numbers(&printed, "ground:")[..3] else {
        panic!("{printed}");
    };
    assert!((tilt - 28.0).abs() < 1.0, "{printed}");
    assert!(roll < 0.7 && error < 1.0, "{printed}");
}

#[test]
fn camera_that_was_turned_between_two_photographs_is_told() {
    let desk = Desk::new();
    let upright = image::open(photograph("ball1.jpg")).unwrap().to_rgb8();
    let (sin, cos) = 1.5_f32.to_radians().sin_cos();
    let middle = [upright.width() / 2, upright.height() / 2].map(|m| m as f32);
    let turned = image::RgbImage::from_fn(upright.width(), upright.height(), |x, y| {
        let (x, y) = (x as f32 - middle[0], y as f32 - middle[1]);
        let from = [middle[0] + cos * x + sin * y, middle[1] - sin * x + cos * y];
        let end = [upright.width() - 1, upright.height() - 1];
        let [u, v] = [0, 1].map(|k| (from[k].round() as u32).min(end[k]));
        *upright.get_pixel(u, v)
    });
    turned.save(desk.path("turned.png")).unwrap();
    let work = |ball: &str| {
        let empty = photograph("empty.jpg");
        let options = "--ball-diameter 80mm --exposures 0,0 -o out.png --force";
        desk.works(&format!("photo {empty} {ball} {options}"))
    };
    assert!(work("turned.png").contains("turned by 1."));
    assert!(!work(&photograph("ball1.jpg")).contains("turned"));
}

#[test]
fn photographs_that_cannot_be_used_are_refused_in_one_line() {
    let desk = Desk::new();
    let empty = photograph("empty.jpg");
    let ball = photograph("ball1.jpg");
    let refused = |line: &str| desk.refuses(&format!("photo {line} -o out.png"));
    let none = refused(&format!("{empty} {empty} --ball-diameter 80mm"));
    assert!(none.contains("no ball found"), "{none}");
    let tag = refused(&format!(
        "{empty} {ball} --ball-diameter 80mm --tag tag36h11:60mm"
    ));
    assert!(tag.contains("no tag of the family tag36h11"), "{tag}");
    let outside = refused(&format!(
        "{empty} {ball} --ball-diameter 80mm --ball 9000,10,5"
    ));
    assert!(outside.contains("is not inside"), "{outside}");
    let count = refused(&format!(
        "{empty} {ball} --ball-diameter 80mm --exposures 0"
    ));
    assert!(count.contains("1 values for 2 pictures"), "{count}");
    let stops = refused(&format!(
        "{empty} {ball} --ball-diameter 80mm --exposures 0,99"
    ));
    assert!(stops.contains("99 is no exposure"), "{stops}");
    let ground = |corners: &str| {
        refused(&format!(
            "{empty} {ball} --ball-diameter 80mm --ground {corners}"
        ))
    };
    let line = ground("10,10,20,20,30,30,10,40");
    assert!(line.contains("lies on a line"), "{line}");
    let crossed = ground("100,100,200,100,120,110,100,200");
    assert!(crossed.contains("not in order round"), "{crossed}");
    let skewed = ground("250,150,350,200,230,250,100,180");
    assert!(skewed.contains("away from a right angle"), "{skewed}");
    desk.put("note.jpg", "no picture");
    let damaged = refused(&format!("{empty} note.jpg --ball-diameter 80mm"));
    assert!(
        damaged.contains("note.jpg is not a JPEG or PNG"),
        "{damaged}"
    );
    assert!(!desk.path("out.png").exists());
}
