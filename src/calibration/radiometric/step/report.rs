//! The step's report.

use super::camera_data::{CameraData, ChartPicture};
use super::camera_result::{CAMERAS, CameraResult};
use super::gains::{Gains, evaluate};
use super::options::RadiometricOptions;
use crate::base64::base64;
use crate::radiometric::chart::patches::HALF;
use crate::radiometric::curve::Curve;
use crate::radiometric::noise::Noise;
use crate::radiometric::reference::NAMES;
use crate::radiometric::vignetting::VignettingFit;
use crate::report::{Page, Plot};
use crate::step::{CalibrationProvenance, Finished};
use glam::{DMat3, DVec3};
use penumbra_camera::Response;
use penumbra_camera::vignetting::polynomial;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::Patch;
use penumbra_white_balance::colour::delta_e_linear;
use std::fmt::Write;

/// Writes the report as HTML.
pub(super) fn report(
    provenance: &CalibrationProvenance,
    found: &Finished,
    data: &[CameraData; 2],
    cameras: &[CameraResult; 2],
    gains: &Gains,
    options: &RadiometricOptions,
) -> String {
    let facts = [
        format!("{}, from {}", provenance.date, provenance.source),
        format!("chart: ColorChecker of {}", options.edition.name()),
    ];
    let mut page = Page::new("Colour and brightness of the cameras", &facts);
    page.verdict(found);
    for i in 0..2 {
        if let Some(seen) = data[i].charts.first() {
            let caption = format!(
                "The chart in the {} camera's picture; white: the areas that were read",
                CAMERAS[i].name()
            );
            page.figure(&chart(seen), &caption);
            own_colours(&mut page, &data[i], &cameras[i], options);
        }
    }
    if !gains.patches.is_empty() {
        page.heading("Patches");
        page.table(&patches(gains));
    }
    for i in 0..2 {
        camera(&mut page, CAMERAS[i].name(), &cameras[i]);
    }
    page.finish()
}

/// Adds a table of ΔE2000 between the chart's patches in one camera and the reference.
fn own_colours(
    page: &mut Page,
    data: &CameraData,
    camera: &CameraResult,
    options: &RadiometricOptions,
) {
    let Some((response, _)) = &camera.response else {
        return;
    };
    let patches = data.patches(response);
    let colours = patches.first().and_then(|p| evaluate(p, options).colours);
    let Some(colours) = colours else { return };
    let header = [
        "patch",
        "ΔE2000 as shown",
        "white balanced",
        "with a matrix",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    let text = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| format!("{v:.1}"));
    for (i, name) in NAMES.iter().enumerate() {
        let values = [&colours.as_shown, &colours.balanced, &colours.matrixed];
        let cells = values.map(|v| text(v[i]));
        rows.push([(*name).to_owned()].into_iter().chain(cells).collect());
    }
    page.table(&rows);
}

/// Returns a table of ΔE2000 between the cameras before and after calibration, with white at 1 in the
/// scene camera.
fn patches(gains: &Gains) -> Vec<Vec<String>> {
    let header = ["patch", "scene", "environment", "ΔE2000 before", "after"];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    let Some((_, estimate)) = gains.best() else {
        return rows;
    };
    let matrix = gains.matrix.unwrap_or(DMat3::from_diagonal(estimate.gains));
    for (name, (scene, environment)) in NAMES.iter().zip(&gains.patches) {
        let (Some(s), Some(e)) = (mean(scene), mean(environment)) else {
            rows.push(vec![
                (*name).to_owned(),
                text(mean(scene)),
                text(mean(environment)),
                "clipped or dark".to_owned(),
                String::new(),
            ]);
            continue;
        };
        // Before: brightness matched in green, so that only colours are compared.
        let before = delta_e_linear(s, e * estimate.gains.y);
        let after = delta_e_linear(s, matrix * e);
        rows.push(vec![
            (*name).to_owned(),
            text(Some(s)),
            text(Some(e)),
            format!("{before:.2}"),
            format!("{after:.2}"),
        ]);
    }
    rows
}

fn mean(patch: &Patch) -> Option<DVec3> {
    let [r, g, b] = patch.0;
    Some(DVec3::new(r?.mean, g?.mean, b?.mean))
}

fn text(value: Option<DVec3>) -> String {
    value.map_or_else(
        || "–".to_owned(),
        |v| format!("{:.4} {:.4} {:.4}", v.x, v.y, v.z),
    )
}

fn camera(page: &mut Page, name: &str, camera: &CameraResult) {
    if let Some(Ok(curve)) = &camera.curve {
        plot_curve(page, name, curve, camera.response.as_ref());
    }
    if let Some(noise) = &camera.noise {
        plot_noise(page, name, noise);
    }
    if let Some((fit, _)) = &camera.vignetting {
        plot_vignetting(page, name, fit);
    }
}

fn plot_curve(page: &mut Page, name: &str, curve: &Curve, active: Option<&(Response, String)>) {
    let points = |table: &[f32; 256]| {
        (0..256)
            .map(|z| (z as f64, f64::from(table[z])))
            .collect::<Vec<_>>()
    };
    let mut series = vec![(
        "measured".to_owned(),
        points(curve.response.linear_from_code()),
        true,
    )];
    if let Some((response, description)) = active {
        let points = points(response.linear_from_code());
        series.push((description.clone(), points, true));
    }
    let plot = Plot {
        x: "code".to_owned(),
        y: "linear".to_owned(),
        series,
    };
    page.plot(&plot, &format!("Tone curve of the {name} camera"));
    let plot = Plot {
        x: "code".to_owned(),
        y: "residual, ln".to_owned(),
        series: vec![("residuals".to_owned(), curve.residuals.clone(), false)],
    };
    page.plot(&plot, "Residuals of the tone curve");
}

fn plot_noise(page: &mut Page, name: &str, noise: &Noise) {
    let mut series = Vec::new();
    for (c, colour) in ["red", "green", "blue"].iter().enumerate() {
        series.push(((*colour).to_owned(), noise.points[c].clone(), false));
    }
    let model = (0..64).map(|i| f64::from(i) / 63.0);
    let sigma = |v: f64| (noise.read[1] + noise.shot[1] * v).max(0.0).sqrt();
    series.push((
        "model, green".to_owned(),
        model.map(|v| (v, sigma(v))).collect(),
        true,
    ));
    let plot = Plot {
        x: "linear value".to_owned(),
        y: "standard deviation of a pixel".to_owned(),
        series,
    };
    page.plot(&plot, &format!("Noise of the {name} camera"));
}

fn plot_vignetting(page: &mut Page, name: &str, fit: &VignettingFit) {
    let rho = (0..=50).map(|i| f64::from(i) / 50.0 * fit.max_rho_squared.sqrt());
    let at = |q: f64| polynomial(&fit.coefficients, q);
    let plot = Plot {
        x: "distance from the centre, half diagonals".to_owned(),
        y: "brightness".to_owned(),
        series: vec![(
            format!("{name} camera"),
            rho.map(|r| (r, at(r * r))).collect(),
            true,
        )],
    };
    page.plot(&plot, "Vignetting");
}

/// Returns the picture of a chart with the areas that were read, as SVG.
fn chart(seen: &ChartPicture) -> String {
    let (width, height) = (seen.picture.width, seen.picture.height);
    let Some(data) = data_uri(&seen.picture) else {
        return String::new();
    };
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width} {height}\"><image width=\"{width}\" height=\"{height}\" \
             href=\"{data}\"/>"
    );
    for i in 0..24 {
        let corners = seen.chart.corners(i, HALF);
        let points: String = corners
            .iter()
            .map(|p| format!("{:.1},{:.1} ", p.x + 0.5, p.y + 0.5))
            .collect();
        let _ = write!(
            svg,
            "<polygon points=\"{points}\" fill=\"none\" stroke=\"#fff\" stroke-width=\"{:.2}\"/>",
            0.03 * seen.chart.pitch()
        );
    }
    svg.push_str("</svg>");
    svg
}

/// Maximum side of a picture in the report, pixels.
const MAX_SIDE: u32 = 640;

/// Returns the picture, subsampled, as the data URI of a PNG; `None` for an empty picture.
fn data_uri(picture: &Picture) -> Option<String> {
    let thin = picture.width.max(picture.height).div_ceil(MAX_SIDE).max(1);
    let (width, height) = (picture.width / thin, picture.height / thin);
    let mut rgb = Vec::with_capacity(3 * (width * height) as usize);
    for y in 0..height {
        for x in 0..width {
            rgb.extend(picture.rgb(x * thin, y * thin));
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&rgb).ok()?;
    writer.finish().ok()?;
    Some(format!("data:image/png;base64,{}", base64(&bytes)))
}
