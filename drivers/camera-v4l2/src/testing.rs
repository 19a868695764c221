//! A video device without a kernel, which fails on demand, on a clock that tests advance.

use crate::device::{
    Capabilities, CaptureFormat, ControlDescription, ControlEvent, ControlKind, Controls,
    FilledBuffer, Formats, OwnedBuffer, Readiness, VideoDevice,
};
use penumbra_interface::{CameraFormat, CameraSize, Clock, ManualClock, MonotonicTime};
use rustix::io::{Errno, Result};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use v4l::{buffer, control};

/// A frame of the fake camera.
#[derive(Clone, Debug)]
pub struct FakeFrame {
    pub data: Vec<u8>,
    /// The number of bytes that the driver reports, true or not.
    pub bytes_used: usize,
    pub flags: buffer::Flags,
    pub sequence: u32,
    /// Nanoseconds from its time stamp to its arrival.
    pub age: i64,
}

impl FakeFrame {
    pub fn new(sequence: u32, data: Vec<u8>) -> Self {
        Self {
            bytes_used: data.len(),
            data,
            flags: buffer::Flags::TIMESTAMP_MONOTONIC | buffer::Flags::TSTAMP_SRC_SOE,
            sequence,
            age: 20_000_000,
        }
    }
}

/// A control of the fake device.
pub struct FakeControl {
    pub description: ControlDescription,
    pub value: i64,
    /// Writing fails with EACCES unless this control has this value.
    pub needs: Option<(u32, i64)>,
    /// Values out of range are refused instead of clamped.
    pub refuses_out_of_range: bool,
    /// Writing succeeds without effect.
    pub ignores_writes: bool,
}

/// A sensor that applies a new exposure some frames late.
pub struct Sensor {
    pub period: i64,
    pub lag: u32,
    pub next: u32,
    /// From which frame on which exposure is in effect.
    pub exposures: VecDeque<(u32, i64)>,
    pub image: Box<dyn FnMut(u32, i64) -> Vec<u8> + Send>,
}

#[derive(Default)]
pub struct State {
    pub clock: ManualClock,
    /// Frames to come, in order of arrival.
    pub arrivals: VecDeque<(i64, FakeFrame)>,
    pub sensor: Option<Sensor>,
    /// Filled buffers that wait to be dequeued.
    pub filled: VecDeque<(u32, FakeFrame, i64)>,
    /// Buffers that the kernel owns and has not filled.
    pub free: VecDeque<u32>,
    pub memory: Vec<Vec<u8>>,
    pub controls: Vec<FakeControl>,
    pub events: VecDeque<ControlEvent>,
    pub subscribed: Vec<u32>,
    pub formats: Vec<CameraFormat>,
    pub format: CaptureFormat,
    pub wait_errors: VecDeque<Errno>,
    pub dequeue_errors: VecDeque<Errno>,
    pub queue_error: Option<Errno>,
    pub start_error: Option<Errno>,
    pub stop_error: Option<Errno>,
    pub control_error: Option<Errno>,
    /// Every wait reports an error.
    pub wait_reports_error: bool,
    /// Every wait reports a frame, also if there is none.
    pub wait_reports_frame: bool,
    /// Frames for which no buffer was free.
    pub lost: u32,
    /// Control values written, in order.
    pub written: Vec<(u32, i64)>,
    pub starts: u32,
    pub stops: u32,
    pub waits: u32,
}

#[derive(Clone, Default)]
pub struct FakeDevice(pub Arc<Mutex<State>>);

impl FakeDevice {
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap()
    }

    /// A camera of one format and size.
    pub fn streaming(fourcc: &[u8; 4], width: u32, height: u32) -> Self {
        let fake = Self::default();
        let mut state = fake.lock();
        state.formats = vec![format(fourcc, &[(width, height, 30.0)])];
        state.format = CaptureFormat {
            width,
            height,
            fourcc: *fourcc,
            ..CaptureFormat::default()
        };
        drop(state);
        fake
    }

    pub fn clock(&self) -> Arc<ManualClock> {
        Arc::new(self.lock().clock.clone())
    }

    /// Lets a frame arrive `millis` after the clock's zero.
    pub fn arrives(&self, millis: i64, frame: FakeFrame) {
        self.lock().arrivals.push_back((millis * 1_000_000, frame));
    }

    pub fn add_control(&self, id: u32, title: &str, kind: ControlKind, (min, max): (i64, i64)) {
        self.lock().controls.push(FakeControl {
            description: ControlDescription {
                id,
                title: title.to_owned(),
                kind,
                min,
                max,
                step: 1,
                default: min,
                flags: control::Flags::empty(),
            },
            value: min,
            needs: None,
            refuses_out_of_range: false,
            ignores_writes: false,
        });
    }

    pub fn edit(&self, id: u32, edit: impl FnOnce(&mut FakeControl)) {
        let mut state = self.lock();
        edit(
            state
                .controls
                .iter_mut()
                .find(|c| c.description.id == id)
                .unwrap(),
        );
    }

    pub fn value(&self, id: u32) -> i64 {
        let state = self.lock();
        let found = state.controls.iter().find(|c| c.description.id == id);
        found.unwrap().value
    }

    /// Sets a control as another program would.
    pub fn set_externally(&self, id: u32, value: i64) {
        self.edit(id, |control| control.value = value);
        let mut state = self.lock();
        if state.subscribed.contains(&id) {
            state.events.push_back(ControlEvent {
                id,
                value_changed: true,
            });
        }
    }
}

/// A format in several sizes, each at one rate.
pub fn format(fourcc: &[u8; 4], sizes: &[(u32, u32, f64)]) -> CameraFormat {
    let sizes = sizes.iter().map(|&(width, height, rate)| CameraSize {
        width,
        height,
        steps: None,
        frames_per_second: vec![rate],
    });
    CameraFormat {
        fourcc: String::from_utf8_lossy(fourcc).into_owned(),
        description: String::new(),
        usable: crate::fourcc::pixel_format(*fourcc).is_some(),
        sizes: sizes.collect(),
    }
}

impl State {
    /// Lets all frames arrive that are due.
    fn deliver(&mut self) {
        let now = self.clock.now().as_nanos();
        while self.next_arrival().is_some_and(|at| at <= now) {
            let (at, frame) = match self.arrivals.pop_front() {
                Some(arrival) => arrival,
                None => self.expose(),
            };
            match self.free.pop_front() {
                Some(index) => self.filled.push_back((index, frame, at)),
                None => self.lost += 1,
            }
        }
    }

    fn next_arrival(&self) -> Option<i64> {
        let listed = self.arrivals.front().map(|(at, _)| *at);
        let sensed = self.sensor.as_ref();
        listed.or_else(|| sensed.map(|s| (i64::from(s.next) + 1) * s.period))
    }

    fn expose(&mut self) -> (i64, FakeFrame) {
        let sensor = self.sensor.as_mut().unwrap();
        let sequence = sensor.next;
        sensor.next += 1;
        while sensor
            .exposures
            .get(1)
            .is_some_and(|(from, _)| *from <= sequence)
        {
            sensor.exposures.pop_front();
        }
        let exposure = sensor
            .exposures
            .front()
            .map_or(0, |(_, exposure)| *exposure);
        let data = (sensor.image)(sequence, exposure);
        let at = (i64::from(sequence) + 1) * sensor.period;
        (at, FakeFrame::new(sequence, data))
    }
}

impl Controls for FakeDevice {
    fn describe_controls(&self) -> Vec<ControlDescription> {
        self.lock()
            .controls
            .iter()
            .map(|c| c.description.clone())
            .collect()
    }

    fn control_flags(&self, id: u32) -> Result<control::Flags> {
        let state = self.lock();
        let found = state.controls.iter().find(|c| c.description.id == id);
        Ok(found.ok_or(Errno::INVAL)?.description.flags)
    }

    fn read_control(&self, id: u32, _: ControlKind) -> Result<i64> {
        if let Some(error) = self.lock().control_error {
            return Err(error);
        }
        Ok(self.value(id))
    }

    fn write_control(&mut self, id: u32, _: ControlKind, value: i64) -> Result<()> {
        let mut state = self.lock();
        if let Some(error) = state.control_error {
            return Err(error);
        }
        let values: Vec<_> = state
            .controls
            .iter()
            .map(|c| (c.description.id, c.value))
            .collect();
        let control = state.controls.iter_mut().find(|c| c.description.id == id);
        let control = control.ok_or(Errno::INVAL)?;
        if control
            .needs
            .is_some_and(|needed| !values.contains(&needed))
        {
            return Err(Errno::ACCESS);
        }
        let (min, max) = (control.description.min, control.description.max);
        if control.refuses_out_of_range && !(min..=max).contains(&value) {
            return Err(Errno::RANGE);
        }
        if !control.ignores_writes {
            control.value = value.clamp(min, max);
        }
        let taken = control.value;
        let is_exposure = control.description.title.starts_with("Exposure Time");
        state.written.push((id, value));
        if let (true, Some(sensor)) = (is_exposure, state.sensor.as_mut()) {
            sensor
                .exposures
                .push_back((sensor.next + sensor.lag, taken));
        }
        Ok(())
    }

    fn subscribe_control(&mut self, id: u32) -> Result<()> {
        self.lock().subscribed.push(id);
        Ok(())
    }

    fn next_event(&mut self) -> Result<Option<ControlEvent>> {
        Ok(self.lock().events.pop_front())
    }
}

impl Formats for FakeDevice {
    fn capabilities(&self) -> Result<Capabilities> {
        Ok(Capabilities {
            captures: true,
            streams: true,
            ..Capabilities::default()
        })
    }

    fn formats(&self) -> Vec<CameraFormat> {
        self.lock().formats.clone()
    }

    fn format(&self) -> Result<CaptureFormat> {
        Ok(self.lock().format)
    }

    fn set_format(&mut self, wanted: &CaptureFormat) -> Result<CaptureFormat> {
        let mut state = self.lock();
        state.format = *wanted;
        Ok(*wanted)
    }
}

impl VideoDevice for FakeDevice {
    fn start_stream(&mut self, buffers: u32) -> Result<u32> {
        let mut state = self.lock();
        if let Some(error) = state.start_error {
            return Err(error);
        }
        state.starts += 1;
        state.free = (0..buffers).collect();
        state.memory = vec![Vec::new(); buffers as usize];
        Ok(buffers)
    }

    fn stop_stream(&mut self) -> Result<()> {
        let mut state = self.lock();
        state.stops += 1;
        state.stop_error.map_or(Ok(()), Err)
    }

    fn wait(&self, timeout: Duration) -> Result<Readiness> {
        let mut state = self.lock();
        state.waits += 1;
        if let Some(error) = state.wait_errors.pop_front() {
            return Err(error);
        }
        state.deliver();
        let idle = state.filled.is_empty() && state.events.is_empty();
        if idle && !state.wait_reports_error && !state.wait_reports_frame {
            let until = state.clock.now() + timeout;
            let next = state
                .next_arrival()
                .map_or(until, MonotonicTime::from_nanos);
            let nanos = next.min(until).nanos_since(state.clock.now());
            state.clock.advance(nanos.max(0));
            state.deliver();
        }
        Ok(Readiness {
            frame: !state.filled.is_empty() || state.wait_reports_frame,
            event: !state.events.is_empty(),
            error: state.wait_reports_error,
        })
    }

    fn dequeue(&mut self) -> Result<FilledBuffer> {
        let mut state = self.lock();
        if let Some(error) = state.dequeue_errors.pop_front() {
            return Err(error);
        }
        state.deliver();
        let (index, frame, at) = state.filled.pop_front().ok_or(Errno::AGAIN)?;
        state.memory[index as usize] = frame.data;
        Ok(FilledBuffer {
            buffer: OwnedBuffer::from_kernel(index),
            bytes_used: frame.bytes_used,
            flags: frame.flags,
            sequence: frame.sequence,
            timestamp: MonotonicTime::from_nanos(at - frame.age),
        })
    }

    fn queue(&mut self, buffer: OwnedBuffer) -> Result<()> {
        let mut state = self.lock();
        if let Some(error) = state.queue_error {
            return Err(error);
        }
        let index = buffer.index();
        let queued = state.free.contains(&index) || state.filled.iter().any(|f| f.0 == index);
        assert!(!queued, "buffer {index} was queued twice");
        // The kernel may overwrite the buffer, which must not change a frame handed out before.
        state.memory[index as usize].fill(0xEE);
        state.free.push_back(index);
        Ok(())
    }

    fn bytes<'a>(&'a self, buffer: &'a OwnedBuffer, len: usize) -> &'a [u8] {
        // Leaked, because the lock ends with this call. Tests are short.
        let state = self.lock();
        let memory = &state.memory[buffer.index() as usize];
        Box::leak(memory[..len.min(memory.len())].to_vec().into_boxed_slice())
    }
}
