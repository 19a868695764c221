//! The dashboard in Chromium.
#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod controls;
mod guide;
mod health;
mod layout;
mod objects;
mod photo;
mod picture;
mod playback;
mod scenes;
#[path = "../support/mod.rs"]
mod support;

use penumbra_config::LightPlacement;
use penumbra_session::{Session, SessionEvent};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use support::chromium::Chromium;
use support::show::Show;

/// Starts the browser; `None`, with a notice, if it is missing.
fn browser(test: &str) -> Option<Chromium> {
    let browser = Chromium::launch();
    if browser.is_none() {
        eprintln!("SKIPPED {test}: Chromium is missing (apt-get install chromium)");
    }
    browser
}

/// Stores screenshots for work on the dashboard: `PENUMBRA_SCREENSHOTS=DIR cargo test --test browser`.
fn keep(name: &str, png: &[u8]) {
    if let Some(dir) = std::env::var_os("PENUMBRA_SCREENSHOTS") {
        std::fs::write(Path::new(&dir).join(name), png).unwrap();
    }
}

/// Opens the dashboard and waits until it shows everything.
fn open(browser: &mut Chromium, show: &Show) {
    browser.open(&format!("http://{}/", show.address));
    browser.wait_for("document.body.dataset.link === 'up'");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    browser.wait_for("document.getElementById('environment').naturalWidth === 512");
}

/// The part of the page where the picture is, as RGB.
fn picture_region(browser: &mut Chromium) -> image::RgbImage {
    let png = browser.screenshot(false);
    let r = browser.evaluate("(() => { const r = document.getElementById('picture').getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()");
    let [x, y, w, h] = [0, 1, 2, 3].map(|i| r[i].as_f64().unwrap().max(0.0) as u32);
    image::load_from_memory(&png)
        .unwrap()
        .crop_imm(x, y, w, h)
        .to_rgb8()
}

/// Share of the pixels that differ clearly.
fn share_that_differs(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    let differ =
        |(p, q): &(&image::Rgb<u8>, &image::Rgb<u8>)| (0..3).any(|c| p[c].abs_diff(q[c]) > 24);
    a.pixels().zip(b.pixels()).filter(differ).count() as f64 / f64::from(a.width() * a.height())
}

/// Waits until a condition on the picture holds; returns the picture.
fn wait_for_picture(
    browser: &mut Chromium,
    what: &str,
    mut holds: impl FnMut(&image::RgbImage) -> bool,
) -> image::RgbImage {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        let picture = picture_region(browser);
        if holds(&picture) {
            return picture;
        }
        assert!(Instant::now() < deadline, "the picture never {what}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Waits until a hundredth of the picture has changed. An object that moves to and fro may look the
/// same in two pictures; so several are compared.
fn wait_for_motion(browser: &mut Chromium) -> image::RgbImage {
    let first = picture_region(browser);
    wait_for_picture(browser, "moved", |now| {
        share_that_differs(&first, now) > 0.01
    })
}

#[test]
fn dashboard_shows_moving_pictures_without_console_errors() {
    let Some(mut browser) = browser("dashboard_shows_moving_pictures_without_console_errors")
    else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    wait_for_motion(&mut browser);
    std::thread::sleep(Duration::from_secs(3));
    keep("desktop.png", &browser.screenshot(false));
    keep("desktop-complete.png", &browser.screenshot(true));
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Path of the bundled session.
const SESSION: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/tests/fixtures/sessions/desk.mcap"
);

/// A running program; killed when dropped.
struct Program(Child);

impl Program {
    /// Plays the bundled session.
    fn replay() -> (Self, String) {
        Self::start(&["replay", SESSION, "--loop"])
    }

    /// A live rig whose cameras and tracker play the bundled session; it records into `folder`.
    fn live(folder: &Path) -> (Self, String) {
        let config = folder.join("rig.toml");
        let device = format!("device = \"replay:{SESSION}\"");
        let text = format!(
            "[scene_camera]\n{device}\n[environment_camera]\n{device}\n[tracker]\n{device}\n\
             [calibration]\nfrom = \"{SESSION}\"\n[recording]\nfolder = \"recordings\"\n\
             max_duration_s = 600\nreserve_mb = 1\n"
        );
        std::fs::write(&config, text).unwrap();
        Self::start(&["run", "--config", config.to_str().unwrap()])
    }

    /// Starts the program; returns it with the address that it prints.
    fn start(command: &[&str]) -> (Self, String) {
        let mut child = Command::new(env!("CARGO_BIN_EXE_penumbra"))
            .args(command)
            .args([
                "--headless",
                "--light-count",
                "8",
                "--listen",
                "127.0.0.1:0",
            ])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let out = child.stdout.take().unwrap();
        let program = Self(child);
        BufReader::new(out).read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("status page: ");
        (program, address.unwrap().to_owned())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Replays the desk in a loop and opens its page.
fn open_replay(browser: &mut Chromium) -> Program {
    let (program, address) = Program::replay();
    browser.resize(1280, 800);
    browser.open(&address);
    browser.wait_for("document.body.dataset.link === 'up'");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    program
}

#[test]
fn dashboard_of_a_replay_moves_and_applies_settings() {
    let Some(mut browser) = browser("dashboard_of_a_replay_moves_and_applies_settings") else {
        return;
    };
    let _program = open_replay(&mut browser);
    browser.wait_for("document.getElementById('environment').naturalWidth >= 128");
    browser.wait_for("parseFloat(document.getElementById('head-fps').textContent) > 0");
    let second = wait_for_motion(&mut browser);
    // The red teapot disappears when it is switched off.
    let red = |picture: &image::RgbImage| {
        let is_red = |p: &&image::Rgb<u8>| p[0] > 120 && p[0] / 2 > p[1].max(p[2]);
        picture.pixels().filter(is_red).count()
    };
    assert!(red(&second) > 5000, "{} red pixels", red(&second));
    browser.evaluate("document.querySelector('[name=virtual_object_visible]').click()");
    wait_for_picture(&mut browser, "lost its red teapot", |p| red(p) < 500);
    keep("replay-without.png", &browser.screenshot(false));
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Recorded megabytes on the page.
const MEGABYTES: &str = "parseFloat((document.getElementById('recording-facts').textContent.match(/([0-9.]+) MB/) ?? [])[1])";

#[test]
fn record_button_records_a_live_rig() {
    let Some(mut browser) = browser("record_button_records_a_live_rig") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (_program, address) = Program::live(folder.path());
    browser.resize(1280, 800);
    browser.open(&address);
    browser.wait_for("document.body.dataset.link === 'up'");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    browser.wait_for("document.getElementById('record').checkVisibility()");
    let pill = |browser: &mut Chromium| {
        browser.evaluate("document.getElementById('recording-pill').textContent")
    };
    assert_eq!(pill(&mut browser), "not recording");

    browser.wait_for("!document.getElementById('composite').disabled");
    browser.evaluate("document.getElementById('composite').click()");
    browser.evaluate("document.getElementById('record').click()");
    browser.wait_for("document.getElementById('recording-pill').textContent === 'recording'");
    browser.wait_for("document.getElementById('record').textContent === 'Stop recording'");
    browser.wait_for(&format!("{MEGABYTES} > 0.2"));
    let earlier = browser.evaluate(MEGABYTES).as_f64().unwrap();
    browser.wait_for(&format!("{MEGABYTES} > {earlier} + 1.0"));
    // The data rate is known after the first second.
    browser.wait_for(
        "document.getElementById('recording-facts').textContent.includes(' per minute · ')",
    );
    // At most ten minutes by the configuration, or less if the disk is almost full.
    let facts = browser.evaluate("document.getElementById('recording-facts').textContent");
    let facts = facts.as_str().unwrap();
    assert!(
        facts.contains(" left · ")
            && facts.contains(" free")
            && facts.contains(" composited pictures · ")
            && facts.contains(" per minute · "),
        "{facts}"
    );
    keep("recording.png", &browser.screenshot(false));

    browser.wait_for("!document.getElementById('record').disabled");
    browser.evaluate("document.getElementById('record').click()");
    browser.wait_for("document.getElementById('recording-pill').textContent === 'recorded'");
    browser.wait_for("document.getElementById('record').textContent === 'Record'");
    let shown = browser.evaluate(MEGABYTES).as_f64().unwrap();
    assert_eq!(browser.complaints(), [""; 0]);

    let mut files = std::fs::read_dir(folder.path().join("recordings")).unwrap();
    let file = files.next().unwrap().unwrap().path();
    assert!(files.next().is_none(), "one press, one file");
    let bytes = std::fs::metadata(&file).unwrap().len() as f64;
    assert!(
        (bytes / 1e6 - shown).abs() < 0.11,
        "{bytes} bytes, {shown} MB shown"
    );
    let counts = recorded(&file);
    let [scene, environment, tracker] = counts;
    assert!(
        scene >= 10 && environment >= 10 && tracker >= 20,
        "{counts:?}"
    );
}

/// Pictures of the scene camera and of the environment camera, and chunks of tracker bytes in a session.
fn recorded(file: &Path) -> [usize; 3] {
    let mut counts = [0; 3];
    for event in Session::open(file).unwrap().events() {
        match event.unwrap() {
            SessionEvent::Scene(_) => counts[0] += 1,
            SessionEvent::Environment(_) => counts[1] += 1,
            SessionEvent::TrackerBytes { .. } => counts[2] += 1,
            _ => {}
        }
    }
    counts
}

/// Starts a live rig whose camera sees a board; its files are in `folder`.
fn sees_a_board(folder: &Path) -> (Program, String) {
    let session = folder.join("board.mcap");
    support::board::record(&session);
    std::fs::create_dir(folder.join("files")).unwrap();
    let text = format!(
        "[scene_camera]\ndevice = \"replay:{}\"\n[calibration]\nfrom = \"files\"\n",
        session.display()
    );
    let config = folder.join("rig.toml");
    std::fs::write(&config, text).unwrap();
    Program::start(&["run", "--config", config.to_str().unwrap()])
}

#[test]
#[expect(clippy::too_many_lines, reason = "one visit, step by step")]
fn dashboard_calibrates_a_lens() {
    let Some(mut browser) = browser("dashboard_calibrates_a_lens") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (_program, address) = sees_a_board(folder.path());
    browser.resize(1280, 900);
    browser.open(&address);
    browser.wait_for("document.getElementById('calibrate-start').checkVisibility()");
    browser.evaluate("document.getElementById('calibrate-card').scrollIntoView()");
    keep("calibrate-form.png", &browser.screenshot(false));
    // The refusal of an invalid board is shown next to its field.
    let type_board = |browser: &mut Chromium, board: &str| {
        browser.evaluate(&format!(
            "document.querySelector('[name=board]').value = '{board}'"
        ));
        browser.evaluate("document.getElementById('calibrate-start').click()");
    };
    let text = |id: &str| format!("document.getElementById('{id}').textContent");
    type_board(&mut browser, "soup");
    browser.wait_for(&format!(
        "{}.includes('board `soup`')",
        text("calibrate-trouble")
    ));
    // The browser logs the refusal.
    let refused = browser.complaints().len();
    type_board(&mut browser, support::board::BOARD);
    browser.wait_for("document.getElementById('calibrate-finish').checkVisibility()");
    browser.wait_for("document.getElementById('calibrate-picture').naturalWidth === 320");
    browser.wait_for(
        "document.querySelector('#calibrate-marks path').getAttribute('d').split('M').length > 20",
    );
    browser.wait_for("document.getElementById('calibrate-share').value > 0.2");
    browser.wait_for(&format!("{} !== ''", text("calibrate-hint")));
    keep("calibrate.png", &browser.screenshot(false));
    // A page opened during the step shows its progress.
    browser.open(&address);
    browser.wait_for("document.getElementById('calibrate-finish').checkVisibility()");
    browser.wait_for("document.getElementById('calibrate-share').value > 0.2");
    browser.wait_for("document.getElementById('calibrate-picture').naturalWidth === 320");
    browser.wait_for("document.getElementById('calibrate-result').checkVisibility()");
    let grade = browser.evaluate(&text("calibrate-grade"));
    assert!(matches!(grade.as_str(), Some("good" | "usable")), "{grade}");
    let file = browser.evaluate(&text("calibrate-files"));
    assert!(
        file.as_str()
            .unwrap()
            .contains("calibration/scene_camera.json"),
        "{file}"
    );
    browser.wait_for(&format!("{}.includes('px RMS')", text("calibrate-figures")));
    browser.evaluate("document.getElementById('calibrate-card').scrollIntoView()");
    keep("calibrate-result.png", &browser.screenshot(false));
    let report = browser.evaluate("document.getElementById('calibrate-report').href");
    assert_eq!(
        browser.complaints().len(),
        refused,
        "{:?}",
        browser.complaints()
    );
    browser.open(report.as_str().unwrap());
    browser.wait_for("document.querySelector('h1').textContent === 'Lens of the scene camera'");
    // Its own style is active, and it runs no script.
    browser
        .wait_for("getComputedStyle(document.querySelector('h2 span')).color !== 'rgb(0, 0, 0)'");
    keep("calibrate-report.png", &browser.screenshot(false));
    assert!(
        folder
            .path()
            .join("files/calibration/scene_camera.json")
            .exists()
    );
}

#[test]
fn dashboard_fits_a_telephone() {
    let Some(mut browser) = browser("dashboard_fits_a_telephone") else {
        return;
    };
    let show = Show::start();
    browser.resize(400, 800);
    open(&mut browser, &show);
    std::thread::sleep(Duration::from_secs(2));
    keep("telephone-complete.png", &browser.screenshot(true));
    let width = browser.evaluate("document.documentElement.scrollWidth");
    assert_eq!(width, 400, "the page scrolls sideways");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn changed_setting_reaches_the_rig_and_is_confirmed() {
    let Some(mut browser) = browser("changed_setting_reaches_the_rig_and_is_confirmed") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.wait_for("document.querySelector('[name=light_count]').value === '64'");
    browser.evaluate("document.querySelector('[name=light_placement][value=grid]').click()");
    browser.evaluate("document.querySelector('[name=virtual_object_visible]').click()");
    browser.evaluate("(() => { const s = document.querySelector('[name=light_count]'); s.value = '96'; s.dispatchEvent(new Event('input', {bubbles: true})); })()");
    browser.evaluate("(() => { const s = document.querySelector('[name=shadow_strength]'); s.value = '0.5'; s.dispatchEvent(new Event('input', {bubbles: true})); })()");
    browser.wait_for("fetch('/status').then(r => r.json()).then(s => s.settings.light_count === 96 && s.settings.shadow_strength === 0.5)");
    let settings = show.shared.snapshot().settings;
    assert_eq!(settings.light_placement, LightPlacement::Grid);
    assert!(!settings.virtual_object_visible);
    browser.wait_for("!document.querySelector('[data-pending]') && document.getElementById('head-lights').textContent === '96'");
    assert_eq!(
        browser.evaluate("document.querySelector('[name=light_count]').value"),
        "96"
    );
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn exposure_is_set_manually() {
    let Some(mut browser) = browser("exposure_is_set_manually") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    let text = |id: &str| format!("document.getElementById('{id}').textContent");
    browser.wait_for(&format!(
        "{}.includes('Now the camera’s exposure')",
        text("exposure_mode-hint")
    ));
    let row = "document.querySelector('[name=exposure_ev]').closest('.row').hidden";
    assert_eq!(browser.evaluate(row), true);
    browser.evaluate("document.querySelector('[name=exposure_mode][value=manual]').click()");
    browser.wait_for(&format!("!{row}"));
    browser.evaluate("(() => { const s = document.querySelector('[name=exposure_ev]'); s.value = '-1.5'; s.dispatchEvent(new Event('input', {bubbles: true})); })()");
    browser.wait_for(&format!(
        "{} === 'Now −1.5\u{a0}EV.'",
        text("exposure_mode-hint")
    ));
    browser.wait_for("!document.querySelector('[data-pending]')");
    assert_eq!(browser.evaluate(&text("exposure_ev-text")), "−1.5\u{a0}EV");
    assert_eq!(show.shared.settings_receiver().borrow().exposure_ev, -1.5);
    keep("exposure.png", &browser.screenshot(true));
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn planes_card_is_shown_while_planes_are_active() {
    let Some(mut browser) = browser("planes_card_is_shown_while_planes_are_active") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    assert_eq!(
        browser.evaluate("document.getElementById('planes-card').hidden"),
        true
    );
    browser.evaluate("(() => { const s = document.querySelector('[name=technique]'); s.value = 'shadowing-planes'; s.dispatchEvent(new Event('input', {bubbles: true})); })()");
    browser.wait_for("!document.getElementById('planes-card').hidden && document.getElementById('planes-pill').textContent === 'ready'");
    let hint = browser.evaluate("document.getElementById('technique-hint').textContent");
    assert!(hint.to_string().contains("Ready"), "{hint}");
    let change = "(() => { const s = document.querySelector('[name=planes_skip_below]'); s.value = '0.02'; s.dispatchEvent(new Event('input', {bubbles: true})); })()";
    browser.evaluate(change);
    browser.wait_for("document.getElementById('planes-facts').textContent.includes('1,387')");
    browser.wait_for(
        "fetch('/status').then(r => r.json()).then(s => s.settings.planes_skip_below === 0.02)",
    );
    browser.wait_for("!document.querySelector('[data-pending]')");
    let skip = browser.evaluate("document.getElementById('planes_skip_below-text').textContent");
    assert_eq!(skip, "2.0 %");
    keep("planes.png", &browser.screenshot(true));
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn dashboard_reports_lost_and_restored_connection() {
    let Some(mut browser) = browser("dashboard_reports_lost_and_restored_connection") else {
        return;
    };
    let show = Show::start();
    open(&mut browser, &show);
    let address = show.address;
    drop(show);
    browser.wait_for(
        "document.body.dataset.link === 'lost' && !document.getElementById('link-lost').hidden",
    );
    keep("lost.png", &browser.screenshot(false));
    let text = browser.evaluate("document.getElementById('link-lost').textContent");
    assert!(
        matches!(&text, Value::String(t) if t.contains("is lost")),
        "{text}"
    );
    let show = Show::start_at(address);
    browser.wait_for(
        "document.body.dataset.link === 'up' && document.getElementById('link-lost').hidden",
    );
    browser.wait_for("fetch('/status').then(r => r.json()).then(s => s.stream.viewers === 1)");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    assert!(show.shared.wants_picture());
}
