//! The HTTP routes.

use super::calibration_routes;
use super::guard::{self, Token};
use super::health::health;
use super::metrics::{METRICS_CONTENT_TYPE, metrics};
use super::recording::RecordingRequest;
use super::settings::{Settings, SettingsChange, SettingsError};
use super::shared::SharedStatus;
use super::snapshot::{Snapshot, WhiteBalance};
use crate::stream::{
    EncodeError, JpegEncoder, STREAM_CONTENT_TYPE, encode_png, stream_part, stream_preamble,
};
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use penumbra_picture::Picture;
use serde_json::json;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Mutex, Semaphore, watch};
use tokio::time::{Instant, sleep_until, timeout};
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt, once};

/// Maximum number of viewers.
pub const MAX_STREAMS: usize = 16;
/// JPEG quality of the stream.
const STREAM_QUALITY: u8 = 85;
/// Minimum interval between encoded pictures (30 Hz); more would take processor time from the rig.
const STREAM_INTERVAL: Duration = Duration::from_millis(33);
/// Time that `/snapshot.png` waits for a new picture before it returns the last one.
const SNAPSHOT_WAIT: Duration = Duration::from_millis(700);
/// Maximum length of a body, bytes; settings are a few dozen.
const MAX_BODY: usize = 16 * 1024;

/// State shared by the routes.
#[derive(Clone)]
pub struct App {
    pub(super) shared: Arc<SharedStatus>,
    parts: watch::Sender<Option<Bytes>>,
    encoder: Arc<std::sync::Mutex<JpegEncoder>>,
    streams: Arc<Semaphore>,
    snapshot_png: Arc<PngCache>,
    environment_png: Arc<PngCache>,
}

impl App {
    /// Creates the state.
    ///
    /// # Errors
    /// The JPEG encoder cannot allocate.
    pub fn new(shared: Arc<SharedStatus>) -> Result<Self, EncodeError> {
        let encoder = JpegEncoder::new(STREAM_QUALITY)?;
        Ok(Self {
            shared,
            parts: watch::Sender::new(None),
            encoder: Arc::new(std::sync::Mutex::new(encoder)),
            streams: Arc::new(Semaphore::new(MAX_STREAMS)),
            snapshot_png: Arc::default(),
            environment_png: Arc::default(),
        })
    }

    /// Encodes each new picture once for all viewers, and nothing without viewers.
    pub async fn stream_pictures(&self) {
        let mut watchers = self.shared.viewers();
        let mut pictures = self.shared.pictures();
        loop {
            if *watchers.borrow_and_update() == 0 {
                self.parts.send_replace(None);
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
            let next = Instant::now() + STREAM_INTERVAL;
            let picture = pictures.borrow_and_update().clone();
            if let Some(picture) = picture {
                self.encode(picture).await;
            }
            sleep_until(next).await;
        }
    }

    async fn encode(&self, picture: Arc<Picture>) {
        let encoder = Arc::clone(&self.encoder);
        let began = Instant::now();
        let encoded = tokio::task::spawn_blocking(move || {
            let mut encoder = encoder
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            encoder.encode(&picture).map(|jpeg| stream_part(&jpeg))
        });
        let error = match encoded.await {
            Ok(Ok(part)) => {
                self.parts.send_replace(Some(part));
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

/// All routes behind the guard.
pub fn router(app: App, token: Option<Arc<Token>>) -> Router {
    Router::new()
        .route(
            "/",
            get(|| asset(HTML, include_str!("dashboard/dashboard.html"))),
        )
        .route("/dashboard/{file}", get(dashboard_file))
        // Browsers ask for it on pages that name no icon, such as /status.
        .route("/favicon.ico", get(|| async { StatusCode::NO_CONTENT }))
        .route("/status", get(status))
        .route("/whitebalance.json", get(white_balance))
        .route("/metrics", get(metrics_page))
        .route("/healthz", get(healthz))
        .route("/settings", post(settings))
        .route("/recording", post(recording))
        .merge(calibration_routes::routes())
        .route("/stream.mjpeg", get(stream))
        .route("/snapshot.png", get(snapshot_png))
        .route("/environment.png", get(environment_png))
        .fallback(not_found)
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(from_fn_with_state(token, guard::guard))
        .with_state(app)
}

const NOT_FOUND: &str = "not here; there are / /status /metrics /healthz /settings \
    /recording /calibration /stream.mjpeg /snapshot.png /environment.png /whitebalance.json\n";

async fn not_found() -> Response {
    (StatusCode::NOT_FOUND, NOT_FOUND).into_response()
}

pub(super) const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

async fn asset(content_type: &'static str, text: &'static str) -> Response {
    ([(header::CONTENT_TYPE, content_type)], text).into_response()
}

/// Files of the dashboard, which are part of the program.
async fn dashboard_file(Path(file): Path<String>) -> Response {
    match file.as_str() {
        "dashboard.css" => asset(CSS, include_str!("dashboard/dashboard.css")).await,
        "dashboard.js" => asset(SCRIPT, include_str!("dashboard/dashboard.js")).await,
        "calibrate.js" => asset(SCRIPT, include_str!("dashboard/calibrate.js")).await,
        "calibrate.css" => asset(CSS, include_str!("dashboard/calibrate.css")).await,
        "charts.js" => asset(SCRIPT, include_str!("dashboard/charts.js")).await,
        "exposure.js" => asset(SCRIPT, include_str!("dashboard/exposure.js")).await,
        "planes.js" => asset(SCRIPT, include_str!("dashboard/planes.js")).await,
        "recording.js" => asset(SCRIPT, include_str!("dashboard/recording.js")).await,
        "settings.js" => asset(SCRIPT, include_str!("dashboard/settings.js")).await,
        "text.js" => asset(SCRIPT, include_str!("dashboard/text.js")).await,
        "favicon.svg" => asset("image/svg+xml", include_str!("dashboard/favicon.svg")).await,
        _ => not_found().await,
    }
}

async fn status(State(app): State<App>) -> Json<Snapshot> {
    Json(app.shared.snapshot())
}

async fn white_balance(State(app): State<App>) -> Json<WhiteBalance> {
    Json(app.shared.snapshot().white_balance)
}

async fn metrics_page(State(app): State<App>) -> impl IntoResponse {
    let page = metrics(&app.shared.snapshot());
    ([(header::CONTENT_TYPE, METRICS_CONTENT_TYPE)], page)
}

async fn healthz(State(app): State<App>) -> (StatusCode, String) {
    match health(&app.shared.snapshot()) {
        Ok(description) => (StatusCode::OK, description + "\n"),
        Err(reason) => (StatusCode::SERVICE_UNAVAILABLE, reason + "\n"),
    }
}

/// Requests settings; `/status` shows when they are active. The content type must be JSON, because a
/// form of another page cannot send it.
async fn settings(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        let text = "settings: send them as Content-Type: application/json";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    let accepted: Result<Settings, SettingsError> =
        SettingsChange::from_json(&body).and_then(|change| app.shared.request_settings(&change));
    match accepted {
        Ok(settings) => (StatusCode::ACCEPTED, Json(settings)).into_response(),
        Err(error) => problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string()),
    }
}

/// Starts or stops a recording; `/status` shows its state.
async fn recording(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        let text = "recording: send the request as Content-Type: application/json";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    let request = match RecordingRequest::from_json(&body) {
        Ok(request) => request,
        Err(error) => return problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string()),
    };
    // Finishing a file may take a moment and would block other requests.
    let shared = Arc::clone(&app.shared);
    match tokio::task::spawn_blocking(move || shared.record(&request)).await {
        Ok(Ok(recording)) => (StatusCode::ACCEPTED, Json(recording)).into_response(),
        Ok(Err(error)) => problem(StatusCode::CONFLICT, &error.to_string()),
        Err(error) => problem(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

pub(super) fn is_json(headers: &HeaderMap) -> bool {
    let content_type = headers
        .get(header::CONTENT_TYPE)
        .and_then(|v| v.to_str().ok());
    content_type.is_some_and(|t| t.starts_with("application/json"))
}

pub(super) fn problem(status: StatusCode, text: &str) -> Response {
    (status, Json(json!({ "error": text }))).into_response()
}

/// Streams the newest pictures. A slow client skips pictures and delays no other.
async fn stream(State(app): State<App>) -> Response {
    let Ok(seat) = Arc::clone(&app.streams).try_acquire_owned() else {
        let text = format!("{MAX_STREAMS} viewers are connected already; close one of them\n");
        return (StatusCode::SERVICE_UNAVAILABLE, text).into_response();
    };
    let body = Body::from_stream(parts(&app, (seat, app.shared.count_viewer())));
    ([(header::CONTENT_TYPE, STREAM_CONTENT_TYPE)], body).into_response()
}

fn parts<G: Send + 'static>(
    app: &App,
    guards: G,
) -> impl Stream<Item = Result<Bytes, Infallible>> + use<G> {
    let pictures = WatchStream::new(app.parts.subscribe()).filter_map(move |part| {
        // The seat is released when the browser disconnects and this closure is dropped.
        let _ = &guards;
        part
    });
    once(stream_preamble()).chain(pictures).map(Ok)
}

/// The newest composited picture, lossless.
async fn snapshot_png(State(app): State<App>) -> Response {
    let _asking = app.shared.ask();
    let mut pictures = app.shared.pictures();
    let _ = timeout(SNAPSHOT_WAIT, pictures.changed()).await;
    let picture = pictures.borrow().clone();
    png_response(
        &app.snapshot_png,
        picture,
        "no picture has been composited yet\n",
    )
    .await
}

/// The environment map with the dome lights marked.
async fn environment_png(State(app): State<App>) -> Response {
    let preview = app.shared.environment_preview();
    png_response(
        &app.environment_png,
        preview,
        "the environment has not been measured yet\n",
    )
    .await
}

async fn png_response(
    cache: &PngCache,
    picture: Option<Arc<Picture>>,
    none: &'static str,
) -> Response {
    let Some(picture) = picture else {
        return (StatusCode::NOT_FOUND, none).into_response();
    };
    match cache.encoded(picture).await {
        Ok(png) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error + "\n").into_response(),
    }
}

/// The last PNG. The lock is held during encoding, so that several requests for the same picture cause
/// one encoding.
#[derive(Default)]
struct PngCache {
    newest: Mutex<Option<(Arc<Picture>, Bytes)>>,
}

impl PngCache {
    async fn encoded(&self, picture: Arc<Picture>) -> Result<Bytes, String> {
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
