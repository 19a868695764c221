//! Places at the server: who is served when many ask.
//!
//! A connection costs little until its request has been judged, so connections are limited
//! generously, and one more closes that which has been idle for longest. A request that the guard
//! has accepted takes a place until its answer has been written. Some places are kept for health,
//! status and metrics.

use axum::body::{Body, Bytes};
use axum::response::Response;
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Instant;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Maximum number of requests that are served at a time.
pub(super) const MAX_REQUESTS: usize = 112;
/// The paths of streams, which have places of their own.
const STREAM_PATHS: [&str; 2] = ["/stream.mjpeg", "/compare.mjpeg"];
/// Further places for health, status and metrics.
const RESERVED: usize = 16;
/// The paths with reserved places.
const RESERVED_PATHS: [&str; 3] = ["/healthz", "/status", "/metrics"];

/// The places for requests.
#[derive(Clone)]
pub(super) struct Places {
    requests: Arc<Semaphore>,
    reserved: Arc<Semaphore>,
    streams: Arc<Semaphore>,
}

impl Places {
    /// The places for requests, among them this many for streams.
    pub fn new(viewers: usize) -> Self {
        Self {
            requests: Arc::new(Semaphore::new(MAX_REQUESTS)),
            reserved: Arc::new(Semaphore::new(RESERVED)),
            streams: Arc::new(Semaphore::new(viewers)),
        }
    }

    /// Takes a place for a request to `path`; `None` if there is none.
    pub fn take(&self, path: &str) -> Option<OwnedSemaphorePermit> {
        let own = match path {
            path if RESERVED_PATHS.contains(&path) => Some(&self.reserved),
            path if STREAM_PATHS.contains(&path) => Some(&self.streams),
            _ => None,
        };
        let mut pools = own.into_iter().chain([&self.requests]);
        pools.find_map(|pool| Arc::clone(pool).try_acquire_owned().ok())
    }
}

/// Whether a connection is busy with requests, or since when it is idle.
#[derive(Debug)]
pub(super) struct Activity(Mutex<(usize, Instant)>);

impl Activity {
    pub fn new() -> Arc<Self> {
        Arc::new(Self(Mutex::new((0, Instant::now()))))
    }

    /// Returns since when the connection is idle; `None` while it is busy.
    pub fn idle_since(&self) -> Option<Instant> {
        let (requests, since) = *self.lock();
        (requests == 0).then_some(since)
    }

    /// Marks the connection as busy until the result is dropped.
    pub fn begin(self: &Arc<Self>) -> Busy {
        self.lock().0 += 1;
        Busy(Arc::clone(self))
    }

    fn lock(&self) -> MutexGuard<'_, (usize, Instant)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request of a connection.
#[derive(Debug)]
pub(super) struct Busy(Arc<Activity>);

impl Drop for Busy {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        *state = (state.0.saturating_sub(1), Instant::now());
    }
}

/// Keeps `held` until the answer's body has been written, or its client is gone.
pub(super) fn hold<G: Send + Unpin + 'static>(response: Response, held: G) -> Response {
    response.map(|body| Body::new(Held { body, _held: held }))
}

struct Held<G> {
    body: Body,
    _held: G,
}

impl<G: Unpin> HttpBody for Held<G> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn health_has_places_when_all_others_are_taken() {
        let places = Places::new(0);
        let taken: Vec<_> = std::iter::from_fn(|| places.take("/snapshot.png")).collect();
        assert_eq!(taken.len(), MAX_REQUESTS);
        let reserved: Vec<_> = std::iter::from_fn(|| places.take("/healthz")).collect();
        assert_eq!(reserved.len(), RESERVED);
        drop(taken);
        assert!(places.take("/status").is_some());
    }

    #[test]
    fn viewers_take_places_of_others_only_when_theirs_are_taken() {
        let places = Places::new(1000);
        let viewers: Vec<_> = std::iter::from_fn(|| places.take("/stream.mjpeg"))
            .take(1000)
            .collect();
        let others: Vec<_> = std::iter::from_fn(|| places.take("/snapshot.png")).collect();
        assert_eq!((viewers.len(), others.len()), (1000, MAX_REQUESTS));
    }

    #[test]
    fn connection_is_idle_when_its_last_request_has_ended() {
        let activity = Activity::new();
        let first = activity.begin();
        let second = activity.begin();
        drop(first);
        assert!(activity.idle_since().is_none());
        drop(second);
        assert!(activity.idle_since().is_some());
    }
}
