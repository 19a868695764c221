//! The order in which transfers are answered.
//!
//! `vhci_hcd` may send an UNLINK before the SUBMIT that it cancels (its transmitter sends from two
//! queues), although SUBMITs themselves arrive in order. If it were answered at once, the device
//! would be lost or the kernel would hang in `usb_kill_urb`; so such an UNLINK waits for its
//! SUBMIT. A RET_SUBMIT after the RET_UNLINK of the same transfer makes the kernel drop the
//! device; so the queue stays locked while an answer is written.

use crate::lock;
use crate::usbip::{UNLINKED, submit_reply, unlink_reply};
use std::collections::{HashMap, VecDeque};
use std::io::{self, Write};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// The device's end of the connection.
pub struct Link<W> {
    queue: Mutex<Queue<W>>,
    arrived: Condvar,
}

struct Queue<W> {
    socket: W,
    /// Transfers that wait for data: number, and maximum number of bytes.
    waiting: VecDeque<(u32, usize)>,
    newest: u32,
    /// UNLINKs that arrived before their SUBMIT: the number of the UNLINK by that of the SUBMIT.
    early: HashMap<u32, u32>,
    closed: bool,
}

impl<W: Write> Link<W> {
    /// Creates a link over this socket.
    pub fn new(socket: W) -> Self {
        Self {
            queue: Mutex::new(Queue {
                socket,
                waiting: VecDeque::new(),
                newest: 0,
                early: HashMap::new(),
                closed: false,
            }),
            arrived: Condvar::new(),
        }
    }

    /// Accepts a transfer; `false` if it was cancelled before, and is answered.
    ///
    /// # Errors
    /// The connection is closed.
    pub fn accept(&self, sequence: u32) -> io::Result<bool> {
        let mut queue = lock(&self.queue);
        queue.newest = sequence;
        match queue.early.remove(&sequence) {
            Some(unlink) => queue.send(&unlink_reply(unlink, UNLINKED)).map(|()| false),
            None => Ok(true),
        }
    }

    /// Answers a transfer now.
    ///
    /// # Errors
    /// The connection is closed.
    pub fn answer(&self, sequence: u32, status: i32, actual: usize, data: &[u8]) -> io::Result<()> {
        lock(&self.queue).send(&submit_reply(sequence, status, actual, data))
    }

    /// Keeps a transfer for [`Link::deliver`].
    pub fn keep(&self, sequence: u32, length: usize) {
        lock(&self.queue).waiting.push_back((sequence, length));
        self.arrived.notify_all();
    }

    /// Cancels a transfer.
    ///
    /// # Errors
    /// The connection is closed.
    pub fn unlink(&self, sequence: u32, target: u32) -> io::Result<()> {
        let mut queue = lock(&self.queue);
        if target > queue.newest {
            queue.early.insert(target, sequence);
            return Ok(());
        }
        let before = queue.waiting.len();
        queue.waiting.retain(|(waiting, _)| *waiting != target);
        let taken_back = queue.waiting.len() < before;
        queue.send(&unlink_reply(
            sequence,
            if taken_back { UNLINKED } else { 0 },
        ))
    }

    /// Answers the oldest kept transfer with `payload`, as soon as there is one; `false` if none
    /// arrives in time or the connection is closed.
    pub fn deliver(&self, payload: &[u8], timeout: Duration) -> bool {
        let mut queue = self.wait(timeout);
        let Some((sequence, length)) = queue.waiting.pop_front() else {
            return false;
        };
        let payload = &payload[..payload.len().min(length)];
        queue
            .send(&submit_reply(sequence, 0, payload.len(), payload))
            .is_ok()
    }

    /// Waits up to `timeout` for a transfer that needs data; whether there is one.
    pub fn wanted(&self, timeout: Duration) -> bool {
        !self.wait(timeout).waiting.is_empty()
    }

    fn wait(&self, timeout: Duration) -> std::sync::MutexGuard<'_, Queue<W>> {
        self.arrived
            .wait_timeout_while(lock(&self.queue), timeout, |queue| {
                queue.waiting.is_empty() && !queue.closed
            })
            .unwrap_or_else(PoisonError::into_inner)
            .0
    }

    /// Closes the connection and drops kept transfers.
    pub fn close(&self) {
        let mut queue = lock(&self.queue);
        queue.closed = true;
        queue.waiting.clear();
        self.arrived.notify_all();
    }

    /// Whether the connection is closed.
    pub fn is_closed(&self) -> bool {
        lock(&self.queue).closed
    }
}

impl<W: Write> Queue<W> {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        let sent = self.socket.write_all(message);
        self.closed |= sent.is_err();
        sent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Command, number and status of every message that was sent.
    fn sent(link: &Link<Vec<u8>>) -> Vec<(u32, u32, i32)> {
        let word = |bytes: &[u8], at| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        let queue = lock(&link.queue);
        let mut rest = queue.socket.as_slice();
        let mut messages = Vec::new();
        while !rest.is_empty() {
            let data = if word(rest, 0) == 3 {
                word(rest, 24) as usize
            } else {
                0
            };
            messages.push((word(rest, 0), word(rest, 4), word(rest, 20) as i32));
            rest = &rest[48 + data..];
        }
        messages
    }

    #[test]
    fn unlink_waits_for_the_submit_that_it_cancels() {
        let link = Link::new(Vec::new());
        assert!(link.accept(5).unwrap());
        link.unlink(9, 7).unwrap();
        assert_eq!(sent(&link), []);
        assert!(!link.accept(7).unwrap(), "cancelled before it arrived");
        assert_eq!(sent(&link), [(4, 9, UNLINKED)]);
    }

    #[test]
    fn cancelled_transfer_gets_no_data() {
        let link = Link::new(Vec::new());
        for sequence in [1, 2] {
            link.accept(sequence).unwrap();
            link.keep(sequence, 100);
        }
        link.unlink(3, 1).unwrap();
        assert!(link.deliver(&[7; 10], Duration::ZERO));
        assert!(!link.deliver(&[7; 10], Duration::ZERO), "none waits");
        link.unlink(4, 2).unwrap();
        assert_eq!(sent(&link), [(4, 3, UNLINKED), (3, 2, 0), (4, 4, 0)]);
    }
}
