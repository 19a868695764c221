//! Permissions of a port, and the program that has it open.

use penumbra_interface::DeviceError;
use std::path::Path;

/// The error for a port that this user may not open; it names the group that may.
///
/// Opening again may help: for a moment after plugging in, before udev has run, a port
/// belongs to root alone.
#[cfg(unix)]
pub(super) fn not_permitted(name: &str, path: &Path) -> DeviceError {
    use std::os::unix::fs::MetadataExt;
    let group = std::fs::metadata(path)
        .ok()
        .and_then(|data| group_name(data.gid(), &std::fs::read_to_string("/etc/group").ok()?));
    let device = name.to_owned();
    match group {
        Some(group) if group != "root" => DeviceError::NotPermitted { device, group },
        _ => DeviceError::Unready {
            device,
            reason: "no permission, and no group has it; install the udev rules (`sudo make \
                     install`) and plug it in again"
                .to_owned(),
        },
    }
}

/// The error for a port that this user may not open.
#[cfg(not(unix))]
pub(super) fn not_permitted(name: &str, _path: &Path) -> DeviceError {
    DeviceError::Unready {
        device: name.to_owned(),
        reason: "no permission, or another program has it open; end that program".to_owned(),
    }
}

/// The name of a group in the text of `/etc/group`.
#[cfg(unix)]
fn group_name(gid: u32, groups: &str) -> Option<String> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        let found = fields.nth(1)?.parse() == Ok(gid);
        found.then(|| name.to_owned())
    })
}

/// The error for a port that another program has open, with that program's name and process
/// number where this user may see them.
pub(super) fn busy(path: &Path) -> DeviceError {
    let holder = holder_of(path).map_or_else(
        || "another program has it open".to_owned(),
        |holder| format!("{holder} has it open"),
    );
    DeviceError::Unready {
        device: path.display().to_string(),
        reason: format!("busy: {holder}; end that program"),
    }
}

/// The program that has `path` open. Linux only: elsewhere there is no `/proc`.
fn holder_of(path: &Path) -> Option<String> {
    let path = path.canonicalize().ok()?;
    let own = std::process::id().to_string();
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|id| *id != own && id.bytes().all(|byte| byte.is_ascii_digit()))
        .find(|id| has_open(id, &path))
        .map(|id| {
            let name = std::fs::read_to_string(format!("/proc/{id}/comm"));
            format!("{} (process {id})", name.unwrap_or_default().trim())
        })
}

fn has_open(process: &str, path: &Path) -> bool {
    let files = std::fs::read_dir(format!("/proc/{process}/fd"));
    files
        .into_iter()
        .flatten()
        .flatten()
        .any(|file| std::fs::read_link(file.path()).is_ok_and(|target| target == path))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn groups_are_found_by_number() {
        let groups = "root:x:0:\ndialout:x:20:ann,bob\nvideo:x:44:\n";
        assert_eq!(group_name(20, groups).as_deref(), Some("dialout"));
        assert_eq!(group_name(2, groups), None);
        assert_eq!(group_name(2, "broken\n::\n"), None);
    }
}
