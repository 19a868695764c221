//! Composited pictures on their way into a recording. The frame loop never waits for them: a picture
//! that finds the queue full is dropped and counted.

use bytes::Bytes;
use penumbra_capture::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use penumbra_capture::sync::channel::{Receiver, Sender, TrySendError, bounded};
use penumbra_capture::sync::{Mutex, limit, threads};
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_picture::Picture;
use penumbra_status::stream::JpegEncoder;
use std::io;
use std::sync::{Arc, PoisonError};

/// Pictures that wait to be encoded.
const PICTURES: usize = 2;
/// Encoded pictures that wait to be written: a quarter of a second at 60 Hz.
const ENCODED: usize = limit(16, 2);
/// JPEG quality, per cent: hardly visible losses.
const JPEG_QUALITY: u8 = 90;

/// Connects the frame loop of a live rig with its recorder.
#[derive(Debug, Default)]
pub struct Composites {
    /// Whether a recording wants pictures; spares the lock.
    wanted: AtomicBool,
    feed: Mutex<Option<Feed>>,
}

#[derive(Debug)]
struct Feed {
    pictures: Sender<Composed>,
    dropped: Arc<AtomicU64>,
}

/// A composited picture.
#[derive(Debug)]
struct Composed {
    picture: Arc<Picture>,
    captured_at: MonotonicTime,
    composed_at: MonotonicTime,
}

/// An encoded one.
#[derive(Debug)]
pub(crate) struct EncodedComposite {
    pub jpeg: Bytes,
    /// The middle of the exposure of the scene camera's picture.
    pub captured_at: MonotonicTime,
    pub composed_at: MonotonicTime,
}

/// The recorder's end; dropping it ends the encoder.
#[derive(Debug)]
pub(crate) struct CompositeQueue {
    owner: Arc<Composites>,
    pub encoded: Receiver<EncodedComposite>,
    /// Pictures that were not recorded.
    dropped: Arc<AtomicU64>,
}

impl Composites {
    /// Whether a recording wants the next picture.
    pub fn wanted(&self) -> bool {
        self.wanted.load(Ordering::Relaxed)
    }

    /// Hands a picture over, or drops it.
    pub fn offer(&self, picture: &Arc<Picture>, captured_at: MonotonicTime) {
        let feed = self.feed.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(feed) = &*feed else { return };
        let composed = Composed {
            picture: Arc::clone(picture),
            captured_at,
            composed_at: SystemClock.now(),
        };
        if let Err(TrySendError::Full(_)) = feed.pictures.try_send(composed) {
            feed.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Starts the encoder of a recording.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub(crate) fn start(self: &Arc<Self>) -> io::Result<CompositeQueue> {
        let (pictures, waiting) = bounded(PICTURES);
        let (encoded, queue) = bounded(ENCODED);
        let dropped = Arc::<AtomicU64>::default();
        let lost = Arc::clone(&dropped);
        // It ends with the channel that it reads.
        threads::spawn_background("composite", move || encode(&waiting, &encoded, &lost))?;
        let feed = Feed {
            pictures,
            dropped: Arc::clone(&dropped),
        };
        self.set(Some(feed));
        Ok(CompositeQueue {
            owner: Arc::clone(self),
            encoded: queue,
            dropped,
        })
    }

    fn set(&self, feed: Option<Feed>) {
        self.wanted.store(feed.is_some(), Ordering::Relaxed);
        *self.feed.lock().unwrap_or_else(PoisonError::into_inner) = feed;
    }
}

impl CompositeQueue {
    /// Accepts no more pictures; those on their way still arrive, and then the channel is closed.
    pub fn close(&self) {
        self.owner.set(None);
    }

    /// Number of pictures that were not recorded.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Counts a picture that cannot be written.
    pub fn drop_one(&self) {
        self.dropped.fetch_add(1, Ordering::Relaxed);
    }
}

impl Drop for CompositeQueue {
    fn drop(&mut self) {
        self.close();
    }
}

/// Encodes pictures until no more can come.
fn encode(pictures: &Receiver<Composed>, out: &Sender<EncodedComposite>, dropped: &AtomicU64) {
    let mut encoder = JpegEncoder::new(JPEG_QUALITY).ok();
    while let Ok(composed) = pictures.recv() {
        let jpeg = encoder
            .as_mut()
            .and_then(|encoder| encoder.encode(&composed.picture).ok());
        let taken = jpeg.is_some_and(|jpeg| {
            let encoded = EncodedComposite {
                jpeg,
                captured_at: composed.captured_at,
                composed_at: composed.composed_at,
            };
            out.try_send(encoded).is_ok()
        });
        if !taken {
            dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}
