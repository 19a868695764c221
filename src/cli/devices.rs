//! `penumbra devices`: lists the connected devices by the names that the configuration uses.

use super::ports::{self, SerialPort};
use super::say;
use clap::Args;
use penumbra_interface::{CameraControl, CameraFormat, CameraInfo, CameraSize};
use serde::Serialize;
use std::fmt::Write;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub(super) struct DevicesArgs {
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Query every serial port for a tracker: up to six seconds each
    #[arg(long)]
    probe: bool,
}

/// All connected devices. Each field is a section of the printed text.
#[derive(Debug, Serialize)]
struct Devices {
    cameras: Vec<CameraInfo>,
    serial_ports: Vec<SerialPort>,
}

pub(super) fn run(args: &DevicesArgs) -> anyhow::Result<ExitCode> {
    let devices = Devices {
        cameras: penumbra_capture::list_cameras(),
        serial_ports: ports::find(args.probe),
    };
    if args.json {
        say(serde_json::to_string_pretty(&devices)?);
    } else {
        say(describe_cameras(&devices.cameras).trim_end());
        say(ports::describe(&devices.serial_ports).trim_end());
    }
    Ok(ExitCode::SUCCESS)
}

fn describe_cameras(cameras: &[CameraInfo]) -> String {
    if cameras.is_empty() {
        return "cameras: none; plug one in (recorded sessions need none)".to_owned();
    }
    let mut text = String::from("cameras\n");
    for camera in cameras {
        // Writing to a String cannot fail.
        let _ = describe_camera(&mut text, camera);
    }
    text
}

fn describe_camera(text: &mut String, camera: &CameraInfo) -> std::fmt::Result {
    writeln!(text, "  {}", camera.identity)?;
    let origin = [&camera.driver, &camera.bus, &camera.node];
    let origin: Vec<&str> = origin
        .into_iter()
        .map(String::as_str)
        .filter(|p| !p.is_empty())
        .collect();
    writeln!(text, "    {} ({})", camera.name, origin.join(", "))?;
    if let Some(trouble) = &camera.trouble {
        writeln!(text, "    {trouble}")?;
    }
    for format in &camera.formats {
        writeln!(text, "    {}", describe_format(format))?;
    }
    let name_width = camera
        .controls
        .iter()
        .map(|c| c.name.len())
        .max()
        .unwrap_or(0);
    for control in &camera.controls {
        writeln!(text, "    {}", describe_control(control, name_width))?;
    }
    Ok(())
}

fn describe_format(format: &CameraFormat) -> String {
    let note = if format.usable {
        ""
    } else {
        " (not supported)"
    };
    let sizes: Vec<String> = format.sizes.iter().map(describe_size).collect();
    format!("{}{note}  {}", format.fourcc, sizes.join(" · "))
        .trim_end()
        .to_owned()
}

fn describe_size(size: &CameraSize) -> String {
    let from = size
        .steps
        .map(|steps| format!("{}×{} to ", steps.min_width, steps.min_height));
    let rates: Vec<String> = size
        .frames_per_second
        .iter()
        .map(|rate| format_rate(*rate))
        .collect();
    let rates = if rates.is_empty() {
        String::new()
    } else {
        format!(" @ {}", rates.join(" "))
    };
    format!(
        "{}{}×{}{rates}",
        from.unwrap_or_default(),
        size.width,
        size.height
    )
}

/// Formats a rate without trailing zeros: 30, 7.5, 29.97.
fn format_rate(rate: f64) -> String {
    let text = format!("{rate:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn describe_control(control: &CameraControl, width: usize) -> String {
    let current = control
        .current
        .map_or("-".to_owned(), |value| value.to_string());
    let range = if control.menu.is_empty() {
        let step = if control.step > 1 {
            format!(" by {}", control.step)
        } else {
            String::new()
        };
        format!("{} to {}{step}", control.min, control.max)
    } else {
        let items = control
            .menu
            .iter()
            .map(|(value, meaning)| format!("{value} {meaning}"));
        items.collect::<Vec<_>>().join(", ")
    };
    let mut words = vec![range, format!("default {}", control.default)];
    words.extend(control.flags.iter().cloned());
    format!(
        "{:width$}  {current:>6}  ({})",
        control.name,
        words.join("; ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn webcam() -> CameraInfo {
        let control = |name: &str, menu, flags| CameraControl {
            name: name.into(),
            kind: "integer".into(),
            min: 3,
            max: 2047,
            step: 1,
            default: 250,
            current: Some(157),
            menu,
            flags,
        };
        CameraInfo {
            identity: "usb-046d_C270-video-index0".into(),
            name: "C270".into(),
            driver: "uvcvideo".into(),
            node: "/dev/video0".into(),
            formats: vec![CameraFormat {
                fourcc: "MJPG".into(),
                description: "Motion-JPEG".into(),
                usable: true,
                sizes: vec![CameraSize {
                    width: 1280,
                    height: 720,
                    steps: None,
                    frames_per_second: vec![30.0, 7.5],
                }],
            }],
            controls: vec![
                control("exposure_time_absolute", vec![], vec!["inactive".into()]),
                control("auto_exposure", vec![(1, "Manual Mode".into())], vec![]),
            ],
            ..CameraInfo::default()
        }
    }

    #[test]
    fn describes_modes_and_controls_of_a_camera() {
        let text = describe_cameras(&[webcam()]);
        let expected = "cameras
  usb-046d_C270-video-index0
    C270 (uvcvideo, /dev/video0)
    MJPG  1280×720 @ 30 7.5
    exposure_time_absolute     157  (3 to 2047; default 250; inactive)
    auto_exposure              157  (1 Manual Mode; default 250)
";
        assert_eq!(text, expected);
    }

    #[test]
    fn shows_why_a_camera_cannot_be_opened() {
        let camera = CameraInfo {
            trouble: Some("/dev/video0: no permission".into()),
            ..CameraInfo::default()
        };
        assert!(describe_cameras(&[camera]).contains("no permission"));
        assert!(describe_cameras(&[]).starts_with("cameras: none"));
    }

    #[test]
    fn json_has_controls_flags_and_rates() {
        let cameras = vec![webcam()];
        let json = serde_json::to_value(Devices {
            cameras,
            serial_ports: Vec::new(),
        })
        .unwrap();
        let control = &json["cameras"][0]["controls"][0];
        assert_eq!(control["name"], "exposure_time_absolute");
        assert_eq!(control["flags"][0], "inactive");
        assert_eq!(
            json["cameras"][0]["formats"][0]["sizes"][0]["frames_per_second"][1],
            7.5
        );
    }
}
