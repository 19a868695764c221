//! Devices that a program which uses Penumbra as a library implements itself.

use crate::error::DeviceError;
use crate::time::Clock;
use std::fmt;
use std::sync::Arc;

type Open<D> = dyn Fn(&Arc<dyn Clock>) -> Result<Box<D>, DeviceError> + Send + Sync;

/// Opens a device that the caller implements, each time its supervisor asks for it.
pub struct DeviceFactory<D: ?Sized> {
    name: Arc<str>,
    open: Arc<Open<D>>,
}

impl<D: ?Sized> DeviceFactory<D> {
    /// `name` is shown in messages. `open` is called again after the previous device was
    /// dropped.
    pub fn new(
        name: &str,
        open: impl Fn(&Arc<dyn Clock>) -> Result<Box<D>, DeviceError> + Send + Sync + 'static,
    ) -> Self {
        Self {
            name: Arc::from(name),
            open: Arc::new(open),
        }
    }

    /// The name shown in messages.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Opens the device.
    ///
    /// # Errors
    /// The device cannot be opened.
    pub fn open(&self, clock: &Arc<dyn Clock>) -> Result<Box<D>, DeviceError> {
        (self.open)(clock)
    }
}

impl<D: ?Sized> Clone for DeviceFactory<D> {
    fn clone(&self) -> Self {
        Self {
            name: Arc::clone(&self.name),
            open: Arc::clone(&self.open),
        }
    }
}

impl<D: ?Sized> fmt::Debug for DeviceFactory<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("DeviceFactory").field(&self.name).finish()
    }
}

/// Two factories are equal if they are the same one.
impl<D: ?Sized> PartialEq for DeviceFactory<D> {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.open, &other.open)
    }
}
