//! OpenCV's FileStorage XML: elements without attributes that matter, text, comments. Strict: other
//! features of XML (entities, CDATA, doctypes) are errors that name their line.
//!
//! No general XML parser is used: the subset is small, and the document becomes the same values as one
//! in YAML, with the line of each.

use super::FormatError;
use super::yaml::{Kind, Value};

/// Maximum nesting depth.
const MAX_DEPTH: usize = 16;

type Result<T> = std::result::Result<T, FormatError>;

/// Parses a document; its root element, `opencv_storage`, becomes the mapping.
pub(super) fn parse(text: &str) -> Result<Value> {
    let mut parser = Parser { text, at: 0 };
    parser.skip_prologue()?;
    let (_, root) = parser.element(0)?;
    Ok(root)
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Parser<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn line(&self) -> usize {
        1 + self.text[..self.at].matches('\n').count()
    }

    fn error<T>(&self, reason: &'static str) -> Result<T> {
        let line = self.line();
        Err(FormatError::Syntax { line, reason })
    }

    /// Skips white space and comments.
    fn skip_blank(&mut self) -> Result<()> {
        loop {
            self.at += self.rest().len() - self.rest().trim_start().len();
            if !self.rest().starts_with("<!--") {
                return Ok(());
            }
            match self.rest().find("-->") {
                Some(end) => self.at += end + 3,
                None => return self.error("a comment does not end"),
            }
        }
    }

    fn skip_prologue(&mut self) -> Result<()> {
        self.skip_blank()?;
        if self.rest().starts_with("<?xml") {
            match self.rest().find("?>") {
                Some(end) => self.at += end + 2,
                None => return self.error("the line <?xml does not end"),
            }
        }
        self.skip_blank()
    }

    /// Parses an element: its name and value.
    fn element(&mut self, depth: usize) -> Result<(&'a str, Value)> {
        let line = self.line();
        if depth > MAX_DEPTH {
            return self.error("nested too deeply");
        }
        let Some(tag) = self.tag()? else {
            return self.error("expected an element such as <camera_matrix>");
        };
        let name = tag.split_whitespace().next().unwrap_or_default();
        if name.is_empty() || name.starts_with(['!', '?', '/']) {
            return self.error("expected an element such as <camera_matrix>");
        }
        if tag.ends_with('/') {
            let kind = Kind::Scalar(String::new());
            return Ok((name.trim_end_matches('/'), Value { line, kind }));
        }
        let value = self.content(name, line, depth)?;
        Ok((name, value))
    }

    /// Reads `<…>` and returns what is in it; `None` if there is none here.
    fn tag(&mut self) -> Result<Option<&'a str>> {
        let Some(inner) = self.rest().strip_prefix('<') else {
            return Ok(None);
        };
        let Some(end) = inner.find('>') else {
            return self.error("a tag does not end");
        };
        self.at += end + 2;
        Ok(Some(&inner[..end]))
    }

    /// Parses the children or the text of an element, and its end.
    fn content(&mut self, name: &str, line: usize, depth: usize) -> Result<Value> {
        let mut children: Vec<(String, Value)> = Vec::new();
        let mut text = "";
        loop {
            self.skip_blank()?;
            if self.rest().is_empty() {
                return self.error("an element does not end");
            }
            if let Some(end) = self.rest().strip_prefix("</") {
                let Some(closing) = end.find('>') else {
                    return self.error("a tag does not end");
                };
                if end[..closing].trim() != name {
                    return self.error("an element ends with another name");
                }
                self.at += closing + 3;
                let kind = kind(name, children, text);
                return Ok(Value { line, kind });
            }
            if self.rest().starts_with('<') {
                let (name, value) = self.element(depth + 1)?;
                children.push((name.to_owned(), value));
            } else {
                let end = self.rest().find('<').unwrap_or(self.rest().len());
                text = &self.rest()[..end];
                if text.contains('&') {
                    return self.error("entities such as &lt; are not supported");
                }
                self.at += end;
            }
        }
    }
}

/// Returns the value of an element: `data` is a list of words, elements named `_` are a list.
fn kind(name: &str, children: Vec<(String, Value)>, text: &str) -> Kind {
    if !children.is_empty() {
        return if children.iter().all(|(name, _)| name == "_") {
            Kind::List(children.into_iter().map(|(_, value)| value).collect())
        } else {
            Kind::Map(children)
        };
    }
    if name == "data" {
        let words = text.split_whitespace().map(|word| Value {
            line: 0,
            kind: Kind::Scalar(word.to_owned()),
        });
        return Kind::List(words.collect());
    }
    Kind::Scalar(text.trim().trim_matches('"').to_owned())
}
