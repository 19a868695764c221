//! `.ci/cross` with a compiler that only notes how it is called: what is checked, and what is skipped by name.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used)]

use std::fs::{create_dir_all, read_to_string, write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

const WINDOWS: &str = "x86_64-pc-windows-gnu";
const MACOS: &str = "aarch64-apple-darwin";
const MINGW: [&str; 3] = ["gcc", "g++", "ar"];

/// Runs the script with nothing on its path but common tools, a `rustc` with these targets, a `cargo` that
/// ends with `status`, and MinGW if wanted.
fn cross(folder: &Path, targets: &[&str], mingw: bool, status: i32) -> Output {
    let bin = folder.join("bin");
    create_dir_all(&bin).unwrap();
    let program = |name: &str, script: &str| {
        let path = bin.join(name);
        write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    };
    for tool in ["bash", "dirname", "env", "mkdir", "realpath", "sh", "tr"] {
        let path = std::env::split_paths(&std::env::var_os("PATH").unwrap())
            .map(|folder| folder.join(tool))
            .find(|path| path.exists());
        std::os::unix::fs::symlink(path.unwrap(), bin.join(tool)).unwrap();
    }
    for target in targets {
        create_dir_all(folder.join("lib/rustlib").join(target).join("lib")).unwrap();
    }
    program("rustc", &format!("echo '{}'", folder.display()));
    let log = folder.join("log").display().to_string();
    program(
        "cargo",
        &format!("echo \"$@ CC=$CC_aarch64_apple_darwin\" >> '{log}'; exit {status}"),
    );
    for tool in MINGW.iter().filter(|_| mingw) {
        program(&format!("x86_64-w64-mingw32-{tool}"), "exit 0");
    }
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join(".ci/cross"))
        .env("PATH", &bin)
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn both_systems_are_checked_with_and_without_cameras() {
    let folder = tempfile::tempdir().unwrap();
    create_dir_all(folder.path().join("target")).unwrap();
    let out = cross(folder.path(), &[WINDOWS, MACOS], true, 0);
    assert!(out.status.success(), "{out:?}");
    let said = text(&out.stdout);
    assert!(
        said.contains("cross windows (x86_64-pc-windows-gnu): Rust, C and C++ compile"),
        "{said}"
    );
    assert!(
        said.contains("cross macos (aarch64-apple-darwin): Rust compiles; C and C++ were left out")
    );
    let calls = read_to_string(folder.path().join("log")).unwrap();
    let line = |target, features, cc| {
        format!("check --locked --target {target} --bin penumbra --features {features} CC={cc}\n")
    };
    let expected = [(WINDOWS, ""), (MACOS, "true")]
        .map(|(target, cc)| line(target, "", cc) + &line(target, "nokhwa", cc));
    assert_eq!(calls, expected.concat());
}

#[test]
fn what_is_missing_is_skipped_by_name() {
    let folder = tempfile::tempdir().unwrap();
    create_dir_all(folder.path().join("target")).unwrap();
    let out = cross(folder.path(), &[WINDOWS], false, 0);
    assert!(out.status.success(), "{out:?}");
    let said = text(&out.stdout);
    let lines: Vec<_> = said.lines().collect();
    assert_eq!(lines.len(), 2, "{said}");
    assert!(lines[0].starts_with("SKIPPED cross windows: x86_64-w64-mingw32-gcc is missing"));
    assert!(lines[1].starts_with("SKIPPED cross macos: the Rust target is missing"));
    assert!(lines[1].contains("rustup target add aarch64-apple-darwin"));
}

#[test]
fn what_does_not_compile_fails() {
    let folder = tempfile::tempdir().unwrap();
    create_dir_all(folder.path().join("target")).unwrap();
    let out = cross(folder.path(), &[WINDOWS, MACOS], true, 101);
    assert_eq!(out.status.code(), Some(1));
    assert_eq!(
        text(&out.stderr),
        "cross windows: FAILED\ncross macos: FAILED\n"
    );
}
