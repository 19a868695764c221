//! All protocols as one type, by the names under which sessions store them.

use crate::decoder::Decoder;
use crate::framing::{Framing, Verdict};
use crate::settings::TrackerSettings;
use crate::step::Step;
use crate::{csv, fastrak, flock, freed, liberty, vrpn};

/// The layout of a tracker's records, for any protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    /// Polhemus FASTRAK.
    Fastrak(fastrak::Format),
    /// Polhemus Liberty and Patriot.
    Liberty(liberty::Format),
    /// Ascension Flock of Birds.
    Flock(flock::Format),
    /// FreeD D1.
    Freed(freed::Format),
    /// Penumbra's line protocol for home-made trackers.
    Csv(csv::Format),
    /// `Pos_Quat` messages of a VRPN server.
    Vrpn(vrpn::Format),
}

/// A decoder for any protocol.
pub type AnyDecoder = Decoder<Format>;

/// Every protocol name, for messages and for probing. `freed` may be followed by the order of
/// its numbers, see [`freed::Axes`]: `freed:-tilt,pan,roll,z,y,x`.
pub const PROTOCOLS: [&str; 18] = [
    "fastrak",
    "fastrak-ascii-quaternion",
    "fastrak-ascii-extended-euler",
    "fastrak-ascii-extended-quaternion",
    "fastrak-binary-euler",
    "fastrak-binary-quaternion",
    "liberty",
    "liberty-euler",
    "flock",
    "flock-inverted",
    "flock-angles",
    "flock-group",
    "flock-group-inverted",
    "flock-angles-group",
    "patriot",
    "freed",
    "csv",
    "vrpn",
];

impl Format {
    /// The format for a protocol name, with the protocol's default units. `None` for a name that
    /// is not in [`PROTOCOLS`].
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        let flock = |angles, group, inverted| {
            Self::Flock(flock::Format {
                angles,
                group,
                inverted,
                ..flock::Format::default()
            })
        };
        Some(match name {
            "liberty" | "patriot" => Self::Liberty(liberty::Format::default()),
            "liberty-euler" => Self::Liberty(liberty::Format {
                euler: true,
                ..liberty::Format::default()
            }),
            "flock" => flock(false, false, false),
            "flock-inverted" => flock(false, false, true),
            "flock-angles" => flock(true, false, false),
            "flock-group" => flock(false, true, false),
            "flock-group-inverted" => flock(false, true, true),
            "flock-angles-group" => flock(true, true, false),
            "csv" => Self::Csv(csv::Format::default()),
            "vrpn" => Self::Vrpn(vrpn::Format::default()),
            _ => {
                return fastrak::Format::for_protocol(name)
                    .map(Self::Fastrak)
                    .or_else(|| freed_format(name));
            }
        })
    }

    /// The same format with another unit of length, for devices that have a choice of units
    /// (FASTRAK, Liberty, Flock of Birds). FreeD, CSV and VRPN have one unit each, by their
    /// specification, and keep it.
    #[must_use]
    pub fn with_metres_per_unit(mut self, metres: f64) -> Self {
        match &mut self {
            Self::Fastrak(format) => format.metres_per_unit = metres,
            Self::Liberty(format) => format.metres_per_unit = metres,
            Self::Flock(format) => format.metres_per_unit = metres,
            Self::Freed(_) | Self::Csv(_) | Self::Vrpn(_) => {}
        }
        self
    }

    /// The steps that make a device of these settings stream.
    pub(crate) fn start_sequence(&self, settings: &TrackerSettings) -> Vec<Step> {
        match self {
            Self::Fastrak(format) => fastrak::commands::start_sequence(settings, format),
            Self::Liberty(format) => liberty::commands::start_sequence(settings, format),
            Self::Flock(format) => flock::commands::start_sequence(settings, format),
            Self::Freed(_) => freed::commands::start_sequence(settings),
            Self::Csv(_) => csv::start_sequence(),
            // The connection has its own handshake, see vrpn::Client.
            Self::Vrpn(_) => Vec::new(),
        }
    }

    /// The command that stops the stream, so that the device is silent for the next program. Empty
    /// if the device has no such command.
    #[must_use]
    pub(crate) fn stop_command(&self) -> Vec<u8> {
        match self {
            Self::Fastrak(_) => b"c".to_vec(),
            Self::Liberty(_) => b"P\r".to_vec(),
            Self::Flock(_) => b"B".to_vec(),
            Self::Freed(_) => freed::commands::command(freed::commands::STOP).to_vec(),
            Self::Csv(_) | Self::Vrpn(_) => Vec::new(),
        }
    }
}

fn freed_format(name: &str) -> Option<Format> {
    let axes = match name.strip_prefix("freed")? {
        "" => freed::Axes::default(),
        axes => freed::Axes::parse(axes.strip_prefix(':')?)?,
    };
    Some(Format::Freed(freed::Format {
        axes,
        ..freed::Format::default()
    }))
}

impl Default for Format {
    /// A FASTRAK with factory settings.
    fn default() -> Self {
        Self::Fastrak(fastrak::Format::default())
    }
}

impl Framing for Format {
    fn classify(&self, previous: Option<u8>, bytes: &[u8]) -> Verdict {
        match self {
            Self::Fastrak(format) => format.classify(previous, bytes),
            Self::Liberty(format) => format.classify(previous, bytes),
            Self::Flock(format) => format.classify(previous, bytes),
            Self::Freed(format) => format.classify(previous, bytes),
            Self::Csv(format) => format.classify(previous, bytes),
            Self::Vrpn(format) => format.classify(previous, bytes),
        }
    }
}

impl AnyDecoder {
    /// A decoder for a protocol's name, with the protocol's default units; `None` for a name
    /// that is not in [`PROTOCOLS`]. The name may be followed by the baud rate of the line, as
    /// in `fastrak@115200`, which corrects arrival times: see [`Decoder::with_baud`].
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        let (name, baud) = match name.split_once('@') {
            Some((name, baud)) => (name, Some(baud.parse().ok()?)),
            None => (name, None),
        };
        let decoder = Self::new(Format::for_protocol(name)?);
        Some(match baud {
            Some(baud) => decoder.with_baud(baud),
            None => decoder,
        })
    }

    /// The same decoder with another unit of length, see [`Format::with_metres_per_unit`].
    #[must_use]
    pub fn with_metres_per_unit(mut self, metres: f64) -> Self {
        self.set_format(self.format().with_metres_per_unit(metres));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_protocol_is_known() {
        for name in PROTOCOLS {
            assert!(Format::for_protocol(name).is_some(), "{name}");
        }
        for name in ["", "freed:", "freed:pan", "freedom", "polaris", "FASTRAK"] {
            assert_eq!(Format::for_protocol(name), None, "{name}");
        }
    }

    #[test]
    fn a_baud_rate_corrects_arrival_times() {
        let arrival = |name: &str| {
            let mut decoder = AnyDecoder::for_protocol(name).unwrap();
            let mut first = None;
            let bytes = b"1,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n";
            let now = penumbra_interface::MonotonicTime::from_nanos(1_000_000_000);
            decoder.push(bytes, now, |pose| first = first.or(Some(pose.arrived_at)));
            now.nanos_since(first.unwrap())
        };
        assert_eq!(arrival("csv"), 0);
        // The first line is discarded, because it may be the rest of one; 16 bytes of ten bits
        // follow the second.
        let late = arrival("csv@9600");
        assert!((late - 16_666_667).abs() < 1000, "{late}");
        assert!(AnyDecoder::for_protocol("csv@fast").is_none());
    }

    #[test]
    fn protocols_with_one_unit_keep_it() {
        for name in ["freed", "csv", "vrpn"] {
            let format = Format::for_protocol(name).unwrap();
            assert_eq!(format.with_metres_per_unit(0.0254), format, "{name}");
        }
        let Format::Liberty(format) = Format::for_protocol("liberty")
            .unwrap()
            .with_metres_per_unit(0.01)
        else {
            unreachable!()
        };
        assert!((format.metres_per_unit - 0.01).abs() < 1e-12);
    }
}
