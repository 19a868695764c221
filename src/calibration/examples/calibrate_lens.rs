//! Calibrates a lens from the corners of a chessboard seen in twelve poses, and prints every
//! parameter with its standard deviation.
//!
//! ```text
//! cargo run -p penumbra-calibration --example calibrate_lens
//! ```
//! The corners are simulated: a known lens projects them, and noise is added to the pixels. In a
//! real picture, `penumbra_calibration::intrinsics::detect::find_chessboard` finds them.

use glam::{DQuat, DVec2, DVec3};
use penumbra_calibration::intrinsics::{
    Correspondence, Estimate, Lens, LensModel, NoEstimate, Options, View, estimate,
};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;
use std::f64::consts::TAU;

/// Width and height of the pictures, pixels.
const SIZE: (u32, u32) = (1280, 720);
/// Inner corners in a row and in a column of the board.
const CORNERS: (u32, u32) = (9, 6);
/// Edge of a square, metres.
const SQUARE: f64 = 0.025;
/// Number of pictures.
const VIEWS: u32 = 12;
/// Standard deviation of a corner along each axis, pixels.
const NOISE: f64 = 0.1;
/// Angle between the board's normal and the optical axis, radians.
const TILT: f64 = 0.6;

fn main() -> Result<(), NoEstimate> {
    let known = known_lens();
    let found = calibrate(&known, 1)?;
    println!("parameter      found  standard deviation      known");
    for (name, (value, sigma, known)) in parameter_names(&known).zip(parameters(&found, &known)) {
        println!("{name:<9} {value:>10.4}  {sigma:>18.4} {known:>10.4}");
    }
    println!("reprojection error (RMS): {:.3} px", found.rms);
    Ok(())
}

/// Returns a lens with barrel distortion, 65° wide.
pub fn known_lens() -> Lens {
    let centre = DVec2::new(644.0, 357.0);
    let mut lens = Lens::ideal(LensModel::Brown, SIZE, DVec2::splat(1000.0), centre);
    lens.coefficients[..5].copy_from_slice(&[-0.12, 0.04, 0.001, -0.0005, 0.0]);
    lens
}

/// Calibrates from simulated views through `lens`; `seed` selects the noise.
pub fn calibrate(lens: &Lens, seed: u64) -> Result<Estimate, NoEstimate> {
    let mut random = Random::new(seed);
    let views: Vec<View> = (0..VIEWS).map(|n| view(lens, n, &mut random)).collect();
    let options = Options {
        model: lens.model,
        square_pixels: false,
    };
    estimate(SIZE, &views, &options)
}

/// Returns the names of a lens's parameters in the order of [`parameters`].
pub fn parameter_names(lens: &Lens) -> impl Iterator<Item = &'static str> {
    let coefficients = lens.model.coefficients().iter().copied();
    ["fx", "fy", "cx", "cy"].into_iter().chain(coefficients)
}

/// Returns value, standard deviation and known value of every parameter.
pub fn parameters(found: &Estimate, known: &Lens) -> impl Iterator<Item = (f64, f64, f64)> {
    let values = found.lens.parameters().into_iter().zip(found.sigma);
    let all = values.zip(known.parameters());
    all.map(|((value, sigma), known)| (value, sigma, known))
        .take(known.parameter_count())
}

/// Simulates picture `n`: its visible corners, with noise.
fn view(lens: &Lens, n: u32, random: &mut Random) -> View {
    let camera_from_board = pose(n);
    let mut points = Vec::new();
    for row in 0..CORNERS.1 {
        for column in 0..CORNERS.0 {
            let point = DVec2::new(f64::from(column), f64::from(row)) * SQUARE;
            let noise = DVec2::new(random.normal(), random.normal()) * NOISE;
            let in_camera = camera_from_board.transform_point(point.extend(0.0));
            let pixel = lens.project(in_camera).map(|pixel| pixel + noise);
            points.extend(
                pixel
                    .filter(|pixel| is_in_picture(*pixel))
                    .map(|pixel| Correspondence { point, pixel }),
            );
        }
    }
    let name = format!("view {n}");
    View { name, points }
}

fn is_in_picture(pixel: DVec2) -> bool {
    let last = DVec2::new(f64::from(SIZE.0 - 1), f64::from(SIZE.1 - 1));
    pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(last).all()
}

/// Returns `camera_from_board` of picture `n`: the board tilts towards another side in each, at
/// another position in the picture.
fn pose(n: u32) -> RigidTransform {
    let around = DVec2::from_angle(TAU * f64::from(n) / f64::from(VIEWS));
    let rotation = DQuat::from_axis_angle(around.extend(0.0), TILT);
    // Every position differs from the tilt's direction, so that no two views are similar.
    let position = DVec2::from_angle(5.0 * TAU * f64::from(n) / f64::from(VIEWS));
    let distance = 0.32 + 0.02 * f64::from(n % 3);
    let centre = DVec3::new(0.07 * position.x, 0.04 * position.y, distance);
    let middle = DVec2::new(f64::from(CORNERS.0 - 1), f64::from(CORNERS.1 - 1)) * 0.5 * SQUARE;
    RigidTransform::new(rotation, centre - rotation * middle.extend(0.0))
}
