use super::*;

#[test]
fn message_names_the_received_protocol() {
    let received = b"01   31.50  -2.00   3.00  10.00  20.00  30.00\r\n".repeat(6);
    let text = recognise(&received[13..], "liberty");
    assert!(
        text.contains("protocol \"fastrak\", not of \"liberty\""),
        "{text}"
    );
}

#[test]
fn other_text_is_quoted() {
    let received = b"PS,12\r\n$GPGGA,123519,4807.038,N*47\r\n".repeat(5);
    let text = recognise(&received, "fastrak");
    assert!(
        text.contains("text that is not of") && text.contains("$GPGGA"),
        "{text}"
    );
}

#[test]
fn noise_suggests_another_baud_rate() {
    let received: Vec<u8> = (0..500_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let text = recognise(&received, "fastrak");
    assert!(text.contains("another baud rate"), "{text}");
}

#[test]
fn empty_input_is_no_error() {
    assert!(protocol_of(&[]).is_none());
    assert!(!recognise(&[], "fastrak").is_empty());
}
