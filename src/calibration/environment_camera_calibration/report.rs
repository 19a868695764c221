//! The step's report: the picture with an overlay of the results, and the residuals.

use super::super::report::{Page, Plot, escaped};
use super::super::step::{CalibrationProvenance, Finished};
use super::observations::{ImageObservation, ObservationKind};
use super::optics::Optics;
use super::pose::PoseResult;
use super::resection::Target;
use super::view::View;
use crate::base64::base64;
use glam::DVec2;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, RgbaImage};
use penumbra_picture::Picture;
use std::fmt::Write;

/// Contents of the report.
pub(super) struct ReportContents<'a> {
    pub picture: Option<Picture>,
    pub optics: Option<&'a Optics>,
    pub pose: Option<&'a PoseResult>,
}

/// Writes the report as HTML.
pub(super) fn report(
    found: &Finished,
    made: &CalibrationProvenance,
    contents: &ReportContents,
) -> String {
    let facts = [format!("{}, from {}", made.date, made.source)];
    let mut page = Page::new("Environment camera", &facts);
    page.verdict(found);
    if let Some(picture) = &contents.picture {
        let caption = "Mean of the environment camera's pictures. Blue: the image circle or the sphere's outline; orange: points of its edge. Green: markers, clicks and lights as observed; red: as predicted by the calibration.";
        page.figure(&overlay(picture, contents), caption);
    }
    if let Some(optics) = contents.optics {
        edge_plot(&mut page, optics);
    }
    if let Some(pose) = contents.pose {
        residuals(&mut page, pose);
    }
    page.finish()
}

fn overlay(picture: &Picture, contents: &ReportContents) -> String {
    let (w, h) = (picture.width, picture.height);
    let thin = f64::from(w.max(h)) / 640.0;
    let mut svg = format!(
        "<svg viewBox=\"-0.5 -0.5 {w} {h}\"><image x=\"-0.5\" y=\"-0.5\" width=\"{w}\" height=\"{h}\" href=\"{}\"/>",
        jpeg_uri(picture)
    );
    if let Some(optics) = contents.optics {
        if let Some(circle) = &optics.circle {
            dots(&mut svg, &circle.edge, "#f97316", 1.2 * thin);
            let _ = write!(
                svg,
                "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{:.2}\" fill=\"none\" stroke=\"#2563eb\" stroke-width=\"{thin:.2}\"/>",
                circle.centre.x, circle.centre.y, circle.radius
            );
            dots(&mut svg, &[circle.centre], "#2563eb", 4.0 * thin);
        }
        if let (Some((outline, _)), View::Pinhole(camera)) = (&optics.outline, &optics.view) {
            dots(&mut svg, &outline.edge, "#f97316", 1.2 * thin);
            let mut path = String::new();
            for (i, p) in outline.curve(camera).iter().enumerate() {
                let _ = write!(
                    path,
                    "{}{:.2} {:.2}",
                    if i == 0 { "M" } else { "L" },
                    p.x,
                    p.y
                );
            }
            let _ = write!(
                svg,
                "<path d=\"{path}\" fill=\"none\" stroke=\"#2563eb\" stroke-width=\"{thin:.2}\"/>"
            );
        }
    }
    if let Some(pose) = contents.pose {
        let seen: Vec<DVec2> = pose.image_observations.iter().map(|m| m.pixel).collect();
        dots(&mut svg, &seen, "#16a34a", 6.0 * thin);
        dots(&mut svg, &predicted(contents, pose), "#dc2626", 3.0 * thin);
    }
    svg.push_str("</svg>");
    svg
}

/// Returns the predicted pixels of what is observed directly, not in the mirror.
fn predicted(contents: &ReportContents, pose: &PoseResult) -> Vec<DVec2> {
    let Some(optics) = contents.optics.filter(|_| pose.resection.is_some()) else {
        return Vec::new();
    };
    let inside = pose.world_from_camera.inverse();
    let at = |m: &ImageObservation| {
        if optics.outline.is_some() && m.by == ObservationKind::Light {
            return None;
        }
        optics.view.pixel(match m.observation.target {
            Target::Point(p) => inside.transform_point(p),
            Target::Direction(d) => inside.rotation * d,
        })
    };
    pose.image_observations.iter().filter_map(at).collect()
}

fn dots(svg: &mut String, at: &[DVec2], colour: &str, size: f64) {
    let mut path = String::new();
    for p in at {
        let _ = write!(path, "M{:.2} {:.2}h.01", p.x, p.y);
    }
    let _ = write!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{size:.2}\" stroke-linecap=\"round\" stroke-opacity=\".8\"/>",
        escaped(colour)
    );
}

/// Plots the distance of each point of the edge from the circle or the outline.
fn edge_plot(page: &mut Page, optics: &Optics) {
    let around = |centre: DVec2, p: &DVec2| (*p - centre).to_angle().to_degrees();
    let points: Vec<(f64, f64)> = match (&optics.circle, &optics.outline, &optics.view) {
        (Some(circle), ..) => circle
            .edge
            .iter()
            .map(|p| {
                (
                    around(circle.centre, p),
                    p.distance(circle.centre) - circle.radius,
                )
            })
            .collect(),
        (None, Some((outline, _)), View::Pinhole(camera)) => {
            let centre = camera.project(outline.axis).unwrap_or(DVec2::ZERO);
            let distance = |p: &DVec2| {
                (camera.unproject(*p).angle_between(outline.axis) - outline.half_angle)
                    * camera.focal.min_element()
            };
            outline
                .edge
                .iter()
                .map(|p| (around(centre, p), distance(p)))
                .collect()
        }
        _ => return,
    };
    let plot = Plot {
        x: "direction from the centre, degrees".to_owned(),
        y: "distance outwards, pixels".to_owned(),
        series: vec![("edge".to_owned(), points, false)],
    };
    page.plot(
        &plot,
        "Distance of the edge from the fitted circle or outline.",
    );
}

fn residuals(page: &mut Page, pose: &PoseResult) {
    let Some(resection) = &pose.resection else {
        return;
    };
    let mut rows = vec![
        [
            "kind",
            "x, px",
            "y, px",
            "deviation, degrees",
            "sigma, degrees",
            "",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    for ((m, deviation), kept) in pose
        .image_observations
        .iter()
        .zip(&resection.deviations)
        .zip(&resection.kept)
    {
        rows.push(vec![
            m.by.name().to_owned(),
            format!("{:.1}", m.pixel.x),
            format!("{:.1}", m.pixel.y),
            format!("{:.3}", deviation.to_degrees()),
            format!("{:.3}", m.observation.sigma.to_degrees()),
            if *kept { "" } else { "rejected" }.to_owned(),
        ]);
    }
    page.heading("WorldLight points and lights");
    page.table(&rows);
}

/// Returns the picture as a data URI.
fn jpeg_uri(picture: &Picture) -> String {
    let mut bytes = Vec::new();
    let image = RgbaImage::from_raw(picture.width, picture.height, picture.rgba.clone());
    if let Some(image) = image {
        let rgb = DynamicImage::ImageRgba8(image).to_rgb8();
        // Encoding into memory fails only for a picture without pixels, which stays empty.
        let _ = JpegEncoder::new_with_quality(&mut bytes, 80).encode_image(&rgb);
    }
    format!("data:image/jpeg;base64,{}", base64(&bytes))
}
