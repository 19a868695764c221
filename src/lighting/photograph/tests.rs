//! Real photographs with published light directions, in `../shared`.

use super::*;
use crate::report::{dominant_direction, photograph_settings};
use crate::{Bracket, EnvironmentEstimator, EnvironmentInput, LightReport};
use glam::Vec3;
use penumbra_interface::MonotonicTime;
use penumbra_test_data::shared;

/// One view for many photographs.
struct Estimator(EnvironmentEstimator);

impl Estimator {
    fn new(picture: &Picture, calibration: &PhotographCalibration) -> Self {
        let view = view(calibration, picture);
        let settings = photograph_settings(calibration);
        Self(EnvironmentEstimator::new(&view, &calibration.response(), settings, None).unwrap())
    }

    fn dominant(&mut self, picture: &Picture) -> Vec3 {
        let brackets = [Bracket { picture, ev: 0.0 }];
        let input = EnvironmentInput::new(&brackets, MonotonicTime::default());
        let lighting = self.0.update(&input).unwrap();
        dominant_direction(&self.0, &lighting)
    }
}

fn view(calibration: &PhotographCalibration, picture: &Picture) -> EnvironmentView {
    let circle = calibration.circle(picture).unwrap();
    calibration.view(picture, &circle).unwrap()
}

fn numbers(path: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    text.split_whitespace()
        .map(|w| w.parse().unwrap())
        .collect()
}

fn median(values: Vec<f64>) -> f64 {
    penumbra_numerics::median(values).unwrap()
}

#[test]
fn chrome_ball_gives_published_light_directions() {
    let Some(folder) = shared("data/probes-fisheye/chrome_ball_lights") else {
        return;
    };
    let [x, y, radius] = numbers(&folder.join("circle_data.txt"))[..] else {
        panic!()
    };
    let published = numbers(&folder.join("light_directions.txt"));
    let first = read_picture(&folder.join("Image_01.JPG")).unwrap();
    let centre = DVec2::new(x - 1.0, f64::from(first.height) - y);
    let mut estimator = Estimator::new(
        &first,
        &PhotographCalibration {
            kind: Some(PhotographKind::Sphere),
            centre: Some(centre.to_array()),
            radius: Some(radius),
            ..Default::default()
        },
    );
    let (mut angles, mut outlines) = (Vec::new(), Vec::new());
    for k in 0..12 {
        // The data set's axes: x right, y up, z towards the camera; ours: the camera looks along
        // +Y.
        let [a, b, c] = [published[k], published[12 + k], published[24 + k]];
        let published_direction = Vec3::new(a as f32, -c as f32, b as f32);
        let picture = read_picture(&folder.join(format!("Image_{:02}.JPG", k + 1))).unwrap();
        angles.push(f64::from(
            estimator
                .dominant(&picture)
                .angle_between(published_direction)
                .to_degrees(),
        ));
        let found = sphere_outline(&picture).map_or(f64::INFINITY, |c| {
            (c.centre.distance(centre) + (c.radius - radius).abs()) / radius
        });
        outlines.push(found);
    }
    println!("chrome ball, degrees from the published lights: {angles:.2?}");
    println!("chrome ball, error of the outline found, radii: {outlines:.3?}");
    assert!(median(angles) < 4.0);
    assert!(median(outlines) < 0.02);
}

#[test]
fn finds_outlines_of_mirror_balls() {
    let Some(folder) = shared("data/probes-fisheye/mirrorball") else {
        return;
    };
    let params: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("params.json")).unwrap())
            .unwrap();
    for name in ["room", "roof", "lamp", "house"] {
        let p = &params["images"][name];
        let crop = |side: &str| p["crop_px"][side].as_f64().unwrap();
        let (w, h) = (p["width"].as_f64().unwrap(), p["height"].as_f64().unwrap());
        let (left, right) = (crop("left"), w - crop("right"));
        let (top, bottom) = (crop("top"), h - crop("bot"));
        let picture = read_picture(&folder.join(format!("{name}.jpg"))).unwrap();
        let found = sphere_outline(&picture).unwrap();
        let radius = (right - left + bottom - top) / 4.0;
        let centre = DVec2::new((left + right) / 2.0, (top + bottom) / 2.0);
        println!("{name}: found {found:?}, set by hand {centre} {radius}");
        assert!((found.radius / radius - 1.0).abs() < 0.06, "{name}");
        assert!(found.centre.distance(centre) < 0.06 * radius, "{name}");
    }
}

#[test]
fn circles_are_taken_only_where_there_is_a_mirror_or_a_fisheye() {
    let Some(data) = shared("data") else {
        return;
    };
    let judge = |name: &str| {
        let picture = read_picture(&data.join(name)).unwrap();
        PhotographCalibration::default().circle(&picture)
    };
    let mirrors = ["room", "roof", "lamp", "house"].map(|n| format!("mirrorball/{n}.jpg"));
    let lit = ["01", "04", "08"].map(|n| format!("chrome_ball_lights/Image_{n}.JPG"));
    let fisheyes = ["ocam_fisheye1/Fisheye1_4.jpg", "ocam_lobby/img0.jpg"];
    let spheres = mirrors.iter().chain(&lit);
    let spheres = spheres.map(|name| (name.clone(), PhotographKind::Sphere));
    let fisheyes = fisheyes.map(|name| (format!("fisheye/{name}"), PhotographKind::Fisheye));
    for (name, kind) in spheres.chain(fisheyes) {
        let found = judge(&format!("probes-fisheye/{name}")).unwrap();
        println!("{name}: {found:?}");
        assert_eq!(found.kind, kind, "{name}");
    }
    for name in [
        "colorchecker/arcu/color_checker_05.jpg",
        "colorchecker/macduff/below_fishbox.jpg",
        "models/torii/textures/Torii_base_baseColor.jpeg",
        "calibration/opencv_stereo_chess/right07.jpg",
        "calibration/apriltag_imgs/tag36_11_00001.png",
        "calibration/aruco_photos/singlemarkersoriginal.jpg",
    ] {
        let refused = judge(name).unwrap_err().to_string();
        println!("{name}: {refused}");
        assert!(refused.contains("--calibration FILE"), "{name}: {refused}");
    }
}

#[test]
fn matt_ball_is_no_mirror() {
    let (centre, radius) = (DVec2::new(160.0, 120.0), 90.0);
    let rgba = (0..320u32 * 240).flat_map(|i| {
        let at = (DVec2::new(f64::from(i % 320), f64::from(i / 320)) - centre) / radius;
        let z = 1.0 - at.length_squared();
        let code = match z > 0.0 {
            true => 40.0 + 90.0 * (z.sqrt() - 0.5 * at.x).max(0.0),
            false => 230.0,
        };
        [code as u8, (0.4 * code) as u8, 30, 255]
    });
    let picture = Picture {
        width: 320,
        height: 240,
        rgba: rgba.collect(),
    };
    let refused = PhotographCalibration::default().circle(&picture);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("like something matt"), "{refused}");
    let stated = PhotographCalibration {
        centre: Some(centre.into()),
        radius: Some(radius),
        ..Default::default()
    };
    assert!(stated.circle(&picture).is_ok());
}

/// The sun over Fehmarn, 54.4947° N 11.2408° E (Astronomical Almanac's low-precision
/// formula, 0.01°), as a vector east, north, up.
fn sun(day_of_september: f64, utc_hours: f64) -> Vec3 {
    let (latitude, longitude) = (54.4947f64.to_radians(), 11.240_817);
    // Days from 2000-01-01 12:00 to 2016-09-01 00:00.
    let n = 6087.5 + day_of_september - 1.0 + utc_hours / 24.0;
    let g = (357.528 + 0.985_600_3 * n).to_radians();
    let l = (280.460 + 0.985_647_4 * n + 1.915 * g.sin() + 0.020 * (2.0 * g).sin()).to_radians();
    let tilt = (23.439 - 0.000_000_4 * n).to_radians();
    let right_ascension = (tilt.cos() * l.sin()).atan2(l.cos());
    let declination = (tilt.sin() * l.sin()).asin();
    let sidereal = (18.697_374_558 + 24.065_709_824_419_08 * n) * 15.0 + longitude;
    let hour = sidereal.to_radians() - right_ascension;
    let (sd, cd) = declination.sin_cos();
    let (sl, cl) = latitude.sin_cos();
    let east = -cd * hour.sin();
    let north = cl * sd - sl * cd * hour.cos();
    let up = sl * sd + cl * cd * hour.cos();
    Vec3::new(east as f32, north as f32, up as f32)
}

/// The lens and pose of the all-sky camera, fitted (least squares, soft-L1) to the 462 positions of
/// the sun in `sun_track.csv`, whose rows are counted from the bottom.
fn all_sky_camera() -> PhotographCalibration {
    PhotographCalibration {
        kind: Some(PhotographKind::Fisheye),
        centre: Some([961.37, 953.60]),
        radius: Some(950.0),
        focal: Some(671.24),
        field_of_view_degrees: Some(160.0),
        distortion: [-0.005_787, -0.010_042, 0.0, 0.0],
        world_from_camera: Some([
            [-0.801_525, -0.597_625, 0.020_042],
            [0.597_288, -0.801_763, -0.020_546],
            [0.028_348, -0.004_497, 0.999_588],
        ]),
        ground: true,
        ..Default::default()
    }
}

#[test]
fn lens_matches_observed_track_of_sun() {
    let Some(folder) = shared("data/probes-fisheye/fisheye/allsky_FE3") else {
        return;
    };
    let black = Picture {
        width: 1920,
        height: 1920,
        rgba: vec![0; 4 * 1920 * 1920],
    };
    let EnvironmentView::Fisheye {
        lens,
        world_from_camera,
    } = view(&all_sky_camera(), &black)
    else {
        panic!()
    };
    let text = std::fs::read_to_string(folder.join("sun_track.csv")).unwrap();
    let mut errors = Vec::new();
    for line in text.lines().skip(2) {
        let row: Vec<f64> = line
            .split(',')
            .map(|v| v.parse().unwrap_or(f64::NAN))
            .collect();
        let [x, y, zenith, azimuth] = row[..] else {
            continue;
        };
        if x.is_nan() {
            continue;
        }
        let (z, a) = (zenith.to_radians(), azimuth.to_radians());
        let published_direction = DVec3::new(z.sin() * a.sin(), z.sin() * a.cos(), z.cos());
        let seen = world_from_camera.rotation * lens.unproject(DVec2::new(x, 1919.0 - y)).unwrap();
        errors.push(seen.angle_between(published_direction).to_degrees());
    }
    assert!(errors.len() > 400);
    let median = median(errors);
    println!("all-sky track, degrees from the sun: median {median:.3}");
    assert!(median < 0.1);
}

#[test]
fn finds_sun_in_all_sky_photographs() {
    let Some(folder) = shared("data/probes-fisheye/fisheye/allsky_FE3") else {
        return;
    };
    let photographs = [
        ("20160829_134000", -2.0, 12.0 + 40.0 / 60.0),
        ("20160901_100000", 1.0, 9.0),
        ("20160901_102000", 1.0, 9.0 + 20.0 / 60.0),
        ("20160901_104000", 1.0, 9.0 + 40.0 / 60.0),
        ("20160901_110000", 1.0, 10.0),
    ];
    let read = |name| read_picture(&folder.join(format!("FE3_Image_{name}_UTCp1.jpg"))).unwrap();
    let mut estimator = Estimator::new(&read(photographs[0].0), &all_sky_camera());
    let mut errors = Vec::new();
    for (name, day, hours) in photographs {
        let angle = estimator
            .dominant(&read(name))
            .angle_between(sun(day, hours))
            .to_degrees();
        errors.push(f64::from(angle));
    }
    println!("all-sky photographs, degrees from the sun: {errors:.2?}");
    // Thin cloud glows over several degrees in these, and saturates.
    assert!(median(errors) < 2.0);
}

#[test]
fn rejects_calibration_with_unknown_key_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.toml");
    std::fs::write(&path, "kind = \"sphere\"\nradios = 4\n").unwrap();
    let message = PhotographCalibration::read(&path).unwrap_err().to_string();
    assert!(
        message.contains("radios") && message.contains("ball.toml"),
        "{message}"
    );
    std::fs::write(
        &path,
        "kind = \"sphere\"\ncentre = [31.5, 31.5]\nradius = 30\nfield_of_view_degrees = 5\n",
    )
    .unwrap();
    let grey = Picture {
        width: 64,
        height: 64,
        rgba: vec![99; 4 * 64 * 64],
    };
    let calibration = PhotographCalibration::read(&path).unwrap();
    let circle = calibration.circle(&grey).unwrap();
    let wrong = calibration.view(&grey, &circle).unwrap_err().to_string();
    assert!(wrong.contains("field_of_view_degrees"), "{wrong}");
}

#[test]
fn grey_sphere_gives_grey_environment() {
    let folder = tempfile::tempdir().unwrap();
    let grey = Picture {
        width: 64,
        height: 64,
        rgba: vec![188; 4 * 64 * 64],
    };
    let calibration = PhotographCalibration {
        kind: Some(PhotographKind::Sphere),
        centre: Some([31.5, 31.5]),
        radius: Some(30.0),
        ..Default::default()
    };
    let report = LightReport::from_picture(&grey, &calibration, |_| ()).unwrap();
    report.write(folder.path()).unwrap();
    let text = std::fs::read_to_string(folder.path().join("light.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let up = json["irradiance"]["plus_z"][0].as_f64().unwrap();
    assert!((up / (PI * 0.502_886) - 1.0).abs() < 1e-3, "{up}");
    assert_eq!(json["photograph"]["radius"], 30.0);
    for file in [
        "environment.exr",
        "environment.png",
        "lights.png",
        "found.png",
    ] {
        assert!(folder.path().join(file).metadata().unwrap().len() > 100);
    }
}

#[test]
fn photograph_that_was_cut_off_is_refused() {
    let Some(folder) = shared("data/probes-fisheye/chrome_ball_lights") else {
        return;
    };
    let bytes = std::fs::read(folder.join("Image_01.JPG")).unwrap();
    let cut = std::env::temp_dir().join(format!("penumbra-cut-off-{}.jpg", std::process::id()));
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let text = read_picture(&cut).unwrap_err().to_string();
    std::fs::remove_file(&cut).unwrap();
    assert!(text.contains("damaged"), "{text}");
}
