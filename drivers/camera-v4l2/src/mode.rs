//! Which of the camera's modes comes nearest to the settings.

use crate::fourcc;
use crate::video::Geometry;
use penumbra_interface::{CameraFormat, CameraSettings, CameraSize, PixelFormat, SizeSteps};

/// Rate that a format should reach where the settings name none.
const FLUENT: f64 = 25.0;
/// 29.97 is as good as 30.
const RATE_TOLERANCE: f64 = 0.5;
/// Sizes named in a complaint.
const NAMED: usize = 8;

/// The mode to ask for; an error says what is offered instead.
pub(crate) fn choose(
    formats: &[CameraFormat],
    settings: &CameraSettings,
    present: &Geometry,
) -> Result<Geometry, String> {
    let (width, height) = match (settings.width, settings.height) {
        (0, _) | (_, 0) => (present.width, present.height),
        wanted => wanted,
    };
    let mut able: Vec<(&CameraFormat, Vec<f64>)> = Vec::new();
    for format in preferred(formats, &settings.formats) {
        if let Some(rates) = rates(format, width, height) {
            able.push((format, rates));
        }
    }
    let target = settings.frames_per_second.unwrap_or(FLUENT) - RATE_TOLERANCE;
    let reaches = |rates: &[f64]| rates.first().is_none_or(|best| *best >= target);
    let fastest = |a: &&(_, Vec<f64>), b: &&(_, Vec<f64>)| {
        let best = |rates: &[f64]| rates.first().copied().unwrap_or(0.0);
        // The first of equals is preferred, and `max_by` would take the last.
        best(&a.1)
            .total_cmp(&best(&b.1))
            .then(std::cmp::Ordering::Greater)
    };
    let chosen = able.iter().find(|(_, rates)| reaches(rates));
    let chosen = chosen.or_else(|| able.iter().max_by(fastest));
    let (format, _) = chosen.ok_or_else(|| complaint(formats, settings, (width, height)))?;
    Ok(Geometry {
        width,
        height,
        fourcc: fourcc::letters(&format.fourcc).unwrap_or_default(),
        bytes_per_line: 0,
        frames_per_second: settings.frames_per_second,
    })
}

/// What the camera took instead of what was wanted, if it did.
pub(crate) fn difference(
    settings: &CameraSettings,
    wanted: &Geometry,
    got: &Geometry,
) -> Option<String> {
    let size = (wanted.width, wanted.height) != (got.width, got.height);
    let rate = settings.frames_per_second.zip(got.frames_per_second);
    let rate = rate.filter(|(wanted, got)| (wanted - got).abs() > RATE_TOLERANCE);
    (size || rate.is_some()).then(|| {
        let rate =
            rate.map(|(wanted, got)| format!(" at {got:.1} instead of {wanted:.1} frames/s"));
        format!(
            "the camera gives {}×{} instead of {}×{}{}",
            got.width,
            got.height,
            wanted.width,
            wanted.height,
            rate.unwrap_or_default()
        )
    })
}

/// The formats that may be taken, the best first.
fn preferred<'a>(
    formats: &'a [CameraFormat],
    wanted: &[PixelFormat],
) -> impl Iterator<Item = &'a CameraFormat> {
    let reading =
        |format: &CameraFormat| fourcc::letters(&format.fourcc).and_then(fourcc::pixel_format);
    let place = move |format: &CameraFormat| {
        let reading = reading(format)?;
        if wanted.is_empty() {
            fourcc::KNOWN
                .iter()
                .position(|(_, known)| *known == reading)
        } else {
            wanted.iter().position(|wanted| *wanted == reading)
        }
    };
    let mut placed: Vec<(usize, &CameraFormat)> = formats
        .iter()
        .filter_map(|format| Some((place(format)?, format)))
        .collect();
    placed.sort_by_key(|(place, _)| *place);
    placed.into_iter().map(|(_, format)| format)
}

/// The rates of a format at a size, fastest first; `None` if it does not come in that
/// size. Drivers that list no sizes take any.
fn rates(format: &CameraFormat, width: u32, height: u32) -> Option<Vec<f64>> {
    if format.sizes.is_empty() {
        return Some(Vec::new());
    }
    let size = format
        .sizes
        .iter()
        .find(|size| comes_in(size, width, height))?;
    Some(size.frames_per_second.clone())
}

fn comes_in(size: &CameraSize, width: u32, height: u32) -> bool {
    let Some(steps) = size.steps else {
        return (size.width, size.height) == (width, height);
    };
    let fits = |value: u32, min: u32, max: u32, step: u32| {
        (min..=max).contains(&value) && (value - min).is_multiple_of(step.max(1))
    };
    fits(width, steps.min_width, size.width, steps.step_width)
        && fits(height, steps.min_height, size.height, steps.step_height)
}

fn complaint(formats: &[CameraFormat], settings: &CameraSettings, size: (u32, u32)) -> String {
    let wanted: Vec<String> = settings.formats.iter().map(|f| format!("{f:?}")).collect();
    let wanted = match wanted.as_slice() {
        [] => "no readable format".to_owned(),
        some => format!("no {}", some.join(" or ")),
    };
    let offered: Vec<String> = formats.iter().map(offer).collect();
    format!(
        "{wanted} at {}×{}; it offers {}",
        size.0,
        size.1,
        offered.join("; ")
    )
}

fn offer(format: &CameraFormat) -> String {
    let more = format.sizes.len().saturating_sub(NAMED);
    let sizes = format
        .sizes
        .iter()
        .take(NAMED)
        .map(|size| match size.steps {
            None => format!("{}×{}", size.width, size.height),
            Some(steps) => {
                let SizeSteps {
                    min_width,
                    min_height,
                    ..
                } = steps;
                format!("{min_width}×{min_height} to {}×{}", size.width, size.height)
            }
        });
    let mut words: Vec<String> = sizes.collect();
    if more > 0 {
        words.push(format!("{more} more"));
    }
    let unread = if format.usable {
        ""
    } else {
        " (not read by Penumbra)"
    };
    format!("{}{unread} {}", format.fourcc, words.join(", "))
        .trim_end()
        .to_owned()
}

#[cfg(test)]
mod tests;
