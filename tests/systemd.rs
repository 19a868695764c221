//! The service that `make install` installs: complete, valid for systemd, confined, and removed by
//! `make uninstall`.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};

fn make(goal: &str, folder: &Path) -> Output {
    Command::new("make")
        .arg(goal)
        .arg(format!("DESTDIR={}", folder.join("root").display()))
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap()
}

/// Files below a folder, sorted.
fn files(folder: &Path, root: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, root, found);
        } else {
            found.push(path.strip_prefix(root).unwrap().display().to_string());
        }
    }
    found.sort();
}

#[test]
fn service_is_installed_valid_confined_and_removed() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    let program = folder.path().join("target/release/penumbra");
    let refused = make("install", folder.path());
    assert!(!refused.status.success(), "nothing is built");
    std::fs::create_dir_all(program.parent().unwrap()).unwrap();
    std::fs::copy(env!("CARGO_BIN_EXE_penumbra"), &program).unwrap();
    for _ in 0..2 {
        let made = make("install", folder.path());
        assert!(made.status.success(), "{made:?}");
    }
    let listed = || {
        let mut found = Vec::new();
        files(&root, &root, &mut found);
        found
    };
    let config = "etc/penumbra/rig.toml";
    let unit = "etc/systemd/system/penumbra.service";
    let (pages, others): (Vec<String>, Vec<String>) = listed()
        .into_iter()
        .partition(|name| name.starts_with("usr/local/share/man/man1/penumbra"));
    assert_eq!(
        others,
        [
            config,
            unit,
            "etc/udev/rules.d/70-penumbra.rules",
            "usr/local/bin/penumbra",
            "usr/local/lib/sysusers.d/penumbra.conf",
            "usr/local/share/bash-completion/completions/penumbra",
            "usr/local/share/fish/vendor_completions.d/penumbra.fish",
            "usr/local/share/zsh/site-functions/_penumbra",
        ]
    );
    assert!(pages.len() > 20, "{pages:?}");
    let checked = Command::new(root.join("usr/local/bin/penumbra"))
        .args(["check-config", &root.join(config).display().to_string()])
        .output()
        .unwrap();
    assert!(checked.status.success(), "{checked:?}");
    check_with_systemd(&root, &root.join(unit));
    let removed = make("uninstall", folder.path());
    assert!(removed.status.success(), "{removed:?}");
    assert_eq!(listed(), [config], "the user's configuration is kept");
}

/// Maximum exposure level by `systemd-analyze security`, of 10.
const MAX_EXPOSURE_LEVEL: f64 = 1.2;

/// Name of the test that needs systemd-analyze.
const SERVICE_TEST: &str = "service_is_installed_valid_confined_and_removed";

fn check_with_systemd(root: &Path, unit: &Path) {
    let analyze = |arguments: &[&str]| {
        let mut command = Command::new("systemd-analyze");
        command.args(arguments).arg(unit).output()
    };
    let text = std::fs::read_to_string(unit).unwrap();
    assert!(!text.contains('@') || !text.contains("@PREFIX@"), "{text}");
    // systemd requires the program at the unit's path.
    let here = root.join("usr/local/bin").display().to_string();
    std::fs::write(unit, text.replace("/usr/local/bin", &here)).unwrap();
    let Ok(verified) = analyze(&["verify"]) else {
        eprintln!("SKIPPED {SERVICE_TEST}: systemd-analyze is missing");
        return;
    };
    assert!(verified.status.success(), "{verified:?}");
    let assessed = analyze(&["security", "--offline=true", "--no-pager"]).unwrap();
    let report = String::from_utf8_lossy(&assessed.stdout).into_owned();
    let Some((_, level)) = report.split_once("Overall exposure level for penumbra.service: ")
    else {
        eprintln!(
            "SKIPPED {SERVICE_TEST}: this systemd-analyze cannot assess a unit that is not running"
        );
        return;
    };
    let level: f64 = level.split_whitespace().next().unwrap().parse().unwrap();
    assert!(level <= MAX_EXPOSURE_LEVEL, "{level}: {report}");
}
