//! Devices that a program brings along which has Penumbra as its library.

use penumbra_interface::{Clock, DeviceError};
use std::fmt;
use std::sync::Arc;

type Open<D> = dyn Fn(&Arc<dyn Clock>) -> Result<Box<D>, DeviceError> + Send + Sync;

/// Opens a device of somebody else's making, whenever its supervisor wants to.
pub struct Maker<D: ?Sized> {
    name: Arc<str>,
    open: Arc<Open<D>>,
}

impl<D: ?Sized> Maker<D> {
    /// `name` is for messages. `open` may be called again and again, once the device before
    /// is gone.
    pub fn new(
        name: &str,
        open: impl Fn(&Arc<dyn Clock>) -> Result<Box<D>, DeviceError> + Send + Sync + 'static,
    ) -> Self {
        Self {
            name: Arc::from(name),
            open: Arc::new(open),
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn open(&self, clock: &Arc<dyn Clock>) -> Result<Box<D>, DeviceError> {
        (self.open)(clock)
    }
}

impl<D: ?Sized> Clone for Maker<D> {
    fn clone(&self) -> Self {
        Self {
            name: Arc::clone(&self.name),
            open: Arc::clone(&self.open),
        }
    }
}

impl<D: ?Sized> fmt::Debug for Maker<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Maker").field(&self.name).finish()
    }
}

/// The same maker, not one that is like it.
impl<D: ?Sized> PartialEq for Maker<D> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.open, &other.open)
    }
}
