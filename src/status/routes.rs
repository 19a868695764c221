//! The HTTP routes.

use super::app::{App, HTML, PngCache, is_json, problem};
use super::calibration_routes;
use super::files::{asset, files};
use super::guard::{Gate, Token, guarded};
use super::health::health;
use super::metrics::{METRICS_CONTENT_TYPE, metrics};
use super::objects::{ObjectRefusal, ObjectRequest};
use super::playback::{PlaybackChange, PlaybackRefusal};
use super::recording::RecordingRequest;
use super::scene_routes;
use super::settings::{Settings, SettingsChange, SettingsError};
use super::shared::View;
use super::snapshot::{Snapshot, WhiteBalance};
use crate::stream::{STREAM_CONTENT_TYPE, stream_preamble};
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use penumbra_picture::Picture;
use serde_json::json;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt, once};

/// Time that `/snapshot.png` waits for a new picture before it returns the last one.
const SNAPSHOT_WAIT: Duration = Duration::from_millis(700);

/// All routes behind the guard.
pub fn router(app: App, token: Option<Arc<Token>>) -> Router {
    let gate = Gate::new(token, app.limits.viewers);
    let routes = files(NOT_FOUND)
        .route(
            "/",
            get(|| asset(HTML, include_str!("dashboard/dashboard.html"))),
        )
        .route("/status", get(status))
        .route("/whitebalance.json", get(white_balance))
        .route("/metrics", get(metrics_page))
        .route("/healthz", get(healthz))
        .route("/log", get(log))
        .route("/settings", post(settings))
        .route("/recording", post(recording))
        .route("/playback", post(playback))
        .route("/objects", post(objects))
        .merge(calibration_routes::routes())
        .merge(scene_routes::routes())
        .route("/stream.mjpeg", get(|app| stream(app, View::Composite)))
        .route("/compare.mjpeg", get(|app| stream(app, View::Pair)))
        .route("/snapshot.png", get(snapshot_png))
        .route("/environment.png", get(environment_png))
        .route("/sheet.pdf", get(sheet_pdf))
        .fallback(not_found);
    guarded(routes, gate).with_state(app)
}

const NOT_FOUND: &str = "not here; there are / /status /metrics /healthz /log /settings \
    /playback /objects /scenes /recording /calibration /stream.mjpeg /compare.mjpeg /snapshot.png /environment.png /sheet.pdf /whitebalance.json\n";

async fn not_found() -> Response {
    (StatusCode::NOT_FOUND, NOT_FOUND).into_response()
}

async fn status(State(app): State<App>) -> Json<Snapshot> {
    Json(app.shared.snapshot())
}

/// The printed sheet of a webcam's rig.
async fn sheet_pdf(State(app): State<App>) -> Response {
    match app.shared.sheet() {
        Some(pdf) => (
            [(header::CONTENT_TYPE, "application/pdf")],
            Bytes::from_owner(pdf),
        )
            .into_response(),
        None => not_found().await,
    }
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

/// The entries of the log, oldest first; `?after=N` leaves out those up to number N.
async fn log(State(app): State<App>, uri: Uri) -> Response {
    let query = uri.query().unwrap_or_default();
    let after = match query.strip_prefix("after=").map(str::parse) {
        Some(Ok(after)) => after,
        None if query.is_empty() => 0,
        _ => {
            let text = "log: ask for /log, or for /log?after=N with the number of an entry";
            return problem(StatusCode::BAD_REQUEST, text);
        }
    };
    Json(json!({ "entries": app.shared.log_since(after) })).into_response()
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

/// Pauses, repeats or jumps; `/status` shows when it has been done.
async fn playback(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        let text = "playback: send the request as Content-Type: application/json";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    match PlaybackChange::from_json(&body).and_then(|change| app.shared.play(&change)) {
        Ok(playback) => (StatusCode::ACCEPTED, Json(playback)).into_response(),
        Err(error @ PlaybackRefusal::Closed { .. }) => {
            problem(StatusCode::CONFLICT, &error.to_string())
        }
        Err(error) => problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string()),
    }
}

/// Answers what is at a place in the picture, or moves, turns or scales an object.
async fn objects(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        let text = "objects: send the request as Content-Type: application/json";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    let request = match ObjectRequest::from_json(&body) {
        Ok(request) => request,
        Err(error) => return problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string()),
    };
    // Casting rays at large models may take a moment.
    let shared = Arc::clone(&app.shared);
    match tokio::task::spawn_blocking(move || shared.change_object(&request)).await {
        Ok(Ok(answer)) => (StatusCode::ACCEPTED, Json(answer)).into_response(),
        Ok(Err(error @ ObjectRefusal::Unavailable { .. })) => {
            problem(StatusCode::CONFLICT, &error.to_string())
        }
        Ok(Err(error)) => problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string()),
        Err(error) => problem(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// Streams the newest pictures. A slow client skips pictures and delays no other.
async fn stream(State(app): State<App>, view: View) -> Response {
    let Ok(seat) = Arc::clone(&app.streams).try_acquire_owned() else {
        let text = format!(
            "{} viewers are connected already; close one of them, or raise `viewers` in [status]\n",
            app.limits.viewers
        );
        return (StatusCode::SERVICE_UNAVAILABLE, text).into_response();
    };
    let body = Body::from_stream(parts(&app, view, (seat, app.shared.count_viewer(view))));
    ([(header::CONTENT_TYPE, STREAM_CONTENT_TYPE)], body).into_response()
}

fn parts<G: Send + 'static>(
    app: &App,
    view: View,
    guards: G,
) -> impl Stream<Item = Result<Bytes, Infallible>> + use<G> {
    let pictures = WatchStream::new(app.parts(view)).filter_map(move |part| {
        // The seat is released when the browser disconnects and this closure is dropped.
        let _ = &guards;
        part
    });
    once(stream_preamble()).chain(pictures).map(Ok)
}

/// The newest composited picture, lossless.
async fn snapshot_png(State(app): State<App>) -> Response {
    let _asking = app.shared.ask();
    let mut pictures = app.shared.pictures(View::Composite);
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
