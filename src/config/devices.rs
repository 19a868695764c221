//! Settings of the devices: the sections of the file, the settings, and the conversion.

use super::range::{Result, millis, set, whole, within};
use crate::REPLAY_PREFIX;
use crate::{CameraSource, TrackerSource};
use penumbra_interface::{BayerPattern, BracketSettings, CameraSettings, OnChange, PixelFormat};
use penumbra_strict_toml::Fault;
use penumbra_tracker_serial::{AnyDecoder, PROTOCOLS, PortName};
use serde::de::{self, Deserializer, Visitor};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// The section of a camera.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct CameraFile {
    pub device: Option<String>,
    pub width: Option<u32>,
    pub height: Option<u32>,
    pub frames_per_second: Option<f64>,
    pub formats: Option<Vec<FormatName>>,
    pub buffers: Option<u32>,
    pub gain_per_unit: Option<f64>,
    pub on_control_change: Option<ControlChange>,
    pub silent_after_ms: Option<f64>,
    pub brackets_ev: Option<Vec<f64>>,
    pub bracket_hold: Option<u32>,
    pub bracket_lag: Option<u32>,
    pub controls: Option<BTreeMap<String, ControlValue>>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TrackerFile {
    pub device: Option<String>,
    pub protocol: Option<String>,
    pub baud: Option<u32>,
    pub station: Option<u32>,
    pub hemisphere: Option<Hemisphere>,
    pub units: Option<TrackerUnits>,
    pub silent_after_ms: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct CalibrationFile {
    pub from: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RecordingFile {
    pub folder: Option<String>,
    pub max_duration_s: Option<f64>,
    pub reserve_mb: Option<f64>,
    pub composite: Option<bool>,
}

/// Pixel format of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum FormatName {
    /// Motion JPEG.
    Mjpeg,
    /// 4:2:2 packed.
    Yuyv,
    /// 4:2:0 in two planes.
    Nv12,
    /// Three bytes a pixel.
    Rgb24,
    /// One byte a pixel.
    Grey,
    /// Bayer mosaic that begins R G / G B, one byte a pixel.
    #[serde(rename = "bayer-rggb")]
    BayerRggb,
    /// B G / G R.
    #[serde(rename = "bayer-bggr")]
    BayerBggr,
    /// G R / B G.
    #[serde(rename = "bayer-grbg")]
    BayerGrbg,
    /// G B / R G.
    #[serde(rename = "bayer-gbrg")]
    BayerGbrg,
}

impl FormatName {
    /// Returns the format for the drivers.
    #[must_use]
    pub const fn format(self) -> PixelFormat {
        match self {
            Self::Mjpeg => PixelFormat::Jpeg,
            Self::Yuyv => PixelFormat::Yuyv,
            Self::Nv12 => PixelFormat::Nv12,
            Self::Rgb24 => PixelFormat::Rgb8,
            Self::Grey => PixelFormat::Grey8,
            Self::BayerRggb => PixelFormat::Bayer8(BayerPattern::Rggb),
            Self::BayerBggr => PixelFormat::Bayer8(BayerPattern::Bggr),
            Self::BayerGrbg => PixelFormat::Bayer8(BayerPattern::Grbg),
            Self::BayerGbrg => PixelFormat::Bayer8(BayerPattern::Gbrg),
        }
    }
}

/// Reaction when another program changes a locked control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ControlChange {
    /// Restore the locked value.
    Restore,
    /// Keep the new value and report it in status.
    Report,
}

/// A control's value: a number, or true and false for 1 and 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControlValue(pub i64);

impl<'de> Deserialize<'de> for ControlValue {
    fn deserialize<D: Deserializer<'de>>(d: D) -> std::result::Result<Self, D::Error> {
        struct Reader;
        impl Visitor<'_> for Reader {
            type Value = ControlValue;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a whole number, true or false")
            }

            fn visit_bool<E: de::Error>(self, v: bool) -> std::result::Result<ControlValue, E> {
                Ok(ControlValue(i64::from(v)))
            }

            fn visit_i64<E: de::Error>(self, v: i64) -> std::result::Result<ControlValue, E> {
                Ok(ControlValue(v))
            }
        }
        d.deserialize_any(Reader)
    }
}

/// Hemisphere around the transmitter in which the receiver stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Hemisphere {
    /// +X.
    #[default]
    Forward,
    /// −X.
    Back,
    /// +Y.
    Right,
    /// −Y.
    Left,
    /// +Z, which points down.
    Lower,
    /// −Z.
    Upper,
}

/// Unit of a tracker whose unit can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TrackerUnits {
    /// 0.0254 m.
    Inches,
    /// 0.01 m.
    Centimetres,
}

impl TrackerUnits {
    /// Returns the length of the unit, metres.
    #[must_use]
    pub const fn metres(self) -> f64 {
        match self {
            Self::Inches => 0.0254,
            Self::Centimetres => 0.01,
        }
    }

    /// Returns the unit of length `metres`; `None` if trackers do not support it.
    #[must_use]
    pub fn from_metres(metres: f64) -> Option<Self> {
        let same = |unit: &Self| (unit.metres() - metres).abs() < 1e-6;
        [Self::Inches, Self::Centimetres].into_iter().find(same)
    }
}

/// `[tracker]`, for a real tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerConfig {
    /// A serial port, `udp:ADDRESS:PORT` or `vrpn:NAME@HOST`.
    pub device: String,
    /// Protocol name, such as `fastrak`.
    pub protocol: String,
    /// Line speed; the protocol's default if `None`.
    pub baud: Option<u32>,
    /// Receiver that carries the scene camera, from 1.
    pub station: u8,
    /// Hemisphere in which the receiver stays.
    pub hemisphere: Hemisphere,
    /// Unit that the device is set to; the calibration's if `None`.
    pub units: Option<TrackerUnits>,
    /// Time without a record after which the tracker is opened again, nanoseconds.
    pub silent_after_nanos: i64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            device: String::new(),
            protocol: "fastrak".to_owned(),
            baud: None,
            station: 1,
            hemisphere: Hemisphere::default(),
            units: None,
            silent_after_nanos: 1_000_000_000,
        }
    }
}

/// `[recording]`
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingConfig {
    /// Folder of recordings that are started from the dashboard.
    pub folder: PathBuf,
    /// Maximum duration of a recording, nanoseconds; unlimited if `None`.
    pub max_duration_nanos: Option<i64>,
    /// Space to leave free on the disk, bytes.
    pub reserve_bytes: u64,
    /// Whether the composited pictures are recorded, too.
    pub composite: bool,
}

impl Default for RecordingConfig {
    fn default() -> Self {
        Self {
            folder: PathBuf::from("recordings"),
            max_duration_nanos: None,
            reserve_bytes: 1_000_000_000,
            composite: false,
        }
    }
}

/// Converts the section of a camera; `None` if it names none. `section` is for messages.
pub(super) fn camera(
    section: &str,
    mut file: CameraFile,
    folder: &Path,
) -> Result<Option<CameraSource>> {
    let device = file.device.take();
    let device = match device.as_deref() {
        None => return no_camera(section, &file),
        Some("") => {
            let reason = "expected a camera's name (`penumbra devices` lists them), \"auto\" for \
                          the only one, or \"replay:FILE.mcap\"";
            return Err(Fault::new(format!("{section}.device"), reason));
        }
        Some("auto") => "",
        Some(device) => device,
    };
    if let Some(path) = device.strip_prefix(REPLAY_PREFIX) {
        return Ok(Some(CameraSource::Replay(folder.join(path))));
    }
    let settings = settings(section, device, file)?;
    Ok(Some(CameraSource::System(settings)))
}

/// Refuses settings without a `device`, which was probably forgotten.
fn no_camera(section: &str, file: &CameraFile) -> Result<Option<CameraSource>> {
    let locks = file
        .controls
        .as_ref()
        .is_some_and(|locks| !locks.is_empty());
    let meant = file.width.is_some() || file.formats.is_some() || locks;
    if meant {
        let reason = "the camera is not named; add `device`";
        return Err(Fault::new(section, reason));
    }
    Ok(None)
}

fn settings(section: &str, device: &str, file: CameraFile) -> Result<CameraSettings> {
    let key = |name: &str| format!("{section}.{name}");
    let mut out = CameraSettings {
        device: device.to_owned(),
        bracket: bracket(section, &file)?,
        ..CameraSettings::default()
    };
    set(
        &mut out.width,
        whole(&key("width"), file.width, 1..=16_384)?,
    );
    set(
        &mut out.height,
        whole(&key("height"), file.height, 1..=16_384)?,
    );
    let rate = within(
        &key("frames_per_second"),
        file.frames_per_second,
        0.1..=1000.0,
    )?;
    out.frames_per_second = rate;
    let formats = file.formats.unwrap_or_default();
    out.formats = formats.into_iter().map(FormatName::format).collect();
    set(
        &mut out.buffers,
        whole(&key("buffers"), file.buffers, 2..=32)?,
    );
    out.gain_per_unit = within(&key("gain_per_unit"), file.gain_per_unit, 1e-6..=1e6)?;
    set(
        &mut out.on_change,
        file.on_control_change.map(|change| match change {
            ControlChange::Restore => OnChange::Restore,
            ControlChange::Report => OnChange::Report,
        }),
    );
    let controls = file.controls.unwrap_or_default();
    out.controls = controls.into_iter().map(|(name, v)| (name, v.0)).collect();
    let silence = millis(
        &key("silent_after_ms"),
        file.silent_after_ms,
        100.0..=60_000.0,
    )?;
    set(
        &mut out.silence,
        silence.map(|nanos| std::time::Duration::from_nanos(nanos.unsigned_abs())),
    );
    Ok(out)
}

fn bracket(section: &str, file: &CameraFile) -> Result<Option<BracketSettings>> {
    let key = format!("{section}.brackets_ev");
    let Some(stops) = &file.brackets_ev else {
        if file.bracket_hold.is_some() || file.bracket_lag.is_some() {
            return Err(Fault::new(
                section,
                "the exposures are missing; add `brackets_ev`",
            ));
        }
        return Ok(None);
    };
    let sane = stops.len() <= 16 && stops.iter().all(|ev| (-30.0..=30.0).contains(ev));
    if !sane || !stops.contains(&0.0) {
        let reason =
            "expected at most 16 stops between -30 and 30, one of them 0 (the base exposure)";
        return Err(Fault::new(key, reason));
    }
    let mut out = BracketSettings {
        stops: stops.clone(),
        ..BracketSettings::default()
    };
    let hold = whole(
        &format!("{section}.bracket_hold"),
        file.bracket_hold,
        1..=30,
    )?;
    set(&mut out.hold, hold);
    out.lag = whole(&format!("{section}.bracket_lag"), file.bracket_lag, 0..=10)?;
    Ok(Some(out))
}

pub(super) fn tracker(file: TrackerFile, folder: &Path) -> Result<Option<TrackerSource>> {
    let Some(device) = file.device else {
        if file.baud.is_some() {
            return Err(Fault::new(
                "tracker",
                "the tracker's connection is missing; add `device`",
            ));
        }
        return Ok(None);
    };
    if let Some(path) = device.strip_prefix(REPLAY_PREFIX) {
        return Ok(Some(TrackerSource::Replay(folder.join(path))));
    }
    if device.trim().is_empty() {
        let reason = "expected a serial port, \"udp:ADDRESS:PORT\", \"vrpn:NAME@HOST\" or \
                      \"replay:FILE.mcap\"";
        return Err(Fault::new("tracker.device", reason));
    }
    let mut out = TrackerConfig {
        device,
        ..TrackerConfig::default()
    };
    set(&mut out.protocol, file.protocol);
    if AnyDecoder::for_protocol(&out.protocol).is_none() {
        return Err(unknown_protocol(&out.protocol));
    }
    if let Err(reason) = PortName::parse(&out.device) {
        return Err(Fault::new("tracker.device", reason));
    }
    out.baud = whole("tracker.baud", file.baud, 300..=4_000_000)?;
    let station = whole("tracker.station", file.station, 1..=16)?;
    set(&mut out.station, station.map(|station| station as u8));
    set(&mut out.hemisphere, file.hemisphere);
    out.units = file.units;
    let silent = millis(
        "tracker.silent_after_ms",
        file.silent_after_ms,
        100.0..=60_000.0,
    )?;
    set(&mut out.silent_after_nanos, silent);
    Ok(Some(TrackerSource::System(Box::new(out))))
}

fn unknown_protocol(name: &str) -> Fault {
    let near = |known: &&&str| strsim::jaro_winkler(known, name) > 0.8;
    let meant = PROTOCOLS.iter().find(near);
    let meant = meant.map_or(String::new(), |known| format!(" (did you mean {known:?}?)"));
    let all = PROTOCOLS.join(", ");
    Fault::new(
        "tracker.protocol",
        format!("{name:?} is not a known protocol{meant}; expected one of {all}"),
    )
}

pub(super) fn recording(
    file: RecordingFile,
    folder: &Path,
    out: &mut RecordingConfig,
) -> Result<()> {
    set(&mut out.folder, file.folder.map(|path| folder.join(path)));
    let seconds = within("recording.max_duration_s", file.max_duration_s, 1.0..=1e7)?;
    out.max_duration_nanos = seconds.map(|seconds| (seconds * 1e9) as i64);
    let reserve = within("recording.reserve_mb", file.reserve_mb, 0.0..=1e9)?;
    set(&mut out.reserve_bytes, reserve.map(|mb| (mb * 1e6) as u64));
    set(&mut out.composite, file.composite);
    Ok(())
}
