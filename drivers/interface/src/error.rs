//! Errors of devices, and how to recover from them.

use thiserror::Error;

/// How the supervisor recovers from a [`DeviceError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recovery {
    /// Go on reading: one record or frame was lost.
    Retry,
    /// Close the device and open it again after a pause.
    Reopen,
    /// Give up: the user must change something.
    Fatal,
}

/// An error of a device. Each message names the device, the error and a remedy.
#[derive(Clone, Debug, Error)]
pub enum DeviceError {
    /// The device does not exist.
    #[error("{device}: not connected; plug it in or configure another one")]
    NotFound {
        /// Path or name.
        device: String,
    },
    /// The device disappeared while in use.
    #[error("{device}: disconnected; plug it in again")]
    Unplugged {
        /// Path or name.
        device: String,
    },
    /// The device has sent nothing for too long.
    #[error("{device}: silent for {millis} ms; {}", silence_advice(device))]
    Silent {
        /// Path or name.
        device: String,
        /// How long, milliseconds.
        millis: u64,
    },
    /// The device stopped working; opening it again may help.
    #[error("{device}: stopped working ({reason}); opening it again")]
    Broken {
        /// Path or name.
        device: String,
        /// What failed.
        reason: String,
    },
    /// The device sent bytes that are not a valid frame or record.
    #[error("{device}: damaged data ({reason})")]
    Damaged {
        /// Path or name.
        device: String,
        /// What was wrong.
        reason: String,
    },
    /// Another program uses the device.
    #[error("{device}: in use by another program; close that one (`fuser -v {device}` names it)")]
    Busy {
        /// Path.
        device: String,
    },
    /// The user has no permission for the device. Opening it again may help: just after plugging
    /// in, udev has not yet assigned the device file to its group.
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
    /// The device exists but cannot be used now: another program uses it, or it sends unexpected
    /// data.
    #[error("{device}: {reason}")]
    Unready {
        /// Path or name.
        device: String,
        /// Observed reason and remedy.
        reason: String,
    },
    /// The operating system refused.
    #[error("{device}: {reason}")]
    Refused {
        /// Path or name.
        device: String,
        /// Reason and remedy.
        reason: String,
    },
}

/// What to do about a silent device, by its name.
fn silence_advice(device: &str) -> &'static str {
    if device.starts_with("udp:") {
        "check that its sender runs and sends to this address and port"
    } else if device.starts_with("vrpn:") {
        "check that the tracker is on, and its name at the server"
    } else {
        "check its cable and power"
    }
}

impl DeviceError {
    /// How the supervisor recovers from this error.
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
