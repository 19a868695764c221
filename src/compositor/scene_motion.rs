//! Where the scene's moving parts are in this frame.

use super::Compositor;
use super::moving::upload;

impl Compositor {
    /// Puts all that moves where it is `seconds` after the session began: what is drawn next
    /// shows it there, with the shadows that it casts there. Nothing is done where nothing has
    /// moved since.
    pub fn set_time(&mut self, seconds: f64) {
        let mut moved = false;
        let buffers = (&self.scene.virtual_buffer, &self.scene.caster_places);
        for (number, part) in self.scene.moving.iter_mut().enumerate() {
            let world = part.motion.at(seconds);
            if world == part.world {
                continue;
            }
            part.world = world;
            moved = true;
            upload(&self.gpu.queue, part, number, buffers);
            self.slots.move_caster(number, world.as_mat4());
            if let Some(corners) = part.placed_corners() {
                self.cover.set_box(part.index, corners);
                if let Some(drawn) = self.scene.virtual_parts.get_mut(part.index) {
                    drawn.details.set_corners(corners);
                }
            }
        }
        if moved {
            self.slots.casters_moved();
        }
    }
}
