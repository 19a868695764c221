//! State that the HTTP routes share, the encoding of pictures for them, and common replies.

use super::shared::{SharedStatus, View};
use crate::stream::{EncodeError, JpegEncoder, encode_png, stream_part};
use axum::Json;
use axum::body::Bytes;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use penumbra_config::StatusConfig;
use penumbra_picture::Picture;
use serde_json::json;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, Semaphore, watch};
use tokio::time::{Instant, sleep_until};

/// Timeout of a client that does not read.
const STALL_LIMIT: Duration = Duration::from_secs(20);
/// Minimum interval between encoded pictures (30 Hz); more would take processor time from the rig.
const STREAM_INTERVAL: Duration = Duration::from_millis(33);
/// Content type of a page.
pub const HTML: &str = "text/html; charset=utf-8";

/// What the streams may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamLimits {
    /// JPEG quality, 1..=100.
    pub quality: u8,
    /// Maximum number of viewers.
    pub viewers: usize,
    /// What a stream sends to all its viewers together at most, bytes per second. It limits the
    /// processor time that viewers take from the rig: without it a thousand viewers on a fast network
    /// would take all.
    pub bytes_per_second: u64,
    /// Timeout of a client that does not read.
    pub stall: Duration,
}

impl Default for StreamLimits {
    fn default() -> Self {
        Self::from(&StatusConfig::default())
    }
}

impl From<&StatusConfig> for StreamLimits {
    fn from(config: &StatusConfig) -> Self {
        Self {
            quality: config.stream_quality,
            viewers: config.viewers as usize,
            bytes_per_second: u64::from(config.stream_mbit_per_s) * (1_000_000 / 8),
            stall: STALL_LIMIT,
        }
    }
}

impl StreamLimits {
    /// Returns the time from a picture of `bytes` to the next one.
    fn interval(&self, bytes: usize, viewers: u32) -> Duration {
        let all = bytes as f64 * f64::from(viewers);
        let needed = Duration::from_secs_f64(all / self.bytes_per_second.max(1) as f64);
        needed.max(STREAM_INTERVAL)
    }
}

/// State shared by the routes.
#[derive(Clone)]
pub struct App {
    pub(super) shared: Arc<SharedStatus>,
    pub(super) limits: StreamLimits,
    composite: Encoded,
    pair: Encoded,
    pub(super) streams: Arc<Semaphore>,
    /// The place of the one upload at a time.
    pub(super) uploads: Arc<Semaphore>,
    pub(super) snapshot_png: Arc<PngCache>,
    pub(super) environment_png: Arc<PngCache>,
}

/// The encoded pictures of a view.
#[derive(Clone)]
struct Encoded {
    parts: watch::Sender<Option<Bytes>>,
    encoder: Arc<std::sync::Mutex<JpegEncoder>>,
}

impl Encoded {
    fn new(quality: u8) -> Result<Self, EncodeError> {
        let encoder = JpegEncoder::new(quality)?;
        Ok(Self {
            parts: watch::Sender::new(None),
            encoder: Arc::new(std::sync::Mutex::new(encoder)),
        })
    }
}

impl App {
    /// Creates the state.
    ///
    /// # Errors
    /// The JPEG encoder cannot allocate.
    pub fn new(shared: Arc<SharedStatus>, limits: StreamLimits) -> Result<Self, EncodeError> {
        Ok(Self {
            shared,
            limits,
            composite: Encoded::new(limits.quality)?,
            pair: Encoded::new(limits.quality)?,
            streams: Arc::new(Semaphore::new(limits.viewers)),
            uploads: Arc::new(Semaphore::new(1)),
            snapshot_png: Arc::default(),
            environment_png: Arc::default(),
        })
    }

    const fn encoded(&self, view: View) -> &Encoded {
        match view {
            View::Composite => &self.composite,
            View::Pair => &self.pair,
        }
    }

    /// Subscribes to the encoded pictures of a view.
    pub(super) fn parts(&self, view: View) -> watch::Receiver<Option<Bytes>> {
        self.encoded(view).parts.subscribe()
    }

    /// Encodes each new picture of a view once for all viewers, and nothing without viewers.
    pub async fn stream_pictures(&self, view: View) {
        let mut watchers = self.shared.viewers(view);
        let mut pictures = self.shared.pictures(view);
        loop {
            if *watchers.borrow_and_update() == 0 {
                self.encoded(view).parts.send_replace(None);
                if watchers.changed().await.is_err() {
                    return;
                }
                // Whoever comes sees the picture there is, even if no other follows.
                pictures.mark_changed();
                continue;
            }
            tokio::select! {
                _ = watchers.changed() => continue,
                _ = pictures.changed() => {}
            }
            let began = Instant::now();
            let picture = pictures.borrow_and_update().clone();
            if let Some(picture) = picture {
                self.encode(view, picture).await;
            }
            let bytes = self
                .encoded(view)
                .parts
                .borrow()
                .as_ref()
                .map_or(0, Bytes::len);
            let interval = self.limits.interval(bytes, *watchers.borrow());
            if interval > STREAM_INTERVAL {
                // Until shortly before the next picture is due, the rig need not read any back.
                let _pause = self.shared.pause_pictures(view);
                sleep_until(began + interval - STREAM_INTERVAL).await;
            }
            sleep_until(began + interval).await;
        }
    }

    async fn encode(&self, view: View, picture: Arc<Picture>) {
        let encoder = Arc::clone(&self.encoded(view).encoder);
        let began = Instant::now();
        let encoded = tokio::task::spawn_blocking(move || {
            let mut encoder = encoder
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            encoder.encode(&picture).map(|jpeg| stream_part(&jpeg))
        });
        let error = match encoded.await {
            Ok(Ok(part)) => {
                self.encoded(view).parts.send_replace(Some(part));
                self.shared.update(|s| {
                    s.stream.encoded += 1;
                    s.stages.record("encode", began.elapsed());
                });
                return;
            }
            Ok(Err(error)) => error.to_string(),
            Err(error) => error.to_string(),
        };
        self.shared.update(|s| s.warn(&format!("stream: {error}")));
    }
}

/// The last PNG. The lock is held during encoding, so that several requests for the same picture cause
/// one encoding.
#[derive(Default)]
pub(super) struct PngCache {
    newest: Mutex<Option<(Arc<Picture>, Bytes)>>,
}

impl PngCache {
    pub async fn encoded(&self, picture: Arc<Picture>) -> Result<Bytes, String> {
        let mut newest = self.newest.lock().await;
        if let Some((_, png)) = newest.as_ref().filter(|(of, _)| Arc::ptr_eq(of, &picture)) {
            return Ok(png.clone());
        }
        let source = Arc::clone(&picture);
        let encoding = tokio::task::spawn_blocking(move || encode_png(&source));
        let png = encoding
            .await
            .map_err(|e| e.to_string())?
            .map_err(|e| e.to_string())?;
        *newest = Some((picture, png.clone()));
        Ok(png)
    }
}

/// Returns whether a request states that its body is JSON. The form of another page cannot state that.
#[must_use]
pub fn is_json(headers: &HeaderMap) -> bool {
    let content_type = headers
        .get(header::CONTENT_TYPE)
        .and_then(|v| v.to_str().ok());
    content_type.is_some_and(|t| t.starts_with("application/json"))
}

/// Answers with the reason of a refusal: `{ "error": text }`.
#[must_use]
pub fn problem(status: StatusCode, text: &str) -> Response {
    (status, Json(json!({ "error": text }))).into_response()
}
