//! Bytes of a glTF document: GLB chunks, buffers, URIs, accessors. Every length and offset is checked,
//! because the readers of the `gltf` crate index without checks.

use super::check::{MAX_FILE_BYTES, MAX_VERTICES};
use gltf::accessor::{DataType, Dimensions};
use std::borrow::Cow;

pub(super) type Fault = String;

/// Returns the bytes of a file that a glTF names by a relative path, or the reason why not.
pub type Resolver<'r> = dyn Fn(&str) -> Result<Vec<u8>, String> + 'r;

/// Maximum number of elements of an accessor without a buffer view.
const MAX_IMPLIED: usize = 1 << 20;

/// Maximum number of files of one model that are monitored.
const MAX_NAMED: usize = 1000;

const DAMAGED: &str = "the file is damaged; export it again";

/// Divides a `.glb` into its JSON text and binary chunk (glTF 2.0, section 4.4); a `.gltf` is only
/// JSON.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    if bytes.len() > MAX_FILE_BYTES {
        return Err(format!("larger than {MAX_FILE_BYTES} bytes; simplify it"));
    }
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes, None));
    };
    let (version, rest) = word(rest)?;
    let (length, rest) = word(rest)?;
    if version != 2 {
        return Err(format!("glTF version {version}; export it as glTF 2.0"));
    }
    if (length as usize) > bytes.len() {
        return Err(format!(
            "{} of {length} bytes: the file is truncated; copy it again",
            bytes.len()
        ));
    }
    let (json, rest) = chunk(rest, b"JSON")?;
    let binary = match rest {
        [] => None,
        rest => Some(chunk(rest, b"BIN\0")?.0),
    };
    Ok((json, binary))
}

fn word(bytes: &[u8]) -> Result<(u32, &[u8]), Fault> {
    let (head, rest) = bytes.split_first_chunk::<4>().ok_or(DAMAGED)?;
    Ok((u32::from_le_bytes(*head), rest))
}

fn chunk<'a>(bytes: &'a [u8], kind: &[u8; 4]) -> Result<(&'a [u8], &'a [u8]), Fault> {
    let (length, rest) = word(bytes)?;
    let (found, rest) = rest.split_first_chunk::<4>().ok_or(DAMAGED)?;
    if found != kind {
        return Err(format!("a chunk of the wrong kind; {DAMAGED}"));
    }
    let body = rest.get(..length as usize).ok_or(DAMAGED)?;
    Ok((body, rest.get(length as usize..).unwrap_or_default()))
}

/// Returns the paths of the files that a glTF names, relative to itself; none if it cannot be read.
pub(super) fn named_files(bytes: &[u8]) -> Vec<String> {
    let root = split(bytes).ok().and_then(|(json, _)| {
        let text = serde_json::from_slice::<serde_json::Value>(json);
        text.ok()
    });
    let lists = ["buffers", "images"].into_iter().filter_map(|list| {
        let root = root.as_ref()?;
        root.get(list)?.as_array()
    });
    let uris = lists
        .flatten()
        .filter_map(|entry| entry.get("uri")?.as_str());
    let files = uris.filter(|uri| !uri.starts_with("data:"));
    files
        .filter_map(|uri| inside(uri).ok())
        .take(MAX_NAMED)
        .collect()
}

/// Returns the bytes of a data URI, or of the file that `resolve` finds.
pub(super) fn follow(uri: &str, resolve: &Resolver) -> Result<Vec<u8>, Fault> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data
            .split_once(";base64,")
            .ok_or("a data URI that is not base64; embed the data as base64")?;
        return base64(text).ok_or_else(|| "a data URI with broken base64; export it again".into());
    }
    resolve(&inside(uri)?).map_err(|e| format!("it refers to `{uri}`: {e}"))
}

/// Returns the path of a URI inside the model's folder.
///
/// # Errors
/// The path leads out of the folder.
fn inside(uri: &str) -> Result<String, Fault> {
    let path = percent_decoded(uri)?;
    let outside = path.contains(':')
        || path.starts_with(['/', '\\'])
        || path.split(['/', '\\']).any(|step| step == "..");
    if outside {
        return Err(format!(
            "it refers to `{uri}`, outside its own folder; put the file beside it"
        ));
    }
    Ok(path)
}

fn percent_decoded(uri: &str) -> Result<String, Fault> {
    let mut out = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((first, tail)) = rest.split_first() {
        rest = tail;
        let escaped = (*first == b'%')
            .then(|| tail.split_first_chunk::<2>())
            .flatten()
            .and_then(|(hex, after)| {
                let digits = std::str::from_utf8(hex).ok()?;
                Some((u8::from_str_radix(digits, 16).ok()?, after))
            });
        match escaped {
            Some((byte, after)) => {
                out.push(byte);
                rest = after;
            }
            None => out.push(*first),
        }
    }
    String::from_utf8(out).map_err(|_| format!("it refers to `{uri}`, which is not UTF-8"))
}

/// Decodes base64 (RFC 4648, section 4); padding may be missing.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0u32);
    for c in text.trim_end_matches('=').bytes() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    Some(out)
}

/// Parses the JSON; checks indices and required extensions.
fn parse(json: &[u8]) -> Result<gltf::Document, Fault> {
    let broken = |e: String| format!("{}; {DAMAGED}", one_line(&e));
    let root = gltf::json::Root::from_slice(json).map_err(|e| broken(e.to_string()))?;
    // gltf-json 1.4.1 uses this index before it checks it.
    let positions = gltf::json::validation::Checked::Valid(gltf::Semantic::Positions);
    let dangling = root
        .meshes
        .iter()
        .flat_map(|m| &m.primitives)
        .filter_map(|p| p.attributes.get(&positions))
        .any(|i| i.value() >= root.accessors.len());
    if dangling {
        return Err(broken("a POSITION accessor that does not exist".into()));
    }
    gltf::Document::from_json(root).map_err(|e| broken(e.to_string()))
}

/// A document with all its buffers in memory.
pub(super) struct Source<'a> {
    pub document: gltf::Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl<'a> Source<'a> {
    pub(super) fn open(bytes: &'a [u8], resolve: &Resolver) -> Result<Self, Fault> {
        let (json, binary) = split(bytes)?;
        let document = parse(json)?;
        let mut buffers = Vec::new();
        let mut total = 0usize;
        for (i, buffer) in document.as_json().buffers.iter().enumerate() {
            let data = match (&buffer.uri, binary) {
                (Some(uri), _) => Cow::Owned(follow(uri, resolve)?),
                (None, Some(binary)) if i == 0 => Cow::Borrowed(binary),
                (None, _) => return Err(format!("buffer {i} has no data; {DAMAGED}")),
            };
            total = total.saturating_add(data.len());
            if (data.len() as u64) < buffer.byte_length.0 || total > MAX_FILE_BYTES {
                return Err(format!("buffer {i} is too short or too large; {DAMAGED}"));
            }
            buffers.push(data);
        }
        Ok(Self { document, buffers })
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&self, index: usize) -> Result<&[u8], Fault> {
        let fault = || format!("buffer view {index} reaches past its buffer; {DAMAGED}");
        let view = self
            .document
            .as_json()
            .buffer_views
            .get(index)
            .ok_or_else(fault)?;
        let start = view.byte_offset.unwrap_or_default().0;
        let end = start.checked_add(view.byte_length.0).ok_or_else(fault)?;
        let range = usize::try_from(start).ok().zip(usize::try_from(end).ok());
        let (start, end) = range.ok_or_else(fault)?;
        self.buffers
            .get(view.buffer.value())
            .and_then(|b| b.get(start..end))
            .ok_or_else(fault)
    }

    /// Reads all elements of an accessor, each converted by `convert`, with sparse substitutions
    /// (section 3.6.2.3).
    pub(super) fn read<T: Copy + Default>(
        &self,
        accessor: &gltf::Accessor,
        shape: Dimensions,
        convert: impl Fn(&[u8], DataType, bool) -> T,
    ) -> Result<Vec<T>, Fault> {
        let fault = |what: &str| format!("accessor {} {what}; {DAMAGED}", accessor.index());
        if accessor.dimensions() != shape {
            return Err(fault("has the wrong shape"));
        }
        let count = accessor.count();
        if count > MAX_VERTICES {
            return Err(fault("is too large"));
        }
        let (kind, normalized) = (accessor.data_type(), accessor.normalized());
        let mut out = match accessor.view() {
            Some(view) => {
                let stride = view.stride().unwrap_or(accessor.size());
                let bytes = self.view(view.index())?;
                elements(bytes, accessor.offset(), stride, accessor.size(), count)
                    .ok_or_else(|| fault("reaches past its buffer view"))?
                    .map(|e| convert(e, kind, normalized))
                    .collect()
            }
            // These zeros take no bytes in the file: a short file could demand gigabytes.
            None if count > MAX_IMPLIED => return Err(fault("is too large to have no data")),
            None => vec![T::default(); count],
        };
        if let Some(sparse) = accessor.sparse() {
            let places = self.sparse_places(&sparse, &fault)?;
            let values = sparse.values();
            let bytes = self.view(values.view().index())?;
            let size = accessor.size();
            let values = elements(bytes, values.offset(), size, size, places.len())
                .ok_or_else(|| fault("has too few sparse values"))?;
            for (place, value) in places.into_iter().zip(values) {
                *out.get_mut(place)
                    .ok_or_else(|| fault("has a sparse index past its end"))? =
                    convert(value, kind, normalized);
            }
        }
        Ok(out)
    }

    fn sparse_places(
        &self,
        sparse: &gltf::accessor::sparse::Sparse,
        fault: &dyn Fn(&str) -> Fault,
    ) -> Result<Vec<usize>, Fault> {
        use gltf::accessor::sparse::IndexType;
        let indices = sparse.indices();
        let kind = match indices.index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let (size, count) = (kind.size(), sparse.count());
        let bytes = self.view(indices.view().index())?;
        Ok(elements(bytes, indices.offset(), size, size, count)
            .ok_or_else(|| fault("has too few sparse indices"))?
            .map(|e| component(e, kind, false) as usize)
            .collect())
    }

    /// Reads an accessor of `N` numbers per element.
    pub(super) fn floats<const N: usize>(
        &self,
        accessor: &gltf::Accessor,
        shape: Dimensions,
    ) -> Result<Vec<[f32; N]>, Fault>
    where
        [f32; N]: Default,
    {
        self.read(accessor, shape, |bytes, kind, normalized| {
            let mut out = [0.0; N];
            for (slot, b) in out.iter_mut().zip(bytes.chunks_exact(kind.size())) {
                *slot = component(b, kind, normalized) as f32;
            }
            out
        })
    }

    /// Reads an accessor of indices.
    pub(super) fn indices(&self, accessor: &gltf::Accessor) -> Result<Vec<u32>, Fault> {
        if !matches!(
            accessor.data_type(),
            DataType::U8 | DataType::U16 | DataType::U32
        ) {
            return Err(format!("indices that are not whole numbers; {DAMAGED}"));
        }
        self.read(accessor, Dimensions::Scalar, |b, kind, _| {
            component(b, kind, false) as u32
        })
    }
}

/// Returns `count` elements of `size` bytes, `stride` apart; `None` if they exceed `bytes`.
fn elements(
    bytes: &[u8],
    offset: usize,
    stride: usize,
    size: usize,
    count: usize,
) -> Option<impl Iterator<Item = &[u8]>> {
    if count > 0 {
        let last = stride.checked_mul(count - 1)?.checked_add(offset)?;
        bytes.get(last..last.checked_add(size)?)?;
    }
    Some((0..count).map(move |i| {
        let start = offset + i * stride;
        bytes.get(start..start + size).unwrap_or_default()
    }))
}

/// Reads a little-endian number; normalised integers by section 3.6.2.2.
fn component(bytes: &[u8], kind: DataType, normalized: bool) -> f64 {
    let b = |i: usize| bytes.get(i).copied().unwrap_or_default();
    let (value, full) = match kind {
        DataType::U8 => (f64::from(b(0)), 255.0),
        DataType::I8 => (f64::from(b(0) as i8), 127.0),
        DataType::U16 => (f64::from(u16::from_le_bytes([b(0), b(1)])), 65_535.0),
        DataType::I16 => (f64::from(i16::from_le_bytes([b(0), b(1)])), 32_767.0),
        DataType::U32 => (f64::from(u32::from_le_bytes([b(0), b(1), b(2), b(3)])), 1.0),
        DataType::F32 => (f64::from(f32::from_le_bytes([b(0), b(1), b(2), b(3)])), 1.0),
    };
    if normalized {
        (value / full).max(-1.0)
    } else {
        value
    }
}

/// Shortens a message of another library to one line.
pub(super) fn one_line(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    text.chars().take(200).collect()
}
