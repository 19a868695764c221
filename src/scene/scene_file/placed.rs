//! Converts the objects and lamps of a scene file to parts, lamps and motions.

use super::typed::{Entry, LampFile};
use super::{Surroundings, lamp, motion, refuse_phantom_keys};
use crate::edit::SceneObject;
use crate::error::SceneError;
use crate::lamps::MAX_LAMPS;
use crate::mesh::Part;
use crate::motion::{Motion, Motions, Mover};
use crate::virtual_light::VirtualLight;
use glam::DMat4;
use penumbra_strict_toml::{Fault, TomlText};
use std::collections::HashMap;
use std::path::Path;

/// Parts, lamps and motions that were converted so far.
#[derive(Default)]
pub(super) struct Placed {
    pub objects: Vec<Part>,
    /// Which parts and lamps belong together.
    pub groups: Vec<SceneObject>,
    pub lamps: Vec<VirtualLight>,
    /// Prefix of a message about each lamp: file, line and key.
    pub lamp_places: Vec<String>,
    pub motions: Motions,
    /// Warnings of the model files, each once.
    pub warnings: Vec<String>,
    /// World from the frame of lamps that are attached to an object, by its name.
    frames: HashMap<String, DMat4>,
    /// Motions of objects by name.
    carriers: HashMap<String, Motion>,
}

impl Placed {
    /// Adds the parts and lamps of entry `index` of the file's objects.
    pub fn add_object(
        &mut self,
        (index, entry): (usize, &Entry),
        (folder, text): (&Path, &TomlText),
        world_from_model: DMat4,
        white: Option<f64>,
    ) -> Result<(), SceneError> {
        let located = |fault: Fault| SceneError::from(text.locate(fault));
        let at = format!("object[{index}]");
        refuse_phantom_keys(entry, &at).map_err(located)?;
        let model = entry.model(&at, folder, text)?;
        for warning in &model.warnings {
            if !self.warnings.contains(warning) {
                self.warnings.push(warning.clone());
            }
        }
        let motion_of_object = entry.motion(&at, world_from_model).map_err(located)?;
        let parts = entry.parts(&model, &at, folder, text)?;
        let (first, first_lamp) = (self.objects.len(), self.lamps.len());
        let name = parts.first().map(|part| part.name.clone());
        for (k, mut part) in parts.into_iter().enumerate() {
            let motion = model.part_motion(k, &motion_of_object);
            part.world_from_part = motion.at(0.0);
            let index = self.objects.len();
            self.motions.parts.extend(moving(index, motion));
            self.objects.push(part);
        }
        for (k, lamp) in model.lamps.iter().enumerate() {
            let white = white.ok_or_else(|| located(lamp::without_white(&at)))?;
            let motion = model.lamp_motion(k, &motion_of_object);
            self.add(lamp.placed(motion_of_object.at(0.0), white), motion);
            self.lamp_places
                .push(message_prefix(text, format!("{at}.file")));
        }
        self.groups.push(SceneObject {
            name: entry.name.clone().or(name).unwrap_or_default(),
            parts: first..self.objects.len(),
            lamps: (first_lamp..self.lamps.len()).collect(),
        });
        if let Some(name) = &entry.name {
            let frame = motion::lamp_frame(&motion_of_object);
            self.frames.insert(name.clone(), frame);
            self.carriers.insert(name.clone(), motion_of_object);
        }
        Ok(())
    }

    /// Adds the file's lamps, after all of its objects.
    pub fn add_lamps(
        &mut self,
        lamps: &[LampFile],
        (folder, text): (&Path, &TomlText),
        white: Option<f64>,
    ) -> Result<(), SceneError> {
        let located = |fault: Fault| SceneError::from(text.locate(fault));
        if self.lamps.len() + lamps.len() > MAX_LAMPS {
            let reason = format!("expected at most {MAX_LAMPS} lamps");
            return Err(located(Fault::new("lamp", reason)));
        }
        for (i, file) in lamps.iter().enumerate() {
            let surroundings = Surroundings {
                objects: &self.frames,
                white,
                folder,
            };
            let at = format!("lamp[{i}]");
            let lamp = lamp::lamp(file, &at, &surroundings).map_err(located)?;
            let place = message_prefix(text, format!("{at}.position_m"));
            self.lamp_places.push(place);
            let carrier = file.attached_to.as_ref();
            let index = self.lamps.len();
            // Of objects of one name, the last carries the lamp.
            let mut groups = self.groups.iter_mut().rev();
            if let Some(group) = groups.find(|group| Some(&group.name) == carrier) {
                group.lamps.push(index);
            }
            let motion = carrier.and_then(|name| self.carriers.get(name));
            self.add(lamp, motion.cloned().unwrap_or_default());
        }
        Ok(())
    }

    fn add(&mut self, lamp: VirtualLight, motion: Motion) {
        let index = self.lamps.len();
        self.motions.lamps.extend(moving(index, motion));
        self.lamps.push(lamp);
    }
}

/// Prefix of a message: file, line and key.
fn message_prefix(text: &TomlText, key: String) -> String {
    text.locate(Fault::new(key, "")).to_string()
}

/// Entry `index` of [`Motions`], if it moves.
fn moving(index: usize, motion: Motion) -> Option<Mover> {
    motion.moves().then_some(Mover { index, motion })
}
