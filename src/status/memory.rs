//! How much memory the program uses, and how much it may use. Linux; unknown elsewhere.

use serde::Serialize;
use std::fs::read_to_string;
use std::path::Path;

/// Share of the allowed memory from which the user is warned.
const NEARLY_ALL: f64 = 0.9;

/// Memory of the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Memory {
    /// Memory that is resident, bytes.
    pub resident_bytes: Option<u64>,
    /// What the service or container may use (control groups, version 2), else all memory of the
    /// machine, bytes.
    pub limit_bytes: Option<u64>,
}

impl Memory {
    /// The present state.
    #[must_use]
    pub fn now() -> Self {
        let read = |path: &str| read_to_string(path).ok();
        let resident = read("/proc/self/status");
        let machine = read("/proc/meminfo");
        let group = read("/proc/self/cgroup")
            .and_then(|text| group_limit(group_path(&text)?, Path::new("/sys/fs/cgroup")));
        let machine = machine.and_then(|text| kibibytes(&text, "MemTotal:"));
        Self {
            resident_bytes: resident.and_then(|text| kibibytes(&text, "VmRSS:")),
            limit_bytes: [group, machine].into_iter().flatten().min(),
        }
    }

    /// What to tell the user if nearly all is used.
    #[must_use]
    pub fn warning(self) -> Option<&'static str> {
        let (used, limit) = (self.resident_bytes?, self.limit_bytes?);
        (used as f64 > NEARLY_ALL * limit as f64).then_some(
            "memory: more than nine tenths of what the program may use is in use; take a smaller \
             scene, a smaller picture or fewer viewers, or raise MemoryMax of the service",
        )
    }
}

/// The value of a line `KEY N kB`, bytes.
fn kibibytes(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    let number: u64 = line.split_whitespace().next()?.parse().ok()?;
    number.checked_mul(1024)
}

/// The path of the process's group in the unified hierarchy.
fn group_path(text: &str) -> Option<&str> {
    let path = text.lines().find_map(|line| line.strip_prefix("0::/"))?;
    let is_inside = !path.split('/').any(|part| part == "..");
    is_inside.then_some(path)
}

/// The least limit of a group and those around it.
fn group_limit(path: &str, root: &Path) -> Option<u64> {
    let limit = |group: &Path| -> Option<u64> {
        let text = read_to_string(group.join("memory.max")).ok()?;
        text.trim().parse().ok()
    };
    let group = root.join(path);
    let around = group
        .ancestors()
        .take_while(|group| group.starts_with(root));
    around.filter_map(limit).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_the_kernel_tables() {
        let status = "Name:\tpenumbra\nVmRSS:\t   1234 kB\nThreads:\t7\n";
        assert_eq!(kibibytes(status, "VmRSS:"), Some(1234 * 1024));
        assert_eq!(kibibytes(status, "VmSwap:"), None);
        assert_eq!(kibibytes("VmRSS: x kB", "VmRSS:"), None);
        assert_eq!(kibibytes("VmRSS: 18446744073709551615 kB", "VmRSS:"), None);
        assert_eq!(
            group_path("1:name=x:/y\n0::/system.slice/a\n"),
            Some("system.slice/a")
        );
        assert_eq!(group_path("0::/../outside\n"), None);
    }

    #[test]
    fn the_least_limit_of_the_groups_around_holds() {
        let root = tempfile::tempdir().unwrap();
        let inner = root.path().join("system.slice/penumbra.service");
        std::fs::create_dir_all(&inner).unwrap();
        let limit = || group_limit("system.slice/penumbra.service", root.path());
        assert_eq!(limit(), None);
        std::fs::write(inner.join("memory.max"), "max\n").unwrap();
        std::fs::write(root.path().join("system.slice/memory.max"), "4096\n").unwrap();
        assert_eq!(limit(), Some(4096));
        std::fs::write(inner.join("memory.max"), "1024\n").unwrap();
        assert_eq!(limit(), Some(1024));
    }

    #[test]
    fn warns_when_nearly_all_is_used() {
        let memory = |used, limit| Memory {
            resident_bytes: Some(used),
            limit_bytes: limit,
        };
        assert_eq!(memory(90, Some(100)).warning(), None);
        assert!(memory(91, Some(100)).warning().unwrap().contains("memory"));
        assert_eq!(memory(91, None).warning(), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_process_uses_less_than_it_may() {
        let Memory {
            resident_bytes,
            limit_bytes,
        } = Memory::now();
        let used = resident_bytes.unwrap();
        assert!(used > 1 << 20 && used < limit_bytes.unwrap());
    }
}
