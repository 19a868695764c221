//! The addresses of the page.

use crate::{Adjustment, PhotoPage, Request};
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use penumbra_status::{CSS, HTML, SCRIPT, asset, is_json, problem};
use std::sync::Arc;

/// A page, and what limits the work for it.
#[derive(Clone)]
struct Shared {
    page: Arc<PhotoPage>,
    /// One view at a time: the newest is all that counts.
    turn: Arc<tokio::sync::Mutex<()>>,
}

impl PhotoPage {
    /// Returns the routes, to be served behind a guard.
    pub fn routes(self: &Arc<Self>) -> Router {
        let shared = Shared {
            page: Arc::clone(self),
            turn: Arc::default(),
        };
        Router::new()
            .route("/", get(|| asset(HTML, include_str!("page/photo.html"))))
            .route("/photo/{file}", get(file))
            .route("/photo.jpg", get(photo))
            .route("/composite.png", get(composite))
            .route("/start", get(start))
            .route("/state", get(state))
            .route("/view", post(view))
            .route("/compose", post(compose))
            .route("/finish", post(finish))
            .fallback(not_found)
            .with_state(shared)
    }
}

const NOT_FOUND: &str = "not here; the page is at /\n";
const NO_JSON: &str = "adjustment: send it as Content-Type: application/json";

async fn not_found() -> Response {
    (StatusCode::NOT_FOUND, NOT_FOUND).into_response()
}

async fn file(Path(name): Path<String>) -> Response {
    match name.as_str() {
        "photo.css" => asset(CSS, include_str!("page/photo.css")).await,
        "photo.js" => asset(SCRIPT, include_str!("page/photo.js")).await,
        "handles.js" => asset(SCRIPT, include_str!("page/handles.js")).await,
        _ => not_found().await,
    }
}

async fn photo(State(shared): State<Shared>) -> Response {
    let jpeg = shared.page.jpeg.clone();
    ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response()
}

/// The picture that was composed last.
async fn composite(State(shared): State<Shared>) -> Response {
    match shared.page.work.png() {
        Some(png) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        None => (StatusCode::NOT_FOUND, "nothing has been composed yet\n").into_response(),
    }
}

async fn start(State(shared): State<Shared>) -> Response {
    Json(&shared.page.start).into_response()
}

async fn state(State(shared): State<Shared>) -> Response {
    Json(shared.page.work.report()).into_response()
}

/// Reads an adjustment; answers why it is refused.
fn adjustment(headers: &HeaderMap, body: &[u8]) -> Result<Adjustment, Box<Response>> {
    if !is_json(headers) {
        return Err(Box::new(problem(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            NO_JSON,
        )));
    }
    Adjustment::from_json(body)
        .map_err(|error| Box::new(problem(StatusCode::BAD_REQUEST, &error.to_string())))
}

/// Runs work that takes a while for a page.
async fn beside<T: Send + 'static>(
    shared: Shared,
    work: impl FnOnce(&PhotoPage) -> T + Send + 'static,
) -> Result<T, Box<Response>> {
    let _turn = shared.turn.lock_owned().await;
    let page = shared.page;
    let done = tokio::task::spawn_blocking(move || work(&page)).await;
    done.map_err(|e| Box::new(problem(StatusCode::INTERNAL_SERVER_ERROR, &e.to_string())))
}

/// Answers what an adjustment gives.
async fn view(State(shared): State<Shared>, headers: HeaderMap, body: Bytes) -> Response {
    let viewed = async {
        let adjustment = adjustment(&headers, &body)?;
        let view = beside(shared, move |page| page.view(&adjustment)).await?;
        view.map_err(|error| Box::new(problem(StatusCode::BAD_REQUEST, &error.to_string())))
    };
    match viewed.await {
        Ok(view) => Json(view).into_response(),
        Err(answer) => *answer,
    }
}

/// Has the picture composed; `/state` shows when it is.
async fn compose(State(shared): State<Shared>, headers: HeaderMap, body: Bytes) -> Response {
    let asked = async {
        let adjustment = adjustment(&headers, &body)?;
        let page = Arc::clone(&shared.page);
        if let Some(trouble) = beside(shared, move |page| page.trouble(&adjustment)).await? {
            return Err(Box::new(problem(StatusCode::BAD_REQUEST, &trouble)));
        }
        let asked = page.work.ask(Request::Compose(adjustment));
        asked.map_err(|reason| Box::new(problem(StatusCode::CONFLICT, reason)))
    };
    match asked.await {
        Ok(()) => accepted(),
        Err(answer) => *answer,
    }
}

/// Has the picture written, and the program end.
async fn finish(State(shared): State<Shared>, headers: HeaderMap) -> Response {
    if !is_json(&headers) {
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, NO_JSON);
    }
    match shared.page.work.ask(Request::Finish) {
        Ok(()) => accepted(),
        Err(reason) => problem(StatusCode::CONFLICT, reason),
    }
}

fn accepted() -> Response {
    (StatusCode::ACCEPTED, Json(serde_json::json!({}))).into_response()
}
