use super::*;

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * 1_000_000)
}

fn device(protocol: &str) -> SimulatedTracker {
    let path = Source::Trajectory(Trajectory::default());
    SimulatedTracker::new(protocol, path, None, false).unwrap()
}

fn answer(device: &mut SimulatedTracker, command: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    device.receive(command, at(0), &mut out);
    out
}

#[test]
fn a_fastrak_answers_as_in_the_manual() {
    let mut device = device("fastrak");
    let status = answer(&mut device, b"S");
    assert_eq!(status.len(), 55);
    assert!(status.starts_with(b"21S3F0000 "), "{status:?}");
    assert!(answer(&mut device, b"fuC").is_empty());
    assert!(answer(&mut device, b"S").starts_with(b"21S3FB"));
    assert_eq!(answer(&mut device, b"cFUO1\r"), b"21O 2 4 1\r\n");
    assert_eq!(answer(&mut device, b"l1\r"), b"21l1000\r\n");
    assert_eq!(answer(&mut device, b"l2,1\rl1\r"), b"21l1100\r\n");
    assert_eq!(
        answer(&mut device, b"H1\r"),
        b"21H   1.00   0.00   0.00\r\n"
    );
    assert_eq!(answer(&mut device, b"P").len(), 2 * 47);
    assert_eq!(answer(&mut device, b"l2,0\rfO1,2,11,0\rP").len(), 32);
    assert_eq!(answer(&mut device, b"FO1,52,61,1\rP").len(), 3 + 7 * 13 + 2);
}

#[test]
fn a_fastrak_shares_its_rate_and_ignores_commands_while_it_resets() {
    let mut device = device("fastrak");
    answer(&mut device, b"l2,1\rC");
    let mut out = Vec::new();
    device.advance(at(0), &mut out);
    device.advance(at(1000), &mut out);
    device.advance(at(1000), &mut out);
    // After a second without a call it sends what is due now, not what it missed.
    assert_eq!(out.len(), 2 * 2 * 47);
    assert_eq!(device.next_due().unwrap().nanos_since(at(1000)), 16_666_666);
    answer(&mut device, b"\x19");
    assert!(!device.is_streaming() && answer(&mut device, b"S").is_empty());
    let mut out = Vec::new();
    device.receive(b"S", at(10_001), &mut out);
    assert_eq!(out.len(), 55);
}

#[test]
fn outside_its_hemisphere_a_fastrak_reports_the_mirror_image() {
    let mut device = device("fastrak");
    let mut first_column = |command: &[u8]| {
        let record = answer(&mut device, command);
        str::from_utf8(&record[3..10]).unwrap().trim().to_owned()
    };
    assert_eq!(first_column(b"P"), "31.50");
    assert_eq!(first_column(b"H1,-1,0,0\rP"), "-31.50");
}

#[test]
fn the_other_devices_answer() {
    let mut liberty = device("liberty");
    assert!(answer(&mut liberty, b"\x16\r").starts_with(b"Polhemus"));
    assert_eq!(answer(&mut liberty, b"\x150\r"), b"00030003\r\n");
    let records = answer(&mut liberty, b"O*,2,7\rF1\rP\r");
    assert_eq!((&records[..4], records.len()), (&b"LY\x01P"[..], 2 * 36));
    assert_eq!(&records[36..40], b"LY\x02P");
    let record = answer(&mut liberty, b"\x151,0\rP\r");
    assert_eq!((&record[..4], record.len()), (&b"LY\x02P"[..], 36));
    let refused = answer(&mut liberty, b"\x153,1\r");
    assert!(refused.ends_with(b"no such station\r\n"), "{refused:?}");
    let mut flock = device("flock");
    assert_eq!(answer(&mut flock, b"O\x01"), [3, 60]);
    assert_eq!(answer(&mut flock, b"]B").len(), 14);
    assert_eq!(answer(&mut flock, b"P\x23\x01\xf1YB").len(), 13);
    // Two birds, the second of which still sends quaternions; there is no fifth one.
    let group = answer(&mut flock, b"P\x32\x02\xf5]B");
    assert_eq!((group.len(), group[12], group[27]), (13 + 15, 1, 2));
    assert_eq!(answer(&mut flock, b"\xf2YB").len(), 2 * 13);
    let mut freed = device("freed");
    assert_eq!(answer(&mut freed, &[0xd0, 1, 0xd1, 0x9e]).len(), 29);
    assert!(answer(&mut freed, &[0xd0, 1, 0xd1, 0x9f]).is_empty());
    assert!(
        SimulatedTracker::new(
            "polaris",
            Source::Recording(Recording::default()),
            None,
            false
        )
        .is_err()
    );
}

#[test]
fn a_recording_is_played_at_its_own_times_and_repeats() {
    let recording = Recording::new(vec![
        (at(500), vec![1]),
        (at(510), vec![2]),
        (at(540), vec![3]),
    ]);
    let source = Source::Recording(recording);
    let mut device =
        SimulatedTracker::new("fastrak-binary-quaternion", source, None, false).unwrap();
    assert!(answer(&mut device, b"S").starts_with(b"21S3F1"));
    answer(&mut device, b"C");
    let mut played = Vec::new();
    for millis in 0..55 {
        let mut out = Vec::new();
        device.advance(at(millis), &mut out);
        played.extend(out.into_iter().map(|byte| (millis, byte)));
    }
    assert_eq!(played, [(0, 1), (10, 2), (40, 3), (50, 1)]);
}
