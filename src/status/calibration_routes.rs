//! HTTP routes of calibration.

use super::app::{App, HTML, is_json, problem};
use super::calibration::{Calibration, CalibrationControl, CalibrationRefusal, CalibrationRequest};
use axum::body::Bytes;
use axum::extract::{RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};

/// Content-Security-Policy of a report: inline style and pictures only, because texts in it come from
/// devices and files.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox";

/// The routes below `/calibration`.
pub fn routes() -> Router<App> {
    Router::new()
        .route("/calibration", get(view))
        .route("/calibration/picture.jpg", get(picture))
        .route("/calibration/report", get(report))
        .route("/calibration/start", post(start))
        .route("/calibration/finish", post(finish))
        .route("/calibration/abort", post(abort))
}

async fn view(State(app): State<App>) -> Json<Calibration> {
    let calibrator = app.shared.calibrator();
    Json(calibrator.map_or_else(unavailable, |calibrator| calibrator.view()))
}

fn unavailable() -> Calibration {
    Calibration {
        description:
            "A recording plays. Calibrate a live rig here (`penumbra run`), or the recording \
                   with `penumbra calibrate STEP --session FILE`."
                .to_owned(),
        ..Calibration::default()
    }
}

/// A picture given to the step, without overlay points.
async fn picture(State(app): State<App>, RawQuery(query): RawQuery) -> Response {
    let Some(calibrator) = app.shared.calibrator() else {
        return (StatusCode::NOT_FOUND, NO_PICTURE).into_response();
    };
    let revision = query.as_deref().and_then(|q| q.strip_prefix("revision="));
    let revision = revision.and_then(|r| r.parse().ok());
    let encoding = tokio::task::spawn_blocking(move || calibrator.picture(revision));
    match encoding.await {
        Ok(Some(jpeg)) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response(),
        _ => (StatusCode::NOT_FOUND, NO_PICTURE).into_response(),
    }
}

const NO_PICTURE: &str =
    "no calibration step has received a picture while a viewer was connected\n";

/// The report of the newest calibration.
async fn report(State(app): State<App>) -> Response {
    let report = app.shared.calibrator().and_then(|c| c.report());
    match report {
        Some(page) => {
            let headers = [
                (header::CONTENT_TYPE, HTML),
                (header::CONTENT_SECURITY_POLICY, REPORT_POLICY),
            ];
            (headers, page).into_response()
        }
        None => (StatusCode::NOT_FOUND, "nothing has been calibrated yet\n").into_response(),
    }
}

async fn start(State(app): State<App>, headers: HeaderMap, body: Bytes) -> Response {
    let request = CalibrationRequest::from_json(&body);
    carry_out(app, &headers, move |calibrator| calibrator.start(&request?)).await
}

async fn finish(State(app): State<App>, headers: HeaderMap) -> Response {
    carry_out(app, &headers, |calibrator| calibrator.finish()).await
}

async fn abort(State(app): State<App>, headers: HeaderMap) -> Response {
    carry_out(app, &headers, |calibrator| calibrator.abort()).await
}

/// Answers with the state afterwards, or the reason of a refusal. The content type must be JSON,
/// because a form of another page cannot send it.
async fn carry_out(
    app: App,
    headers: &HeaderMap,
    job: impl FnOnce(&dyn CalibrationControl) -> Result<(), CalibrationRefusal> + Send + 'static,
) -> Response {
    if !is_json(headers) {
        let text = "calibration: send the request as Content-Type: application/json";
        return problem(StatusCode::UNSUPPORTED_MEDIA_TYPE, text);
    }
    let Some(calibrator) = app.shared.calibrator() else {
        let text = CalibrationRefusal::Unavailable.to_string();
        return problem(StatusCode::CONFLICT, &text);
    };
    // Reading the files of the rig would block other requests.
    let answer = tokio::task::spawn_blocking(move || -> Result<Calibration, CalibrationRefusal> {
        job(&*calibrator)?;
        Ok(calibrator.view())
    });
    match answer.await {
        Ok(Ok(view)) => (StatusCode::ACCEPTED, Json(view)).into_response(),
        Ok(Err(refusal)) => problem(status_of(&refusal), &refusal.to_string()),
        Err(error) => problem(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

const fn status_of(refusal: &CalibrationRefusal) -> StatusCode {
    match refusal {
        CalibrationRefusal::Malformed { .. } | CalibrationRefusal::Parameter { .. } => {
            StatusCode::UNPROCESSABLE_ENTITY
        }
        _ => StatusCode::CONFLICT,
    }
}
