//! What can go wrong with a device, and what to do then.

use thiserror::Error;

/// What the supervisor is to do after a [`DeviceError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recovery {
    /// Go on reading: only one record or frame was lost.
    Retry,
    /// Close the device and open it again after a pause.
    Reopen,
    /// Nothing helps but the user.
    Fatal,
}

/// A device misbehaved. Each text says what, where and what to do.
#[derive(Clone, Debug, Error)]
pub enum DeviceError {
    /// No such device.
    #[error("{device}: not there; plug it in or name another one")]
    NotFound {
        /// Path or name.
        device: String,
    },
    /// The device went away while in use.
    #[error("{device}: gone; plug it in again")]
    Unplugged {
        /// Path or name.
        device: String,
    },
    /// The device sent nothing for too long.
    #[error("{device}: silent for {millis} ms; check its cable and power")]
    Silent {
        /// Path or name.
        device: String,
        /// How long, milliseconds.
        millis: u64,
    },
    /// The device stopped working in a way that opening it again may mend.
    #[error("{device}: stopped working ({reason}); opening it again")]
    Broken {
        /// Path or name.
        device: String,
        /// What failed.
        reason: String,
    },
    /// The device sent something that is no frame or record.
    #[error("{device}: damaged data ({reason})")]
    Damaged {
        /// Path or name.
        device: String,
        /// What was wrong.
        reason: String,
    },
    /// Another program has the device.
    #[error("{device}: in use by another program; close that one (`fuser -v {device}` names it)")]
    Busy {
        /// Path.
        device: String,
    },
    /// The user may not use the device. Just after plugging in this passes, once udev has
    /// given the device file to its group.
    #[error(
        "{device}: no permission; join its group: sudo usermod -aG {group} $USER, then log \
         out and in"
    )]
    NotPermitted {
        /// Path.
        device: String,
        /// Group that the device file belongs to.
        group: String,
    },
    /// It is there but of no use now: another program has it, or it speaks otherwise than
    /// it should.
    #[error("{device}: {reason}")]
    Unready {
        /// Path or name.
        device: String,
        /// What was seen and what to do.
        reason: String,
    },
    /// The operating system refused.
    #[error("{device}: {reason}")]
    Refused {
        /// Path or name.
        device: String,
        /// What it said and what to do.
        reason: String,
    },
}

impl DeviceError {
    /// What the supervisor is to do.
    #[must_use]
    pub fn recovery(&self) -> Recovery {
        match self {
            Self::Damaged { .. } => Recovery::Retry,
            Self::NotFound { .. }
            | Self::Unplugged { .. }
            | Self::Silent { .. }
            | Self::Broken { .. }
            | Self::Busy { .. }
            | Self::NotPermitted { .. }
            | Self::Unready { .. } => Recovery::Reopen,
            Self::Refused { .. } => Recovery::Fatal,
        }
    }
}
