//! Reads PLY files (Turk 1994).
//!
//! The elements `vertex` (x y z, and nx ny nz if present) and `face` (`vertex_indices` or
//! `vertex_index`; polygons are triangulated as fans) are read, in ASCII and both binary byte
//! orders; other elements are skipped. Coordinates are metres, +Z up.

use super::check::{MAX_FILE_BYTES, MAX_TRIANGLES, MAX_VERTICES, check_mesh};
use super::normals::{normalise_directions, recompute_normals};
use crate::error::SceneError;
use crate::mesh::{Mesh, Vertex};
use glam::{Vec2, Vec3, Vec4};

/// Minimum angle between faces at a sharp edge where a file has no normals, radians (40°).
const CREASE: f32 = 0.698;

type Fault = String;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Debug)]
enum Property {
    Scalar(String, Kind),
    List(String, Kind, Kind),
}

#[derive(Debug)]
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Reads the bytes of a PLY file. `file` is its name, for messages.
///
/// # Errors
/// The file is damaged, too large or has no triangles.
pub fn load_ply(bytes: &[u8], file: &str) -> Result<Mesh, SceneError> {
    read(bytes).map_err(|reason| SceneError::broken(file, format!("not a usable PLY: {reason}")))
}

fn read(bytes: &[u8]) -> Result<Mesh, Fault> {
    if bytes.len() > MAX_FILE_BYTES {
        return Err(format!("larger than {MAX_FILE_BYTES} bytes; simplify it"));
    }
    let (encoding, elements, body) = header(bytes)?;
    let mut values = Values {
        encoding,
        rest: body,
    };
    let mut mesh = Mesh::default();
    let mut has_normals = false;
    for element in &elements {
        match element.name.as_str() {
            "vertex" => has_normals = read_vertices(element, &mut values, &mut mesh)?,
            "face" => read_faces(element, &mut values, &mut mesh)?,
            _ => skip(element, &mut values)?,
        }
    }
    check_mesh(&mesh)?;
    if !has_normals {
        recompute_normals(&mut mesh, CREASE);
    }
    normalise_directions(&mut mesh);
    Ok(mesh)
}

/// Reads the header; returns the encoding, the elements and the body.
fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, &[u8]), Fault> {
    let mut rest = bytes;
    if line(&mut rest)? != "ply" {
        return Err("it does not begin with the line `ply`".into());
    }
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let text = line(&mut rest)?;
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["format", name, _] => encoding = Some(encoding_named(name)?),
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] => elements.push(Element {
                name: (*name).to_owned(),
                count: count
                    .parse()
                    .map_err(|_| format!("bad count in `{text}`"))?,
                properties: Vec::new(),
            }),
            ["property", words @ ..] => elements
                .last_mut()
                .ok_or("a property before any element")?
                .properties
                .push(property(words).ok_or_else(|| format!("bad property `{text}`"))?),
            ["end_header"] => break,
            _ => return Err(format!("unknown header line `{text}`")),
        }
        if elements.len() > 64 {
            return Err("more than 64 elements".into());
        }
    }
    Ok((encoding.ok_or("no `format` line")?, elements, rest))
}

/// Reads the next line of the header, at most 1000 bytes.
fn line<'a>(rest: &mut &'a [u8]) -> Result<&'a str, Fault> {
    let end = rest
        .iter()
        .take(1000)
        .position(|b| *b == b'\n')
        .ok_or("its header does not end")?;
    let (head, tail) = rest.split_at(end);
    *rest = tail.get(1..).unwrap_or_default();
    std::str::from_utf8(head)
        .map(str::trim_end)
        .map_err(|_| "its header is not text".into())
}

fn encoding_named(name: &str) -> Result<Encoding, Fault> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(format!("unknown format `{name}`")),
    }
}

fn property(words: &[&str]) -> Option<Property> {
    match words {
        ["list", count, item, name] => Some(Property::List(
            (*name).to_owned(),
            kind(count)?,
            kind(item)?,
        )),
        [item, name] => Some(Property::Scalar((*name).to_owned(), kind(item)?)),
        _ => None,
    }
}

fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

/// The body, read value by value.
struct Values<'a> {
    encoding: Encoding,
    rest: &'a [u8],
}

impl Values<'_> {
    fn next(&mut self, kind: Kind) -> Result<f64, Fault> {
        match self.encoding {
            Encoding::Ascii => self.word(),
            Encoding::LittleEndian => self.binary(kind, true),
            Encoding::BigEndian => self.binary(kind, false),
        }
    }

    fn word(&mut self) -> Result<f64, Fault> {
        let text = self.rest.trim_ascii_start();
        let end = text
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        std::str::from_utf8(word)
            .ok()
            .and_then(|w| w.parse().ok())
            .ok_or_else(|| "it ends too early or contains a word that is no number".into())
    }

    fn bytes<const N: usize>(&mut self, little: bool) -> Result<[u8; N], Fault> {
        let (head, rest) = self
            .rest
            .split_first_chunk::<N>()
            .ok_or("it ends too early; copy it again")?;
        self.rest = rest;
        let mut out = *head;
        if !little {
            out.reverse();
        }
        Ok(out)
    }

    fn binary(&mut self, kind: Kind, little: bool) -> Result<f64, Fault> {
        Ok(match kind {
            Kind::I8 => i8::from_le_bytes(self.bytes(little)?).into(),
            Kind::U8 => u8::from_le_bytes(self.bytes(little)?).into(),
            Kind::I16 => i16::from_le_bytes(self.bytes(little)?).into(),
            Kind::U16 => u16::from_le_bytes(self.bytes(little)?).into(),
            Kind::I32 => i32::from_le_bytes(self.bytes(little)?).into(),
            Kind::U32 => u32::from_le_bytes(self.bytes(little)?).into(),
            Kind::F32 => f32::from_le_bytes(self.bytes(little)?).into(),
            Kind::F64 => f64::from_le_bytes(self.bytes(little)?),
        })
    }

    /// Reads a non-negative integer.
    fn integer(&mut self, kind: Kind) -> Result<u32, Fault> {
        let value = self.next(kind)?;
        if value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value) {
            Ok(value as u32)
        } else {
            Err(format!("expected a count or an index, found {value}"))
        }
    }
}

fn skip(element: &Element, values: &mut Values) -> Result<(), Fault> {
    // An element without properties has no bytes, whatever its count says.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            skip_property(property, values)?;
        }
    }
    Ok(())
}

fn skip_property(property: &Property, values: &mut Values) -> Result<(), Fault> {
    match property {
        Property::Scalar(_, kind) => values.next(*kind).map(drop),
        Property::List(_, count, kind) => {
            for _ in 0..values.integer(*count)? {
                values.next(*kind)?;
            }
            Ok(())
        }
    }
}

/// Appends the vertices; returns whether they have normals.
fn read_vertices(element: &Element, values: &mut Values, mesh: &mut Mesh) -> Result<bool, Fault> {
    const NAMES: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
    let slots: Vec<Option<usize>> = element
        .properties
        .iter()
        .map(|p| match p {
            Property::Scalar(name, _) => NAMES.iter().position(|n| n == name),
            Property::List(..) => None,
        })
        .collect();
    let has = |slot: usize| slots.contains(&Some(slot));
    if !(has(0) && has(1) && has(2)) {
        return Err("its vertices lack x, y or z".into());
    }
    if element.count > MAX_VERTICES {
        return Err(format!("more than {MAX_VERTICES} vertices; simplify it"));
    }
    for _ in 0..element.count {
        let mut v = [0.0f32; 6];
        for (property, slot) in element.properties.iter().zip(&slots) {
            match (property, slot.and_then(|s| v.get_mut(s))) {
                (Property::Scalar(_, kind), Some(place)) => *place = values.next(*kind)? as f32,
                _ => skip_property(property, values)?,
            }
        }
        mesh.vertices.push(Vertex {
            position: Vec3::new(v[0], v[1], v[2]),
            normal: Vec3::new(v[3], v[4], v[5]),
            uv: Vec2::ZERO,
            tangent: Vec4::ZERO,
        });
    }
    Ok(has(3) && has(4) && has(5))
}

fn read_faces(element: &Element, values: &mut Values, mesh: &mut Mesh) -> Result<(), Fault> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            match property {
                Property::List(name, count, item)
                    if name == "vertex_indices" || name == "vertex_index" =>
                {
                    read_polygon(*count, *item, values, mesh)?;
                }
                _ => skip_property(property, values)?,
            }
        }
    }
    Ok(())
}

/// Reads a polygon as a fan around its first corner.
fn read_polygon(
    count: Kind,
    item: Kind,
    values: &mut Values,
    mesh: &mut Mesh,
) -> Result<(), Fault> {
    let corners = values.integer(count)?;
    let mut first = 0;
    let mut last = 0;
    for i in 0..corners {
        let corner = values.integer(item)?;
        match i {
            0 => first = corner,
            1 => {}
            _ => mesh.indices.extend([first, last, corner]),
        }
        last = corner;
    }
    if mesh.indices.len() / 3 > MAX_TRIANGLES {
        return Err(format!("more than {MAX_TRIANGLES} triangles; simplify it"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::triangles;
    use proptest::prelude::*;

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment a square of two halves\n\
        element vertex 4\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n4 0 1 2 3\n";

    fn binary(little: bool) -> Vec<u8> {
        let name = if little { "little" } else { "big" };
        let mut out = format!(
            "ply\nformat binary_{name}_endian 1.0\nelement vertex 4\nproperty float x\n\
             property float y\nproperty float z\nproperty float nx\nproperty float ny\n\
             property float nz\nelement face 1\nproperty list uchar ushort vertex_index\nend_header\n"
        )
        .into_bytes();
        let floats = |out: &mut Vec<u8>, v: [f32; 6]| {
            for x in v {
                out.extend(if little {
                    x.to_le_bytes()
                } else {
                    x.to_be_bytes()
                });
            }
        };
        for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            floats(&mut out, [x, y, 0.0, 0.0, 0.0, 2.0]);
        }
        out.push(4);
        for i in 0u16..4 {
            out.extend(if little {
                i.to_le_bytes()
            } else {
                i.to_be_bytes()
            });
        }
        out
    }

    fn assert_is_unit_square(mesh: &Mesh) {
        let area: f32 = triangles(mesh)
            .map(|[a, b, c]| (b - a).cross(c - a).z / 2.0)
            .sum();
        assert!((area - 1.0).abs() < 1e-6);
        assert!(
            mesh.vertices.iter().all(|v| v.normal == Vec3::Z),
            "{mesh:?}"
        );
    }

    #[test]
    fn encodings_are_equivalent() {
        assert_is_unit_square(&load_ply(ASCII.as_bytes(), "a.ply").unwrap());
        assert_is_unit_square(&load_ply(&binary(true), "b.ply").unwrap());
        assert_is_unit_square(&load_ply(&binary(false), "c.ply").unwrap());
    }

    #[test]
    fn reads_windows_line_ends() {
        assert_is_unit_square(&load_ply(ASCII.replace('\n', "\r\n").as_bytes(), "a.ply").unwrap());
    }

    #[test]
    fn errors_name_the_fault() {
        let refuse = |text: String, expected: &str| {
            let message = load_ply(text.as_bytes(), "a.ply").unwrap_err().to_string();
            assert!(
                message.starts_with("a.ply: ") && message.contains(expected),
                "{message}"
            );
        };
        refuse("solid".into(), "header");
        refuse(ASCII.replace("ascii", "utf9"), "utf9");
        refuse(ASCII.replace("float x", "half x"), "half x");
        refuse(ASCII.replace("float z", "float w"), "lack x, y or z");
        refuse(ASCII.replace("4 0 1 2 3", "4 0 1 2 4"), "index 4");
        refuse(ASCII.replace("4 0 1 2 3", "4 0 1 2"), "too early");
        refuse(ASCII.replace("1 1 0 3", "nan 1 0 3"), "finite");
        refuse(ASCII.replace("vertex 4", "vertex 99999999999"), "vertices");
        refuse(ASCII.replace("face 1", "face 0"), "no triangles");
        refuse(ASCII.replace("4 0 1 2 3", "4 0 0 0 0"), "no area");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn damaged_bytes_never_panic(
            ascii: bool, at in 0usize..600, byte: u8, cut in prop::option::of(0usize..600),
        ) {
            let mut bytes = if ascii { ASCII.as_bytes().to_vec() } else { binary(true) };
            if let Some(b) = bytes.get_mut(at) {
                *b = byte;
            }
            bytes.truncate(cut.unwrap_or(usize::MAX));
            let _ = load_ply(&bytes, "a.ply");
        }
    }
}
