//! A camera without a kernel, which fails on purpose, on a clock that tests advance.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use crate::video::{
    Capabilities, ControlDescription, ControlEvent, ControlKind, Controls, Filled, Geometry, Held,
    Modes, Ready, Video,
};
use penumbra_interface::{CameraFormat, CameraSize, Clock, MonotonicTime};
use rustix::io::{Errno, Result};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use v4l::{buffer, control};

/// Time that only moves when told.
#[derive(Clone, Debug, Default)]
pub struct TestClock(Arc<AtomicI64>);

impl TestClock {
    pub fn advance(&self, nanos: i64) {
        self.0.fetch_add(nanos, Ordering::Relaxed);
    }
}

impl Clock for TestClock {
    fn now(&self) -> MonotonicTime {
        MonotonicTime::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// One picture that the camera makes.
#[derive(Clone, Debug)]
pub struct Shot {
    pub data: Vec<u8>,
    /// What the driver says that it filled; the data's length unless it lies.
    pub used: usize,
    pub flags: buffer::Flags,
    pub sequence: u32,
    /// Nanoseconds before its arrival.
    pub age: i64,
}

impl Shot {
    pub fn new(sequence: u32, data: Vec<u8>) -> Self {
        Self {
            used: data.len(),
            data,
            flags: buffer::Flags::TIMESTAMP_MONOTONIC | buffer::Flags::TSTAMP_SRC_SOE,
            sequence,
            age: 20_000_000,
        }
    }
}

pub struct FakeControl {
    pub description: ControlDescription,
    pub value: i64,
    /// The control that owns this one unless it has this value: EACCES then.
    pub owner: Option<(u32, i64)>,
    /// Out of range is an error instead of being clamped.
    pub strict: bool,
    /// Sets nothing but says it did.
    pub deaf: bool,
}

/// A sensor that follows its exposure control some frames late.
pub struct Sensor {
    pub period: i64,
    pub lag: u32,
    pub next: u32,
    /// From which frame on which exposure.
    pub exposures: VecDeque<(u32, i64)>,
    pub picture: Box<dyn FnMut(u32, i64) -> Vec<u8> + Send>,
}

#[derive(Default)]
pub struct State {
    pub clock: TestClock,
    /// Pictures to come, by arrival.
    pub arrivals: VecDeque<(i64, Shot)>,
    pub sensor: Option<Sensor>,
    /// Pictures in buffers that wait to be dequeued.
    pub filled: VecDeque<(u32, Shot, i64)>,
    /// Buffers that the kernel owns and has not filled.
    pub free: VecDeque<u32>,
    pub memory: Vec<Vec<u8>>,
    pub controls: Vec<FakeControl>,
    pub events: VecDeque<ControlEvent>,
    pub watched: Vec<u32>,
    pub formats: Vec<CameraFormat>,
    pub geometry: Geometry,
    pub wait_faults: VecDeque<Errno>,
    pub dequeue_faults: VecDeque<Errno>,
    pub queue_fault: Option<Errno>,
    pub start_fault: Option<Errno>,
    pub stop_fault: Option<Errno>,
    pub control_fault: Option<Errno>,
    pub poll_error: bool,
    pub poll_lies: bool,
    pub lost: u32,
    pub sets: Vec<(u32, i64)>,
    pub starts: u32,
    pub stops: u32,
    pub waits: u32,
}

#[derive(Clone, Default)]
pub struct FakeVideo(pub Arc<Mutex<State>>);

impl FakeVideo {
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap()
    }

    /// A camera of one format and size.
    pub fn streaming(fourcc: &[u8; 4], width: u32, height: u32) -> Self {
        let fake = Self::default();
        let mut state = fake.lock();
        state.formats = vec![format(fourcc, &[(width, height, 30.0)])];
        state.geometry = Geometry {
            width,
            height,
            fourcc: *fourcc,
            ..Geometry::default()
        };
        drop(state);
        fake
    }

    pub fn clock(&self) -> Arc<TestClock> {
        Arc::new(self.lock().clock.clone())
    }

    /// A picture arrives `millis` from the clock's zero.
    pub fn arrives(&self, millis: i64, shot: Shot) {
        self.lock().arrivals.push_back((millis * 1_000_000, shot));
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
            owner: None,
            strict: false,
            deaf: false,
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

    /// Another program sets a control.
    pub fn meddle(&self, id: u32, value: i64) {
        self.edit(id, |control| control.value = value);
        let mut state = self.lock();
        if state.watched.contains(&id) {
            state.events.push_back(ControlEvent {
                id,
                value_changed: true,
                value,
            });
        }
    }
}

/// A format in some sizes, each at one rate.
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
    /// Lets everything arrive that is due by now.
    fn deliver(&mut self) {
        let now = self.clock.now().as_nanos();
        while self.next_arrival().is_some_and(|at| at <= now) {
            let (at, shot) = match self.arrivals.pop_front() {
                Some(arrival) => arrival,
                None => self.expose(),
            };
            match self.free.pop_front() {
                Some(index) => self.filled.push_back((index, shot, at)),
                None => self.lost += 1,
            }
        }
    }

    fn next_arrival(&self) -> Option<i64> {
        let listed = self.arrivals.front().map(|(at, _)| *at);
        let sensed = self.sensor.as_ref();
        listed.or_else(|| sensed.map(|s| (i64::from(s.next) + 1) * s.period))
    }

    fn expose(&mut self) -> (i64, Shot) {
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
        let data = (sensor.picture)(sequence, exposure);
        let at = (i64::from(sequence) + 1) * sensor.period;
        (at, Shot::new(sequence, data))
    }
}

impl Controls for FakeVideo {
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

    fn control(&self, id: u32, _: ControlKind) -> Result<i64> {
        if let Some(fault) = self.lock().control_fault {
            return Err(fault);
        }
        Ok(self.value(id))
    }

    fn set_control(&mut self, id: u32, _: ControlKind, value: i64) -> Result<()> {
        let mut state = self.lock();
        if let Some(fault) = state.control_fault {
            return Err(fault);
        }
        let values: Vec<_> = state
            .controls
            .iter()
            .map(|c| (c.description.id, c.value))
            .collect();
        let control = state.controls.iter_mut().find(|c| c.description.id == id);
        let control = control.ok_or(Errno::INVAL)?;
        if let Some((owner, free)) = control.owner {
            if values.contains(&(owner, free)) {
            } else {
                return Err(Errno::ACCESS);
            }
        }
        let (min, max) = (control.description.min, control.description.max);
        if control.strict && !(min..=max).contains(&value) {
            return Err(Errno::RANGE);
        }
        if !control.deaf {
            control.value = value.clamp(min, max);
        }
        let taken = control.value;
        let is_exposure = control.description.title.starts_with("Exposure Time");
        state.sets.push((id, value));
        if let (true, Some(sensor)) = (is_exposure, state.sensor.as_mut()) {
            sensor
                .exposures
                .push_back((sensor.next + sensor.lag, taken));
        }
        Ok(())
    }

    fn watch_control(&mut self, id: u32) -> Result<()> {
        self.lock().watched.push(id);
        Ok(())
    }

    fn next_event(&mut self) -> Result<Option<ControlEvent>> {
        Ok(self.lock().events.pop_front())
    }
}

impl Modes for FakeVideo {
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

    fn geometry(&self) -> Result<Geometry> {
        Ok(self.lock().geometry)
    }

    fn set_geometry(&mut self, wanted: &Geometry) -> Result<Geometry> {
        let mut state = self.lock();
        state.geometry = *wanted;
        Ok(*wanted)
    }
}

impl Video for FakeVideo {
    fn start(&mut self, buffers: u32) -> Result<u32> {
        let mut state = self.lock();
        if let Some(fault) = state.start_fault {
            return Err(fault);
        }
        state.starts += 1;
        state.free = (0..buffers).collect();
        state.memory = vec![Vec::new(); buffers as usize];
        Ok(buffers)
    }

    fn stop(&mut self) -> Result<()> {
        let mut state = self.lock();
        state.stops += 1;
        state.stop_fault.map_or(Ok(()), Err)
    }

    fn wait(&self, timeout: Duration) -> Result<Ready> {
        let mut state = self.lock();
        state.waits += 1;
        if let Some(fault) = state.wait_faults.pop_front() {
            return Err(fault);
        }
        state.deliver();
        let idle = state.filled.is_empty() && state.events.is_empty();
        if idle && !state.poll_error && !state.poll_lies {
            let until = state.clock.now() + timeout;
            let next = state
                .next_arrival()
                .map_or(until, MonotonicTime::from_nanos);
            let nanos = next.min(until).nanos_since(state.clock.now());
            state.clock.advance(nanos.max(0));
            state.deliver();
        }
        Ok(Ready {
            frame: !state.filled.is_empty() || state.poll_lies,
            event: !state.events.is_empty(),
            error: state.poll_error,
        })
    }

    fn dequeue(&mut self) -> Result<Filled> {
        let mut state = self.lock();
        if let Some(fault) = state.dequeue_faults.pop_front() {
            return Err(fault);
        }
        state.deliver();
        let (index, shot, at) = state.filled.pop_front().ok_or(Errno::AGAIN)?;
        state.memory[index as usize] = shot.data;
        Ok(Filled {
            held: Held::received(index),
            used: shot.used,
            flags: shot.flags,
            sequence: shot.sequence,
            stamp: MonotonicTime::from_nanos(at - shot.age),
        })
    }

    fn queue(&mut self, held: Held) -> Result<()> {
        let mut state = self.lock();
        if let Some(fault) = state.queue_fault {
            return Err(fault);
        }
        let index = held.index();
        let queued = state.free.contains(&index) || state.filled.iter().any(|f| f.0 == index);
        assert!(!queued, "buffer {index} was queued twice");
        // What the kernel writes next must not be seen in a picture that was handed over.
        state.memory[index as usize].fill(0xEE);
        state.free.push_back(index);
        Ok(())
    }

    fn bytes<'a>(&'a self, held: &'a Held, used: usize) -> &'a [u8] {
        // Leaked, because the lock cannot be held: tests are short.
        let state = self.lock();
        let memory = &state.memory[held.index() as usize];
        Box::leak(memory[..used.min(memory.len())].to_vec().into_boxed_slice())
    }
}
