//! `penumbra photo --browser` by HTTP: access, wrong requests, and adjust, compose, done.

use crate::photo::{pictures, sheet};
use crate::program::{Desk, text};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

const TIMEOUT: Duration = Duration::from_secs(120);
const JSON: &str = "Content-Type: application/json";

/// A program that serves the page; killed when dropped.
struct Page {
    program: Child,
    printed: BufReader<ChildStdout>,
    host: String,
    token: String,
}

impl Page {
    fn open(desk: &Desk, line: &str) -> Self {
        let words: Vec<&str> = line.split_whitespace().collect();
        let mut program = desk
            .command(&words)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut printed = BufReader::new(program.stdout.take().unwrap());
        let mut line = String::new();
        printed.read_line(&mut line).unwrap();
        let address = line.trim_end().rsplit_once("http://").unwrap().1;
        let (host, token) = address.split_once("/?token=").unwrap();
        assert!(host.starts_with("127.0.0.1:"), "{line}");
        Self {
            host: host.to_owned(),
            token: token.to_owned(),
            program,
            printed,
        }
    }

    /// Returns status, head and body of the answer to a request with these header lines.
    fn ask(&self, line: &str, headers: &[&str], body: &str) -> (u16, String, Vec<u8>) {
        let mut socket = TcpStream::connect(&self.host).unwrap();
        socket.set_read_timeout(Some(TIMEOUT)).unwrap();
        let own = format!("Host: {}", self.host);
        let host = headers.iter().find(|h| h.starts_with("Host:"));
        let mut head = vec![format!("{line} HTTP/1.1"), "Connection: close".to_owned()];
        head.push(host.map_or(own, |h| (*h).to_owned()));
        let others = headers.iter().filter(|h| !h.starts_with("Host:"));
        head.extend(others.map(|h| (*h).to_owned()));
        head.push(format!("Content-Length: {}", body.len()));
        let request = head.join("\r\n") + "\r\n\r\n" + body;
        // A refusal may arrive before the body has been sent.
        let _ = socket.write_all(request.as_bytes());
        let mut bytes = Vec::new();
        let _ = socket.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
        let head = text(&bytes[..end]);
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (status, head.to_lowercase(), bytes[end + 4..].to_vec())
    }

    fn get(&self, path: &str) -> (u16, String, Vec<u8>) {
        let bearer = format!("Authorization: Bearer {}", self.token);
        self.ask(&format!("GET {path}"), &[&bearer], "")
    }

    fn post(&self, path: &str, body: &str) -> (u16, Value) {
        let bearer = format!("Authorization: Bearer {}", self.token);
        let (status, _, body) = self.ask(&format!("POST {path}"), &[&bearer, JSON], body);
        (status, serde_json::from_slice(&body).unwrap())
    }

    fn json(&self, path: &str) -> Value {
        serde_json::from_slice(&self.get(path).2).unwrap()
    }

    /// Composes, and returns the state with the result.
    fn compose(&self, adjustment: &Value) -> Value {
        let before = self.json("/state")["composed"].clone();
        let (status, answer) = self.post("/compose", &adjustment.to_string());
        assert_eq!(status, 202, "{answer}");
        let until = Instant::now() + TIMEOUT;
        loop {
            let state = self.json("/state");
            assert_eq!(state["trouble"], Value::Null, "{state}");
            if state["composed"] != before {
                return state;
            }
            assert!(Instant::now() < until, "{state}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Returns the exit status, and what was printed after the address.
    fn end(mut self) -> (Option<i32>, String) {
        let mut printed = String::new();
        self.printed.read_to_string(&mut printed).unwrap();
        (self.program.wait().unwrap().code(), printed)
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn by_tilt(degrees: f64) -> Value {
    json!({ "circle": [222.0, 181.0, 24.0], "ground": { "tilt": degrees } })
}

#[test]
fn page_answers_to_its_own_user_only() {
    let desk = Desk::new();
    let line = format!(
        "photo {} --ball-diameter 80mm --browser -o out.png",
        pictures(1)
    );
    let page = Page::open(&desk, &line);
    assert_eq!(page.ask("GET /", &[], "").0, 401);
    assert_eq!(page.ask("GET /healthz", &[], "").0, 401);
    let bearer = format!("Authorization: Bearer {}", page.token);
    let elsewhere = page.ask("GET /", &[&bearer, "Host: evil.example"], "");
    assert_eq!(elsewhere.0, 421);
    let other = page.ask(
        "POST /finish",
        &[&bearer, JSON, "Origin: http://evil.example"],
        "{}",
    );
    assert_eq!(other.0, 403);
    let (status, head, _) = page.ask(&format!("GET /?token={}", page.token), &[], "");
    assert_eq!(status, 303);
    let cookie = head.lines().find_map(|l| l.strip_prefix("set-cookie: "));
    let cookie = format!("Cookie: {}", cookie.unwrap().split(';').next().unwrap());
    let (status, head, html) = page.ask("GET /", &[&cookie], "");
    assert_eq!(status, 200);
    assert!(
        head.contains("default-src 'none'; script-src 'self'"),
        "{head}"
    );
    let html = text(&html);
    assert!(!html.contains("://"), "a file of another server");
    let own = ["/dashboard/", "/photo/", "/photo.jpg"];
    let named = html
        .split('"')
        .filter(|s| own.iter().any(|o| s.starts_with(o)));
    let modules = [
        "/photo/handles.js",
        "/dashboard/text.js",
        "/dashboard/requests.js",
    ];
    for path in named.chain(modules) {
        assert_eq!(page.get(path).0, 200, "{path}");
    }
    assert_eq!(page.get("/composite.png").0, 404);
    assert_eq!(page.get("/status").0, 404);
}

#[test]
fn wrong_requests_are_refused_in_one_line() {
    let desk = Desk::new();
    let line = format!(
        "photo {} --ball-diameter 80mm --browser -o out.png",
        pictures(1)
    );
    let page = Page::open(&desk, &line);
    let garbage = [
        "",
        "[1, 2]",
        "{\"circle\": [1, 2, 3]}",
        r#"{"circle": [220, 179, 25], "ground": {"tilt": 500}}"#,
        r#"{"circle": [220, 179, 25], "ground": {"corners": [[1, 2]]}}"#,
        r#"{"circle": [9000, 179, 25], "ground": {"tilt": 30}}"#,
        "\u{0}\u{1}",
    ];
    for body in garbage {
        for path in ["/view", "/compose"] {
            let (status, answer) = page.post(path, body);
            let reason = answer["error"].as_str().unwrap();
            assert_eq!(
                (status, reason.lines().count()),
                (400, 1),
                "{body}: {answer}"
            );
        }
    }
    let bearer = format!("Authorization: Bearer {}", page.token);
    let form = page.ask("POST /view", &[&bearer, "Content-Type: text/plain"], "{}");
    assert_eq!(form.0, 415);
    let large = page.ask("POST /view", &[&bearer, JSON], &" ".repeat(1 << 20));
    assert_eq!(large.0, 413);
    // A ground that cannot be is told beside the ball, and not composed.
    let skewed = json!({ "circle": [220, 179, 25], "ground": { "corners": [[250, 150], [350, 200], [230, 250], [100, 180]] } });
    let (status, view) = page.post("/view", &skewed.to_string());
    assert_eq!((status, &view["ground"]), (200, &Value::Null));
    assert!(view["ball"]["seen"].as_f64() > Some(0.7), "{view}");
    assert!(view["trouble"].as_str().unwrap().contains("right angle"));
    assert_eq!(page.post("/compose", &skewed.to_string()).0, 400);
    let tag = json!({ "circle": [220, 179, 25], "ground": "tag" });
    assert_eq!(page.post("/compose", &tag.to_string()).0, 400);
    assert_eq!(page.post("/finish", "{}").0, 409);
    assert!(!desk.path("out.png").exists());
}

#[test]
fn adjusted_picture_is_written_and_its_options_give_the_same() {
    let desk = Desk::new();
    let arguments = format!("photo {} --ball-diameter 80mm", pictures(2));
    let page = Page::open(
        &desk,
        &format!("{arguments} --browser --found found.png -o out.png"),
    );
    let start = page.json("/start");
    let circle = &start["adjustment"]["circle"];
    assert!((circle[0].as_f64().unwrap() - 220.0).abs() < 2.0, "{start}");
    let first = page.compose(&by_tilt(28.0));
    assert!(first["lines"].to_string().contains("check: "), "{first}");
    let tilted = page.get("/composite.png").2;
    let corners: Vec<f64> = sheet().split(',').map(|n| n.parse().unwrap()).collect();
    let corners: Vec<&[f64]> = corners.chunks(2).collect();
    let adjustment = json!({ "circle": circle, "ground": { "corners": corners } });
    let view = page.post("/view", &adjustment.to_string()).1;
    let tilt = view["ground"]["tilt_deg"].as_f64().unwrap();
    assert!((tilt - 28.0).abs() < 1.0, "{view}");
    page.compose(&adjustment);
    let composite = page.get("/composite.png").2;
    assert_ne!(composite, tilted);
    assert!(!desk.path("out.png").exists(), "only Done writes it");
    assert_eq!(page.post("/finish", "{}").0, 202);
    while page.json("/state")["phase"] != "finished" {}
    let (code, printed) = page.end();
    assert_eq!(code, Some(0), "{printed}");
    assert_eq!(desk.read("out.png"), composite);
    assert!(desk.path("found.png").exists());
    let options = printed
        .rsplit_once("the same without a browser: ")
        .unwrap()
        .1;
    assert!(
        options.contains(&format!("--ground {}", sheet())),
        "{options}"
    );
    desk.works(&format!("{arguments} {} -o again.png", options.trim_end()));
    assert_eq!(desk.read("again.png"), composite);
}

#[test]
fn page_opens_without_a_ball_and_an_interrupt_writes_nothing() {
    let desk = Desk::new();
    let empty = pictures(0);
    let line = format!("photo {empty} {empty} --ball-diameter 80mm --browser -o out.png");
    let page = Page::open(&desk, &line);
    let start = page.json("/start");
    assert_eq!(start["trouble"], "No ball was found.");
    // What the user places is believed.
    let (status, view) = page.post("/view", &by_tilt(28.0).to_string());
    assert_eq!((status, &view["ball"]["is_fitted"]), (200, &json!(false)));
    let id = page.program.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let (code, printed) = page.end();
    assert_eq!((code, printed.as_str()), (Some(1), ""));
    assert!(!desk.path("out.png").exists());
}
