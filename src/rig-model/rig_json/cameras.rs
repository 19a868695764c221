//! The cameras, the mirrored ball, the tracker and the chart of a `rig.json`.

use super::{Marker, Node, Result};
use crate::{EnvironmentCamera, SceneCamera, SphereMarker, TrackerCalibration};
use glam::{DVec2, DVec3};
use penumbra_camera::{EnvironmentView, FisheyeLens, MirrorSphere};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_white_balance::chart::PhotometricChart;

pub(super) fn scene_camera(node: &Node) -> Result<SceneCamera> {
    Ok(SceneCamera {
        camera: pinhole(node)?,
        response: response(node)?,
        vignetting: None,
        latency_nanos: latency(node)?,
    })
}

fn pinhole(node: &Node) -> Result<PinholeCamera> {
    let (width, height) = node
        .need("image_size", "[width, height] in pixels")?
        .image_size()?;
    let (focal, centre) = node.need("K", "the 3x3 camera matrix")?.camera_matrix()?;
    Ok(PinholeCamera {
        width,
        height,
        focal,
        centre,
        distortion: lens_distortion(node)?,
    })
}

/// `lens_distortion`: `"none"`, OpenCV's list k1, k2, p1, p2 and perhaps k3, or an object
/// with these keys.
fn lens_distortion(node: &Node) -> Result<[f64; 5]> {
    let Some(node) = node.find("lens_distortion") else {
        return Ok([0.0; 5]);
    };
    if node.is_list() {
        return match node.numbers::<4>() {
            Ok([k1, k2, p1, p2]) => Ok([k1, k2, p1, p2, 0.0]),
            Err(_) => node.numbers::<5>(),
        };
    }
    if node.is_object() {
        return coefficients(&node, ["k1", "k2", "p1", "p2", "k3"]);
    }
    match node.text() {
        Ok("none") => Ok([0.0; 5]),
        _ => Err(node.wrong("\"none\", a list k1, k2, p1, p2, k3, or an object with these keys")),
    }
}

fn coefficients<const N: usize>(node: &Node, keys: [&str; N]) -> Result<[f64; N]> {
    let mut out = [0.0; N];
    for (slot, key) in out.iter_mut().zip(keys) {
        if let Some(n) = node.find(key) {
            *slot = n.number()?;
        }
    }
    Ok(out)
}

/// `response`: `"srgb"` (the default), `"linear"`, or `{"gamma": 2.2}`.
fn response(node: &Node) -> Result<Response> {
    let Some(node) = node.find("response") else {
        return Ok(Response::srgb());
    };
    if let Some(gamma) = node.find("gamma") {
        return Ok(Response::gamma(gamma.positive()? as f32));
    }
    match node.text() {
        Ok("srgb") => Ok(Response::srgb()),
        Ok("linear") => Ok(Response::linear()),
        _ => Err(node.wrong("\"srgb\", \"linear\" or {\"gamma\": number}")),
    }
}

/// `latency_s` in nanoseconds; absent means none.
fn latency(node: &Node) -> Result<i64> {
    let Some(node) = node.find("latency_s") else {
        return Ok(0);
    };
    let seconds = node.number()?;
    if seconds.abs() > 10.0 {
        return Err(node.wrong("seconds, at most 10"));
    }
    Ok((seconds * 1e9).round() as i64)
}

pub(super) fn environment_camera(node: &Node, markers: &[Marker]) -> Result<EnvironmentCamera> {
    let brackets = match node.find("brackets_ev") {
        Some(list) => list
            .list(16)?
            .iter()
            .map(Node::number)
            .collect::<Result<_>>()?,
        None => Vec::new(),
    };
    Ok(EnvironmentCamera {
        response: response(node)?,
        vignetting: None,
        view: environment_view(node, markers)?,
        latency_nanos: latency(node)?,
        brackets_ev: brackets,
    })
}

fn environment_view(node: &Node, markers: &[Marker]) -> Result<EnvironmentView> {
    let kind = node.need("kind", "\"fisheye\" or \"sphere\"")?;
    let pose = node.need("T_world_cam", "the camera's pose in the world")?;
    let world_from_camera = pose.rigid()?;
    match kind.text()? {
        "fisheye" => Ok(EnvironmentView::Fisheye {
            lens: fisheye(node)?,
            world_from_camera,
        }),
        "sphere" => {
            let ball = node.need("mirror_sphere", "the mirrored ball")?;
            let (sphere, carried) = sphere(&ball, markers)?;
            if carried.is_some() {
                return Err(ball.wrong("at a fixed place before a camera of its own: name a marker that is among `markers`, or give center_world"));
            }
            Ok(EnvironmentView::Sphere {
                camera: pinhole(node)?,
                world_from_camera,
                sphere,
            })
        }
        _ => Err(kind.wrong("\"fisheye\" or \"sphere\"")),
    }
}

fn fisheye(node: &Node) -> Result<FisheyeLens> {
    let (width, height) = node
        .need("image_size", "[width, height] in pixels")?
        .image_size()?;
    let lens = node.need("projection", "an object with f, cx, cy, max_theta_rad")?;
    if let Some(model) = lens.find("model")
        && !matches!(model.text()?, "equidistant" | "kannala-brandt")
    {
        return Err(model.wrong("\"equidistant\" (with k1..k4 where it departs from it)"));
    }
    let max_theta = lens.need("max_theta_rad", "half the field of view, radians")?;
    if max_theta.positive()? > std::f64::consts::PI {
        return Err(max_theta.wrong("radians, at most pi"));
    }
    Ok(FisheyeLens {
        width,
        height,
        focal: lens
            .need("f", "pixels per radian at the axis")?
            .positive()?,
        centre: DVec2::new(
            lens.need("cx", "pixels")?.number()?,
            lens.need("cy", "pixels")?.number()?,
        ),
        distortion: coefficients(&lens, ["k1", "k2", "k3", "k4"])?,
        max_theta: max_theta.positive()?,
    })
}

/// The ball, and the marker that carries it, if it moves about. A marker that is among `markers`
/// stands still, and its ball with it.
pub(super) fn sphere(
    node: &Node,
    markers: &[Marker],
) -> Result<(MirrorSphere, Option<SphereMarker>)> {
    let reflectance = match node.find("reflectance_rgb") {
        Some(n) => n.colour()?,
        None => [1.0; 3],
    };
    let (centre_in_world, carried) = match node.find("marker") {
        Some(marker) => beside_marker(&marker, markers)?,
        None => {
            let centre = node.need("center_world", "x, y, z in metres, or a `marker`")?;
            (centre.vector()?, None)
        }
    };
    let sphere = MirrorSphere {
        centre_in_world,
        radius: node.need("radius", "metres")?.positive()?,
        reflectance,
        in_scene: carried.is_some() || flag(node, "in_scene_camera_images")?,
    };
    Ok((sphere, carried))
}

fn beside_marker(node: &Node, markers: &[Marker]) -> Result<(DVec3, Option<SphereMarker>)> {
    let family = node.need("family", "e.g. \"tag36h11\"")?;
    let name = family.text()?;
    let id = node.need("id", "a whole number")?.pixels()?;
    let centre = node.need("center", "x, y, z in the marker's frame, metres")?;
    let centre_in_marker = centre.vector()?;
    if let Some(fixed) = markers.iter().find(|m| m.family == name && m.id == id) {
        let centre = fixed.world_from_marker.transform_point(centre_in_marker);
        return Ok((centre, None));
    }
    let carried = SphereMarker {
        family: name
            .parse()
            .map_err(|_| family.wrong("\"tag36h11\", \"tag25h9\" or \"tag16h5\""))?,
        id,
        size: node
            .need("size_m", "metres, as the marker is not among `markers`")?
            .positive()?,
        centre_in_marker,
    };
    Ok((DVec3::ZERO, Some(carried)))
}

pub(super) fn flag(node: &Node, key: &str) -> Result<bool> {
    node.find(key).map_or(Ok(false), |n| n.flag())
}

pub(super) fn tracker(node: &Node) -> Result<TrackerCalibration> {
    Ok(TrackerCalibration {
        world_from_transmitter: node
            .need("T_world_source", "the transmitter's pose in the world")?
            .rigid()?,
        sensor_from_scene_camera: node
            .need(
                "T_sensor_cam",
                "the scene camera's pose in the sensor's frame",
            )?
            .rigid()?,
        latency_nanos: latency(node)?,
        metres_per_unit: match node.find("fastrak").and_then(|f| f.find("units")) {
            Some(units) => metres_per_unit(&units)?,
            // A FASTRAK sends inches unless it is told otherwise.
            None => 0.0254,
        },
        field: None,
    })
}

fn metres_per_unit(units: &Node) -> Result<f64> {
    match units.text()? {
        "inches" => Ok(0.0254),
        "centimetres" | "centimeters" => Ok(0.01),
        "millimetres" | "millimeters" => Ok(0.001),
        "metres" | "meters" => Ok(1.0),
        _ => Err(units.wrong("\"inches\", \"centimetres\", \"millimetres\" or \"metres\"")),
    }
}

pub(super) fn chart(node: &Node) -> Result<PhotometricChart> {
    let patches = node.need("patches_xywh", "a list of [x, y, width, height]")?;
    let patches = patches
        .list(10_000)?
        .iter()
        .map(patch)
        .collect::<Result<_>>()?;
    let reflectance = match node.find("reflectance_linear_rgb") {
        Some(n) => n
            .list(10_000)?
            .iter()
            .map(Node::colour)
            .collect::<Result<_>>()?,
        None => Vec::new(),
    };
    let chart = PhotometricChart {
        scene_picture: node.need("scene", "a file name")?.text()?.to_owned(),
        environment_picture: node.need("environment", "a file name")?.text()?.to_owned(),
        patches,
        reflectance,
    };
    if !chart.reflectance.is_empty() && chart.reflectance.len() != chart.patches.len() {
        return Err(node.wrong("given as many reflectances as patches"));
    }
    Ok(chart)
}

fn patch(node: &Node) -> Result<[u32; 4]> {
    let [x, y, w, h] = node.array::<4>()?;
    let patch = [x.pixels()?, y.pixels()?, w.pixels()?, h.pixels()?];
    if patch[2] == 0 || patch[3] == 0 {
        return Err(node.wrong("x, y, width, height with width and height above 0"));
    }
    Ok(patch)
}
