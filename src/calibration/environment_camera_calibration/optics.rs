//! The environment camera's lens: from the image circle of a fisheye, or the outline of a mirrored
//! sphere.

use super::super::intrinsics::Grey;
use super::image_circle::{ImageCircle, image_circle};
use super::inputs::{EnvironmentCameraKind, Inputs};
use super::rays::{RAYS, side};
use super::sphere_outline::{Outline, RoughSphere, best_outline};
use super::view::View;
use crate::summary::Summary;
use glam::{DVec2, DVec3};
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_camera::{LensModel, PinholeCamera};
use penumbra_lighting::sphere_outline;
use penumbra_rig_model::Grade;
use penumbra_rig_model::environment_file::CircleLens;

/// The lens found.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    pub view: View,
    pub circle: Option<ImageCircle>,
    /// The lens for the calibration file, unless a lens calibration exists.
    pub lens: Option<CircleLens>,
    /// The sphere's outline and its radius, metres.
    pub outline: Option<(Outline, f64)>,
}

impl Optics {
    /// Returns the sphere's outline and its radius, metres.
    pub fn sphere(&self) -> Option<(&Outline, f64)> {
        self.outline.as_ref().map(|(o, r)| (o, *r))
    }
}

/// Finds the lens; `None` if there is no picture or neither picture nor rig determine it.
pub(super) fn optics(inputs: &Inputs, summary: &mut Summary) -> Option<Optics> {
    if inputs.gathered.mean.count == 0 {
        return None;
    }
    match inputs.kind {
        EnvironmentCameraKind::Fisheye => fisheye(inputs, summary),
        EnvironmentCameraKind::Sphere => sphere(inputs, summary),
    }
}

fn fisheye(inputs: &Inputs, summary: &mut Summary) -> Option<Optics> {
    let (codes, linear) = inputs.gathered.mean.brightest(&inputs.response());
    let written = written(inputs);
    let calibrated = calibrated(inputs);
    let circle = match image_circle(&codes, &linear) {
        Ok(circle) => circle,
        Err(why) => {
            // A known lens is used unless the picture contradicts it.
            let known = calibrated.or(written);
            let lens = known.filter(|l| !is_lit_beyond(&codes, l));
            let grade = match lens {
                Some(_) => Grade::Usable,
                None => Grade::Refused,
            };
            summary.finding(grade, why);
            return lens.map(|lens| Optics {
                view: View::Fisheye(lens),
                circle: None,
                lens: None,
                outline: None,
            });
        }
    };
    describe_circle(&circle, summary);
    let (width, height) = inputs.gathered.mean.size;
    let (lens, from_circle) = match calibrated {
        Some(lens) => (with_circle(lens, &circle, summary), false),
        None => (by_circle(inputs, &circle, written.as_ref(), summary), true),
    };
    let lens = FisheyeLens {
        width,
        height,
        ..lens
    };
    let sigma = circle.centre_sigma;
    let record = from_circle.then(|| CircleLens {
        centre: lens.centre.to_array(),
        radius: circle.radius,
        focal: lens.focal,
        distortion: lens.distortion,
        max_theta: lens.max_theta,
        sigma: [sigma.x, sigma.y, circle.radius_sigma],
    });
    Some(Optics {
        view: View::Fisheye(lens),
        circle: Some(circle),
        lens: record,
        outline: None,
    })
}

/// Returns whether there is picture outside of this lens's image circle.
fn is_lit_beyond(codes: &Grey, lens: &FisheyeLens) -> bool {
    let (sin, cos) = lens.max_theta.min(3.1).sin_cos();
    let (mut beyond, mut lit) = (0, 0);
    for ray in 0..RAYS {
        let across = side(ray);
        let rim = lens.project(DVec3::new(across.x * sin, across.y * sin, cos) * 0.999);
        let Some(rim) = rim else { continue };
        let p = rim + (rim - lens.centre) * 0.06;
        if codes.contains(p, 1.0) {
            beyond += 1;
            lit += usize::from(codes.sample(p) > 40.0);
        }
    }
    2 * lit > beyond && 5 * beyond > RAYS
}

fn describe_circle(circle: &ImageCircle, summary: &mut Summary) {
    summary.line(format!(
        "image circle: centre ({:.2} ± {:.2}, {:.2} ± {:.2}), radius {:.2} ± {:.2} px; visible over {:.0} % of its circumference, edge {:.1} px wide",
        circle.centre.x,
        circle.centre_sigma.x,
        circle.centre.y,
        circle.centre_sigma.y,
        circle.radius,
        circle.radius_sigma,
        100.0 * circle.seen,
        circle.softness
    ));
    let (stretch, sigma) = circle.stretch;
    if stretch.abs() > 0.01 && stretch.abs() > 4.0 * sigma {
        summary.finding(Grade::Usable, format!("the image circle is {:.1} % {} than high: the picture is stretched; record it in the camera's native aspect ratio", 100.0 * stretch.abs(), if stretch > 0.0 { "wider" } else { "narrower" }));
    }
    if circle.seen < 0.5 {
        summary.finding(
            Grade::Usable,
            format!(
                "only {:.0} % of the image circle is visible",
                100.0 * circle.seen
            ),
        );
    }
}

/// Returns the lens in `rig.json` if it fits the pictures' size.
fn written(inputs: &Inputs) -> Option<FisheyeLens> {
    match &inputs.known.rig.calibration.environment.as_ref()?.view {
        EnvironmentView::Fisheye { lens, .. }
            if (lens.width, lens.height) == inputs.gathered.mean.size =>
        {
            Some(lens.clone())
        }
        _ => None,
    }
}

/// Returns the lens found by `calibrate intrinsics` if it is a fisheye and fits the pictures' size.
fn calibrated(inputs: &Inputs) -> Option<FisheyeLens> {
    let lens = inputs.known.lens.as_ref()?;
    let fits = lens.model == LensModel::KannalaBrandt
        && (lens.width, lens.height) == inputs.gathered.mean.size;
    let mut distortion = [0.0; 4];
    distortion.copy_from_slice(lens.coefficients.get(..4)?);
    fits.then(|| FisheyeLens {
        width: lens.width,
        height: lens.height,
        focal: (lens.focal.x * lens.focal.y).sqrt(),
        centre: lens.centre,
        distortion,
        max_theta: std::f64::consts::PI,
    })
}

/// Sets a calibrated lens's field of view from the image circle.
fn with_circle(mut lens: FisheyeLens, circle: &ImageCircle, summary: &mut Summary) -> FisheyeLens {
    let at_rim = lens.unproject(lens.centre + DVec2::X * circle.radius);
    lens.max_theta = at_rim.map_or(std::f64::consts::FRAC_PI_2, |d| d.angle_between(DVec3::Z));
    let distance = lens.centre.distance(circle.centre);
    summary.line(format!(
        "calibrated lens: {:.1}° field of view by the circle; its centre is {distance:.1} px from the circle's",
        2.0 * lens.max_theta.to_degrees()
    ));
    if distance > 0.04 * circle.radius + 5.0 * circle.centre_sigma.length() {
        summary.finding(Grade::Usable, format!("the calibrated lens has its centre {distance:.0} px from that of the image circle; check that environment_camera.json is of this camera and mode"));
    }
    lens
}

/// Returns the lens with the given field of view at the circle.
fn by_circle(
    inputs: &Inputs,
    circle: &ImageCircle,
    written: Option<&FisheyeLens>,
    summary: &mut Summary,
) -> FisheyeLens {
    let half = inputs.options.fov.map(|f| 0.5 * f);
    let max_theta = half
        .or(written.map(|w| w.max_theta))
        .unwrap_or(std::f64::consts::FRAC_PI_2);
    let distortion = written.map_or([0.0; 4], |w| w.distortion);
    let unit = FisheyeLens {
        width: 0,
        height: 0,
        focal: 1.0,
        centre: DVec2::ZERO,
        distortion,
        max_theta: std::f64::consts::PI,
    };
    let (sin, cos) = max_theta.sin_cos();
    let reach = unit
        .project(DVec3::new(sin, 0.0, cos))
        .map_or(max_theta, |p| p.length());
    let lens = FisheyeLens {
        focal: circle.radius / reach,
        centre: circle.centre,
        max_theta,
        ..unit
    };
    summary.line(format!(
        "lens from the circle and {:.1}° field of view: f {:.2} ± {:.2} px/rad",
        2.0 * max_theta.to_degrees(),
        lens.focal,
        lens.focal * circle.radius_sigma / circle.radius
    ));
    if let Some(written) = written {
        let apart = written
            .centre
            .distance(circle.centre)
            .max((written.focal - lens.focal).abs() * max_theta);
        summary.line(format!(
            "rig.json has f {:.2}, centre ({:.2}, {:.2}): differs by at most {apart:.2} px",
            written.focal, written.centre.x, written.centre.y
        ));
        if apart > 0.03 * circle.radius {
            summary.finding(Grade::Usable, format!("rig.json's lens differs from the image circle by {apart:.0} px; the circle is used. If the field of view is not {:.0}°, give it with --fov", 2.0 * max_theta.to_degrees()));
        }
    }
    lens
}

fn sphere(inputs: &Inputs, summary: &mut Summary) -> Option<Optics> {
    let camera = inputs.camera.clone()?;
    if (camera.width, camera.height) != inputs.gathered.mean.size {
        let (w, h) = inputs.gathered.mean.size;
        summary.finding(Grade::Refused, format!("the pictures are {w}×{h}, the camera's lens is for {}×{}; calibrate the lens in the mode in use", camera.width, camera.height));
        return None;
    }
    let radius = inputs.known.rig.mirror_sphere.as_ref()?.radius;
    let planes = inputs.gathered.mean.planes();
    let found = match best_outline(&planes, &camera, rough_spheres(inputs)) {
        Ok(found) => found,
        Err(why) => {
            summary.finding(Grade::Refused, why);
            return None;
        }
    };
    if let Some(click) = inputs.options.rough_sphere {
        check_click(&found, &camera, click, summary);
    }
    describe_outline(&found, &camera, radius, summary);
    Some(Optics {
        view: View::Pinhole(camera),
        circle: None,
        lens: None,
        outline: Some((found, radius)),
    })
}

fn describe_outline(found: &Outline, camera: &PinholeCamera, radius: f64, summary: &mut Summary) {
    let (centre, sigma) = found.centre(radius);
    let focal = camera.focal.min_element();
    summary.line(format!(
        "outline of the sphere: centre ({:.2}, {:.2}) ± {:.2} px, radius {:.2} ± {:.2} px; visible over {:.0} % of its circumference, spread {:.2} px",
        camera.project(found.axis).map_or(f64::NAN, |p| p.x),
        camera.project(found.axis).map_or(f64::NAN, |p| p.y),
        found.axis_sigma * focal,
        found.half_angle.tan() * focal,
        found.angle_sigma * focal,
        100.0 * found.seen,
        found.spread
    ));
    summary.line(format!(
        "sphere of {:.1} mm radius: {:.1} mm from the camera, ± {:.2} mm across and ± {:.2} mm along the line of observation",
        1000.0 * radius,
        1000.0 * centre.length(),
        1000.0 * sigma[0],
        1000.0 * sigma[1]
    ));
    if found.seen < 0.6 {
        summary.finding(
            Grade::Usable,
            format!(
                "only {:.0} % of the sphere's outline is visible",
                100.0 * found.seen
            ),
        );
    }
}

/// Maximum distance of the clicked position from the sphere's centre, its radii.
const MAX_CLICK_DISTANCE: f64 = 0.6;

/// Compares the outline with the position that the user clicked on.
fn check_click(found: &Outline, camera: &PinholeCamera, click: RoughSphere, summary: &mut Summary) {
    let radius = found.half_angle.tan() * camera.focal.min_element();
    let centre = camera.project(found.axis).unwrap_or(DVec2::INFINITY);
    let apart = centre.distance(click.centre);
    if apart.is_nan() || apart > MAX_CLICK_DISTANCE * radius {
        summary.finding(
            Grade::Refused,
            format!(
                "the outline found has its centre at ({:.0}, {:.0}) and a radius of {radius:.0} px, {apart:.0} px from the position given; give the radius, too: --click X,Y,RADIUS",
                centre.x, centre.y
            ),
        );
    }
}

/// Returns the positions at which to search for the sphere: the user's; else the picture's centre, a
/// round shape in the picture, and the position by the rig.
fn rough_spheres(inputs: &Inputs) -> Vec<RoughSphere> {
    let (w, h) = inputs.gathered.mean.size;
    if let Some(click) = inputs.options.rough_sphere {
        return click.candidates(DVec2::new(f64::from(w), f64::from(h)));
    }
    let picture_centre = 0.5 * DVec2::new(f64::from(w), f64::from(h));
    let round = sphere_outline(&inputs.gathered.mean.picture());
    let by_rig = sphere_by_rig(inputs);
    let mut out = Vec::new();
    for centre in [
        Some(picture_centre),
        round.map(|c| c.centre),
        by_rig.map(|s| s.centre),
    ]
    .into_iter()
    .flatten()
    {
        out.push(RoughSphere {
            centre,
            radius: None,
        });
        out.extend(by_rig.map(|s| RoughSphere { centre, ..s }));
    }
    out.extend(round.map(|c| RoughSphere {
        centre: c.centre,
        radius: Some(c.radius),
    }));
    out
}

/// Returns the sphere's position in the picture by `rig.json`.
fn sphere_by_rig(inputs: &Inputs) -> Option<RoughSphere> {
    let sphere = inputs.known.rig.mirror_sphere.as_ref()?;
    let in_camera = inputs
        .rough_pose()?
        .inverse()
        .transform_point(sphere.centre_in_world);
    let camera = inputs.camera.as_ref()?;
    Some(RoughSphere {
        centre: camera.project(in_camera)?,
        radius: Some(camera.focal.min_element() * sphere.radius / in_camera.length()),
    })
}
