//! Strict reading of TOML: every error names file, line and key, and unknown keys get a suggestion.

mod error;

pub use error::TomlError;
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::de::{DeTable, DeValue};

/// The text of a TOML file and its name.
pub struct TomlText {
    /// Path, for messages.
    pub file: String,
    text: String,
}

/// An invalid value of the right type.
#[derive(Debug)]
pub struct Fault {
    /// Dotted path of the key, e.g. `object[1].scale`.
    pub key: String,
    /// What is expected.
    pub reason: String,
}

impl Fault {
    /// Creates the fault of a dotted key.
    pub fn new(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            reason: reason.into(),
        }
    }
}

/// Minimum similarity of a known key that is suggested for an unknown one (Jaro–Winkler: 1 = equal).
const MIN_SIMILARITY: f64 = 0.75;
/// Units by the ending of a key.
const UNITS: [(&str, &str); 5] = [
    ("_ms", "milliseconds"),
    ("_s", "seconds"),
    ("_m", "metres"),
    ("_deg", "degrees"),
    ("_ev", "stops"),
];
/// Maximum size of a file, bytes.
const MAX_BYTES: u64 = 4 << 20;

impl TomlText {
    /// Creates a text with the file name for messages.
    pub fn new(file: impl Into<String>, text: impl Into<String>) -> Self {
        Self {
            file: file.into(),
            text: text.into(),
        }
    }

    /// Reads a file of at most 4 MiB.
    ///
    /// # Errors
    /// The file cannot be read or is too large.
    pub fn read(path: &Path) -> Result<Self, TomlError> {
        let file = path.display().to_string();
        let refuse = |reason: String| TomlError::Unreadable {
            file: file.clone(),
            reason,
        };
        let found = std::fs::metadata(path).map_err(|e| refuse(e.to_string()))?;
        if !found.is_file() || found.len() > MAX_BYTES {
            return Err(refuse(format!("no file of at most {MAX_BYTES} bytes")));
        }
        let text = std::fs::read_to_string(path).map_err(|e| refuse(e.to_string()))?;
        Ok(Self { file, text })
    }

    /// Deserialises the text.
    ///
    /// # Errors
    /// The text is not TOML, has an unknown key or a value of the wrong type. The error names file,
    /// line and key.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, TomlError> {
        toml::from_str(&self.text).map_err(|e| self.explain(&e))
    }

    /// Adds file and line to a [`Fault`].
    pub fn locate(&self, fault: Fault) -> TomlError {
        TomlError::Value {
            file: self.file.clone(),
            line: self.line_of(&fault.key),
            key: fault.key,
            reason: fault.reason,
        }
    }

    fn explain(&self, error: &toml::de::Error) -> TomlError {
        let at = error.span().map_or(0, |s| s.start);
        let (file, line) = (self.file.clone(), self.line_at(at));
        let message = error.message();
        let Ok(table) = DeTable::parse(&self.text) else {
            let reason = message.lines().collect::<Vec<_>>().join("; ");
            return TomlError::Syntax { file, line, reason };
        };
        let mut path = Vec::new();
        path_at(table.get_ref(), at, &mut path);
        let key = dotted(&path);
        if message.starts_with("unknown field") {
            let mut names = message.split('`').skip(1).step_by(2);
            let unknown = names.next().unwrap_or_default();
            let known: Vec<&str> = names.collect();
            let key = if path.last().is_some_and(|k| k == unknown) || key.is_empty() {
                if key.is_empty() {
                    unknown.to_owned()
                } else {
                    key
                }
            } else {
                format!("{key}.{unknown}")
            };
            let hint = suggestion(unknown, &known);
            return TomlError::UnknownKey {
                file,
                line,
                key,
                hint,
            };
        }
        let found = error.span().and_then(|span| self.text.get(span));
        let found = found
            .and_then(|text| text.lines().next())
            .unwrap_or_default();
        let reason = friendly(message, path.last().map_or("", String::as_str), found);
        TomlError::Value {
            file,
            line,
            key,
            reason,
        }
    }

    /// Returns the line (from 1) of a byte offset.
    fn line_at(&self, at: usize) -> usize {
        let before = self.text.as_bytes().iter().take(at);
        1 + before.filter(|b| **b == b'\n').count()
    }

    /// Returns the line of a dotted key such as `object[1].scale`, or of the deepest existing table
    /// above it.
    fn line_of(&self, key: &str) -> usize {
        let Ok(table) = DeTable::parse(&self.text) else {
            return 1;
        };
        let mut at = 0;
        let mut table = Some(table.get_ref());
        for step in key.split('.') {
            let (name, index) = match step.split_once('[') {
                Some((name, index)) => (name, index.trim_end_matches(']').parse().ok()),
                None => (step, None),
            };
            let entry = table.and_then(|t| t.iter().find(|(k, _)| k.get_ref() == name));
            let Some((found, value)) = entry else {
                break;
            };
            at = found.span().start;
            let value = match (value.get_ref(), index) {
                (DeValue::Array(items), Some(i)) => {
                    let item = items.get::<usize>(i);
                    at = item.map_or(at, |v| v.span().start);
                    item.map(|v| v.get_ref())
                }
                (value, _) => Some(value),
            };
            table = value.and_then(DeValue::as_table);
        }
        self.line_at(at)
    }
}

/// Collects the keys of the path to the value at byte `at`.
fn path_at(table: &DeTable, at: usize, path: &mut Vec<String>) {
    let covers = |span: std::ops::Range<usize>| span.contains(&at);
    let inside = |value: &DeValue, span| covers(span) || holds(value, at);
    for (key, value) in table {
        if covers(key.span()) || inside(value.get_ref(), value.span()) {
            path.push(key.get_ref().to_string());
            descend(value.get_ref(), at, path);
            return;
        }
    }
}

fn descend(value: &DeValue, at: usize, path: &mut Vec<String>) {
    match value {
        DeValue::Table(table) => path_at(table, at, path),
        DeValue::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                if item.span().contains(&at) || holds(item.get_ref(), at) {
                    path.push(format!("[{i}]"));
                    descend(item.get_ref(), at, path);
                    return;
                }
            }
        }
        _ => {}
    }
}

/// Returns whether a value below `value` is written at byte `at`: the span of a `[section]` covers
/// only its header.
fn holds(value: &DeValue, at: usize) -> bool {
    match value {
        DeValue::Table(table) => table.iter().any(|(k, v)| {
            k.span().contains(&at) || v.span().contains(&at) || holds(v.get_ref(), at)
        }),
        DeValue::Array(items) => items
            .iter()
            .any(|v| v.span().contains(&at) || holds(v.get_ref(), at)),
        _ => false,
    }
}

fn dotted(path: &[String]) -> String {
    path.join(".").replace(".[", "[")
}

/// Returns a hint for an unknown key: the most similar known key, or all known keys.
fn suggestion(unknown: &str, known: &[&str]) -> String {
    let best = known
        .iter()
        .map(|k| (strsim::jaro_winkler(unknown, k), *k))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((score, name)) if score >= MIN_SIMILARITY => {
            let unit = unit_of(name).map_or(String::new(), |u| format!(" (in {u})"));
            format!("did you mean `{name}`{unit}?")
        }
        Some(_) => format!("known here: {}", known.join(", ")),
        None => "no keys are known here; remove it".into(),
    }
}

fn unit_of(key: &str) -> Option<&'static str> {
    UNITS
        .iter()
        .find(|(ending, _)| key.ends_with(ending))
        .map(|(_, unit)| *unit)
}

/// Rewords serde's message about an invalid value for users.
/// Maximum length of a value in a message, characters.
const MAX_SHOWN: usize = 60;

fn friendly(message: &str, key: &str, found: &str) -> String {
    let text = message.lines().next().unwrap_or_default();
    // The toml crate's words for a value that is none of an enumeration's names.
    if text == "wanted string or table" {
        let found: String = found.chars().take(MAX_SHOWN).collect();
        return format!("expected a word in quotes, found {found}");
    }
    let text = text
        .replace("invalid type: ", "")
        .replace("invalid value: ", "")
        .replace("invalid length", "length")
        .replace("missing field", "lacks the key");
    let text = match text.split_once(", expected ") {
        Some((found, expected)) => format!("expected {}, found {found}", plain(expected, found)),
        None => text,
    };
    match unit_of(key) {
        Some(unit) => format!("{text} (the unit is {unit})"),
        None => text,
    }
}

fn plain<'e>(expected: &'e str, found: &str) -> &'e str {
    // Neither negative nor fractional, so it is too large.
    let is_large = found.starts_with("integer `") && !found.starts_with("integer `-");
    match expected {
        "u8" if is_large => "a whole number of at most 255",
        "u16" if is_large => "a whole number of at most 65535",
        "u32" if is_large => "a whole number of at most 4294967295",
        "f32" | "f64" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, at least 0",
        "a boolean" => "true or false",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only deserialised")]
    struct Outer {
        inner: Option<Inner>,
        list: Option<Vec<Inner>>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only deserialised")]
    struct Inner {
        latency_ms: f64,
        count: Option<u32>,
        on: Option<bool>,
        choice: Option<Choice>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Choice {
        One,
        Two,
    }

    fn message(text: &str) -> String {
        let text = TomlText::new("f.toml", text)
            .parse::<Outer>()
            .unwrap_err()
            .to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let cases = [
            (
                "[inner]\nlatency_ms = 1\n\nlatency = 2\n",
                "f.toml:4: unknown key `inner.latency`; did you mean `latency_ms` (in milliseconds)?",
            ),
            (
                "[inner]\nlatency_s = 0.1\n",
                "f.toml:2: unknown key `inner.latency_s`; did you mean `latency_ms` (in milliseconds)?",
            ),
            (
                "x = 2\n",
                "f.toml:1: unknown key `x`; known here: inner, list",
            ),
            (
                "\n[iner]\n",
                "f.toml:2: unknown key `iner`; did you mean `inner`?",
            ),
            (
                "[inner]\nlatency_ms = \"8 ms\"\n",
                "f.toml:2: `inner.latency_ms`: expected a number, found string \"8 ms\" (the unit is milliseconds)",
            ),
            (
                "[inner]\nlatency_ms = 1\ncount = -1\n",
                "f.toml:3: `inner.count`: expected a whole number, at least 0, found integer `-1`",
            ),
            (
                "[inner]\nlatency_ms = 3\ncount = 4294967296",
                "f.toml:3: `inner.count`: expected a whole number of at most 4294967295, found integer `4294967296`",
            ),
            (
                "[inner]\nlatency_ms = 3\nchoice = 3",
                "f.toml:3: `inner.choice`: expected a word in quotes, found 3",
            ),
            (
                "[inner]\nlatency_ms = 1\non = 1\n",
                "f.toml:3: `inner.on`: expected true or false, found integer `1`",
            ),
            (
                "[inner]\ncount = 1\n",
                "f.toml:1: `inner`: lacks the key `latency_ms`",
            ),
            (
                "[[list]]\nlatency_ms = 1\n[[list]]\nlatency_ms = true\n",
                "f.toml:4: `list[1].latency_ms`: expected a number, found boolean `true` (the unit is milliseconds)",
            ),
            (
                "inner = { latency_ms = 1, cuont = 2 }\n",
                "f.toml:1: unknown key `inner.cuont`; did you mean `count`?",
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(message(text), expected);
        }
        assert!(message("[inner]\nlatency_ms = \n").starts_with("f.toml:2: not TOML: "));
        assert!(message("[inner]\n[inner]\n").starts_with("f.toml:2: not TOML: "));
    }

    #[test]
    fn locates_faults_by_key() {
        let text = TomlText::new(
            "f.toml",
            "[inner]\nlatency_ms = 1\n\n[[list]]\ncount = 1\n[[list]]\ncount = 2\n",
        );
        let line = |key: &str| text.line_of(key);
        assert_eq!(line("inner.latency_ms"), 2);
        assert_eq!(line("inner.absent"), 1);
        assert_eq!(line("list[1].count"), 7);
        assert_eq!(line("list[1].absent"), 6);
        assert_eq!(line("nowhere"), 1);
    }

    #[test]
    fn names_missing_file() {
        let error = TomlText::read(Path::new("/nowhere/rig.toml"))
            .err()
            .unwrap();
        assert!(
            error
                .to_string()
                .contains("/nowhere/rig.toml: cannot be read")
        );
    }
}
