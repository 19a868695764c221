#![expect(clippy::unwrap_used)]
use super::*;
use crate::port::testing::PtyPair;
use proptest::prelude::*;
use serialport::Parity;
use std::fs::{OpenOptions, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

const DEFAULT: LineSettings = LineSettings::new(115_200, Parity::None);

fn open_at(path: &Path, settings: LineSettings) -> Result<NativePort, DeviceError> {
    open_port(&path.to_string_lossy(), path, settings)
}

/// Whether the system refuses to open the port, as it does in exclusive mode. It never refuses
/// root, so root asks as another user.
fn is_exclusive(path: &Path) -> bool {
    let opened = OpenOptions::new().read(true).write(true).open(path);
    if let Err(error) = opened {
        assert_eq!(error.kind(), ErrorKind::ResourceBusy, "{error}");
        return true;
    }
    std::fs::set_permissions(path, Permissions::from_mode(0o666)).unwrap();
    let shell = Command::new("sh")
        .args(["-c", "exec 3<>\"$0\"", &path.to_string_lossy()])
        .uid(65_534)
        .stderr(Stdio::null())
        .status();
    shell.is_ok_and(|status| !status.success())
}

#[test]
fn an_open_port_is_exclusive_until_it_is_dropped() {
    let pty = PtyPair::open();
    assert!(!is_exclusive(&pty.path));
    let port = open_at(&pty.path, DEFAULT).unwrap();
    assert!(is_exclusive(&pty.path));
    // A refused attempt must leave the port to its holder.
    let error = open_at(&pty.path, DEFAULT).unwrap_err().to_string();
    assert!(error.contains("busy"), "{error}");
    assert!(is_exclusive(&pty.path));
    drop(port);
    assert!(!is_exclusive(&pty.path));
    open_at(&pty.path, DEFAULT).unwrap();
}

#[test]
fn a_port_whose_device_is_gone_is_not_found() {
    let PtyPair { device, path, .. } = PtyPair::open();
    drop(device);
    let error = open_at(&path, DEFAULT).unwrap_err();
    assert!(matches!(error, DeviceError::NotFound { .. }), "{error}");
}

#[test]
fn recoverable_errors_are_distinguished() {
    let pty = PtyPair::open();
    let preflight = native::preflight(&pty.path).unwrap();
    let message = |kind| {
        let error = serialport::Error::new(kind, "reason");
        configure_error("port", &pty.path, &error, &preflight).to_string()
    };
    assert!(message(serialport::ErrorKind::NoDevice).contains("busy"));
    assert!(message(serialport::ErrorKind::Unknown).contains("cannot be set up"));
    drop(pty.device);
    assert!(message(serialport::ErrorKind::Unknown).contains("not connected"));
    let error = preflight_error("port", &pty.path, &ErrorKind::PermissionDenied.into());
    assert_eq!(error.recovery(), penumbra_interface::Recovery::Reopen);
}

#[test]
fn rate_of_zero_is_refused() {
    let pty = PtyPair::open();
    let error = open_at(&pty.path, LineSettings::new(0, Parity::None)).unwrap_err();
    assert!(error.to_string().contains("set another `baud`"), "{error}");
    open_at(&pty.path, DEFAULT).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A pseudo-terminal accepts some settings and ignores others without an error.
    #[test]
    fn any_settings_are_accepted_or_refused_and_leave_the_port_usable(
        baud in prop_oneof![any::<u32>(), 0..200_000u32],
        parity in prop::sample::select(vec![Parity::None, Parity::Odd, Parity::Even]),
    ) {
        let pty = PtyPair::open();
        match open_at(&pty.path, LineSettings::new(baud, parity)) {
            Ok(port) => {
                prop_assert_eq!(port.baud_rate().unwrap(), baud);
                prop_assert!(open_at(&pty.path, DEFAULT).is_err());
            }
            Err(error) => {
                let text = error.to_string();
                prop_assert!(text.starts_with("/dev/pts/") && !text.contains('\n'), "{}", text);
            }
        }
        prop_assert!(open_at(&pty.path, DEFAULT).is_ok());
    }
}
