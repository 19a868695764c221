//! HTTP routes of scene files and models.

use super::app::{App, is_json, problem};
use super::scene_files::{
    SaveRequest, SceneControl, SceneFolder, SceneRefusal, SceneRequest, sanitised_name,
};
use axum::body::{Body, Bytes};
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use std::sync::Arc;

/// Path of uploads, which may take longer than other requests.
pub const UPLOAD_PATH: &str = "/scenes/upload";
/// Content type of an uploaded file. Forms and pages of other origins cannot send it without asking.
const FILE_TYPE: &str = "application/octet-stream";

/// The routes below `/scenes`.
pub fn routes() -> Router<App> {
    Router::new()
        .route("/scenes", get(list).post(show))
        // Its limit is configured, and applied as the body is read.
        .route(UPLOAD_PATH, post(upload))
        .route("/scenes/save", post(save))
}

async fn list(State(app): State<App>) -> Response {
    let Some(scenes) = app.shared.scenes() else {
        let closed = Some(NOT_YET.to_owned());
        return Json(SceneFolder {
            closed,
            ..SceneFolder::default()
        })
        .into_response();
    };
    match tokio::task::spawn_blocking(move || scenes.list()).await {
        Ok(folder) => Json(folder).into_response(),
        Err(error) => problem(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

const NO_JSON: &str = "scenes: send the request as Content-Type: application/json";
const NOT_YET: &str = "no scene is shown yet";

/// Shows a scene; answers when it is loaded or refused, at most after some seconds.
async fn show(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, NO_JSON);
    }
    let request = match SceneRequest::from_json(&body) {
        Ok(request) => request,
        Err(refusal) => return refused(&refusal),
    };
    carried_out(&app, move |scenes| scenes.show(&request)).await
}

/// Writes the shown scene to a new scene file.
async fn save(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    if !is_json(&headers) {
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, NO_JSON);
    }
    match SaveRequest::from_json(&body) {
        Ok(request) => carried_out(&app, move |scenes| scenes.save(&request)).await,
        Err(refusal) => refused(&refusal),
    }
}

/// Takes a file: its name is `?name=…`, percent-encoded, its content the body.
async fn upload(
    State(app): State<App>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    body: Body,
) -> Response {
    let content_type = headers.get(header::CONTENT_TYPE);
    if content_type.is_none_or(|t| t.as_bytes() != FILE_TYPE.as_bytes()) {
        let text = "scenes: send the file as Content-Type: application/octet-stream";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    let name = query.as_deref().and_then(|q| q.strip_prefix("name="));
    let name = match sanitised_name(&percent_decoded(name.unwrap_or_default())) {
        Ok(name) => name,
        Err(refusal) => return refused(&refusal),
    };
    // One at a time, because each is held in memory.
    let Ok(_turn) = Arc::clone(&app.uploads).try_acquire_owned() else {
        let reason = "another file is being uploaded; try again".to_owned();
        return refused(&SceneRefusal::Unavailable { reason });
    };
    let scenes = app.shared.scenes();
    let limit = scenes.map_or(0, |scenes| scenes.max_upload_bytes());
    let too_large = SceneRefusal::TooLarge {
        megabytes: limit / 1_000_000,
    };
    let length = headers.get(header::CONTENT_LENGTH);
    let length = length.and_then(|l| l.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|length| length > limit) {
        return refused(&too_large);
    }
    let Ok(content) = axum::body::to_bytes(body, limit as usize).await else {
        return refused(&too_large);
    };
    carried_out(&app, move |scenes| scenes.keep(&name, &content)).await
}

/// Carries out a request on a thread that may wait.
async fn carried_out<T: serde::Serialize + Send + 'static>(
    app: &App,
    request: impl FnOnce(&dyn SceneControl) -> Result<T, SceneRefusal> + Send + 'static,
) -> Response {
    let Some(scenes) = app.shared.scenes() else {
        let reason = NOT_YET.to_owned();
        return refused(&SceneRefusal::Unavailable { reason });
    };
    match tokio::task::spawn_blocking(move || request(&*scenes)).await {
        Ok(Ok(answer)) => (StatusCode::ACCEPTED, Json(answer)).into_response(),
        Ok(Err(refusal)) => refused(&refusal),
        Err(error) => problem(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

fn refused(refusal: &SceneRefusal) -> Response {
    let status = match refusal {
        SceneRefusal::Missing { .. } => StatusCode::NOT_FOUND,
        SceneRefusal::Exists { .. } | SceneRefusal::Unavailable { .. } => StatusCode::CONFLICT,
        SceneRefusal::TooLarge { .. } => StatusCode::PAYLOAD_TOO_LARGE,
        SceneRefusal::Malformed { .. }
        | SceneRefusal::FileName { .. }
        | SceneRefusal::Content { .. } => StatusCode::UNPROCESSABLE_ENTITY,
    };
    problem(status, &refusal.to_string())
}

/// Decodes `%XX` of a query; malformed sequences stay as they are.
fn percent_decoded(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let code = (byte == b'%').then(|| text.get(at + 1..at + 3)).flatten();
        match code.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(code) => {
                decoded.push(code);
                at += 3;
            }
            None => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decodes_names() {
        assert_eq!(percent_decoded("tea%20pot%2eglb"), "tea pot.glb");
        assert_eq!(percent_decoded("B%C3%A4r.ply"), "Bär.ply");
        assert_eq!(percent_decoded("100%.png%4"), "100%.png%4");
        assert_eq!(percent_decoded("%zz%é"), "%zz%é");
    }
}
