//! What the documents show works: settings are read, command lines are understood, make's
//! targets and the linked files exist.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use penumbra_config::Config;
use penumbra_scene::SceneAddition;
use std::path::{Path, PathBuf};
use std::process::Command;

const DOCUMENTS: [&str; 3] = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(document: &str) -> String {
    let path = root().join(document);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Fenced blocks of one language, each with its document and first line's number.
fn blocks(language: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for document in DOCUMENTS {
        let mut open: Option<(bool, String, String)> = None;
        for (number, line) in text(document).lines().enumerate() {
            match (line.trim_start().strip_prefix("```"), &mut open) {
                (Some(_), Some(_)) => {
                    if let Some((true, place, block)) = open.take() {
                        found.push((place, block));
                    }
                }
                (Some(tag), None) => {
                    let place = format!("{document}:{}", number + 2);
                    open = Some((tag.trim() == language, place, String::new()));
                }
                (None, Some((_, _, block))) => {
                    block.push_str(line);
                    block.push('\n');
                }
                (None, None) => {}
            }
        }
        assert!(open.is_none(), "{document}: a block is not closed");
    }
    found
}

/// Lines of shell blocks that start with `program`, comments cut off.
fn command_lines(program: &str) -> Vec<(String, Vec<String>)> {
    let lines = blocks("sh").into_iter().flat_map(|(place, block)| {
        let lines: Vec<String> = block.lines().map(str::to_owned).collect();
        lines.into_iter().map(move |line| (place.clone(), line))
    });
    lines
        .filter_map(|(place, line)| {
            let command = line.split('#').next().unwrap_or("").trim();
            let arguments = command.strip_prefix(program)?.strip_prefix(' ')?;
            Some((
                place,
                arguments.split_whitespace().map(str::to_owned).collect(),
            ))
        })
        .collect()
}

/// Whether the command line is understood. `--help` at its end keeps it from being carried
/// out, and comes last, so everything before it has been parsed.
fn understood(arguments: &[String]) -> Result<(), String> {
    let output = Command::new(env!("CARGO_BIN_EXE_penumbra"))
        .args(arguments)
        .arg("--help")
        .output()
        .unwrap();
    if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).into_owned())
    }
}

/// Scene files have a grammar of their own.
fn read_scene(place: &str, text: &str) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    SceneAddition::load(&path).unwrap_or_else(|e| panic!("{place}: {e}"));
}

#[test]
fn settings_in_the_documents_are_read() {
    let blocks = blocks("toml");
    assert!(!blocks.is_empty(), "no TOML block found");
    for (place, block) in blocks {
        if block.contains("[[object]]") || block.contains("[[lamp]]") {
            read_scene(&place, &block);
            continue;
        }
        Config::from_text(&block, &place).unwrap_or_else(|e| panic!("{place}: {e}"));
    }
}

#[test]
fn command_lines_in_the_documents_are_understood() {
    let lines = command_lines("penumbra");
    assert!(
        lines.len() >= 10,
        "only {} command lines found",
        lines.len()
    );
    for (place, arguments) in lines {
        if let Err(error) = understood(&arguments) {
            panic!("{place}: penumbra {}: {error}", arguments.join(" "));
        }
    }
    // The check above can fail.
    for wrong in ["--no-such-flag", "--speed=soon"] {
        let line = ["replay", "desk.mcap", wrong].map(str::to_owned);
        assert!(understood(&line).is_err(), "{wrong} is taken");
    }
}

#[test]
fn every_make_target_in_the_documents_is_there() {
    let makefile = text("Makefile");
    let lines = command_lines("make");
    assert!(lines.len() >= 3, "only {} make lines found", lines.len());
    for (place, arguments) in lines {
        let target = arguments.first().unwrap();
        let rule = format!("\n{target}:");
        assert!(makefile.contains(&rule), "{place}: no target {target}");
    }
}

#[test]
fn linked_files_are_there() {
    for document in DOCUMENTS {
        let text = text(document);
        let links = text
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split(')').next());
        for link in links.filter(|link| !link.starts_with("http")) {
            let path: PathBuf = root().join(link);
            assert!(path.exists(), "{document}: {link} is not there");
        }
    }
}
