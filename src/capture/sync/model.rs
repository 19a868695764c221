//! Twins of what `sync` uses, which give every step to the model checker. Time does not pass by
//! itself: a wait of an hour or more ends only with what it waits for, so that a lost notification
//! is a deadlock, which the checker reports; a shorter wait may end at any moment.

pub use shuttle::sync::atomic;
use shuttle::thread::yield_now;
use std::ops::{Deref, DerefMut};
use std::sync::{LockResult, PoisonError};
use std::time::Duration;

/// A wait of this length or more does not end by itself.
const FOREVER: Duration = Duration::from_secs(3600);

/// A lock.
#[derive(Debug, Default)]
pub struct Mutex<T>(shuttle::sync::Mutex<T>);

/// A held lock.
#[derive(Debug)]
pub struct MutexGuard<'a, T> {
    held: shuttle::sync::MutexGuard<'a, T>,
    /// To lock it again after a wait.
    mutex: &'a Mutex<T>,
}

impl<T> Mutex<T> {
    /// Creates an open lock.
    pub const fn new(value: T) -> Self {
        Self(shuttle::sync::Mutex::new(value))
    }

    /// Waits for the lock.
    ///
    /// # Errors
    /// A thread has panicked while it held the lock.
    pub fn lock(&self) -> LockResult<MutexGuard<'_, T>> {
        self.guard(self.0.lock())
    }

    fn guard<'a>(
        &'a self,
        held: LockResult<shuttle::sync::MutexGuard<'a, T>>,
    ) -> LockResult<MutexGuard<'a, T>> {
        let guard = |held| MutexGuard { held, mutex: self };
        match held {
            Ok(held) => Ok(guard(held)),
            Err(error) => Err(PoisonError::new(guard(error.into_inner()))),
        }
    }
}

impl<T> Deref for MutexGuard<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.held
    }
}

impl<T> DerefMut for MutexGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.held
    }
}

/// A condition to wait for.
#[derive(Debug, Default)]
pub struct Condvar(shuttle::sync::Condvar);

impl Condvar {
    /// Creates a condition that nobody waits for.
    #[must_use]
    pub const fn new() -> Self {
        Self(shuttle::sync::Condvar::new())
    }

    /// Wakes one waiting thread.
    pub fn notify_one(&self) {
        self.0.notify_one();
    }

    /// Wakes all waiting threads.
    pub fn notify_all(&self) {
        self.0.notify_all();
    }

    /// Waits for a notification; returns also whether a short wait has ended without one.
    ///
    /// # Errors
    /// A thread has panicked while it held the lock.
    pub fn wait_timeout<'a, T>(
        &self,
        guard: MutexGuard<'a, T>,
        time: Duration,
    ) -> LockResult<(MutexGuard<'a, T>, bool)> {
        let MutexGuard { held, mutex } = guard;
        let has_timed_out = time < FOREVER;
        let waited = if has_timed_out {
            // Every other thread may run first, for any number of steps.
            drop(held);
            yield_now();
            mutex.lock()
        } else {
            mutex.guard(self.0.wait(held))
        };
        match waited {
            Ok(guard) => Ok((guard, has_timed_out)),
            Err(error) => Err(PoisonError::new((error.into_inner(), has_timed_out))),
        }
    }
}

/// Bounded channels.
pub mod channel {
    use super::{FOREVER, yield_now};
    use shuttle::sync::mpsc;
    pub use shuttle::sync::mpsc::{
        RecvError, RecvTimeoutError, SyncSender as Sender, TryRecvError, TrySendError,
    };
    use std::time::Duration;

    /// Creates a channel of `capacity` messages.
    #[must_use]
    pub fn bounded<T>(capacity: usize) -> (Sender<T>, Receiver<T>) {
        let (sender, receiver) = mpsc::sync_channel(capacity);
        (sender, Receiver(receiver))
    }

    /// The receiving end.
    #[derive(Debug)]
    pub struct Receiver<T>(mpsc::Receiver<T>);

    impl<T> Receiver<T> {
        /// Waits for the next message.
        ///
        /// # Errors
        /// The channel is empty and has no sender.
        pub fn recv(&self) -> Result<T, RecvError> {
            self.0.recv()
        }

        /// Takes the next message.
        ///
        /// # Errors
        /// The channel is empty.
        pub fn try_recv(&self) -> Result<T, TryRecvError> {
            self.0.try_recv()
        }

        /// Waits for the next message; a short wait may end at any moment.
        ///
        /// # Errors
        /// The channel is empty, and has no sender or the wait has ended.
        pub fn recv_timeout(&self, time: Duration) -> Result<T, RecvTimeoutError> {
            if time >= FOREVER {
                return self
                    .recv()
                    .map_err(|RecvError| RecvTimeoutError::Disconnected);
            }
            yield_now();
            self.try_recv().map_err(|error| match error {
                TryRecvError::Empty => RecvTimeoutError::Timeout,
                TryRecvError::Disconnected => RecvTimeoutError::Disconnected,
            })
        }
    }
}

/// Threads of the model.
pub mod threads {
    use super::JoinHandle;
    use shuttle::thread::Builder;
    use std::io;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// Starts a named thread.
    ///
    /// # Errors
    /// None in the model.
    pub fn spawn<T: Send + 'static>(
        name: &str,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<JoinHandle<T>> {
        let is_finished = Arc::<AtomicBool>::default();
        let finished = Arc::clone(&is_finished);
        let job = move || {
            let result = job();
            finished.store(true, Ordering::Relaxed);
            result
        };
        let thread = Builder::new().name(name.to_owned()).spawn(job)?;
        Ok(JoinHandle {
            thread,
            is_finished,
        })
    }

    /// As [`spawn`]: the model knows no priorities.
    ///
    /// # Errors
    /// None in the model.
    pub fn spawn_background<T: Send + 'static>(
        name: &str,
        job: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<JoinHandle<T>> {
        spawn(name, job)
    }
}

/// The handle of a thread.
#[derive(Debug)]
pub struct JoinHandle<T> {
    thread: shuttle::thread::JoinHandle<T>,
    is_finished: std::sync::Arc<std::sync::atomic::AtomicBool>,
}

impl<T> JoinHandle<T> {
    /// Waits for the thread's end.
    ///
    /// # Errors
    /// The thread has panicked.
    pub fn join(self) -> std::thread::Result<T> {
        self.thread.join()
    }

    /// Returns whether the thread has ended.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.is_finished.load(std::sync::atomic::Ordering::Relaxed)
    }
}
