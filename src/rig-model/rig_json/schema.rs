//! The JSON schema of `rig.json`, generated from the types that read it.

use super::RigEntry;
use super::values::{
    Albedo, Array, CameraMatrix, Colour, Count, Direction, Focal, ImageSize, Latency, List,
    MAX_COUNT, MAX_LATENCY_SECONDS, MAX_MAGNITUDE, NotNegative, Number, Placement, Pose, Positive,
    Vector,
};
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::Value;
use std::borrow::Cow;

/// Returns the JSON schema (draft 2020-12) of `rig.json`. A file that [`super::RigDocument::parse`] reads
/// is valid by it; the reader also checks what a schema cannot state, such as rotations.
#[must_use]
pub fn rig_json_schema() -> Value {
    let generator = SchemaSettings::draft2020_12().into_generator();
    generator.into_root_schema_for::<RigEntry>().to_value()
}

/// Implements [`JsonSchema`] for values that stand where they are used.
macro_rules! values {
    ($($type:ty => $schema:expr;)*) => { $(
        impl JsonSchema for $type {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> Cow<'static, str> {
                stringify!($type).into()
            }

            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                let schema: fn(&mut SchemaGenerator) -> Schema = $schema;
                schema(generator)
            }
        }
    )* };
}

/// A schema with a description.
fn described(schema: Schema, description: &str) -> Schema {
    let mut schema = schema;
    schema.insert("description".to_owned(), description.into());
    schema
}

fn numbers(count: usize, least: f64, most: f64, description: &str) -> Schema {
    json_schema!({
        "type": "array",
        "description": description,
        "items": { "type": "number", "minimum": least, "maximum": most },
        "minItems": count,
        "maxItems": count,
    })
}

values! {
    Number => |_| json_schema!({ "type": "number", "minimum": -MAX_MAGNITUDE, "maximum": MAX_MAGNITUDE });
    Positive => |_| json_schema!({ "type": "number", "exclusiveMinimum": 0, "maximum": MAX_MAGNITUDE });
    Focal => |_| json_schema!({ "type": "number", "minimum": 1, "maximum": MAX_MAGNITUDE, "description": "Focal length, pixels." });
    NotNegative => |_| json_schema!({ "type": "number", "minimum": 0, "maximum": MAX_MAGNITUDE });
    Latency => |_| json_schema!({ "type": "number", "minimum": -MAX_LATENCY_SECONDS, "maximum": MAX_LATENCY_SECONDS, "description": "Seconds." });
    Count => |_| json_schema!({ "type": "integer", "minimum": 0, "maximum": MAX_COUNT });
    Vector => |_| numbers(3, -MAX_MAGNITUDE, MAX_MAGNITUDE, "x, y, z, metres.");
    Direction => |_| numbers(3, -MAX_MAGNITUDE, MAX_MAGNITUDE, "A direction other than 0, 0, 0.");
    Colour => |_| numbers(3, 0.0, MAX_MAGNITUDE, "Linear red, green, blue.");
    Albedo => |_| numbers(3, 0.0, 1.0, "Linear diffuse reflectance of red, green, blue.");
    ImageSize => |_| json_schema!({
        "type": "array", "description": "Width and height, pixels.",
        "items": { "type": "integer", "minimum": 1, "maximum": MAX_COUNT }, "minItems": 2, "maxItems": 2,
    });
    CameraMatrix => |generator| described(
        Array::<Array<Number, 3>, 3>::json_schema(generator),
        "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels; (0, 0) is the centre of the top-left pixel.",
    );
    Placement => |generator| placement(generator, "An affine placement: `matrix_row_major` (4x4), or `position` with `quaternion_wxyz`.");
    Pose => |generator| placement(generator, "A rotation and a translation: `matrix_row_major` (4x4), or `position` with `quaternion_wxyz`.");
}

fn placement(generator: &mut SchemaGenerator, description: &str) -> Schema {
    let matrix = Array::<Array<Number, 4>, 4>::json_schema(generator);
    json_schema!({
        "type": "object",
        "description": description,
        "properties": {
            "matrix_row_major": matrix,
            "position": numbers(3, -MAX_MAGNITUDE, MAX_MAGNITUDE, "x, y, z, metres."),
            "quaternion_wxyz": numbers(4, -1.01, 1.01, "A unit quaternion w, x, y, z."),
        },
        "anyOf": [
            { "required": ["matrix_row_major"] },
            { "required": ["position", "quaternion_wxyz"] },
        ],
    })
}

impl<T: JsonSchema, const MIN: usize, const MAX: usize> JsonSchema for List<T, MIN, MAX> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        format!("List_of_{}_{MIN}_{MAX}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let items = generator.subschema_for::<T>();
        json_schema!({ "type": "array", "items": items, "minItems": MIN, "maxItems": MAX })
    }
}

impl<T: JsonSchema, const N: usize> JsonSchema for Array<T, N> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        List::<T, N, N>::schema_name()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        List::<T, N, N>::json_schema(generator)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RigDocument;
    use std::path::Path;

    /// The page of the book.
    const PAGE: &str = "docs/src/rig.schema.json";

    fn root() -> &'static Path {
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
    }

    /// Checks a value by the keywords that the schema uses; an unknown one is an error of the test. A
    /// validator of a library would bring some sixty crates.
    struct Validator(Value);

    impl Validator {
        fn is_valid(&self, value: &Value) -> bool {
            self.fits(&self.0, value)
        }

        fn fits(&self, schema: &Value, value: &Value) -> bool {
            let Value::Object(schema) = schema else {
                return schema == &Value::Bool(true);
            };
            schema.iter().all(|(keyword, rule)| match keyword.as_str() {
                "$schema" | "$defs" | "title" | "description" | "format" | "default" => true,
                "$ref" => {
                    let path = rule.as_str().unwrap().trim_start_matches('#');
                    self.fits(self.0.pointer(path).unwrap(), value)
                }
                "anyOf" | "oneOf" => each(rule).any(|s| self.fits(s, value)),
                "const" => rule == value,
                "enum" => each(rule).any(|x| x == value),
                "type" => match rule {
                    Value::Array(all) => all.iter().any(|t| is_type(t, value)),
                    one => is_type(one, value),
                },
                "minimum" => value.as_f64().is_none_or(|x| x >= rule.as_f64().unwrap()),
                "maximum" => value.as_f64().is_none_or(|x| x <= rule.as_f64().unwrap()),
                "exclusiveMinimum" => value.as_f64().is_none_or(|x| x > rule.as_f64().unwrap()),
                "items" => value
                    .as_array()
                    .is_none_or(|l| l.iter().all(|v| self.fits(rule, v))),
                "minItems" => value
                    .as_array()
                    .is_none_or(|l| l.len() as u64 >= rule.as_u64().unwrap()),
                "maxItems" => value
                    .as_array()
                    .is_none_or(|l| l.len() as u64 <= rule.as_u64().unwrap()),
                "required" => value
                    .as_object()
                    .is_none_or(|o| each(rule).all(|k| o.contains_key(k.as_str().unwrap()))),
                "properties" => value.as_object().is_none_or(|o| {
                    let rules = rule.as_object().unwrap();
                    o.iter()
                        .all(|(k, v)| rules.get(k).is_none_or(|s| self.fits(s, v)))
                }),
                "additionalProperties" => {
                    *rule == Value::Bool(false) && {
                        let known = schema.get("properties").and_then(Value::as_object);
                        let keys = value.as_object().into_iter().flat_map(|o| o.keys());
                        keys.into_iter()
                            .all(|k| known.is_some_and(|p| p.contains_key(k)))
                    }
                }
                other => panic!("the test does not know {other}"),
            })
        }
    }

    fn each(list: &Value) -> std::slice::Iter<'_, Value> {
        list.as_array().unwrap().iter()
    }

    fn is_type(name: &Value, value: &Value) -> bool {
        match name.as_str().unwrap() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "null" => value.is_null(),
            "number" => value.is_number(),
            "integer" => value.is_u64() || value.is_i64(),
            other => panic!("the test does not know the type {other}"),
        }
    }

    fn validator() -> Validator {
        Validator(rig_json_schema())
    }

    /// Complete descriptions of rigs: a fisheye, a sphere of its own, a sphere on a marker.
    fn rigs() -> Vec<Value> {
        super::super::tests::complete_rigs()
    }

    /// Paths of all values in a document.
    fn paths(value: &Value, path: &str, out: &mut Vec<String>) {
        match value {
            Value::Object(map) => map.iter().for_each(|(key, value)| {
                out.push(format!("{path}/{key}"));
                paths(value, &format!("{path}/{key}"), out);
            }),
            Value::Array(list) => list.iter().take(2).enumerate().for_each(|(i, value)| {
                out.push(format!("{path}/{i}"));
                paths(value, &format!("{path}/{i}"), out);
            }),
            _ => (),
        }
    }

    #[test]
    fn descriptions_that_can_be_read_are_valid() {
        let validator = validator();
        for rig in rigs() {
            RigDocument::parse(rig.to_string().as_bytes()).unwrap();
            assert!(validator.is_valid(&rig), "{rig}");
        }
    }

    /// What the schema refuses is refused by the reader; an object in place of another value by both.
    #[test]
    fn reader_and_schema_refuse_the_same_types() {
        let validator = validator();
        for rig in rigs() {
            let mut all = Vec::new();
            paths(&rig, "", &mut all);
            for path in all {
                for wrong in [
                    Value::from("§"),
                    Value::from(-1e9),
                    serde_json::json!({"§": 1}),
                ] {
                    let mut changed = rig.clone();
                    *changed.pointer_mut(&path).unwrap() = wrong.clone();
                    let reads = RigDocument::parse(changed.to_string().as_bytes()).is_ok();
                    let valid = validator.is_valid(&changed);
                    assert!(valid || !reads, "only the schema refuses {wrong} at {path}");
                    // A place of an object takes any; a list of coefficients may be one.
                    let may_be_object = rig.pointer(&path).is_some_and(Value::is_object)
                        || path.ends_with("/lens_distortion");
                    let is_note = path == "/notes";
                    assert!(
                        !valid || !wrong.is_object() || may_be_object || is_note,
                        "{wrong} at {path}"
                    );
                }
            }
        }
    }

    #[test]
    fn rig_schema_page_is_up_to_date() {
        let text = serde_json::to_string_pretty(&rig_json_schema()).unwrap() + "\n";
        let path = root().join(PAGE);
        if std::env::var_os("UPDATE_DOCS").is_some() {
            std::fs::write(path, text).unwrap();
            return;
        }
        let page = std::fs::read_to_string(path).unwrap_or_default();
        assert!(page == text, "{PAGE} is out of date; run `make docs-write`");
    }
}
