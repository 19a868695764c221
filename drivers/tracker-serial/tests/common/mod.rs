//! A simulated device on a thread, and helpers that read a tracker.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use penumbra_interface::{PoseSample, SystemClock, Tracker};
use penumbra_synthetic::{Faults, Pty, SimulatedTracker, Source, Trajectory, serve};
use penumbra_tracker_serial::{AnyDecoder, Counters, PortName, TrackerSettings, Units};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A simulated tracker at a pseudo-terminal until it is dropped.
pub struct Device {
    path: String,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    streaming: Arc<AtomicBool>,
}

impl Device {
    pub fn start(protocol: &str, faults: Faults) -> Self {
        let source = Source::Trajectory(Trajectory::default());
        Self::with(
            SimulatedTracker::new(protocol, source, None, false).unwrap(),
            faults,
        )
    }

    pub fn with(mut device: SimulatedTracker, mut faults: Faults) -> Self {
        let mut pty = Pty::open().unwrap();
        let path = pty.path().display().to_string();
        let (stop, streaming) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicBool::new(false)),
        );
        let (stopped, state) = (Arc::clone(&stop), Arc::clone(&streaming));
        let thread = std::thread::spawn(move || {
            let mut outlet = Watched {
                pty: &mut pty,
                state,
            };
            let _ = serve(
                &mut device,
                &mut outlet,
                &mut faults,
                &SystemClock,
                &stopped,
            );
        });
        Self {
            path,
            stop,
            thread: Some(thread),
            streaming,
        }
    }

    pub fn path(&self) -> String {
        self.path.clone()
    }

    /// Whether the device sends anything within 60 ms.
    pub fn is_streaming(&self) -> bool {
        self.streaming.store(false, Ordering::Relaxed);
        std::thread::sleep(Duration::from_millis(60));
        self.streaming.load(Ordering::Relaxed)
    }

    pub fn hang_up(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        self.hang_up();
    }
}

/// Sets `state` when something is written.
struct Watched<'a> {
    pty: &'a mut Pty,
    state: Arc<AtomicBool>,
}

impl penumbra_synthetic::Outlet for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> std::io::Result<usize> {
        self.pty.read(buffer, timeout)
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.state.store(true, Ordering::Relaxed);
        self.pty.write(bytes)
    }
}

pub fn settings(protocol: &str, device: &Device) -> TrackerSettings {
    TrackerSettings {
        units: Units::Inches,
        ..TrackerSettings::new(protocol, PortName::Serial(device.path()))
    }
}

/// At least `count` poses within ten seconds.
pub fn poses(
    tracker: &mut dyn Tracker,
    protocol: &str,
    count: usize,
) -> (Vec<PoseSample>, Counters) {
    let mut decoder = AnyDecoder::for_protocol(protocol).unwrap();
    let found = decode(tracker, &mut decoder, count);
    (found, decoder.counters())
}

pub fn decode(
    tracker: &mut dyn Tracker,
    decoder: &mut AnyDecoder,
    count: usize,
) -> Vec<PoseSample> {
    let began = Instant::now();
    let mut found = Vec::new();
    while found.len() < count {
        assert!(
            began.elapsed() < Duration::from_secs(10),
            "only {} poses",
            found.len()
        );
        if let Some(read) = tracker.next_bytes(Duration::from_millis(200)).unwrap() {
            decoder.push(&read.bytes, read.arrived_at, |sample| found.push(sample));
        }
    }
    found
}
