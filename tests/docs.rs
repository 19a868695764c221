//! Checks the documents (README, ARCHITECTURE, CHANGELOG and every page of the book): settings and
//! scene files that they show can be read, command lines can be parsed, make targets, linked files
//! and headings exist, every page is listed in the book's summary, the README's figures are in
//! the results, and the two introductory documents are short.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test fails by panicking"
)]

use penumbra_config::Config;
use penumbra_rig_model::RigDocument;
use penumbra_scene::SceneAddition;
use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

const BOOK: &str = "docs/src";
const SUMMARY: &str = "docs/src/SUMMARY.md";
/// Tables that only scene files have.
const SCENE_TABLES: [&str; 6] = [
    "[[object]]",
    "[[phantom]]",
    "[[lamp]]",
    "[[plane]]",
    "[model]",
    "[ground]",
];

/// A fenced block of a document, with the location of its first line for messages.
struct Block {
    place: String,
    text: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Reads a document; its path is relative to the repository.
fn text(document: &str) -> String {
    let path = root().join(document);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The documents at the top and all pages of the book, relative to the repository.
fn documents() -> Vec<String> {
    let mut documents = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"]
        .map(str::to_owned)
        .to_vec();
    documents.extend(pages());
    documents
}

/// All pages of the book, relative to the repository.
fn pages() -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::from(BOOK)];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(root().join(&folder)).unwrap() {
            let entry = entry.unwrap();
            let path = folder.join(entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path.to_str().unwrap().to_owned());
            }
        }
    }
    found.sort();
    found
}

/// Splits a document into prose (block lines are blank there) and its fenced blocks of `language`.
fn split(document: &str, language: &str) -> (String, Vec<Block>) {
    let (mut prose, mut blocks) = (String::new(), Vec::new());
    let mut open: Option<(bool, Block)> = None;
    for (number, line) in text(document).lines().enumerate() {
        let fence = line.trim_start().strip_prefix("```");
        match (fence, &mut open) {
            (Some(_), Some(_)) => {
                blocks.extend(
                    open.take()
                        .filter(|(wanted, _)| *wanted)
                        .map(|(_, block)| block),
                );
            }
            (Some(tag), None) => {
                let place = format!("{document}:{}", number + 2);
                let text = String::new();
                open = Some((tag.trim() == language, Block { place, text }));
            }
            (None, Some((_, block))) => {
                block.text.push_str(line.trim_end());
                block.text.push('\n');
            }
            (None, None) => prose.push_str(line),
        }
        prose.push('\n');
    }
    assert!(open.is_none(), "{document}: a block is not closed");
    (prose, blocks)
}

/// Fenced blocks of one language in all documents.
fn blocks(language: &str) -> Vec<Block> {
    let documents = documents();
    documents
        .iter()
        .flat_map(|document| split(document, language).1)
        .collect()
}

/// Arguments of the lines in shell blocks that run one of `programs`, without comments.
fn command_lines(programs: &[&str]) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for block in blocks("sh") {
        // A backslash at the end continues the line.
        for line in block.text.replace("\\\n", " ").lines() {
            let command = line.split(" #").next().unwrap_or("").trim();
            let command = command.strip_prefix("sudo ").unwrap_or(command);
            let mut words = command.split_whitespace().map(str::to_owned);
            if words
                .next()
                .is_some_and(|word| programs.contains(&word.as_str()))
            {
                found.push((block.place.clone(), words.collect()));
            }
        }
    }
    found
}

/// Whether the program can parse the arguments. `--help` comes last: everything before it is
/// parsed, and nothing is carried out.
fn parses(arguments: &[String]) -> Result<(), String> {
    let output = Command::new(env!("CARGO_BIN_EXE_penumbra"))
        .args(arguments)
        .arg("--help")
        .output()
        .unwrap();
    if output.status.success() {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).into_owned())
}

/// The link targets of a document, outside code.
fn links(document: &str) -> Vec<String> {
    let (prose, _) = split(document, "");
    // Odd parts of the text between back quotes are code.
    let prose: String = prose.split('`').step_by(2).collect::<Vec<_>>().join("code");
    let ends = prose.split("](").skip(1);
    ends.filter_map(|rest| rest.split(')').next())
        .map(str::to_owned)
        .collect()
}

/// The anchors of a document's headings, as GitHub and mdBook make them.
fn anchors(document: &str) -> HashSet<String> {
    let (prose, _) = split(document, "");
    let headings = prose.lines().filter(|line| line.starts_with('#'));
    headings
        .map(|line| anchor(line.trim_start_matches('#').trim()))
        .collect()
}

fn anchor(heading: &str) -> String {
    let kept = heading
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| {
        if c == ' ' {
            '-'
        } else {
            c.to_ascii_lowercase()
        }
    })
    .collect()
}

/// The file that `link` in `document` leads to, relative to the repository.
fn resolve(document: &str, link: &str) -> String {
    let mut path = PathBuf::from(document);
    path.pop();
    for part in Path::new(link).components() {
        match part {
            Component::ParentDir => assert!(path.pop(), "{document}: {link} leaves the repository"),
            part => path.push(part),
        }
    }
    path.to_str().unwrap().to_owned()
}

#[test]
fn settings_and_scene_files_in_the_documents_can_be_read() {
    let blocks = blocks("toml");
    assert!(
        blocks.len() >= 10,
        "only {} TOML blocks found",
        blocks.len()
    );
    let folder = tempfile::tempdir().unwrap();
    // Settings may name a scene file in the same folder.
    let scene = folder.path().join("scene.toml");
    std::fs::copy(root().join("config/scene.toml"), scene).unwrap();
    // They may name a dictionary of markers, too.
    let markers = "1010111000101101001001110\n0111001011100010110101001\n";
    std::fs::write(folder.path().join("mine.yml"), markers).unwrap();
    let path = folder.path().join("block.toml");
    for Block { place, text } in blocks {
        std::fs::write(&path, &text).unwrap();
        if SCENE_TABLES.iter().any(|table| text.contains(table)) {
            SceneAddition::load(&path).unwrap_or_else(|e| panic!("{place}: {e}"));
        } else {
            Config::load(&path).unwrap_or_else(|e| panic!("{place}: {e}"));
        }
    }
}

#[test]
fn rig_descriptions_in_the_documents_can_be_read() {
    for Block { place, text } in blocks("json") {
        let value: Result<serde_json::Value, _> = serde_json::from_str(&text);
        let value = value.unwrap_or_else(|e| panic!("{place}: {e}"));
        if value.get("scene_camera").is_some() {
            let read = RigDocument::parse(text.as_bytes());
            read.unwrap_or_else(|e| panic!("{place}: {e}"));
        }
    }
}

#[test]
fn command_lines_in_the_documents_can_be_parsed() {
    let lines = command_lines(&["penumbra", "target/release/penumbra"]);
    assert!(
        lines.len() >= 30,
        "only {} command lines found",
        lines.len()
    );
    for (place, arguments) in lines {
        if let Err(error) = parses(&arguments) {
            panic!("{place}: penumbra {}: {error}", arguments.join(" "));
        }
    }
    for wrong in ["--no-such-flag", "--speed=soon"] {
        let line = ["replay", "desk.mcap", wrong].map(str::to_owned);
        assert!(parses(&line).is_err(), "the check accepts {wrong}");
    }
}

#[test]
fn files_of_the_repository_in_command_lines_exist() {
    for (place, arguments) in command_lines(&["target/release/penumbra"]) {
        let inputs = arguments
            .iter()
            .filter(|a| a.starts_with("tests/") || a.starts_with("config/"));
        for input in inputs {
            assert!(root().join(input).exists(), "{place}: there is no {input}");
        }
    }
}

#[test]
fn make_targets_in_the_documents_exist() {
    let makefile = text("Makefile");
    let lines = command_lines(&["make"]);
    assert!(lines.len() >= 3, "only {} make lines found", lines.len());
    for (place, arguments) in lines {
        let target = arguments.first().expect("a target");
        let rule = format!("\n{target}:");
        assert!(
            makefile.contains(&rule),
            "{place}: there is no target {target}"
        );
    }
}

#[test]
fn linked_files_and_headings_exist() {
    for document in documents() {
        for link in links(&document) {
            if link.starts_with("http://") || link.starts_with("https://") {
                continue;
            }
            let (file, heading) = link.split_once('#').unwrap_or((&link, ""));
            let file = match file {
                "" => document.clone(),
                file => resolve(&document, file),
            };
            assert!(
                root().join(&file).exists(),
                "{document}: {link} does not exist"
            );
            let known = heading.is_empty() || anchors(&file).contains(heading);
            assert!(known, "{document}: {file} has no heading for #{heading}");
        }
    }
}

/// mdBook copies nothing from outside its folder, so such links would lead nowhere.
#[test]
fn pages_of_the_book_link_to_pages_of_the_book() {
    for page in pages() {
        for link in links(&page).iter().filter(|link| !link.starts_with("http")) {
            let file = link.split('#').next().unwrap_or("");
            let inside = file.is_empty() || resolve(&page, file).starts_with(BOOK);
            assert!(
                inside,
                "{page}: {link} is outside the book; name the file in code quotes"
            );
        }
    }
}

#[test]
fn summary_lists_every_page_once() {
    let listed: Vec<String> = links(SUMMARY)
        .iter()
        .map(|link| resolve(SUMMARY, link))
        .collect();
    let unique: HashSet<&String> = listed.iter().collect();
    assert_eq!(unique.len(), listed.len(), "{SUMMARY} lists a page twice");
    for page in pages().iter().filter(|page| *page != SUMMARY) {
        assert!(unique.contains(page), "{SUMMARY} does not list {page}");
    }
}

/// Rows of the README's tables whose last cell links to a results page: their figures are those of
/// that page.
#[test]
fn figures_in_the_readme_are_in_the_results() {
    let readme = text("README.md");
    let rows = readme.lines().filter(|line| line.starts_with('|'));
    let mut found = 0;
    for row in rows {
        let Some((cells, source)) = row.rsplit_once("](docs/src/results/") else {
            continue;
        };
        // A link in the middle of a row is no source of figures.
        if source.trim_end_matches(['|', ' ']).contains('|') {
            continue;
        }
        let page = source.split(')').next().unwrap();
        let results = text(&format!("{BOOK}/results/{page}"));
        let known: HashSet<&str> = results
            .split(|c: char| !(c.is_ascii_digit() || c == '.'))
            .collect();
        let cells: Vec<&str> = cells.split('|').collect();
        for cell in cells.iter().skip(2).take(2) {
            let figures = cell.split(|c: char| !(c.is_ascii_digit() || c == '.'));
            for figure in figures.filter(|f| f.contains('.') && f.len() > 2) {
                let figure = figure.trim_end_matches('.');
                assert!(
                    known.contains(figure),
                    "README: {figure} is not in results/{page}"
                );
                found += 1;
            }
        }
    }
    assert!(found >= 5, "only {found} figures found");
}

#[test]
fn readme_and_architecture_are_short() {
    for (document, max) in [("README.md", 200), ("ARCHITECTURE.md", 300)] {
        let lines = text(document).lines().count();
        assert!(
            lines <= max,
            "{document} has {lines} lines, more than {max}"
        );
    }
}
