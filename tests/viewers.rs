//! Many viewers of the live picture, some of which do not read. `make viewers` does the same with a
//! thousand of them beside a rig.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, clippy::panic)]

use penumbra_picture::Picture;
use penumbra_status::{Settings, SharedStatus, StatusServer, StreamLimits};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

const VIEWERS: usize = 60;
const STALLED: usize = 10;

/// A picture of noise, which JPEG compresses badly, so that a few fill all buffers.
fn noise(seed: u32) -> Picture {
    let mut state = seed | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as u8
    };
    let (width, height) = (320, 240);
    Picture {
        width,
        height,
        rgba: (0..width * height * 4).map(next).collect(),
    }
}

fn open(address: SocketAddr) -> TcpStream {
    let mut socket = TcpStream::connect(address).unwrap();
    let request = format!("GET /stream.mjpeg HTTP/1.0\r\nHost: {address}\r\n\r\n");
    socket.write_all(request.as_bytes()).unwrap();
    socket.set_nonblocking(true).unwrap();
    socket
}

/// A viewer that reads, and what it has received.
struct Viewer {
    socket: TcpStream,
    /// The last bytes, among which a heading may have begun.
    tail: Vec<u8>,
    pictures: usize,
}

impl Viewer {
    /// Reads what there is, and counts the pictures.
    fn read(&mut self, buffer: &mut [u8]) {
        const HEADING: &[u8] = b"Content-Type: image/jpeg";
        loop {
            match self.socket.read(buffer) {
                Ok(0) => panic!("a viewer that reads was let go"),
                Ok(count) => {
                    self.tail.extend_from_slice(&buffer[..count]);
                    let headings = self.tail.windows(HEADING.len());
                    self.pictures += headings.filter(|bytes| *bytes == HEADING).count();
                    self.tail
                        .drain(..self.tail.len().saturating_sub(HEADING.len() - 1));
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) => panic!("{error}"),
            }
        }
    }
}

/// Memory of this process, MB.
fn resident_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find_map(|l| l.strip_prefix("VmRSS:"))
        .unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1000
}

#[test]
fn all_viewers_are_served_in_bounded_memory_and_stalled_ones_are_let_go() {
    let shared = SharedStatus::new(Settings::default());
    let limits = StreamLimits {
        viewers: VIEWERS,
        bytes_per_second: 1 << 30,
        stall: Duration::from_secs(2),
        ..StreamLimits::default()
    };
    let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
    let server = StatusServer::bind_with(any_port, None, Arc::clone(&shared), limits).unwrap();
    let address = server.local_addr();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .unwrap();
    runtime.spawn(server.serve(std::future::pending()));

    let stalled: Vec<TcpStream> = (0..STALLED).map(|_| open(address)).collect();
    let mut reading: Vec<Viewer> = (STALLED..VIEWERS)
        .map(|_| Viewer {
            socket: open(address),
            tail: Vec::new(),
            pictures: 0,
        })
        .collect();
    let (begun, before) = (Instant::now(), resident_mb());
    let pictures = [1, 2, 3].map(|seed| Arc::new(noise(seed)));
    let mut buffer = vec![0; 1 << 16];
    let (mut most_viewers, mut most_mb) = (0, before);
    for turn in 0.. {
        shared.publish_picture(Arc::clone(&pictures[turn % 3]));
        reading
            .iter_mut()
            .for_each(|viewer| viewer.read(&mut buffer));
        let viewers = shared.snapshot().stream.viewers as usize;
        (most_viewers, most_mb) = (most_viewers.max(viewers), most_mb.max(resident_mb()));
        if most_viewers == VIEWERS && viewers == VIEWERS - STALLED {
            break;
        }
        let seconds = begun.elapsed().as_secs();
        assert!(seconds < 60, "{viewers} viewers, at most {most_viewers}");
        std::thread::sleep(Duration::from_millis(5));
    }
    let fewest = reading.iter().map(|viewer| viewer.pictures).min().unwrap();
    assert!(fewest >= 10, "a viewer received {fewest} pictures");
    let growth = most_mb - before;
    assert!(growth < 100, "memory grew by {growth} MB");
    drop(stalled);
}

/// With a small share for each, viewers receive fewer pictures, and the rig is asked for fewer.
#[test]
fn stream_keeps_to_its_rate() {
    let shared = SharedStatus::new(Settings::default());
    let limits = StreamLimits {
        bytes_per_second: 1_000_000,
        ..StreamLimits::default()
    };
    let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
    let server = StatusServer::bind_with(any_port, None, Arc::clone(&shared), limits).unwrap();
    let address = server.local_addr();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .unwrap();
    runtime.spawn(server.serve(std::future::pending()));
    let mut viewers: Vec<TcpStream> = (0..10).map(|_| open(address)).collect();
    let picture = Arc::new(noise(1));
    let (begun, mut received, mut wanted, mut turns) = (Instant::now(), 0, 0, 0);
    let mut buffer = vec![0; 1 << 16];
    while begun.elapsed() < Duration::from_secs(4) {
        turns += 1;
        wanted += u32::from(shared.wants_picture());
        shared.publish_picture(Arc::clone(&picture));
        for viewer in &mut viewers {
            while let Ok(count @ 1..) = viewer.read(&mut buffer) {
                received += count;
            }
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let rate = received as f64 / begun.elapsed().as_secs_f64();
    assert!((2e5..1.6e6).contains(&rate), "{rate:.0} bytes per second");
    assert!(wanted * 2 < turns, "wanted in {wanted} of {turns} turns");
}
