use super::*;
use proptest::prelude::*;

fn data_bits() -> impl Strategy<Value = DataBits> {
    use DataBits::{Eight, Five, Seven, Six};
    prop::sample::select(vec![Five, Six, Seven, Eight])
}

fn parity() -> impl Strategy<Value = Parity> {
    prop::sample::select(vec![Parity::None, Parity::Odd, Parity::Even])
}

fn stop_bits() -> impl Strategy<Value = StopBits> {
    prop::sample::select(vec![StopBits::One, StopBits::Two])
}

fn flow_control() -> impl Strategy<Value = FlowControl> {
    use FlowControl::{Hardware, None, Software};
    prop::sample::select(vec![None, Software, Hardware])
}

prop_compose! {
    fn settings()(
        baud in any::<u32>(), data_bits in data_bits(), parity in parity(),
        stop_bits in stop_bits(), flow_control in flow_control(),
    ) -> LineSettings {
        LineSettings { baud, data_bits, parity, stop_bits, flow_control }
    }
}

proptest! {
    #[test]
    fn any_changed_setting_is_detected(
        requested in settings(), actual in settings(), which in 0..5,
    ) {
        let mut taken = requested;
        match which {
            0 => taken.baud = actual.baud,
            1 => taken.data_bits = actual.data_bits,
            2 => taken.parity = actual.parity,
            3 => taken.stop_bits = actual.stop_bits,
            _ => taken.flow_control = actual.flow_control,
        }
        prop_assert!(requested.are_met_by(requested));
        let off = (f64::from(taken.baud) - f64::from(requested.baud)).abs();
        let close = off <= 0.025 * f64::from(requested.baud);
        let rest_is_same = LineSettings { baud: requested.baud, ..taken } == requested;
        // Whole numbers: at a low rate the limit is rounded down.
        let at_limit = (off - 0.025 * f64::from(requested.baud)).abs() < 1.0;
        prop_assert!(at_limit || requested.are_met_by(taken) == (close && rest_is_same));
        if !rest_is_same {
            prop_assert!(!requested.are_met_by(taken));
            prop_assert_ne!(requested.to_string(), taken.to_string());
        }
    }
}

#[test]
fn rate_may_deviate_by_the_error_of_a_divisor() {
    let met = |requested, actual| {
        let requested = LineSettings::new(requested, Parity::None);
        requested.are_met_by(LineSettings::new(actual, Parity::None))
    };
    // The actual rates of an FTDI chip for 115200 and of a PC port for 128000.
    assert!(met(115_200, 115_385));
    assert!(!met(128_000, 115_200));
    assert!(!met(115_200, 9_600));
    assert!(!met(115_200, 0));
}

#[test]
fn settings_are_printed_in_common_notation() {
    let settings = LineSettings::new(38_400, Parity::Odd);
    assert_eq!(settings.to_string(), "38400 baud, 8O1");
    let other = LineSettings {
        flow_control: FlowControl::Hardware,
        stop_bits: StopBits::Two,
        data_bits: DataBits::Seven,
        ..settings
    };
    assert_eq!(other.to_string(), "38400 baud, 7O2, RTS/CTS");
}
