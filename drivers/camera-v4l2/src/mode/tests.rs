use super::*;
use crate::testing::format;

/// A typical webcam: uncompressed frames at full rate in small sizes only.
fn webcam() -> Vec<CameraFormat> {
    vec![
        format(
            b"MJPG",
            &[(1920, 1080, 30.0), (1280, 720, 60.0), (640, 480, 60.0)],
        ),
        format(
            b"YUYV",
            &[(1920, 1080, 5.0), (1280, 720, 10.0), (640, 480, 30.0)],
        ),
        format(b"H264", &[(1920, 1080, 30.0)]),
    ]
}

fn present() -> CaptureFormat {
    CaptureFormat {
        width: 640,
        height: 480,
        ..CaptureFormat::default()
    }
}

fn chosen(settings: &CameraSettings) -> Result<(String, u32, u32), String> {
    let mode = choose(&webcam(), settings, &present())?;
    Ok((fourcc::to_text(mode.fourcc), mode.width, mode.height))
}

fn sized(width: u32, height: u32, rate: Option<f64>) -> CameraSettings {
    CameraSettings {
        width,
        height,
        frames_per_second: rate,
        ..CameraSettings::default()
    }
}

#[test]
fn uncompressed_formats_are_preferred_at_sufficient_rates() {
    let mode = |settings| chosen(&settings).unwrap().0;
    assert_eq!(
        chosen(&sized(0, 0, None)).unwrap(),
        ("YUYV".into(), 640, 480)
    );
    assert_eq!(mode(sized(640, 480, Some(60.0))), "MJPG");
    assert_eq!(mode(sized(1280, 720, None)), "MJPG");
    assert_eq!(mode(sized(1280, 720, Some(10.0))), "YUYV");
    assert_eq!(mode(sized(640, 480, Some(29.97))), "YUYV");
}

#[test]
fn the_fastest_format_is_taken_if_none_is_fast_enough() {
    assert_eq!(chosen(&sized(1920, 1080, Some(120.0))).unwrap().0, "MJPG");
}

#[test]
fn the_order_of_formats_in_the_settings_is_kept() {
    let mut settings = sized(640, 480, Some(30.0));
    settings.formats = vec![PixelFormat::Jpeg, PixelFormat::Yuyv];
    assert_eq!(chosen(&settings).unwrap().0, "MJPG");
    settings.formats = vec![PixelFormat::Nv12, PixelFormat::Yuyv];
    assert_eq!(chosen(&settings).unwrap().0, "YUYV");
}

#[test]
fn error_lists_offered_modes() {
    let mut settings = sized(800, 600, None);
    let error = chosen(&settings).unwrap_err();
    assert!(
        error.starts_with("no readable format at 800×600; it offers MJPG 1920×1080"),
        "{error}"
    );
    assert!(
        error.contains("H264 (not read by Penumbra) 1920×1080"),
        "{error}"
    );
    settings.formats = vec![PixelFormat::Grey8];
    assert!(
        chosen(&settings)
            .unwrap_err()
            .starts_with("no Grey8 at 800×600")
    );
}

#[test]
fn size_ranges_and_drivers_without_size_lists_are_supported() {
    let mut stepwise = format(b"NV12", &[(1920, 1080, 30.0)]);
    stepwise.sizes[0].steps = Some(SizeSteps {
        min_width: 32,
        min_height: 32,
        step_width: 16,
        step_height: 2,
    });
    let fits = |width, height| choose(&[stepwise.clone()], &sized(width, height, None), &present());
    assert!(fits(640, 482).is_ok());
    assert!(fits(640, 481).is_err());
    assert!(fits(16, 32).is_err());
    assert!(fits(1936, 1080).is_err());
    let without_sizes = format(b"GREY", &[]);
    assert!(choose(&[without_sizes], &sized(123, 45, None), &present()).is_ok());
}

#[test]
fn other_size_or_rate_is_noted() {
    let wanted = CaptureFormat {
        frames_per_second: Some(30.0),
        ..present()
    };
    let settings = sized(640, 480, Some(30.0));
    assert_eq!(deviation_note(&settings, &wanted, &wanted), None);
    let slow = CaptureFormat {
        frames_per_second: Some(15.0),
        ..wanted
    };
    let note = deviation_note(&settings, &wanted, &slow).unwrap();
    assert!(note.ends_with("at 15.0 instead of 30.0 frames/s"), "{note}");
}
