use super::*;
use crate::format::AnyDecoder;
use proptest::prelude::*;

fn pos_quat(sender: i32, kind: i32, sensor: i32, x: f64) -> Vec<u8> {
    let mut payload = [sensor.to_be_bytes(), sensor.to_be_bytes()].concat();
    for value in [x, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8] {
        payload.extend(value.to_be_bytes());
    }
    wire::message(sender, kind, &payload)
}

fn name(number: i32, kind: i32, name: &str) -> Vec<u8> {
    wire::message(number, kind, &wire::name_payload(name))
}

fn server() -> Vec<u8> {
    let mut bytes = b"vrpn: ver. 07.35  0".to_vec();
    bytes.resize(COOKIE_LEN, 0);
    bytes.extend(name(0, -1, "VRPN Control"));
    bytes.extend(name(1, -1, "Tracker0"));
    bytes.extend(name(2, -1, "Tracker1"));
    bytes.extend(name(3, -2, "vrpn_Tracker Velocity"));
    bytes.extend(name(4, -2, "vrpn_Tracker Pos_Quat"));
    bytes
}

#[test]
fn only_poses_of_the_tracker_are_passed_on_and_decode() {
    let mut client = Client::new("Tracker1");
    let stream = [
        server(),
        pos_quat(1, 4, 0, 1.0),
        pos_quat(2, 3, 0, 2.0),
        pos_quat(2, 4, 0, 3.0),
        pos_quat(2, 4, 1, 4.0),
    ]
    .concat();
    let mut messages = Vec::new();
    client.push(&stream, &mut messages).unwrap();
    assert_eq!(messages.len(), 2 * POS_QUAT_LEN);
    let names: Vec<_> = client.senders().collect();
    assert_eq!(names, ["VRPN Control", "Tracker0", "Tracker1"]);
    let trackers: Vec<_> = client.trackers().collect();
    assert_eq!(trackers, ["Tracker0", "Tracker1"]);
    let mut found = Vec::new();
    let mut decoder = AnyDecoder::for_protocol("vrpn").unwrap();
    decoder.push(
        &messages,
        penumbra_interface::MonotonicTime::default(),
        |s| found.push(s),
    );
    let read: Vec<_> = found
        .iter()
        .map(|s| (s.station, s.transmitter_from_sensor.translation.x))
        .collect();
    assert_eq!(read, [(1, 3.0), (2, 4.0)]);
    let q = found[0].transmitter_from_sensor.rotation;
    assert!((q.z - 0.6).abs() < 1e-12 && (q.w - 0.8).abs() < 1e-12);
}

#[test]
fn other_servers_and_impossible_lengths_are_refused() {
    let push = |bytes: &[u8]| Client::new("T").push(bytes, &mut Vec::new()).unwrap_err();
    assert!(matches!(
        push(b"HTTP/1.1 400 Bad Request\r\n"),
        VrpnError::NoServer { .. }
    ));
    assert!(matches!(push(b"SSH-2"), VrpnError::NoServer { .. }));
    assert!(matches!(
        push(b"vrpn: ver. 08.00  0\0\0\0\0\0"),
        VrpnError::Version { .. }
    ));
    let mut long = server();
    long.extend([0x7f, 0xff, 0xff, 0xff]);
    assert_eq!(
        push(&long),
        VrpnError::Length {
            length: 0x7fff_ffff
        }
    );
    let mut negative = server();
    negative.extend([0xff; 4]);
    assert_eq!(push(&negative), VrpnError::Length { length: -1 });
    assert_eq!(
        push(&[server(), wire::message(0, -5, &[])].concat()),
        VrpnError::Closed
    );
}

#[test]
fn the_greeting_is_a_cookie_and_two_names() {
    let greeting = Client::new("Tracker0").greeting();
    assert!(greeting.starts_with(b"vrpn: ver. 07.38  0\0\0\0\0\0"));
    assert_eq!(greeting.len() % 8, 0);
    assert_eq!(wire::int_at(&greeting, COOKIE_LEN), Some(24 + 4 + 9));
}

proptest! {
    #[test]
    fn result_does_not_depend_on_splits(cuts in prop::collection::vec(0usize..1000, 0..12)) {
        let stream = [server(), pos_quat(1, 4, 0, 1.0), pos_quat(1, 4, 0, 2.0)].concat();
        let mut cuts: Vec<_> = cuts.into_iter().map(|cut| cut.min(stream.len())).collect();
        cuts.extend([0, stream.len()]);
        cuts.sort_unstable();
        let (mut client, mut messages) = (Client::new("Tracker0"), Vec::new());
        for pair in cuts.windows(2) {
            client.push(&stream[pair[0]..pair[1]], &mut messages).unwrap();
        }
        prop_assert_eq!(messages.len(), 2 * POS_QUAT_LEN);
    }

    #[test]
    fn arbitrary_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let (mut client, mut messages) = (Client::new("T"), Vec::new());
        client.push(&server(), &mut messages).unwrap();
        let _ = client.push(&bytes, &mut messages);
        prop_assert_eq!(messages.len() % POS_QUAT_LEN, 0);
    }
}
