//! Recovers from the loss of the graphics device: opens it again and rebuilds what was on it.

use super::{Run, compositor};
use crate::context::RunContext;
use crate::error::RigError;
use crate::status as published;
use penumbra_compositor::{Gpu, GpuError};
use std::time::{Duration, Instant};

/// Number of losses without a picture in between after which the run ends.
const MAX_SUCCESSIVE_LOSSES: u32 = 3;
/// Maximum time to try to open a device again. A driver that resets its adapter needs a moment.
const REOPEN_FOR: Duration = Duration::from_secs(10);
/// Interval of these tries.
const REOPEN_EVERY: Duration = Duration::from_millis(100);

impl Run {
    /// Opens the graphics device again and rebuilds the compositor if `error` has come from its
    /// loss; the frame can then be composed again. Devices and recording go on meanwhile; the
    /// screen follows with its next picture.
    ///
    /// # Errors
    /// `error`, if the device was not lost or was lost again and again; the device cannot be opened
    /// again.
    pub(super) fn recover(
        &mut self,
        context: &RunContext,
        error: RigError,
    ) -> Result<(), RigError> {
        let gpu = self.compositor.gpu().clone();
        let Some(reason) = gpu.loss() else {
            return Err(error);
        };
        self.successive_losses += 1;
        if self.successive_losses > MAX_SUCCESSIVE_LOSSES {
            return Err(error);
        }
        self.lost_at.get_or_insert_with(Instant::now);
        self.compositor = compositor(context, reopen(context, &gpu)?);
        self.compositor.set_light_budget(self.settings.light_count);
        self.planes.forget_device();
        self.scenes.upload_to(&mut self.compositor);
        self.has_picture = false;
        let text = format!(
            "graphics device '{}' was lost ({reason}) and opened again",
            gpu.name
        );
        tracing::warn!("{text}");
        published::reopened(&context.status, self.compositor.gpu(), &text);
        Ok(())
    }

    /// Publishes how long there was no picture, with the first one after a loss.
    pub(super) fn end_recovery(&mut self, context: &RunContext) {
        if let Some(lost_at) = self.lost_at.take() {
            published::recovered(&context.status, lost_at.elapsed());
        }
        self.successive_losses = 0;
    }
}

/// Opens the device again, trying for some time.
fn reopen(context: &RunContext, lost: &Gpu) -> Result<Gpu, GpuError> {
    let begun = Instant::now();
    loop {
        match lost.reopen() {
            Err(error) if begun.elapsed() > REOPEN_FOR || context.is_shutting_down() => {
                return Err(error);
            }
            Err(_) => std::thread::sleep(REOPEN_EVERY),
            opened => return opened,
        }
    }
}
