use super::*;

#[test]
fn text_of_a_fastrak_is_named() {
    let heard = b"01   31.50  -2.00   3.00  10.00  20.00  30.00\r\n".repeat(6);
    let seen = recognise(&heard[13..], "liberty");
    assert!(
        seen.contains("protocol \"fastrak\", not of \"liberty\""),
        "{seen}"
    );
}

#[test]
fn other_lines_are_shown() {
    let heard = b"PS,12\r\n$GPGGA,123519,4807.038,N*47\r\n".repeat(5);
    let seen = recognise(&heard, "fastrak");
    assert!(
        seen.contains("printable lines") && seen.contains("$GPGGA"),
        "{seen}"
    );
}

#[test]
fn noise_points_to_the_speed() {
    let heard: Vec<u8> = (0..500_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let seen = recognise(&heard, "fastrak");
    assert!(seen.contains("another baud rate"), "{seen}");
}

#[test]
fn an_empty_line_is_no_reason_to_fail() {
    assert!(protocol_of(&[]).is_none());
    assert!(!recognise(&[], "fastrak").is_empty());
}
