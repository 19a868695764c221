//! The files of the dashboard, which are part of the program.

use axum::Router;
use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

/// Content type of a style sheet.
pub const CSS: &str = "text/css; charset=utf-8";
/// Content type of a script.
pub const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Answers with a file that is part of the program.
pub async fn asset(content_type: &'static str, text: &'static str) -> Response {
    ([(header::CONTENT_TYPE, content_type)], text).into_response()
}

/// A file of the dashboard: name, content.
macro_rules! file {
    ($name:literal) => {
        ($name, include_str!(concat!("dashboard/", $name)))
    };
}

/// Files of the dashboard, which are part of the program.
const FILES: [(&str, &str); 27] = [
    file!("calibrate.css"),
    file!("calibrate.js"),
    file!("charts.js"),
    file!("columns.js"),
    file!("controls.css"),
    file!("controls.js"),
    file!("dashboard.css"),
    file!("dashboard.js"),
    file!("exposure.js"),
    file!("favicon.svg"),
    file!("guide.css"),
    file!("guide.js"),
    file!("health.js"),
    file!("lamps.js"),
    file!("log.js"),
    file!("objects.js"),
    file!("picture.js"),
    file!("planes.js"),
    file!("playback.js"),
    file!("presets.js"),
    file!("recording.js"),
    file!("requests.js"),
    file!("rows.js"),
    file!("scenes.js"),
    file!("settings.js"),
    file!("text.js"),
    file!("theme.js"),
];

/// The routes of the dashboard's files, which other pages use, too. `missing` is the answer to other names.
pub fn files<S: Clone + Send + Sync + 'static>(missing: &'static str) -> Router<S> {
    let file = move |name| dashboard_file(name, missing);
    Router::new()
        .route("/dashboard/{file}", get(file))
        // Browsers ask for it on pages that name no icon, such as /status.
        .route("/favicon.ico", get(|| async { StatusCode::NO_CONTENT }))
}

async fn dashboard_file(Path(file): Path<String>, missing: &'static str) -> Response {
    let Some((name, text)) = FILES.iter().find(|(name, _)| *name == file) else {
        return (StatusCode::NOT_FOUND, missing).into_response();
    };
    let content_type = match name.rsplit_once('.') {
        Some((_, "css")) => CSS,
        Some((_, "svg")) => "image/svg+xml",
        _ => SCRIPT,
    };
    asset(content_type, text).await
}
