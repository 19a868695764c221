//! Tests of the status server over sockets.
#![expect(clippy::unwrap_used, clippy::expect_used)]

use penumbra_picture::Picture;
use penumbra_status::calibration::{
    Calibration, CalibrationControl, CalibrationRefusal, CalibrationRequest,
};
use penumbra_status::recording::{Recording, RecordingControl, RecordingRefusal, RecordingRequest};
use penumbra_status::scene_files::{
    SaveRequest, SceneAnswer, SceneControl, SceneFileEntry, SceneFileKind, SceneFolder,
    SceneRefusal, SceneRequest,
};
use penumbra_status::snapshot::SessionState;
use penumbra_status::{Settings, SharedStatus, StatusError, StatusServer};
use proptest::prelude::*;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

const TOKEN: &str = "a-token-for-tests";
const TIMEOUT: Duration = Duration::from_secs(30);

struct Server {
    address: SocketAddr,
    shared: Arc<SharedStatus>,
    _runtime: tokio::runtime::Runtime,
}

impl Server {
    fn start(token: Option<&str>) -> Self {
        let shared = SharedStatus::new(Settings::default());
        let token = token.map(str::to_owned);
        let server = StatusServer::bind(any_port(), token, Arc::clone(&shared)).unwrap();
        let address = server.local_addr();
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build()
            .unwrap();
        runtime.spawn(server.serve(std::future::pending()));
        Self {
            address,
            shared,
            _runtime: runtime,
        }
    }

    /// Counts a composed picture.
    fn compose(&self) {
        self.shared.update(|s| s.frames.composed += 1);
    }

    fn connect(&self) -> TcpStream {
        let socket = TcpStream::connect(self.address).unwrap();
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
        socket
    }

    /// Sends a request with these header lines and reads the complete response.
    fn request(&self, line: &str, headers: &[&str], body: &str) -> Answer {
        let mut socket = self.connect();
        let host = format!("Host: {}", self.address);
        let mut head = vec![
            line.to_owned() + " HTTP/1.1",
            "Connection: close".to_owned(),
        ];
        if !headers.iter().any(|h| h.starts_with("Host:")) {
            head.push(host);
        }
        head.extend(headers.iter().map(|h| (*h).to_owned()));
        head.push(format!("Content-Length: {}", body.len()));
        let request = head.join("\r\n") + "\r\n\r\n" + body;
        // A refusal may arrive before the body has been sent.
        let _ = socket.write_all(request.as_bytes());
        Answer::read(socket)
    }

    fn get(&self, path: &str) -> Answer {
        self.request(&format!("GET {path}"), &[], "")
    }

    fn post_settings(&self, body: &str) -> Answer {
        self.request("POST /settings", &["Content-Type: application/json"], body)
    }

    fn picture(&self, shade: u8) {
        self.shared.publish_picture(Arc::new(grey(shade)));
    }

    fn until(&self, what: &str, holds: impl Fn() -> bool) {
        let deadline = Instant::now() + TIMEOUT;
        while !holds() {
            assert!(Instant::now() < deadline, "timeout: {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Answer {
    fn read(mut socket: TcpStream) -> Self {
        let mut bytes = Vec::new();
        let _ = socket.read_to_end(&mut bytes);
        let end = bytes
            .windows(4)
            .position(|w| w == b"\r\n\r\n")
            .expect("a head");
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Self {
            status,
            head: head.to_lowercase(),
            body: bytes[end + 4..].to_vec(),
        }
    }

    fn header(&self, name: &str) -> &str {
        let prefix = format!("{name}: ");
        self.head
            .lines()
            .find_map(|l| l.strip_prefix(&prefix))
            .unwrap_or_default()
    }

    fn text(&self) -> String {
        String::from_utf8(self.body.clone()).unwrap()
    }

    fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

fn any_port() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 0))
}

fn grey(shade: u8) -> Picture {
    let rgba = [shade, shade / 2, 255 - shade, 255].repeat(48 * 32);
    Picture {
        width: 48,
        height: 32,
        rgba,
    }
}

// ── pages ───────────────────────────────────────────────────────────────────────

#[test]
fn page_needs_no_other_server_and_all_its_files_exist() {
    let server = Server::start(None);
    let page = server.get("/");
    assert_eq!(
        (page.status, page.header("content-type")),
        (200, "text/html; charset=utf-8")
    );
    assert!(
        page.header("content-security-policy")
            .starts_with("default-src 'none'; script-src 'self'")
    );
    assert_eq!(page.header("x-content-type-options"), "nosniff");
    let html = page.text();
    assert!(!html.contains("://"), "a file of another server");
    let scripts = [
        "dashboard.js",
        "calibrate.js",
        "charts.js",
        "settings.js",
        "text.js",
    ]
    .map(|f| format!("/dashboard/{f}"));
    let named = html
        .split('"')
        .filter(|s| s.starts_with("/dashboard/"))
        .map(str::to_owned);
    for path in named.chain(scripts) {
        let asset = server.get(&path);
        assert_eq!(asset.status, 200, "{path}");
        let kind = if path.ends_with("js") {
            "javascript"
        } else if path.ends_with("css") {
            "css"
        } else {
            "svg"
        };
        assert!(asset.header("content-type").contains(kind), "{path}");
    }
}

#[test]
fn unknown_paths_are_404_and_list_the_known_ones() {
    let server = Server::start(None);
    for path in [
        "/nothing",
        "/dashboard/../status",
        "/dashboard/x.js",
        "/stream.mjpeg/",
        "/%2e%2e/etc/passwd",
    ] {
        let answer = server.get(path);
        assert_eq!(answer.status, 404, "{path}");
        assert!(answer.text().contains("/stream.mjpeg"));
    }
    assert_eq!(server.request("POST /status", &[], "").status, 405);
}

#[test]
fn status_metrics_and_health_follow_the_rig() {
    let server = Server::start(None);
    // Both say that there is no picture yet.
    let starting = server.get("/healthz");
    assert_eq!(
        (starting.status, starting.text().as_str()),
        (503, "starting: no picture yet\n")
    );
    assert_eq!(server.get("/snapshot.png").status, 404);
    server.compose();
    assert_eq!(server.get("/healthz").status, 200);
    server.shared.update(|s| {
        s.session
            .enter_because(SessionState::Failed, "the adapter is lost");
        s.frames.composed = 12;
        s.white_balance.gains = [1.25, 1.0, 0.5];
    });
    let status = server.get("/status").json();
    assert_eq!(
        (&status["version"], &status["frames"]["composed"]),
        (&1.into(), &12.into())
    );
    assert_eq!(server.get("/whitebalance.json").json()["gains"][2], 0.5);
    let metrics = server.get("/metrics");
    assert_eq!(
        metrics.header("content-type"),
        "text/plain; version=0.0.4; charset=utf-8"
    );
    assert!(
        metrics
            .text()
            .contains("\npenumbra_frames_composed_total 12\n")
    );
    let health = server.get("/healthz");
    assert_eq!(
        (health.status, health.text().as_str()),
        (503, "failed: the adapter is lost\n")
    );
}

// ── pictures ────────────────────────────────────────────────────────────────────────────

/// A viewer of the stream that checks each part.
struct Viewer(BufReader<TcpStream>);

impl Viewer {
    fn open(server: &Server) -> Self {
        let mut socket = server.connect();
        let request = format!(
            "GET /stream.mjpeg HTTP/1.0\r\nHost: {}\r\n\r\n",
            server.address
        );
        socket.write_all(request.as_bytes()).unwrap();
        let mut viewer = Self(BufReader::new(socket));
        assert!(viewer.line().contains(" 200 "));
        let head: Vec<String> =
            std::iter::from_fn(|| Some(viewer.line()).filter(|l| !l.is_empty())).collect();
        let kind = "content-type: multipart/x-mixed-replace; boundary=penumbra-frame";
        assert!(head.iter().any(|l| l.to_lowercase() == kind), "{head:?}");
        assert_eq!(viewer.line(), "--penumbra-frame");
        viewer
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.0.read_line(&mut line).unwrap();
        line.strip_suffix("\r\n")
            .expect("a complete line")
            .to_owned()
    }

    /// Reads the next picture and the boundary after it.
    fn next(&mut self) -> image::RgbImage {
        assert_eq!(self.line(), "Content-Type: image/jpeg");
        let length = self
            .line()
            .strip_prefix("Content-Length: ")
            .unwrap()
            .parse()
            .unwrap();
        assert_eq!(self.line(), "");
        let mut jpeg = vec![0; length];
        self.0.read_exact(&mut jpeg).unwrap();
        assert_eq!(
            (self.line().as_str(), self.line().as_str()),
            ("", "--penumbra-frame")
        );
        image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg)
            .unwrap()
            .to_rgb8()
    }
}

#[test]
fn viewer_receives_the_current_picture_and_then_new_ones() {
    let server = Server::start(None);
    server.picture(200);
    let mut viewer = Viewer::open(&server);
    for shade in [200, 40, 120] {
        server.picture(shade);
        let seen = std::iter::repeat_with(|| viewer.next())
            .take(3)
            .find(|p| p.dimensions() == (48, 32) && p.get_pixel(24, 16)[0].abs_diff(shade) <= 3);
        assert!(seen.is_some(), "shade {shade} was not received");
    }
}

#[test]
fn encodes_nothing_without_viewers() {
    let server = Server::start(None);
    for shade in 0..50 {
        server.picture(shade);
    }
    let mut viewer = Viewer::open(&server);
    viewer.next();
    assert!(server.shared.wants_picture());
    drop(viewer);
    server.picture(1);
    server.until("the viewer is disconnected", || {
        server.picture(2);
        server.shared.snapshot().stream.viewers == 0
    });
    assert!(!server.shared.wants_picture());
    let encoded = server.shared.snapshot().stream.encoded;
    assert!(encoded < 10, "{encoded} of 50 unseen pictures were encoded");
}

/// A picture of noise, which JPEG compresses badly, so that a few dozen fill all buffers.
fn noise(seed: u32) -> Picture {
    let mut state = seed | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as u8
    };
    Picture {
        width: 800,
        height: 600,
        rgba: (0..800 * 600 * 4).map(next).collect(),
    }
}

#[test]
fn a_stalled_viewer_does_not_delay_others() {
    let server = Server::start(None);
    let show = |seed| server.shared.publish_picture(Arc::new(noise(seed)));
    show(1);
    let stalled = Viewer::open(&server);
    let mut active = Viewer::open(&server);
    let received: usize = (0..40)
        .map(|round| {
            show(round);
            active.next().len()
        })
        .sum();
    assert_eq!(received, 40 * 800 * 600 * 3);
    assert_eq!(server.shared.snapshot().stream.viewers, 2);
    drop(stalled);
}

#[test]
fn serves_sixteen_viewers_at_a_time() {
    let server = Server::start(None);
    server.picture(9);
    let viewers: Vec<Viewer> = (0..16).map(|_| Viewer::open(&server)).collect();
    let refused = server.get("/stream.mjpeg");
    assert_eq!(refused.status, 503);
    assert!(refused.text().contains("16 viewers are connected already"));
    server.compose();
    assert_eq!(server.get("/healthz").status, 200);
    drop(viewers);
    server.until("the viewers are disconnected", || {
        server.picture(8);
        server.shared.snapshot().stream.viewers == 0
    });
    Viewer::open(&server).next();
}

#[test]
fn snapshot_is_lossless_and_missing_pictures_are_404() {
    let server = Server::start(None);
    assert_eq!(server.get("/snapshot.png").status, 404);
    assert_eq!(server.get("/environment.png").status, 404);
    server.picture(77);
    server.shared.publish_environment_preview(Arc::new(grey(5)));
    for (path, shade) in [("/snapshot.png", 77), ("/environment.png", 5)] {
        let png = server.get(path);
        assert_eq!((png.status, png.header("content-type")), (200, "image/png"));
        let picture = image::load_from_memory(&png.body).unwrap().to_rgba8();
        assert_eq!(picture.into_raw(), grey(shade).rgba);
    }
    let again = server.get("/environment.png");
    server.shared.publish_environment_preview(Arc::new(grey(6)));
    assert_ne!(server.get("/environment.png").body, again.body);
}

// ── settings ────────────────────────────────────────────────────────────────────────────

#[test]
fn valid_settings_reach_the_rig_and_others_are_refused_with_a_reason() {
    let server = Server::start(None);
    let requested = server.shared.settings_receiver();
    let accepted = server.post_settings(r#"{"light_count": 384, "shadow_mode": "subtract"}"#);
    assert_eq!(
        (accepted.status, &accepted.json()["light_count"]),
        (202, &384.into())
    );
    assert_eq!(requested.borrow().light_count, 384);
    for (body, reason) in [
        (r#"{"light_count": 50}"#, "choose 8, 24, 48, 64, 96 or 384"),
        (r#"{"shadow_strength": -0.1}"#, "not between 0"),
        (
            r#"{"shadow_mode": "multiply"}"#,
            "expected `ratio` or `subtract`",
        ),
        (r#"{"light_count": 8"#, "line 1 column"),
        ("[]", "settings: "),
        (r#"{"nonsense": 1}"#, "unknown field `nonsense`"),
    ] {
        let refused = server.post_settings(body);
        assert_eq!(refused.status, 422, "{body}");
        let text = refused.json()["error"].as_str().unwrap().to_owned();
        assert!(text.contains(reason), "{body}: {text}");
    }
    assert_eq!(requested.borrow().light_count, 384);
}

#[test]
fn refuses_settings_that_are_not_json_or_too_large() {
    let server = Server::start(None);
    let form = ["Content-Type: text/plain"];
    assert_eq!(
        server
            .request("POST /settings", &form, r#"{"light_count": 8}"#)
            .status,
        415
    );
    assert_eq!(server.request("POST /settings", &[], "{}").status, 415);
    assert_eq!(server.post_settings(&"x".repeat(20_000)).status, 413);
    assert_eq!(server.get("/settings").status, 405);
}

/// A recorder that stores the requests.
#[derive(Default)]
struct RecordedRequests(std::sync::Mutex<Vec<RecordingRequest>>);

impl RecordingControl for RecordedRequests {
    fn carry_out(&self, request: &RecordingRequest) -> Result<Recording, RecordingRefusal> {
        self.0.lock().unwrap().push(request.clone());
        if request.record {
            return Ok(Recording::default());
        }
        Err(RecordingRefusal::Busy {
            file: "a.mcap".to_owned(),
        })
    }
}

#[test]
fn recording_requests_reach_the_recorder_only_from_the_own_page() {
    let server = Server::start(None);
    let json = "Content-Type: application/json";
    let post = |headers: &[&str], body| server.request("POST /recording", headers, body);
    let request = r#"{"record": true, "file": "a.mcap", "seconds": 5}"#;
    let refused = post(&[json], request);
    assert_eq!(refused.status, 409);
    assert!(refused.text().contains("only a live rig"));
    let requests = Arc::new(RecordedRequests::default());
    server.shared.set_recorder(requests.clone());
    assert_eq!(post(&[json], request).status, 202);
    assert_eq!(post(&[json], r#"{"record": false}"#).status, 409);
    assert_eq!(requests.0.lock().unwrap().len(), 2);
    assert_eq!(post(&[], request).status, 415);
    assert_eq!(post(&[json], "{}").status, 422);
    assert_eq!(
        post(&[json], r#"{"record": true, "file": "../a.mcap"}"#).status,
        422
    );
    assert_eq!(
        post(&[json, "Origin: http://evil.example"], request).status,
        403
    );
    assert_eq!(
        post(&[json, "Sec-Fetch-Site: cross-site"], request).status,
        403
    );
    assert_eq!(server.get("/recording").status, 405);
    assert_eq!(requests.0.lock().unwrap().len(), 2, "no other request");
    let guarded = Server::start(Some("open-sesame-now"));
    guarded.shared.set_recorder(requests.clone());
    let outside = guarded.request("POST /recording", &[json], request);
    assert_eq!(outside.status, 401);
    assert_eq!(requests.0.lock().unwrap().len(), 2);
}

/// Scenes that note what they are asked for.
#[derive(Default)]
struct FakeScenes(std::sync::Mutex<Vec<String>>);

impl SceneControl for FakeScenes {
    fn list(&self) -> SceneFolder {
        SceneFolder {
            folder: "scenes".to_owned(),
            max_upload_bytes: self.max_upload_bytes(),
            ..SceneFolder::default()
        }
    }

    fn max_upload_bytes(&self) -> u64 {
        1000
    }

    fn show(&self, request: &SceneRequest) -> Result<SceneAnswer, SceneRefusal> {
        self.0.lock().unwrap().push(request.show.clone());
        let file = request.show.clone();
        match file.as_str() {
            "broken.toml" => Err(SceneRefusal::Content {
                reason: "broken.toml:3: no".to_owned(),
            }),
            _ => Ok(SceneAnswer {
                file,
                loading: false,
            }),
        }
    }

    fn save(&self, request: &SaveRequest) -> Result<SceneAnswer, SceneRefusal> {
        let file = request.file.clone().unwrap_or_default();
        self.0.lock().unwrap().push(format!("save {file}"));
        Ok(SceneAnswer {
            file,
            loading: false,
        })
    }

    fn keep(&self, name: &str, content: &[u8]) -> Result<SceneFileEntry, SceneRefusal> {
        self.0
            .lock()
            .unwrap()
            .push(format!("{name}: {}", content.len()));
        Ok(SceneFileEntry {
            name: name.to_owned(),
            kind: SceneFileKind::Model,
            bytes: content.len() as u64,
        })
    }
}

#[test]
fn scenes_are_listed_shown_and_uploaded_only_from_the_own_page() {
    let server = Server::start(None);
    let json = "Content-Type: application/json";
    let file = "Content-Type: application/octet-stream";
    let show = |headers: &[&str], body| server.request("POST /scenes", headers, body);
    let upload = |query: &str, headers: &[&str], body: &str| {
        server.request(&format!("POST /scenes/upload{query}"), headers, body)
    };
    assert!(server.get("/scenes").json()["closed"].is_string());
    assert_eq!(show(&[json], r#"{"show": "none"}"#).status, 409);
    assert_eq!(upload("?name=a.glb", &[file], "").status, 409);
    let scenes = Arc::new(FakeScenes::default());
    server.shared.set_scene_control(scenes.clone());
    assert_eq!(server.get("/scenes").json()["folder"], "scenes");
    assert_eq!(show(&[json], r#"{"show": "a.toml"}"#).status, 202);
    let refused = show(&[json], r#"{"show": "broken.toml"}"#);
    assert_eq!(refused.status, 422);
    assert_eq!(refused.json()["error"], "broken.toml:3: no");
    let answer = upload("?name=tea%20pot.glb", &[file], &"x".repeat(1000));
    assert_eq!(
        (answer.status, &answer.json()["name"]),
        (202, &"tea-pot.glb".into())
    );
    let save = |headers: &[&str], body| server.request("POST /scenes/save", headers, body);
    assert_eq!(save(&[json], r#"{"file": "b.toml"}"#).status, 202);
    let asked = ["a.toml", "broken.toml", "tea-pot.glb: 1000", "save b.toml"];
    assert_eq!(*scenes.0.lock().unwrap(), asked);
    for (expected, answer) in [
        (415, show(&[], r#"{"show": "a.toml"}"#)),
        (422, show(&[json], r#"{"show": "../a.toml"}"#)),
        (403, show(&[json, "Origin: http://evil.example"], "{}")),
        (415, save(&[], "{}")),
        (422, save(&[json], r#"{"file": "b.glb"}"#)),
        (403, save(&[json, "Origin: http://evil.example"], "{}")),
        (415, upload("?name=a.glb", &[json], "")),
        (422, upload("", &[file], "x")),
        (422, upload("?name=a.exe", &[file], "x")),
        (413, upload("?name=a.glb", &[file], &"x".repeat(1001))),
        (
            403,
            upload("?name=a.glb", &[file, "Origin: http://evil.example"], "x"),
        ),
        (
            403,
            upload("?name=a.glb", &[file, "Sec-Fetch-Site: cross-site"], "x"),
        ),
        (
            421,
            upload("?name=a.glb", &[file, "Host: evil.example"], "x"),
        ),
    ] {
        assert_eq!(answer.status, expected, "{}", answer.text());
    }
    let guarded = Server::start(Some("open-sesame-now"));
    guarded.shared.set_scene_control(scenes.clone());
    assert_eq!(guarded.get("/scenes").status, 401);
    let outside = guarded.request("POST /scenes/upload?name=a.glb", &[file], "x");
    assert_eq!(outside.status, 401);
    assert_eq!(scenes.0.lock().unwrap().len(), 4, "no other request");
}

// ── access ─────────────────────────────────────────────────────────────────────────

/// A calibrator that accepts one step at a time and has a report.
#[derive(Default)]
struct FakeCalibrator(std::sync::Mutex<Option<String>>);

impl CalibrationControl for FakeCalibrator {
    fn view(&self) -> Calibration {
        Calibration {
            step: self.0.lock().unwrap().clone().unwrap_or_default(),
            ..Calibration::default()
        }
    }

    fn start(&self, request: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        let mut step = self.0.lock().unwrap();
        match &*step {
            Some(step) => Err(CalibrationRefusal::Busy { step: step.clone() }),
            None => {
                *step = Some(request.step.clone());
                Ok(())
            }
        }
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        let ended = self.0.lock().unwrap().take();
        ended.map(drop).ok_or(CalibrationRefusal::NotRunning)
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        self.finish()
    }

    fn picture(&self, revision: Option<u64>) -> Option<bytes::Bytes> {
        revision.map(|r| bytes::Bytes::from(format!("jpeg {r}")))
    }

    fn report(&self) -> Option<String> {
        Some("<h1>Report</h1>".to_owned())
    }
}

#[test]
#[expect(
    clippy::too_many_lines,
    clippy::cognitive_complexity,
    reason = "one client, step by step"
)]
fn calibration_requests_are_accepted_only_from_the_own_page() {
    let server = Server::start(None);
    let json = "Content-Type: application/json";
    let post = |server: &Server, path: &str, headers: &[&str], body: &str| {
        server.request(&format!("POST /calibration/{path}"), headers, body)
    };
    let request = r#"{"step": "intrinsics"}"#;
    assert_eq!(server.get("/calibration").json()["state"], "unavailable");
    let refused = post(&server, "start", &[json], request);
    assert_eq!(refused.status, 409);
    assert!(
        refused.text().contains("penumbra run"),
        "{}",
        refused.text()
    );
    assert_eq!(server.get("/calibration/report").status, 404);

    server
        .shared
        .set_calibrator(Arc::<FakeCalibrator>::default());
    assert_eq!(post(&server, "finish", &[json], "{}").status, 409);
    assert_eq!(post(&server, "start", &[], request).status, 415);
    let form = "Content-Type: application/x-www-form-urlencoded";
    assert_eq!(post(&server, "start", &[form], request).status, 415);
    let other_origin = "Origin: http://evil.example";
    assert_eq!(
        post(&server, "start", &[json, other_origin], request).status,
        403
    );
    assert_eq!(post(&server, "start", &[json], "{}").status, 422);
    assert_eq!(
        post(&server, "start", &[json], &"x".repeat(20_000)).status,
        413
    );
    assert_eq!(server.get("/calibration").json()["step"], "");
    let begun = post(&server, "start", &[json], request);
    assert_eq!(
        (begun.status, &begun.json()["step"]),
        (202, &"intrinsics".into())
    );
    let again = post(&server, "start", &[json], request);
    assert_eq!(again.status, 409);
    assert!(again.text().contains("`intrinsics` is running"));
    assert_eq!(post(&server, "abort", &[json], "{}").status, 202);
    assert_eq!(server.get("/calibration/start").status, 405);

    assert_eq!(
        server.get("/calibration/picture.jpg?revision=7").body,
        b"jpeg 7"
    );
    for none in ["", "?revision=-1", "?revision=x&y", "?x=1"] {
        let path = format!("/calibration/picture.jpg{none}");
        assert_eq!(server.get(&path).status, 404, "{none}");
    }
    // A report has its own styles, but no scripts: a device name in it cannot run code.
    let report = server.get("/calibration/report");
    let policy = report.header("content-security-policy");
    assert!(
        policy.contains("sandbox") && !policy.contains("script-src"),
        "{policy}"
    );
    assert_eq!(report.head.matches("content-security-policy").count(), 1);
    assert_eq!(report.header("x-frame-options"), "deny");

    let guarded = Server::start(Some("0123456789ab"));
    guarded
        .shared
        .set_calibrator(Arc::<FakeCalibrator>::default());
    assert_eq!(guarded.get("/calibration").status, 401);
    let wrong = "Authorization: Bearer 0123456789ac";
    assert_eq!(post(&guarded, "start", &[json, wrong], request).status, 401);
    let right = "Authorization: Bearer 0123456789ab";
    assert_eq!(post(&guarded, "start", &[json, right], request).status, 202);
}

#[test]
fn refuses_host_names_that_others_can_resolve_to_this_machine() {
    let server = Server::start(None);
    for host in ["evil.example", "evil.example:8780", "192.168.1.9", ""] {
        let header = format!("Host: {host}");
        assert_eq!(
            server.request("GET /status", &[&header], "").status,
            421,
            "{host}"
        );
    }
    for host in ["localhost:8780", "127.0.0.1", "[::1]:9000"] {
        let header = format!("Host: {host}");
        assert_eq!(
            server.request("GET /status", &[&header], "").status,
            200,
            "{host}"
        );
    }
}

#[test]
fn other_origins_cannot_change_settings_or_read_the_picture() {
    let server = Server::start(None);
    let json = "Content-Type: application/json";
    let own = format!("Origin: http://{}", server.address);
    for origin in [
        "Origin: http://evil.example",
        "Origin: null",
        "Origin: http://localhost:1",
        "Origin: http://127.0.0.1",
    ] {
        assert_eq!(
            server
                .request("POST /settings", &[json, origin], r#"{"light_count": 8}"#)
                .status,
            403,
            "{origin}"
        );
    }
    assert_eq!(
        server
            .request("POST /settings", &[json, &own], r#"{"light_count": 96}"#)
            .status,
        202
    );
    assert_eq!(server.shared.settings_receiver().borrow().light_count, 96);
    server.picture(3);
    for site in ["cross-site", "same-site"] {
        let image = [
            format!("Sec-Fetch-Site: {site}"),
            "Sec-Fetch-Mode: no-cors".to_owned(),
        ];
        let image: Vec<&str> = image.iter().map(String::as_str).collect();
        assert_eq!(server.request("GET /snapshot.png", &image, "").status, 403);
        let link = [image[0], "Sec-Fetch-Mode: navigate"];
        assert_eq!(
            server.request("GET /", &link, "").status,
            200,
            "following a link"
        );
        assert_eq!(
            server
                .request("POST /settings", &[json, link[0], link[1]], "{}")
                .status,
            403
        );
    }
}

/// Requests that were begun and never end must not shut anybody out.
#[test]
fn half_open_requests_shut_nobody_out() {
    let server = Server::start(None);
    let half_open: Vec<_> = (0..400)
        .map(|_| {
            let mut socket = server.connect();
            let _ = socket.write_all(b"GET /status HTTP/1.1\r\nHost: loc");
            socket
        })
        .collect();
    server.compose();
    for path in ["/healthz", "/status", "/metrics", "/"] {
        assert_eq!(server.get(path).status, 200, "{path}");
    }
    drop(half_open);
}

#[test]
fn viewers_and_refused_clients_leave_places_for_health_and_status() {
    let server = Server::start(Some(TOKEN));
    let authorised = format!("Authorization: Bearer {TOKEN}");
    let mut clients = Vec::new();
    for i in 0..300 {
        let mut socket = server.connect();
        let token = if i % 2 == 0 {
            authorised.as_str()
        } else {
            "X: y"
        };
        let request = format!("GET /stream.mjpeg HTTP/1.1\r\nHost: localhost\r\n{token}\r\n\r\n");
        let _ = socket.write_all(request.as_bytes());
        clients.push(socket);
    }
    server.compose();
    assert_eq!(server.get("/healthz").status, 200);
    let status = server.request("GET /status", &[&authorised], "");
    assert_eq!(status.status, 200);
    // Who has no token is let go at once, although it asked to stay.
    let refused = Answer::read(clients.remove(299));
    assert_eq!(refused.status, 401);
    assert_eq!(refused.header("connection"), "close");
}

#[test]
fn repeated_host_or_origin_is_refused() {
    let server = Server::start(None);
    let own = format!("Host: {}", server.address);
    let origin = format!("Origin: http://{}", server.address);
    let answer = server.request("GET /status", &[&own, "Host: evil.example"], "");
    assert_eq!(answer.status, 400);
    let twice = [origin.as_str(), "Origin: http://evil.example"];
    assert_eq!(server.request("GET /status", &twice, "").status, 400);
    assert_eq!(server.request("GET /status", &[&origin], "").status, 200);
}

#[test]
fn refuses_requests_without_the_token() {
    let server = Server::start(Some(TOKEN));
    for path in [
        "/",
        "/status",
        "/metrics",
        "/stream.mjpeg",
        "/snapshot.png",
        "/settings",
        "/nothing",
    ] {
        assert_eq!(server.get(path).status, 401, "{path}");
    }
    assert_eq!(server.post_settings("{}").status, 401);
    server.compose();
    assert_eq!(
        server.get("/healthz").status,
        200,
        "a watchdog has no token"
    );
    for wrong in [
        "Authorization: Bearer a-token-for-test",
        "Authorization: Basic a-token-for-tests",
        "Cookie: penumbra_token=",
        "Cookie: other=a-token-for-tests",
    ] {
        assert_eq!(
            server.request("GET /status", &[wrong], "").status,
            401,
            "{wrong}"
        );
    }
    for right in [
        "Authorization: Bearer a-token-for-tests",
        "Cookie: a=b; penumbra_token=a-token-for-tests; c=d",
    ] {
        assert_eq!(
            server.request("GET /status", &[right], "").status,
            200,
            "{right}"
        );
    }
    let other_name = [
        "Host: rig.museum.example:8780",
        "Authorization: Bearer a-token-for-tests",
    ];
    assert_eq!(server.request("GET /status", &other_name, "").status, 200);
}

#[test]
fn token_moves_from_the_address_to_a_cookie() {
    let server = Server::start(Some(TOKEN));
    let first = server.get("/?x=1&token=a-token-for-tests");
    assert_eq!((first.status, first.header("location")), (303, "/"));
    let cookie = first.header("set-cookie");
    assert_eq!(
        cookie,
        "penumbra_token=a-token-for-tests; path=/; httponly; samesite=strict"
    );
    assert_eq!(server.get("/?token=wrong-wrong-wrong").status, 401);
    assert_eq!(
        server
            .get("//evil.example/?token=a-token-for-tests")
            .header("location"),
        "/evil.example/"
    );
}

#[test]
fn public_address_requires_a_valid_token() {
    let bind = |address: [u8; 4], token: Option<&str>| {
        let shared = SharedStatus::new(Settings::default());
        StatusServer::bind(
            SocketAddr::from((address, 0)),
            token.map(str::to_owned),
            shared,
        )
    };
    assert!(matches!(
        bind([0, 0, 0, 0], None),
        Err(StatusError::TokenNeeded { .. })
    ));
    assert!(matches!(
        bind([0, 0, 0, 0], Some("short")),
        Err(StatusError::BadToken)
    ));
    assert!(bind([0, 0, 0, 0], Some(TOKEN)).is_ok());
    assert!(bind([127, 0, 0, 2], None).is_ok());
    let foreign = bind([192, 0, 2, 1], Some(TOKEN)).err().unwrap();
    assert!(
        foreign
            .to_string()
            .contains("choose another address with --listen"),
        "{foreign}"
    );
}

#[test]
fn port_in_use_is_reported_in_one_line_with_a_remedy() {
    let server = Server::start(None);
    let shared = SharedStatus::new(Settings::default());
    let error = StatusServer::bind(server.address, None, shared)
        .err()
        .unwrap();
    let text = error.to_string();
    assert!(
        text.starts_with(&format!(
            "port {} on 127.0.0.1 is in use",
            server.address.port()
        )),
        "{text}"
    );
    assert!(text.contains("--listen 127.0.0.1:PORT"), "{text}");
    assert!(!text.contains('\n'));
}

#[test]
fn shutdown_closes_streams() {
    let shared = SharedStatus::new(Settings::default());
    let server = StatusServer::bind(any_port(), None, Arc::clone(&shared)).unwrap();
    let address = server.local_addr();
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let serving = runtime.spawn(server.serve(async {
        let _ = stopped.await;
    }));
    let server = Server {
        address,
        shared,
        _runtime: runtime,
    };
    server.picture(1);
    let mut viewer = Viewer::open(&server);
    viewer.next();
    stop.send(()).unwrap();
    let mut rest = Vec::new();
    // The read ends whether the connection is closed or reset.
    let _ = viewer.0.read_to_end(&mut rest);
    server._runtime.block_on(serving).unwrap().unwrap();
    assert!(
        TcpStream::connect(address).is_err(),
        "the port is free again"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn server_survives_random_bytes(bytes in proptest::collection::vec(any::<u8>(), 0..400), http in any::<bool>()) {
        let server = shared_server();
        let mut socket = server.connect();
        let start: &[u8] = if http { b"POST /settings HTTP/1.1\r\nHost: localhost\r\n" } else { b"" };
        let _ = socket.write_all(&[start, &bytes].concat());
        let _ = socket.shutdown(std::net::Shutdown::Write);
        let _ = socket.read_to_end(&mut Vec::new());
        prop_assert_eq!(server.get("/status").status, 200);
    }
}

fn shared_server() -> &'static Server {
    static SERVER: std::sync::OnceLock<Server> = std::sync::OnceLock::new();
    SERVER.get_or_init(|| Server::start(None))
}

#[test]
fn log_tells_what_happened_after_a_number() {
    let server = Server::start(None);
    let entries = |path: &str| {
        server.get(path).json()["entries"]
            .as_array()
            .unwrap()
            .clone()
    };
    assert!(entries("/log").is_empty());
    server.shared.update(|s| s.warn("a lamp is clipped"));
    server.post_settings(r#"{"light_count": 96, "indirect_light": false}"#);
    let all = entries("/log");
    assert_eq!(
        (&all[0]["level"], &all[0]["text"]),
        (&"warning".into(), &"a lamp is clipped".into())
    );
    assert_eq!(
        (&all[1]["level"], &all[1]["text"]),
        (
            &"info".into(),
            &"settings: indirect_light = false, light_count = 96".into()
        )
    );
    assert!(all[1]["unix_ms"].as_u64() > Some(1_700_000_000_000));
    assert_eq!(server.get("/status").json()["log"]["newest"], 2);
    assert_eq!(entries("/log?after=1").len(), 1);
    assert!(entries("/log?after=2").is_empty());
    assert_eq!(server.get("/log?after=x").status, 400);
    assert_eq!(server.get("/log?before=1").status, 400);
}

#[test]
fn playback_is_changed_by_requests_and_refused_where_it_is_closed() {
    let server = Server::start(None);
    let post =
        |body: &str| server.request("POST /playback", &["Content-Type: application/json"], body);
    let refused = post(r#"{"paused": true}"#);
    assert_eq!(refused.status, 409);
    assert_eq!(refused.json()["error"], "playback: no recording plays");
    server.shared.open_playback(true, Some(12.0), None);
    let answer = post(r#"{"paused": true, "position": 0.5}"#);
    assert_eq!(answer.status, 202);
    assert_eq!(answer.json()["paused"], true);
    let playback = &server.get("/status").json()["playback"];
    assert_eq!(
        (&playback["jumps_requested"], &playback["jumps"]),
        (&1.into(), &0.into()),
        "the rig has not jumped yet"
    );
    assert_eq!(post(r#"{"position": 2}"#).status, 422);
    assert_eq!(server.request("POST /playback", &[], "{}").status, 415);
}
