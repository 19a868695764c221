//! Trackers on sockets: a VRPN server and FreeD datagrams.
#![expect(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods, reason = "tests start their own threads")]

use penumbra_interface::{DeviceError, Tracker};
use penumbra_tracker_serial::freed::{FreedSender, Lens};
use penumbra_tracker_serial::{AnyDecoder, PortName, TrackerSettings, open};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A message as `vrpn_Connection.C` encodes it.
fn message(sender: i32, kind: i32, payload: &[u8]) -> Vec<u8> {
    let mut bytes = (24 + payload.len() as u32).to_be_bytes().to_vec();
    for number in [5, 6, sender, kind, 0] {
        bytes.extend(number.to_be_bytes());
    }
    bytes.extend(payload);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

fn name(number: i32, kind: i32, name: &str) -> Vec<u8> {
    let mut payload = (name.len() as u32 + 1).to_be_bytes().to_vec();
    payload.extend(name.as_bytes());
    payload.push(0);
    message(number, kind, &payload)
}

fn pose(sender: i32, x: f64) -> Vec<u8> {
    let mut payload = vec![0; 8];
    for value in [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] {
        payload.extend(value.to_be_bytes());
    }
    message(sender, 1, &payload)
}

/// A VRPN server on a thread, until it is dropped.
struct Server {
    port: u16,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// `answer` is what it sends first, `streams` whether poses follow.
    fn start(answer: Vec<u8>, streams: bool) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let _ = serve_client(&mut stream, &answer, streams, &stopped);
        });
        Self {
            port,
            stop,
            thread: Some(thread),
        }
    }

    fn settings(&self, tracker: &str) -> TrackerSettings {
        let port = PortName::parse(&format!("vrpn:{tracker}@127.0.0.1:{}", self.port)).unwrap();
        TrackerSettings::new("vrpn", port)
    }
}

fn serve_client(
    stream: &mut TcpStream,
    answer: &[u8],
    streams: bool,
    stop: &AtomicBool,
) -> std::io::Result<()> {
    let mut cookie = [0; 24];
    stream.read_exact(&mut cookie)?;
    assert!(cookie.starts_with(b"vrpn: ver. 07."));
    stream.write_all(answer)?;
    let mut x = 0.0;
    while !stop.load(Ordering::Relaxed) {
        if streams {
            x += 0.01;
            let bytes = [pose(0, x), pose(1, 50.0)].concat();
            // Split within a message.
            stream.write_all(&bytes[..31])?;
            std::thread::sleep(Duration::from_millis(1));
            stream.write_all(&bytes[31..])?;
        }
        std::thread::sleep(Duration::from_millis(4));
    }
    Ok(())
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().unwrap().join();
    }
}

fn greeting() -> Vec<u8> {
    let mut bytes = b"vrpn: ver. 07.35  0".to_vec();
    bytes.resize(24, 0);
    for described in [
        name(0, -1, "Tracker0"),
        name(1, -1, "Wand"),
        name(1, -2, "vrpn_Tracker Pos_Quat"),
    ] {
        bytes.extend(described);
    }
    bytes
}

fn positions(tracker: &mut dyn Tracker, protocol: &str, count: usize) -> Vec<f64> {
    let mut decoder = AnyDecoder::for_protocol(protocol).unwrap();
    let (began, mut found) = (Instant::now(), Vec::new());
    while found.len() < count {
        assert!(
            began.elapsed() < Duration::from_secs(10),
            "{} poses",
            found.len()
        );
        if let Some(read) = tracker.next_bytes(Duration::from_millis(100)).unwrap() {
            decoder.push(&read.bytes, read.arrived_at, |sample| {
                found.push(sample.transmitter_from_sensor.translation.x);
            });
        }
    }
    assert_eq!(decoder.counters().skipped_bytes, 0);
    found
}

#[test]
fn a_tracker_of_a_server_streams_until_the_server_ends() {
    let server = Server::start(greeting(), true);
    let mut tracker = open(&server.settings("Tracker0")).unwrap();
    let found = positions(&mut *tracker, "vrpn", 20);
    assert!(
        found.windows(2).all(|w| (w[1] - w[0] - 0.01).abs() < 1e-9),
        "{found:?}"
    );
    assert!(
        tracker
            .report()
            .description
            .unwrap()
            .contains("Tracker0, Wand")
    );
    drop(server);
    let began = Instant::now();
    let error = loop {
        if let Err(error) = tracker.next_bytes(Duration::from_secs(5)) {
            break error;
        }
    };
    // At once would be less, but a busy machine may delay the thread.
    assert!(began.elapsed() < Duration::from_millis(2500));
    assert!(matches!(error, DeviceError::Unplugged { .. }), "{error}");
}

#[test]
fn errors_name_the_reason_why_a_server_is_unusable() {
    let error =
        |server: &Server, tracker| open(&server.settings(tracker)).err().unwrap().to_string();
    let server = Server::start(greeting(), true);
    let said = error(&server, "Tracker9");
    assert!(
        said.contains("no pose of a tracker \"Tracker9\"; trackers that send some: Tracker0, Wand"),
        "{said}"
    );
    // A real server repeats the name that a client asks for.
    let echo = [greeting(), name(2, -1, "Tracker9")].concat();
    let said = error(&Server::start(echo, true), "Tracker9");
    assert!(
        said.contains("trackers that send some: Tracker0, Wand; check the name"),
        "{said}"
    );
    let server = Server::start(b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(), false);
    let said = error(&server, "Tracker0");
    assert!(
        said.contains("is no VRPN server: it answered \"HTTP/1.1 400"),
        "{said}"
    );
    let server = Server::start(greeting(), false);
    let said = error(&server, "Tracker0");
    assert!(said.contains("other devices of the server: Wand"), "{said}");
    assert!(!said.contains("cable") && !said.contains("baud"), "{said}");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    drop(listener);
    let nowhere = PortName::parse(&format!("vrpn:T@127.0.0.1:{port}")).unwrap();
    let said = open(&TrackerSettings::new("vrpn", nowhere))
        .err()
        .unwrap()
        .to_string();
    assert!(said.contains("no VRPN server at"), "{said}");
}

#[test]
fn ports_and_protocols_that_do_not_match_are_refused() {
    let refused = |protocol: &str, port: &str| {
        let settings = TrackerSettings::new(protocol, PortName::parse(port).unwrap());
        open(&settings).err().unwrap().to_string()
    };
    assert!(refused("fastrak", "vrpn:T@localhost").contains("protocol = \"vrpn\""));
    assert!(refused("vrpn", "/dev/ttyUSB0").contains("vrpn:NAME@HOST"));
}

#[test]
fn free_d_datagrams_are_poses_until_they_stop() {
    let free = UdpSocket::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    let sender = FreedSender::new(free, 1).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let sending = std::thread::spawn(move || {
        let at = glam::DVec3::new(1.5, 0.0, 1.0);
        let pose = penumbra_interface::RigidTransform::new(glam::DQuat::IDENTITY, at);
        while !stopped.load(Ordering::Relaxed) {
            sender.send(pose, Lens::default()).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    let settings = TrackerSettings {
        silence_millis: 300,
        ..TrackerSettings::new("freed", PortName::Udp(free))
    };
    let mut tracker = open(&settings).unwrap();
    let found = positions(&mut *tracker, "freed", 10);
    assert!(found.iter().all(|x| (x - 1.5).abs() < 1e-4));
    let busy = open(&settings).err().unwrap().to_string();
    assert!(busy.contains("another program listens there"), "{busy}");
    stop.store(true, Ordering::Relaxed);
    sending.join().unwrap();
    let error = loop {
        if let Err(error) = tracker.next_bytes(Duration::from_millis(50)) {
            break error;
        }
    };
    assert!(
        matches!(
            error,
            DeviceError::Silent {
                millis: 300..1000,
                ..
            }
        ),
        "{error}"
    );
}
