//! Checks the status port, the display, its libraries, and the disk.

use super::{Check, DoctorOptions};
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};

/// Upper estimate of the data rate of two cameras with MJPEG at 1080p and 60 Hz, bytes per second.
const RECORDING_BYTES_PER_SECOND: u64 = 40_000_000;
/// Minimum recording time that should fit on the disk, minutes.
const SHORT_MINUTES: u64 = 10;

/// Libraries that winit loads at run time for every window, and their packages.
const X11_LIBRARIES: [(&str, &str); 6] = [
    ("libX11.so.6", "libx11-6"),
    ("libX11-xcb.so.1", "libx11-xcb1"),
    ("libXcursor.so.1", "libxcursor1"),
    ("libXi.so.6", "libxi6"),
    ("libXrandr.so.2", "libxrandr2"),
    ("libxkbcommon-x11.so.0", "libxkbcommon-x11-0"),
];
const WAYLAND_LIBRARIES: [(&str, &str); 2] = [
    ("libwayland-client.so.0", "libwayland-client0"),
    ("libxkbcommon.so.0", "libxkbcommon0"),
];

pub(super) fn examine(options: &DoctorOptions) -> Vec<Check> {
    let mut checks = vec![port(options.listen)];
    // macOS and Windows always have a display.
    if cfg!(all(unix, not(target_os = "macos"))) {
        let display = Display::from_environment();
        checks.push(display.check());
        checks.extend(display.libraries(&options.root));
    }
    checks.push(disk(&options.recordings));
    checks
}

fn port(listen: SocketAddr) -> Check {
    match TcpListener::bind(listen) {
        Ok(_) => Check::ok("status port", format!("{listen} is free")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => Check::warn(
            "status port",
            format!("{listen} is in use, perhaps by another penumbra"),
            format!("--listen {}:0 takes any free port", listen.ip()),
        ),
        Err(error) => Check::fail(
            "status port",
            format!("cannot listen on {listen} ({error})"),
            "--listen 127.0.0.1:0 takes any free port of this machine",
        ),
    }
}

/// The window system that a window would use.
#[derive(Debug, PartialEq, Eq)]
enum Display {
    /// None: pictures are shown in the browser and written to files.
    None,
    /// On an X server.
    X11(String),
    /// On a Wayland compositor; its socket is in the run-time folder.
    Wayland {
        name: String,
        runtime: Option<PathBuf>,
    },
}

impl Display {
    fn from_environment() -> Self {
        Self::new(|name| std::env::var(name).ok().filter(|value| !value.is_empty()))
    }

    /// Returns winit's choice: Wayland before X11.
    fn new(variable: impl Fn(&str) -> Option<String>) -> Self {
        if let Some(name) = variable("WAYLAND_DISPLAY") {
            let runtime = variable("XDG_RUNTIME_DIR").map(PathBuf::from);
            return Self::Wayland { name, runtime };
        }
        variable("DISPLAY").map_or(Self::None, Self::X11)
    }

    fn check(&self) -> Check {
        match self {
            Self::None => Check::warn(
                "display",
                "no DISPLAY or WAYLAND_DISPLAY, so no window can open",
                "run with --headless; the picture is at the status address",
            ),
            Self::X11(name) => Check::ok("display", format!("X11 {name}")),
            Self::Wayland { name, runtime } => wayland(name, runtime.as_deref()),
        }
    }

    fn libraries(&self, root: &Path) -> Option<Check> {
        let required: &[(&str, &str)] = match self {
            Self::None => return None,
            Self::X11(_) => &X11_LIBRARIES,
            Self::Wayland { .. } => &WAYLAND_LIBRARIES,
        };
        Some(libraries(required, &library_folders(root)))
    }
}

fn wayland(name: &str, runtime: Option<&Path>) -> Check {
    match runtime {
        Some(folder) if folder.join(name).exists() => {
            Check::ok("display", format!("Wayland {name}"))
        }
        Some(folder) => Check::warn(
            "display",
            format!(
                "no Wayland socket {} in XDG_RUNTIME_DIR",
                folder.join(name).display()
            ),
            "run from the desktop's own session, or with --headless",
        ),
        None => Check::warn(
            "display",
            "WAYLAND_DISPLAY is set and XDG_RUNTIME_DIR is not",
            "export XDG_RUNTIME_DIR=/run/user/$(id -u), or run with --headless",
        ),
    }
}

fn libraries(required: &[(&str, &str)], folders: &[PathBuf]) -> Check {
    let missing: Vec<&str> = required
        .iter()
        .filter(|(library, _)| !folders.iter().any(|folder| folder.join(library).exists()))
        .map(|(_, package)| *package)
        .collect();
    if missing.is_empty() {
        return Check::ok("window libraries", "all there");
    }
    Check::warn(
        "window libraries",
        format!("missing: {}", missing.join(", ")),
        format!(
            "sudo apt-get install -y --no-install-recommends {}",
            missing.join(" ")
        ),
    )
}

/// The dynamic linker's folders on Debian and the like, and LD_LIBRARY_PATH.
fn library_folders(root: &Path) -> Vec<PathBuf> {
    let triplet = format!("usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    let own = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    [triplet.as_str(), "usr/lib64", "usr/lib", "usr/local/lib"]
        .map(|folder| root.join(folder))
        .into_iter()
        .chain(std::env::split_paths(&own))
        .collect()
}

fn disk(folder: &Path) -> Check {
    let shown = folder.display();
    match free_bytes(folder) {
        Err(error) => Check::fail(
            "disk",
            format!("{shown} cannot be examined ({error})"),
            format!("mkdir -p {shown}"),
        ),
        Ok(Some(bytes)) => room(&shown.to_string(), bytes),
        Ok(None) => Check::ok("disk", format!("{shown} exists; its free space is unknown")),
    }
}

/// Returns the free space on a folder's disk, bytes; `None` on systems where it is not queried.
#[cfg(unix)]
fn free_bytes(folder: &Path) -> io::Result<Option<u64>> {
    let disk = rustix::fs::statvfs(folder)?;
    Ok(Some(disk.f_bavail.saturating_mul(disk.f_frsize)))
}

#[cfg(not(unix))]
fn free_bytes(folder: &Path) -> io::Result<Option<u64>> {
    std::fs::metadata(folder).map(|_| None)
}

fn room(shown: &str, free_bytes: u64) -> Check {
    let minutes = free_bytes / RECORDING_BYTES_PER_SECOND / 60;
    let found = format!(
        "{:.1} GB free in {shown}: about {minutes} minutes of recording",
        free_bytes as f64 * 1e-9
    );
    if minutes < SHORT_MINUTES {
        Check::warn("disk", found, "free some space, or record to another disk")
    } else {
        Check::ok("disk", found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::State;

    fn display(variables: &[(&str, &str)]) -> Display {
        Display::new(|name| {
            let found = variables.iter().find(|(key, _)| *key == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn warns_about_a_port_in_use_with_a_remedy() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let check = port(listener.local_addr().unwrap());
        assert_eq!(check.state, State::Warn);
        assert_eq!(
            check.remedy.as_deref(),
            Some("--listen 127.0.0.1:0 takes any free port")
        );
        assert_eq!(port(([127, 0, 0, 1], 0).into()).state, State::Ok);
    }

    #[test]
    fn fails_for_an_address_of_another_machine() {
        // 192.0.2.0/24 is for documentation (RFC 5737): no machine has it.
        assert_eq!(port(([192, 0, 2, 1], 0).into()).state, State::Fail);
    }

    #[test]
    fn prefers_wayland_to_x11_and_requires_its_socket() {
        let runtime = tempfile::tempdir().unwrap();
        let folder = runtime.path().to_str().unwrap();
        let both = display(&[
            ("DISPLAY", ":0"),
            ("WAYLAND_DISPLAY", "wayland-0"),
            ("XDG_RUNTIME_DIR", folder),
        ]);
        assert_eq!(both.check().state, State::Warn);
        std::fs::write(runtime.path().join("wayland-0"), "").unwrap();
        assert_eq!(both.check().found, "Wayland wayland-0");
        assert_eq!(display(&[("DISPLAY", ":0")]).check().found, "X11 :0");
        assert_eq!(display(&[]).check().state, State::Warn);
        let lost = display(&[("WAYLAND_DISPLAY", "wayland-0")]);
        assert!(lost.check().remedy.unwrap().contains("XDG_RUNTIME_DIR"));
    }

    #[test]
    fn names_the_package_of_a_missing_window_library() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("libwayland-client.so.0"), "").unwrap();
        let check = libraries(&WAYLAND_LIBRARIES, &[folder.path().to_path_buf()]);
        assert_eq!(check.found, "missing: libxkbcommon0");
        assert!(display(&[]).libraries(folder.path()).is_none());
    }

    #[test]
    fn warns_about_a_full_disk_and_fails_for_a_missing_folder() {
        assert_eq!(room("x", 1_000_000_000).state, State::Warn);
        assert_eq!(room("x", 500_000_000_000).state, State::Ok);
        assert_eq!(disk(Path::new("/no/such/folder")).state, State::Fail);
    }
}
