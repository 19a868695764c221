//! The settings of a serial line, and whether a port uses them.

use serialport::{DataBits, FlowControl, Parity, SerialPort, SerialPortBuilder, StopBits};
use std::fmt;

/// Baud rate and the shape of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LineSettings {
    pub baud: u32,
    pub data_bits: DataBits,
    pub parity: Parity,
    pub stop_bits: StopBits,
    pub flow_control: FlowControl,
}

impl LineSettings {
    /// 8 data bits, 1 stop bit, no flow control.
    pub(super) const fn new(baud: u32, parity: Parity) -> Self {
        Self {
            baud,
            data_bits: DataBits::Eight,
            parity,
            stop_bits: StopBits::One,
            flow_control: FlowControl::None,
        }
    }

    /// Puts the settings into a builder.
    pub(super) fn apply(self, builder: SerialPortBuilder) -> SerialPortBuilder {
        builder
            .baud_rate(self.baud)
            .data_bits(self.data_bits)
            .parity(self.parity)
            .stop_bits(self.stop_bits)
            .flow_control(self.flow_control)
    }

    /// The settings that a port has now.
    ///
    /// # Errors
    /// The system cannot read the settings.
    pub(super) fn of(port: &impl SerialPort) -> serialport::Result<Self> {
        Ok(Self {
            baud: port.baud_rate()?,
            data_bits: port.data_bits()?,
            parity: port.parity()?,
            stop_bits: port.stop_bits()?,
            flow_control: port.flow_control()?,
        })
    }

    /// Whether a port with the settings `actual` can communicate with a device that uses these.
    ///
    /// A driver divides a clock, so the baud rate may deviate by 2.5 %: the receiver samples the
    /// last bit of ten in its middle, and each side may use half of that half bit.
    pub(super) fn are_met_by(self, actual: Self) -> bool {
        let close = self.baud.abs_diff(actual.baud) <= self.baud / 40;
        close
            && Self {
                baud: self.baud,
                ..actual
            } == self
    }
}

/// As in `115200 baud, 8N1`.
impl fmt::Display for LineSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Odd => 'O',
            Parity::Even => 'E',
        };
        let (data, stop) = (u8::from(self.data_bits), u8::from(self.stop_bits));
        write!(f, "{} baud, {data}{parity}{stop}", self.baud)?;
        match self.flow_control {
            FlowControl::None => Ok(()),
            FlowControl::Software => f.write_str(", XON/XOFF"),
            FlowControl::Hardware => f.write_str(", RTS/CTS"),
        }
    }
}

#[cfg(test)]
mod tests;
