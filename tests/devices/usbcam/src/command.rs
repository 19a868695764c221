//! Commands of the emulator: one line, answered by one line.

use crate::bus::{Bus, BusError};
use thiserror::Error;

/// Syntax of the commands.
pub const HELP: &str = "\
plug CAMERA             CAMERA is scene or environment
unplug CAMERA
freeze CAMERA           send no frames, but answer requests
thaw CAMERA
errors CAMERA COUNT     set the error bit of COUNT frames
truncate CAMERA COUNT   cut COUNT JPEG frames in half
tables CAMERA on|off    JPEG frames with or without Huffman tables
lag CAMERA COUNT        frames until a setting takes effect
state CAMERA            plugged or not, newest frame's number and settings
reset                   all plugged in, no faults, controls at their defaults";

/// A line that is not a command, or a command that cannot be executed.
#[derive(Debug, Error)]
pub enum CommandError {
    /// The line does not follow [`HELP`].
    #[error("no such command: {line}")]
    Unknown {
        /// The line.
        line: String,
    },
    /// The bus refused the command.
    #[error(transparent)]
    Bus(#[from] BusError),
}

/// Executes a command and returns the answer.
///
/// # Errors
/// The line is not a command, or the command cannot be executed now.
pub fn execute(bus: &mut Bus, line: &str) -> Result<String, CommandError> {
    let unknown = || CommandError::Unknown {
        line: line.to_owned(),
    };
    let words: Vec<&str> = line.split_whitespace().collect();
    if words == ["reset"] {
        bus.reset()?;
        return Ok("ok".into());
    }
    let camera = match words.get(1) {
        Some(&"scene") => 0,
        Some(&"environment") => 1,
        _ => return Err(unknown()),
    };
    let count = || {
        words
            .get(2)
            .and_then(|word| word.parse::<u32>().ok())
            .ok_or_else(unknown)
    };
    match (words[0], words.get(2)) {
        ("state", _) => return Ok(bus.state(camera)),
        ("plug", _) => bus.plug(camera)?,
        ("unplug", _) => bus.unplug(camera)?,
        ("freeze", _) => bus.faults(camera).frozen = true,
        ("thaw", _) => bus.faults(camera).frozen = false,
        ("errors", _) => bus.faults(camera).damaged = count()?,
        ("truncate", _) => bus.faults(camera).truncated = count()?,
        ("lag", _) => bus.faults(camera).lag = count()? as usize,
        ("tables", Some(&"on")) => bus.faults(camera).huffman_tables = true,
        ("tables", Some(&"off")) => bus.faults(camera).huffman_tables = false,
        _ => return Err(unknown()),
    }
    Ok("ok".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_set_faults_and_unknown_ones_are_refused() {
        let mut bus = Bus::default();
        for line in [
            "errors scene 3",
            "lag scene 2",
            "tables scene off",
            "freeze environment",
        ] {
            assert_eq!(execute(&mut bus, line).unwrap(), "ok", "{line}");
        }
        let faults = *bus.faults(0);
        assert_eq!(
            (faults.damaged, faults.lag, faults.huffman_tables),
            (3, 2, false)
        );
        assert!(bus.faults(1).frozen && !faults.frozen);
        for line in [
            "",
            "plug",
            "lag scene",
            "lag scene x",
            "tables scene",
            "melt scene",
        ] {
            let error = execute(&mut bus, line).unwrap_err();
            assert!(
                error.to_string().starts_with("no such command"),
                "{line}: {error}"
            );
        }
        assert_eq!(execute(&mut bus, "state scene").unwrap(), "unplugged");
    }
}
