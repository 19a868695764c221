//! The Debian package that `make deb` builds: its files and what they say.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used)]

use std::path::Path;
use std::process::Command;

/// Runs a program and returns its standard output.
fn output(program: &str, arguments: &[&str]) -> String {
    let out = Command::new(program)
        .args(arguments)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(out.status.success(), "{program} {arguments:?}: {out:?}");
    String::from_utf8(out.stdout).unwrap()
}

fn has(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

#[test]
fn package_has_program_service_documentation_sessions_and_licences() {
    for program in ["dpkg-deb", "python3", "strip"] {
        if !has(program) {
            eprintln!("SKIPPED package: {program} is missing");
            return;
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let program = env!("CARGO_BIN_EXE_penumbra");
    let package = output(".ci/deb", &["--penumbra", program, "--out", &out]);
    let package = package.trim();
    let listed = output("dpkg-deb", &["--contents", package]);
    for file in [
        "./usr/bin/penumbra",
        "./etc/penumbra/rig.toml",
        "./usr/lib/systemd/system/penumbra.service",
        "./usr/lib/udev/rules.d/70-penumbra.rules",
        "./usr/lib/sysusers.d/penumbra.conf",
        "./usr/share/man/man1/penumbra-replay.1.gz",
        "./usr/share/bash-completion/completions/penumbra",
        "./usr/share/zsh/site-functions/_penumbra",
        "./usr/share/fish/vendor_completions.d/penumbra.fish",
        "./usr/share/doc/penumbra/copyright",
        "./usr/share/doc/penumbra/changelog.gz",
        "./usr/share/doc/penumbra/release-notes.md",
        "./usr/share/doc/penumbra/licences-of-libraries.txt.gz",
        "./usr/share/doc/penumbra/sbom.cdx.json",
        "./usr/share/doc/penumbra/book/install.md",
        "./usr/share/penumbra/sessions/desk.mcap",
        "./usr/share/penumbra/sessions/tea-table.mcap",
        "./usr/share/penumbra/config/demo.toml",
    ] {
        let is_file = |line: &str| line.ends_with(&format!(" {file}"));
        assert!(listed.lines().any(is_file), "{file}: {listed}");
    }
    let owners = |line: &str| line.contains(" root/root ");
    assert!(listed.lines().all(owners), "{listed}");
    check_contents(package, folder.path());
}

/// Unpacks the package and reads its files.
fn check_contents(package: &str, folder: &Path) {
    let root = folder.join("root");
    output("dpkg-deb", &["--extract", package, root.to_str().unwrap()]);
    let unit = std::fs::read_to_string(root.join("usr/lib/systemd/system/penumbra.service"));
    let start = "ExecStart=/usr/bin/penumbra run --headless --config /etc/penumbra/rig.toml";
    assert!(unit.unwrap().contains(start));
    let program = root.join("usr/bin/penumbra").display().to_string();
    let config = root.join("etc/penumbra/rig.toml").display().to_string();
    output(&program, &["check-config", &config]);
    let docs = root.join("usr/share/doc/penumbra");
    let text = std::fs::read_to_string(docs.join("sbom.cdx.json")).unwrap();
    let bill: serde_json::Value = serde_json::from_str(&text).unwrap();
    let components = bill["components"].as_array().unwrap();
    let wgpu = components.iter().find(|c| c["name"] == "wgpu");
    assert!(
        wgpu.is_some() && components.len() > 200,
        "{}",
        components.len()
    );
    assert!(components.iter().all(|c| c["name"] != "proptest"));
    let notes = std::fs::read_to_string(docs.join("release-notes.md")).unwrap();
    assert!(notes.starts_with("## "), "{notes}");
    let control = output("dpkg-deb", &["--field", package]);
    assert!(control.contains("Package: penumbra\n") && control.contains("libvulkan1"));
}
