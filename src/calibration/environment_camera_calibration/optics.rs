//! How the environment camera looks: through a fisheye whose circle is in the picture, or at a sphere
//! whose outline is.

use super::super::intrinsics::Grey;
use super::ball::{Outline, RoughBall, outline};
use super::circle::{ImageCircle, image_circle};
use super::rays::{RAYS, side};
use super::solve::Said;
use super::step::{EnvironmentStep, Kind};
use super::view::View;
use glam::{DVec2, DVec3};
use penumbra_camera::LensModel;
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_lighting::ball_outline;
use penumbra_rig_model::Grade;
use penumbra_rig_model::environment_file::CircleLens;

/// What was found of it.
#[derive(Clone, Debug)]
pub(super) struct Optics {
    pub view: View,
    pub circle: Option<ImageCircle>,
    /// What goes into the file, where the lens was not calibrated by itself.
    pub lens: Option<CircleLens>,
    /// With the sphere's radius, metres.
    pub outline: Option<(Outline, f64)>,
}

impl Optics {
    pub fn ball(&self) -> Option<(&Outline, f64)> {
        self.outline.as_ref().map(|(o, r)| (o, *r))
    }
}

/// None where there is nothing to go on by.
pub(super) fn optics(step: &EnvironmentStep, said: &mut Said) -> Option<Optics> {
    if step.gathered.layers.count == 0 {
        return None;
    }
    match step.kind {
        Kind::Fisheye => fisheye(step, said),
        Kind::Sphere => sphere(step, said),
    }
}

fn fisheye(step: &EnvironmentStep, said: &mut Said) -> Option<Optics> {
    let (codes, linear) = step.gathered.layers.brightest(&step.response());
    let written = written(step);
    let calibrated = calibrated(step);
    let circle = match image_circle(&codes, &linear) {
        Ok(circle) => circle,
        Err(why) => {
            let known = calibrated.or(written);
            let contradicted = known.as_ref().is_none_or(|l| is_lit_beyond(&codes, l));
            let grade = if contradicted {
                Grade::Refused
            } else {
                Grade::Usable
            };
            said.against(grade, why);
            if contradicted {
                return None;
            }
            return known.map(|lens| Optics {
                view: View::Fisheye(lens),
                circle: None,
                lens: None,
                outline: None,
            });
        }
    };
    tell_circle(&circle, said);
    let (width, height) = step.gathered.layers.size;
    let (lens, from_circle) = match calibrated {
        Some(lens) => (seen_through(lens, &circle, said), false),
        None => (by_circle(step, &circle, written.as_ref(), said), true),
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

/// There is picture where this lens would leave it black.
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

fn tell_circle(circle: &ImageCircle, said: &mut Said) {
    said.line(format!(
        "image circle: centre ({:.2} ± {:.2}, {:.2} ± {:.2}), radius {:.2} ± {:.2} px; seen {:.0} % of the way round, edge {:.1} px soft",
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
        said.against(Grade::Usable, format!("the image circle is {:.1} % {} than high: the picture is stretched; record it as the camera sends it", 100.0 * stretch.abs(), if stretch > 0.0 { "wider" } else { "narrower" }));
    }
    if circle.seen < 0.5 {
        said.against(
            Grade::Usable,
            format!(
                "only {:.0} % of the image circle is seen",
                100.0 * circle.seen
            ),
        );
    }
}

fn written(step: &EnvironmentStep) -> Option<FisheyeLens> {
    match &step.known.rig.calibration.environment.as_ref()?.view {
        EnvironmentView::Fisheye { lens, .. }
            if (lens.width, lens.height) == step.gathered.layers.size =>
        {
            Some(lens.clone())
        }
        _ => None,
    }
}

/// By `calibrate intrinsics`, if it fits the pictures.
fn calibrated(step: &EnvironmentStep) -> Option<FisheyeLens> {
    let lens = step.known.lens.as_ref()?;
    let fits = lens.model == LensModel::KannalaBrandt
        && (lens.width, lens.height) == step.gathered.layers.size;
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

/// A calibrated lens sees as far as its circle reaches.
fn seen_through(mut lens: FisheyeLens, circle: &ImageCircle, said: &mut Said) -> FisheyeLens {
    let at_rim = lens.unproject(lens.centre + DVec2::X * circle.radius);
    lens.max_theta = at_rim.map_or(std::f64::consts::FRAC_PI_2, |d| d.angle_between(DVec3::Z));
    let off = lens.centre.distance(circle.centre);
    said.line(format!(
        "lens as calibrated: {:.1}° field of view by the circle; its centre is {off:.1} px from the circle's",
        2.0 * lens.max_theta.to_degrees()
    ));
    if off > 0.04 * circle.radius + 5.0 * circle.centre_sigma.length() {
        said.against(Grade::Usable, format!("the calibrated lens has its centre {off:.0} px from the middle of the image circle: is environment_camera.json of this camera and this mode?"));
    }
    lens
}

/// The lens that the field of view gives the circle.
fn by_circle(
    step: &EnvironmentStep,
    circle: &ImageCircle,
    written: Option<&FisheyeLens>,
    said: &mut Said,
) -> FisheyeLens {
    let half = step.asked.fov.map(|f| 0.5 * f);
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
    said.line(format!(
        "lens by the circle and {:.1}° field of view: f {:.2} ± {:.2} px/rad",
        2.0 * max_theta.to_degrees(),
        lens.focal,
        lens.focal * circle.radius_sigma / circle.radius
    ));
    if let Some(written) = written {
        let apart = written
            .centre
            .distance(circle.centre)
            .max((written.focal - lens.focal).abs() * max_theta);
        said.line(format!(
            "rig.json has f {:.2}, centre ({:.2}, {:.2}): at most {apart:.2} px apart",
            written.focal, written.centre.x, written.centre.y
        ));
        if apart > 0.03 * circle.radius {
            said.against(Grade::Usable, format!("rig.json's lens is {apart:.0} px off the image circle; the circle is taken. If the lens does not see {:.0}°, say --fov", 2.0 * max_theta.to_degrees()));
        }
    }
    lens
}

fn sphere(step: &EnvironmentStep, said: &mut Said) -> Option<Optics> {
    let camera = step.camera.clone()?;
    if (camera.width, camera.height) != step.gathered.layers.size {
        let (w, h) = step.gathered.layers.size;
        said.against(Grade::Refused, format!("the pictures are {w}×{h}, the camera's lens is of {}×{}; calibrate in the mode that is used", camera.width, camera.height));
        return None;
    }
    let radius = step.known.rig.mirror_sphere.as_ref()?.radius;
    let planes = step.gathered.layers.planes();
    let mut best: Option<Outline> = None;
    let mut last = super::ball::NoOutline::None;
    for rough in rough_balls(step) {
        match outline(&planes, &camera, rough) {
            Ok(found) if best.as_ref().is_none_or(|b| found.worth() > b.worth()) => {
                best = Some(found)
            }
            Ok(_) => {}
            Err(why) => last = why,
        }
    }
    let Some(found) = best else {
        said.against(Grade::Refused, last);
        return None;
    };
    let (centre, sigma) = found.centre(radius);
    let focal = camera.focal.min_element();
    said.line(format!(
        "outline of the sphere: middle ({:.2}, {:.2}) ± {:.2} px, {:.2} ± {:.2} px in radius; seen {:.0} % of the way round, spread {:.2} px",
        camera.project(found.axis).map_or(f64::NAN, |p| p.x),
        camera.project(found.axis).map_or(f64::NAN, |p| p.y),
        found.axis_sigma * focal,
        found.half_angle.tan() * focal,
        found.angle_sigma * focal,
        100.0 * found.seen,
        found.spread
    ));
    said.line(format!(
        "sphere of {:.1} mm radius: {:.1} mm before the camera, ± {:.2} mm across and ± {:.2} mm along",
        1000.0 * radius,
        1000.0 * centre.length(),
        1000.0 * sigma[0],
        1000.0 * sigma[1]
    ));
    if found.seen < 0.6 {
        said.against(
            Grade::Usable,
            format!(
                "only {:.0} % of the sphere's outline is seen",
                100.0 * found.seen
            ),
        );
    }
    Some(Optics {
        view: View::Pinhole(camera),
        circle: None,
        lens: None,
        outline: Some((found, radius)),
    })
}

/// Where to look for the sphere: where the user says; else where the picture shows something round,
/// in its middle, and as large as the rig says.
fn rough_balls(step: &EnvironmentStep) -> Vec<RoughBall> {
    if let Some(click) = step.asked.click {
        return vec![click];
    }
    let (w, h) = step.gathered.layers.size;
    let middle = 0.5 * DVec2::new(f64::from(w), f64::from(h));
    let round = ball_outline(&step.gathered.layers.picture());
    let said = said_ball(step);
    let mut out = Vec::new();
    for centre in [
        Some(middle),
        round.map(|c| c.centre),
        said.map(|s| s.centre),
    ]
    .into_iter()
    .flatten()
    {
        out.push(RoughBall {
            centre,
            radius: None,
        });
        out.extend(said.map(|s| RoughBall { centre, ..s }));
    }
    out.extend(round.map(|c| RoughBall {
        centre: c.centre,
        radius: Some(c.radius),
    }));
    out
}

/// Where the rig says that it is.
fn said_ball(step: &EnvironmentStep) -> Option<RoughBall> {
    let sphere = step.known.rig.mirror_sphere.as_ref()?;
    let in_camera = step
        .rough_pose()?
        .inverse()
        .transform_point(sphere.centre_in_world);
    let camera = step.camera.as_ref()?;
    Some(RoughBall {
        centre: camera.project(in_camera)?,
        radius: Some(camera.focal.min_element() * sphere.radius / in_camera.length()),
    })
}
