//! Who may open a port, and who has it open: for messages.

use std::path::Path;

/// Why opening was refused and what to do: the file's group, by name, and the command that
/// puts the user into it.
#[cfg(unix)]
pub(super) fn permission_hint(path: &Path) -> String {
    use std::os::unix::fs::MetadataExt;
    let group = std::fs::metadata(path)
        .ok()
        .and_then(|data| group_name(data.gid(), &std::fs::read_to_string("/etc/group").ok()?));
    match group {
        Some(group) if group != "root" => format!(
            "no permission: this user is not in the group {group}; run \
             `sudo usermod -aG {group} $USER` and log in again"
        ),
        _ => "no permission, and no group has it; install the udev rules (`sudo make install`) \
              and plug it in again"
            .to_owned(),
    }
}

#[cfg(not(unix))]
pub(super) fn permission_hint(_path: &Path) -> String {
    "no permission, or another program has it open; end that program".to_owned()
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

/// The program that has `path` open, as name and number, as far as this user may know.
pub(super) fn holder_of(path: &Path) -> Option<String> {
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
