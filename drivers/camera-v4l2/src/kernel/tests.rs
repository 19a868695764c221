use super::*;
use std::io::Write;
use v4l::{Capabilities, Format, control, format};

#[test]
fn texts_end_at_the_first_zero_and_may_be_cut_in_a_character() {
    assert_eq!(text(*b"vivid\0rest"), "vivid");
    assert_eq!(text(*b" padded "), "padded");
    assert_eq!(text([b'4', b'K', 0xCE]), "4K\u{FFFD}");
}

#[test]
fn time_stamps_do_not_overflow() {
    let at = |tv_sec, tv_usec| time(sys::timeval { tv_sec, tv_usec }).as_nanos();
    assert_eq!(at(3, 7), 3_000_007_000);
    assert!(at(sys::__time_t::MAX, sys::__suseconds_t::MAX) > 0);
    assert!(at(sys::__time_t::MIN, sys::__suseconds_t::MIN) < 0);
}

/// The numbers of the commands that the crate `v4l` lacks, as the C compiler prints them on
/// 64-bit machines.
#[cfg(target_pointer_width = "64")]
#[test]
fn commands_of_events_have_the_numbers_of_the_c_header() {
    assert_eq!(ioctl::DQEVENT.number(), 0x8088_5659);
    assert_eq!(ioctl::SUBSCRIBE_EVENT.number(), 0x4020_565a);
}

#[test]
fn other_files_than_video_devices_are_not_opened() {
    for path in ["/dev/null", "/dev", "/proc/self/status"] {
        assert_eq!(V4l2Device::open(path.as_ref()).err(), Some(Errno::NOTTY));
    }
    let missing = V4l2Device::open("/dev/no-such-video".as_ref());
    assert_eq!(missing.err(), Some(Errno::NOENT));
    assert!(V4l2Device::open("/dev/null\0".as_ref()).is_err());
}

#[test]
fn only_changes_of_values_of_controls_are_reported() {
    let event = |type_, changes| {
        let mut event = sys::v4l2_event {
            type_,
            id: 7,
            ..sys::v4l2_event::zeroed()
        };
        event.u.ctrl.changes = changes;
        let event = controls::control_event(&event);
        assert_eq!(event.id, 7);
        event.value_changed
    };
    let (value, flags) = (sys::V4L2_EVENT_CTRL_CH_VALUE, sys::V4L2_EVENT_CTRL_CH_FLAGS);
    assert!(event(sys::V4L2_EVENT_CTRL, value | flags));
    assert!(!event(sys::V4L2_EVENT_CTRL, flags));
    assert!(!event(sys::V4L2_EVENT_SOURCE_CHANGE, value));
}

#[test]
fn mapping_shows_what_is_asked_for_and_no_more_than_it_has() {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(&[7; 8192]).unwrap();
    let mapping = Mapping::new(&file, 8192, 0).unwrap();
    // SAFETY: nobody writes to the file any more.
    let (some, all) = unsafe { (mapping.bytes(3), mapping.bytes(usize::MAX)) };
    assert_eq!((some, all), (&[7; 3][..], &[7; 8192][..]));
}

// Why raw commands replace calls of the crate `v4l`. If one of these tests fails, a newer
// version has corrected the call: use it then.

#[test]
#[should_panic(expected = "Utf8Error")]
fn the_crate_cannot_read_a_product_name_that_is_cut_in_a_character() {
    let _ = Capabilities::from(sys::v4l2_capability {
        card: [0xCE; 32],
        ..sys::v4l2_capability::zeroed()
    });
}

#[test]
#[should_panic(expected = "Utf8Error")]
fn the_crate_cannot_read_any_description_of_a_format() {
    let _ = format::Description::from(sys::v4l2_fmtdesc {
        description: [0xCE; 32],
        ..sys::v4l2_fmtdesc::zeroed()
    });
}

#[test]
#[should_panic(expected = "Invalid colorspace")]
fn the_crate_does_not_know_all_colour_spaces() {
    let mut format = sys::v4l2_format::zeroed();
    format.fmt.pix.colorspace = 4; // V4L2_COLORSPACE_BT878
    // SAFETY: every bit pattern is a valid value of this member.
    let _ = Format::from(unsafe { format.fmt.pix });
}

#[test]
#[should_panic(expected = "called `Result::unwrap()`")]
fn the_crate_does_not_know_all_control_types() {
    let _ = control::Description::from(sys::v4l2_query_ext_ctrl {
        type_: 0x0107, // V4L2_CTRL_TYPE_RECT, Linux 6.15
        ..sys::v4l2_query_ext_ctrl::zeroed()
    });
}
