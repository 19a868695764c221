//! Chooses the camera mode that fits the settings best.

use crate::device::CaptureFormat;
use crate::fourcc;
use penumbra_interface::{CameraFormat, CameraSettings, CameraSize, PixelFormat, SizeSteps};

/// Frames per second that a format should reach if the settings ask for no rate.
const DEFAULT_RATE: f64 = 25.0;
/// Frames per second by which rates may differ and still count as equal: 29.97 is 30.
const RATE_TOLERANCE: f64 = 0.5;
/// Sizes listed per format in an error message.
const MAX_SIZES_LISTED: usize = 8;

/// The format to request from the driver: the most preferred one that reaches the wanted rate
/// at the wanted size, or the fastest one if none does.
///
/// # Errors
/// The camera does not offer the size or a format; the message lists what it offers.
pub(crate) fn choose(
    formats: &[CameraFormat],
    settings: &CameraSettings,
    present: &CaptureFormat,
) -> Result<CaptureFormat, String> {
    let (width, height) = match (settings.width, settings.height) {
        (0, _) | (_, 0) => (present.width, present.height),
        wanted => wanted,
    };
    let candidates: Vec<(&CameraFormat, Vec<f64>)> = by_preference(formats, &settings.formats)
        .filter_map(|format| Some((format, rates(format, width, height)?)))
        .collect();
    let wanted_rate = settings.frames_per_second.unwrap_or(DEFAULT_RATE) - RATE_TOLERANCE;
    let reaches = |rates: &[f64]| rates.first().is_none_or(|best| *best >= wanted_rate);
    let fastest = |a: &&(_, Vec<f64>), b: &&(_, Vec<f64>)| {
        let best = |rates: &[f64]| rates.first().copied().unwrap_or(0.0);
        // `max_by` takes the last of equals, and the first is preferred.
        best(&a.1)
            .total_cmp(&best(&b.1))
            .then(std::cmp::Ordering::Greater)
    };
    let chosen = candidates.iter().find(|(_, rates)| reaches(rates));
    let chosen = chosen.or_else(|| candidates.iter().max_by(fastest));
    let (format, _) = chosen.ok_or_else(|| not_offered(formats, settings, (width, height)))?;
    Ok(CaptureFormat {
        width,
        height,
        fourcc: fourcc::from_text(&format.fourcc).unwrap_or_default(),
        bytes_per_line: 0,
        frames_per_second: settings.frames_per_second,
    })
}

/// A note for the user if the driver set another size or rate than requested.
pub(crate) fn deviation_note(
    settings: &CameraSettings,
    wanted: &CaptureFormat,
    got: &CaptureFormat,
) -> Option<String> {
    let is_other_size = (wanted.width, wanted.height) != (got.width, got.height);
    let rates = settings.frames_per_second.zip(got.frames_per_second);
    let rates = rates.filter(|(wanted, got)| (wanted - got).abs() > RATE_TOLERANCE);
    if !is_other_size && rates.is_none() {
        return None;
    }
    let rate = rates.map_or_else(String::new, |(wanted, got)| {
        format!(" at {got:.1} instead of {wanted:.1} frames/s")
    });
    Some(format!(
        "the camera gives {}×{} instead of {}×{}{rate}",
        got.width, got.height, wanted.width, wanted.height
    ))
}

/// The formats that Penumbra reads and the settings allow, most preferred first.
fn by_preference<'a>(
    formats: &'a [CameraFormat],
    allowed: &[PixelFormat],
) -> impl Iterator<Item = &'a CameraFormat> {
    let rank = |format: &CameraFormat| {
        let pixels = fourcc::from_text(&format.fourcc).and_then(fourcc::pixel_format)?;
        if allowed.is_empty() {
            fourcc::KNOWN.iter().position(|(_, known)| *known == pixels)
        } else {
            allowed.iter().position(|allowed| *allowed == pixels)
        }
    };
    let mut ranked: Vec<(usize, &CameraFormat)> = formats
        .iter()
        .filter_map(|format| Some((rank(format)?, format)))
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().map(|(_, format)| format)
}

/// The rates of a format at a size, fastest first; `None` if it does not offer the size. A
/// driver that lists no sizes takes any.
fn rates(format: &CameraFormat, width: u32, height: u32) -> Option<Vec<f64>> {
    if format.sizes.is_empty() {
        return Some(Vec::new());
    }
    let mut sizes = format.sizes.iter();
    let size = sizes.find(|size| includes(size, width, height))?;
    Some(size.frames_per_second.clone())
}

fn includes(size: &CameraSize, width: u32, height: u32) -> bool {
    let Some(steps) = size.steps else {
        return (size.width, size.height) == (width, height);
    };
    let fits = |value: u32, min: u32, max: u32, step: u32| {
        (min..=max).contains(&value) && (value - min).is_multiple_of(step.max(1))
    };
    fits(width, steps.min_width, size.width, steps.step_width)
        && fits(height, steps.min_height, size.height, steps.step_height)
}

fn not_offered(formats: &[CameraFormat], settings: &CameraSettings, size: (u32, u32)) -> String {
    let wanted: Vec<String> = settings.formats.iter().map(|f| format!("{f:?}")).collect();
    let wanted = match wanted.as_slice() {
        [] => "no readable format".to_owned(),
        some => format!("no {}", some.join(" or ")),
    };
    let offered: Vec<String> = formats.iter().map(describe).collect();
    format!(
        "{wanted} at {}×{}; it offers {}",
        size.0,
        size.1,
        offered.join("; ")
    )
}

/// A format and its sizes, in one line.
fn describe(format: &CameraFormat) -> String {
    let size = |size: &CameraSize| match size.steps {
        None => format!("{}×{}", size.width, size.height),
        Some(SizeSteps {
            min_width,
            min_height,
            ..
        }) => format!("{min_width}×{min_height} to {}×{}", size.width, size.height),
    };
    let mut sizes: Vec<String> = format
        .sizes
        .iter()
        .take(MAX_SIZES_LISTED)
        .map(size)
        .collect();
    if format.sizes.len() > MAX_SIZES_LISTED {
        sizes.push(format!("{} more", format.sizes.len() - MAX_SIZES_LISTED));
    }
    let remark = if format.usable {
        ""
    } else {
        " (not read by Penumbra)"
    };
    format!("{}{remark} {}", format.fourcc, sizes.join(", "))
        .trim_end()
        .to_owned()
}

#[cfg(test)]
mod tests;
