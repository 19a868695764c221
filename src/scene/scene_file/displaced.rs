//! Writes displacements of objects into the text of a scene file; its comments and order stay.
//!
//! An object's place in the world is `M·T·R·S` with the pose `M` of the whole model. A displacement
//! `E` is a similarity, so `E·M·T·R·S = M·(M⁻¹·E·M)·T·R·S`, and the similarity in brackets is applied
//! to position, rotation and scale of the object and of each of its keys.

use super::place::MAX_COORDINATE;
use super::typed::{Entry, ObjectKeyFile, Place, Scale, SceneFile};
use crate::error::SceneError;
use glam::{DMat4, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_strict_toml::{Fault, TomlText};
use toml_edit::{Array, DocumentMut, Item, TableLike, Value};

/// Written numbers are rounded to this, so that 0.1 stays 0.1.
const DIGITS: f64 = 1e9;
/// Tolerance of a rotation about the vertical.
const VERTICAL: f64 = 1e-9;

/// Returns the text of a scene file with its objects displaced: one world transform for each, which
/// moves, turns and scales, the same along all axes. `name` is that of the file, for messages.
///
/// # Errors
/// The text is not a scene file with as many objects, or an object turns about an axis that the angles
/// of its keys cannot state.
pub fn displaced_text(name: &str, text: &str, by: &[DMat4]) -> Result<String, SceneError> {
    let source = TomlText::new(name, text);
    let file: SceneFile = source.parse()?;
    let located = |fault: Fault| SceneError::from(source.locate(fault));
    let broken = |reason: String| SceneError::broken(name, reason);
    if file.object.len() != by.len() {
        let reason = format!("{} objects are shown; save again", by.len());
        return Err(broken(reason));
    }
    let model = file.model.as_ref().map(|m| m.placement("model"));
    let model = model
        .transpose()
        .map_err(located)?
        .unwrap_or(RigidTransform::IDENTITY);
    let world_from_model = model.to_matrix();
    let mut document: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| {
        broken(e.message().lines().collect::<Vec<_>>().join("; "))
    })?;
    let mut tables = document.get_mut("object").map(tables).unwrap_or_default();
    for (i, (entry, by)) in file.object.iter().zip(by).enumerate() {
        let Some(table) = tables.get_mut(i).filter(|_| *by != DMat4::IDENTITY) else {
            continue;
        };
        let by = Similarity::new(world_from_model.inverse() * *by * world_from_model);
        by.displace(entry, &mut **table, &format!("object[{i}]"))
            .map_err(located)?;
    }
    Ok(document.to_string())
}

/// Returns the text of a scene file with one object, the model in the file `model`.
#[must_use]
pub fn model_text(model: &str) -> String {
    format!("[[object]]\nfile = {}\n", Value::from(model))
}

/// The tables of an array, in either notation.
fn tables(item: &mut Item) -> Vec<&mut dyn TableLike> {
    match item {
        Item::ArrayOfTables(tables) => tables.iter_mut().map(|t| t as &mut dyn TableLike).collect(),
        Item::Value(Value::Array(array)) => array
            .iter_mut()
            .filter_map(Value::as_inline_table_mut)
            .map(|t| t as &mut dyn TableLike)
            .collect(),
        _ => Vec::new(),
    }
}

/// Scales, turns, then moves, in the frame of the whole model.
#[derive(Clone, Copy)]
struct Similarity {
    scale: f64,
    rotation: DQuat,
    offset: DVec3,
}

impl Similarity {
    fn new(matrix: DMat4) -> Self {
        let (scale, rotation, offset) = matrix.to_scale_rotation_translation();
        Self {
            scale: scale.element_sum() / 3.0,
            rotation: rotation.normalize(),
            offset,
        }
    }

    /// The angle of its turn about the vertical, degrees; `None` if it turns about another axis.
    fn yaw(self) -> Option<f64> {
        let up = self.rotation * DVec3::Z;
        let ahead = self.rotation * DVec3::X;
        ((up - DVec3::Z).length() < VERTICAL).then(|| rounded(ahead.y.atan2(ahead.x).to_degrees()))
    }

    fn displace(self, entry: &Entry, table: &mut dyn TableLike, at: &str) -> Result<(), Fault> {
        let own = Place {
            position_m: Some(entry.position_m.unwrap_or_default()),
            rotation_deg: entry.rotation_deg,
            rotation_wxyz: entry.rotation_wxyz,
        };
        self.place(&own, table, at)?;
        let has_turn = entry.rotation_deg.is_some() || entry.rotation_wxyz.is_some();
        if !has_turn {
            self.turn_unturned(entry, table);
        } else if entry.rotation_deg.is_some() && self.yaw().is_none() {
            let rotation = own.placement(at)?.rotation;
            table.remove("rotation_deg");
            set(table, "rotation_wxyz", wxyz(self.rotation * rotation));
        }
        self.grow(Some(entry.scale.unwrap_or(Scale(DVec3::ONE))), table);
        let mut keys = table.get_mut("keys").map(tables).unwrap_or_default();
        for (i, (key, table)) in entry.keys.iter().zip(&mut keys).enumerate() {
            self.displace_key(key, &mut **table, &format!("{at}.keys[{i}]"))?;
        }
        Ok(())
    }

    fn displace_key(
        self,
        key: &ObjectKeyFile,
        table: &mut dyn TableLike,
        at: &str,
    ) -> Result<(), Fault> {
        if key.rotation_deg.is_some() && self.yaw().is_none() {
            let reason = "its object was turned, and [model] is tilted: angles cannot state that; \
                          write rotation_wxyz in its place, or put the object back";
            return Err(Fault::new(format!("{at}.rotation_deg"), reason));
        }
        let place = Place {
            position_m: key.position_m,
            rotation_deg: key.rotation_deg,
            rotation_wxyz: key.rotation_wxyz,
        };
        self.place(&place, table, at)?;
        self.grow(key.scale, table);
        Ok(())
    }

    /// Displaces the values that a table states. Of `rotation_deg` only the yaw changes, so that full
    /// turns from key to key remain.
    fn place(self, place: &Place, table: &mut dyn TableLike, at: &str) -> Result<(), Fault> {
        if let Some(position) = place.position_m {
            let position = self.rotation * (DVec3::from(position) * self.scale) + self.offset;
            if position.abs().max_element() > MAX_COORDINATE {
                return Err(Fault::new(format!("{at}.position_m"), "it is too far away"));
            }
            set(table, "position_m", array(&position.to_array()));
        }
        if let (Some([yaw, pitch, roll]), Some(turn)) = (place.rotation_deg, self.yaw())
            && turn != 0.0
        {
            set(table, "rotation_deg", array(&[yaw + turn, pitch, roll]));
        }
        if let Some([w, x, y, z]) = place.rotation_wxyz {
            let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
            set(table, "rotation_wxyz", wxyz(self.rotation * rotation));
        }
        Ok(())
    }

    /// Turns an object that states no rotation, in the notation of its keys.
    fn turn_unturned(self, entry: &Entry, table: &mut dyn TableLike) {
        let by_quaternion = entry.keys.iter().any(|k| k.rotation_wxyz.is_some());
        match self.yaw().filter(|_| !by_quaternion) {
            Some(0.0) => (),
            Some(yaw) => set(table, "rotation_deg", array(&[yaw, 0.0, 0.0])),
            None => set(table, "rotation_wxyz", wxyz(self.rotation)),
        }
    }

    fn grow(self, scale: Option<Scale>, table: &mut dyn TableLike) {
        let Some(Scale(scale)) = scale.filter(|_| (self.scale - 1.0).abs() > 1.0 / DIGITS) else {
            return;
        };
        let scale = scale * self.scale;
        let value = if scale.min_element() == scale.max_element() {
            rounded(scale.x).into()
        } else {
            array(&scale.to_array())
        };
        set(table, "scale", value);
    }
}

/// Sets a key and keeps its comment.
fn set(table: &mut dyn TableLike, key: &str, value: Value) {
    if let Some(Item::Value(old)) = table.get_mut(key) {
        let decor = old.decor().clone();
        *old = value;
        *old.decor_mut() = decor;
    } else {
        table.insert(key, Item::Value(value));
    }
}

fn rounded(x: f64) -> f64 {
    // Never -0.0.
    (x * DIGITS).round() / DIGITS + 0.0
}

fn array(numbers: &[f64]) -> Value {
    numbers
        .iter()
        .map(|x| rounded(*x))
        .collect::<Array>()
        .into()
}

fn wxyz(q: DQuat) -> Value {
    array(&[q.w, q.x, q.y, q.z])
}
