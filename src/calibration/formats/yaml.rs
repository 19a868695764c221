//! The subset of YAML in which camera parameters are written: block mappings and lists, flow
//! mappings and lists over several lines, quoted and plain scalars, comments, tags (skipped).
//! Strict: other features of YAML (anchors, multi-line scalars, several documents) are errors that
//! name their line.
//!
//! No general YAML parser is used, because OpenCV writes `%YAML:1.0`, which is not a valid
//! directive, and because errors must name line and key.

use super::FormatError;

/// A value and the line on which it begins.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Value {
    pub line: usize,
    pub kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    Scalar(String),
    List(Vec<Value>),
    Map(Vec<(String, Value)>),
}

/// Maximum length of a file, bytes.
const MAX_BYTES: usize = 1 << 20;
/// Maximum nesting depth.
const MAX_DEPTH: usize = 16;

struct Line<'a> {
    number: usize,
    indent: usize,
    text: &'a str,
}

type Result<T> = std::result::Result<T, FormatError>;

fn syntax_error(line: usize, reason: &'static str) -> FormatError {
    FormatError::Syntax { line, reason }
}

/// Parses a document.
pub(super) fn parse(text: &str) -> Result<Value> {
    if text.len() > MAX_BYTES {
        return Err(syntax_error(
            1,
            "longer than 1 MiB; not a file of camera parameters",
        ));
    }
    let mut lines = Vec::new();
    for (i, raw) in text.lines().enumerate() {
        let text = without_comment(raw).trim_end();
        let content = text.trim_start();
        let skipped = content.is_empty() || content.starts_with('%') || content == "---";
        if content == "..." {
            break;
        }
        if !skipped {
            let indent = text.len() - content.len();
            lines.push(Line {
                number: i + 1,
                indent,
                text: content,
            });
        }
    }
    let mut reader = Reader { lines, next: 0 };
    let indent = reader.lines.first().ok_or(syntax_error(1, "empty"))?.indent;
    let value = reader.block(indent, 0)?;
    match reader.lines.get(reader.next) {
        Some(line) => Err(syntax_error(
            line.number,
            "indentation differs from the lines before",
        )),
        None => Ok(value),
    }
}

/// Returns the line without its comment: a `#` at the start or after a blank, outside quotes.
fn without_comment(line: &str) -> &str {
    let (mut quote, mut before) = (None, ' ');
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (None, '#') if before.is_whitespace() => return &line[..i],
            (None, '"' | '\'') => quote = Some(c),
            (Some(q), c) if q == c => quote = None,
            _ => {}
        }
        before = c;
    }
    line
}

struct Reader<'a> {
    lines: Vec<Line<'a>>,
    next: usize,
}

impl<'a> Reader<'a> {
    fn block(&mut self, indent: usize, depth: usize) -> Result<Value> {
        let Some(first) = self.lines.get(self.next) else {
            return Err(syntax_error(0, "missing value at the end"));
        };
        let line = first.number;
        if depth > MAX_DEPTH {
            return Err(syntax_error(line, "nested too deeply"));
        }
        let is_list = first.text == "-" || first.text.starts_with("- ");
        let kind = if is_list {
            self.list(indent, depth)?
        } else {
            self.map(indent, depth)?
        };
        Ok(Value { line, kind })
    }

    fn map(&mut self, indent: usize, depth: usize) -> Result<Kind> {
        let mut entries: Vec<(String, Value)> = Vec::new();
        while let Some(line) = self.lines.get(self.next).filter(|l| l.indent == indent) {
            let (number, text) = (line.number, line.text);
            let (key, rest) =
                split_key(text).ok_or(syntax_error(number, "expected `key: value`"))?;
            if entries.iter().any(|(k, _)| k == key) {
                return Err(syntax_error(number, "duplicate key"));
            }
            self.next += 1;
            let value = self.value(number, rest, indent, depth)?;
            entries.push((key.to_owned(), value));
        }
        Ok(Kind::Map(entries))
    }

    fn list(&mut self, indent: usize, depth: usize) -> Result<Kind> {
        let mut values = Vec::new();
        while let Some(line) = self.lines.get(self.next).filter(|l| l.indent == indent) {
            let (number, text) = (line.number, line.text);
            // A list that is indented like its key ends where the next key begins.
            let Some(rest) = text.strip_prefix('-') else {
                break;
            };
            let content = rest.trim_start();
            let flow = content.starts_with(['[', '{', '"', '\'']);
            if !flow && split_key(content).is_some() {
                // `- key: value` begins a mapping with the key's indentation.
                let inner = indent + text.len() - content.len();
                self.lines[self.next].indent = inner;
                self.lines[self.next].text = content;
                values.push(self.block(inner, depth + 1)?);
            } else {
                self.next += 1;
                values.push(self.value(number, content, indent, depth)?);
            }
        }
        Ok(Kind::List(values))
    }

    /// Parses the value after `key:` on its line and on the lines below that belong to it.
    fn value(&mut self, line: usize, rest: &'a str, indent: usize, depth: usize) -> Result<Value> {
        let rest = without_tag(rest.trim());
        if rest.is_empty() {
            return match self.lines.get(self.next) {
                Some(below) if below.indent > indent => self.block(below.indent, depth + 1),
                // A list may be indented like its key.
                Some(below) if below.indent == indent && below.text.starts_with("- ") => {
                    let kind = self.list(indent, depth + 1)?;
                    Ok(Value { line, kind })
                }
                _ => Ok(scalar(line, "")),
            };
        }
        if rest.starts_with(['[', '{']) {
            let mut text = rest.to_owned();
            while !is_closed(&text) {
                let Some(more) = self.lines.get(self.next) else {
                    return Err(syntax_error(line, "unclosed bracket"));
                };
                text.push(' ');
                text.push_str(more.text);
                self.next += 1;
            }
            return Flow { line, rest: &text }.parse();
        }
        if rest.starts_with(['&', '*', '|', '>']) {
            return Err(syntax_error(
                line,
                "anchors and multi-line scalars are not supported",
            ));
        }
        Ok(scalar(line, unquoted(rest)))
    }
}

fn scalar(line: usize, text: &str) -> Value {
    Value {
        line,
        kind: Kind::Scalar(text.to_owned()),
    }
}

fn split_key(text: &str) -> Option<(&str, &str)> {
    let at = text
        .match_indices(':')
        .map(|(i, _)| i)
        .find(|i| text[i + 1..].is_empty() || text[i + 1..].starts_with(' '))?;
    let key = unquoted(text[..at].trim());
    (!key.is_empty()).then_some((key, &text[at + 1..]))
}

/// Removes a tag such as `!!opencv-matrix`: the keys suffice.
fn without_tag(text: &str) -> &str {
    if text.starts_with('!') {
        text.split_once(' ')
            .map_or("", |(_, rest)| rest.trim_start())
    } else {
        text
    }
}

fn unquoted(text: &str) -> &str {
    let inner = |q: char| text.strip_prefix(q)?.strip_suffix(q);
    inner('"').or_else(|| inner('\'')).unwrap_or(text)
}

fn is_closed(text: &str) -> bool {
    let open = text.matches(['[', '{']).count();
    open <= text.matches([']', '}']).count()
}

/// Parser of flow values, e.g. `[1, 2, {a: b}]`.
struct Flow<'a> {
    line: usize,
    rest: &'a str,
}

impl Flow<'_> {
    fn parse(mut self) -> Result<Value> {
        let value = self.value(0)?;
        if self.rest.trim().is_empty() {
            Ok(value)
        } else {
            Err(syntax_error(
                self.line,
                "unexpected text after the closing bracket",
            ))
        }
    }

    fn value(&mut self, depth: usize) -> Result<Value> {
        if depth > MAX_DEPTH {
            return Err(syntax_error(self.line, "nested too deeply"));
        }
        self.rest = self.rest.trim_start();
        let kind = if self.eat('[') {
            let mut values = Vec::new();
            while !self.eat(']') {
                values.push(self.value(depth + 1)?);
                self.separator(']')?;
            }
            Kind::List(values)
        } else if self.eat('{') {
            let mut entries = Vec::new();
            while !self.eat('}') {
                let (key, rest) = self.rest.split_once(':').ok_or(syntax_error(
                    self.line,
                    "expected `key: value` between braces",
                ))?;
                let key = unquoted(key.trim()).to_owned();
                self.rest = rest;
                entries.push((key, self.value(depth + 1)?));
                self.separator('}')?;
            }
            Kind::Map(entries)
        } else {
            let end = self.rest.find([',', ']', '}']).unwrap_or(self.rest.len());
            let (text, rest) = self.rest.split_at(end);
            self.rest = rest;
            Kind::Scalar(unquoted(text.trim()).to_owned())
        };
        Ok(Value {
            line: self.line,
            kind,
        })
    }

    /// Consumes a comma, unless the closing bracket follows.
    fn separator(&mut self, closing: char) -> Result<()> {
        self.rest = self.rest.trim_start();
        if self.eat(',') || self.rest.starts_with(closing) {
            self.rest = self.rest.trim_start();
            Ok(())
        } else {
            Err(syntax_error(
                self.line,
                "expected a comma or the closing bracket",
            ))
        }
    }

    fn eat(&mut self, c: char) -> bool {
        let rest = self.rest.trim_start().strip_prefix(c);
        if let Some(rest) = rest {
            self.rest = rest.trim_start();
        }
        rest.is_some()
    }
}
