//! A headless Chromium, controlled by the DevTools protocol over a pipe, which needs no port, driver
//! program or web-socket library.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Paths of Chromium on Debian and Ubuntu.
const PROGRAMS: [&str; 3] = [
    "/usr/bin/chromium",
    "/usr/bin/chromium-browser",
    "/usr/bin/google-chrome",
];
/// Timeout; Chromium may start slowly on a machine that is busy compiling.
const TIMEOUT: Duration = Duration::from_secs(60);
const FLAGS: [&str; 15] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--hide-scrollbars",
    "--mute-audio",
    "--no-default-browser-check",
    "--no-first-run",
    "--remote-debugging-pipe",
];

/// A browser with one page.
pub struct Chromium {
    process: Child,
    requests: ChildStdin,
    messages: Receiver<Value>,
    next_id: u64,
    session: Option<String>,
    complaints: Vec<String>,
    _profile: TempDir,
}

impl Chromium {
    /// Starts a browser with a new profile and a blank page; `None` if none is installed.
    pub fn launch() -> Option<Self> {
        let program = PROGRAMS.into_iter().find(|p| Path::new(p).exists())?;
        let profile = tempfile::tempdir().expect("a folder for the profile");
        // DevTools reads file descriptor 3 and writes 4; the shell redirects our pipes to them.
        let mut process = Command::new("/bin/sh")
            .args([
                "-c",
                r#"exec "$0" "$@" 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null"#,
                program,
            ])
            .args(FLAGS)
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a shell");
        let requests = process.stdin.take().expect("stdin was piped");
        let answers = process.stdout.take().expect("stdout was piped");
        let (sender, messages) = channel();
        let listen = move || {
            for message in BufReader::new(answers).split(0).map_while(Result::ok) {
                let json = serde_json::from_slice(&message).expect("a JSON message");
                if sender.send(json).is_err() {
                    return;
                }
            }
        };
        penumbra_interface::threads::spawn("devtools", listen).expect("a thread");
        let mut browser = Self {
            process,
            requests,
            messages,
            next_id: 1,
            session: None,
            complaints: Vec::new(),
            _profile: profile,
        };
        browser.attach();
        Some(browser)
    }

    fn attach(&mut self) {
        let target = self.call("Target.createTarget", json!({"url": "about:blank"}));
        let attached = self.call(
            "Target.attachToTarget",
            json!({"targetId": target["targetId"], "flatten": true}),
        );
        self.session = attached["sessionId"].as_str().map(str::to_owned);
        for domain in ["Runtime", "Log", "Page"] {
            self.call(&format!("{domain}.enable"), json!({}));
        }
    }

    /// Sets the size of the page, CSS pixels.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500});
        self.call("Emulation.setDeviceMetricsOverride", size);
    }

    /// Sets the colours that the system prefers: `light` or `dark`.
    pub fn prefer_colours(&mut self, colours: &str) {
        let features = json!([{"name": "prefers-color-scheme", "value": colours}]);
        self.call(
            "Emulation.setEmulatedMedia",
            json!({ "features": features }),
        );
    }

    /// Presses a key.
    pub fn press(&mut self, key: &str, code: u32) {
        for kind in ["rawKeyDown", "keyUp"] {
            let event =
                json!({"type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code});
            self.call("Input.dispatchKeyEvent", event);
        }
        if key == "Enter" {
            let event = json!({"type": "char", "key": key, "text": "\r"});
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Returns the middle of an element in the visible part of the page, after scrolling to it.
    pub fn middle_of(&mut self, selector: &str) -> [f64; 2] {
        let at = self.evaluate(&format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{ block: 'center' }}); \
             const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
        ));
        [0, 1].map(|i| at[i].as_f64().expect("a number"))
    }

    /// Touches an element.
    pub fn tap(&mut self, selector: &str) {
        let [x, y] = self.middle_of(selector);
        let points = json!([{"x": x, "y": y}]);
        self.call(
            "Input.dispatchTouchEvent",
            json!({"type": "touchStart", "touchPoints": points}),
        );
        self.call(
            "Input.dispatchTouchEvent",
            json!({"type": "touchEnd", "touchPoints": []}),
        );
    }

    /// Moves a finger from one point of the visible part to another.
    pub fn swipe(&mut self, from: [f64; 2], to: [f64; 2]) {
        let mut touch = |kind: &str, points: Value| {
            let event = json!({"type": kind, "touchPoints": points});
            self.call("Input.dispatchTouchEvent", event);
        };
        touch("touchStart", json!([{"x": from[0], "y": from[1]}]));
        for step in 1..=10 {
            let share = f64::from(step) / 10.0;
            let [x, y] = [0, 1].map(|i| from[i] + share * (to[i] - from[i]));
            touch("touchMove", json!([{"x": x, "y": y}]));
        }
        touch("touchEnd", json!([]));
    }

    /// Moves the mouse with the button pressed from one point of the visible part to another.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        let mut mouse = |kind: &str, [x, y]: [f64; 2]| {
            let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1});
            self.call("Input.dispatchMouseEvent", event);
        };
        mouse("mousePressed", from);
        for step in 1..=10 {
            let share = f64::from(step) / 10.0;
            mouse(
                "mouseMoved",
                [0, 1].map(|i| from[i] + share * (to[i] - from[i])),
            );
        }
        mouse("mouseReleased", to);
    }

    /// Opens an address.
    pub fn open(&mut self, url: &str) {
        let opened = self.call("Page.navigate", json!({ "url": url }));
        assert!(opened["errorText"].is_null(), "{url}: {opened}");
    }

    /// Returns a PNG of the complete page or of the visible part.
    pub fn screenshot(&mut self, complete_page: bool) -> Vec<u8> {
        let how = json!({"format": "png", "captureBeyondViewport": complete_page});
        let shot = self.call("Page.captureScreenshot", how);
        from_base64(shot["data"].as_str().expect("a picture"))
    }

    /// Evaluates a JavaScript expression.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let how = json!({"expression": expression, "returnByValue": true, "awaitPromise": true});
        let answer = self.call("Runtime.evaluate", how);
        assert!(
            answer["exceptionDetails"].is_null(),
            "{expression}: {answer}"
        );
        answer["result"]["value"].clone()
    }

    /// Waits until an expression, or its promise, is true.
    pub fn wait_for(&mut self, expression: &str) {
        let deadline = Instant::now() + TIMEOUT;
        // While a page loads, even `document.body` may be missing.
        let test = format!("(async () => Boolean(await ({expression})))().catch(() => false)");
        while self.evaluate(&test) != Value::Bool(true) {
            let late = Instant::now() >= deadline
                || self.complaints.iter().any(|c| c.contains("Uncaught"));
            assert!(
                !late,
                "timeout: {expression}; messages: {:?}",
                self.complaints
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Returns the errors and warnings on the console, uncaught exceptions and failed requests.
    pub fn complaints(&mut self) -> &[String] {
        self.evaluate("1");
        &self.complaints
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        let id = self.next_id;
        self.next_id += 1;
        let mut request = json!({"id": id, "method": method, "params": params});
        if let Some(session) = &self.session {
            request["sessionId"] = json!(session);
        }
        self.requests
            .write_all(format!("{request}\0").as_bytes())
            .expect("Chromium reads requests");
        loop {
            let message = self
                .messages
                .recv_timeout(TIMEOUT)
                .unwrap_or_else(|e| panic!("{method}: {e}"));
            if message["id"] == id {
                assert!(message["error"].is_null(), "{method}: {message}");
                return message["result"].clone();
            }
            self.complaints.extend(complaint(&message));
        }
    }
}

/// Returns the error or warning of an event, if it has one.
fn complaint(event: &Value) -> Option<String> {
    let params = &event["params"];
    let bad = |level: &Value| matches!(level.as_str(), Some("error" | "warning" | "assert"));
    match event["method"].as_str()? {
        "Runtime.exceptionThrown" => Some(params["exceptionDetails"].to_string()),
        "Runtime.consoleAPICalled" if bad(&params["type"]) => Some(params["args"].to_string()),
        "Log.entryAdded" if bad(&params["entry"]["level"]) => Some(params["entry"].to_string()),
        _ => None,
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        // `Browser.close` also ends the helper processes; killing may not.
        self.session = None;
        let _ = self
            .requests
            .write_all(b"{\"id\":0,\"method\":\"Browser.close\"}\0");
        let deadline = Instant::now() + Duration::from_secs(5);
        while Instant::now() < deadline && matches!(self.process.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// RFC 4648, standard alphabet.
fn from_base64(text: &str) -> Vec<u8> {
    let value = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let digits: Vec<u8> = text.bytes().filter(|c| *c != b'=').map(value).collect();
    let group = |four: &[u8]| {
        let bits =
            four.iter().fold(0_u32, |bits, d| bits << 6 | u32::from(*d)) << (6 * (4 - four.len()));
        bits.to_be_bytes()[1..four.len()].to_vec()
    };
    digits.chunks(4).flat_map(group).collect()
}
