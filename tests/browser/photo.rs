//! The page of `penumbra photo --browser`.

use crate::support::chromium::Chromium;
use crate::{browser, keep};
use penumbra_picture::Picture;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use tempfile::TempDir;

/// A program that serves the page; killed when dropped.
struct Page {
    program: Child,
    printed: BufReader<ChildStdout>,
    folder: TempDir,
}

impl Page {
    /// Opens the page on these photographs of the fixture.
    fn open(browser: &mut Chromium, photographs: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/photo");
        let mut program = Command::new(env!("CARGO_BIN_EXE_penumbra"))
            .args([
                "--quiet",
                "photo",
                "--ball-diameter",
                "80mm",
                "--browser",
                "-o",
            ])
            .arg(folder.path().join("out.png"))
            .args(photographs.iter().map(|name| fixture.join(name)))
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut printed = BufReader::new(program.stdout.take().unwrap());
        let mut line = String::new();
        printed.read_line(&mut line).unwrap();
        let page = Self {
            program,
            printed,
            folder,
        };
        let at = line.find("http://").unwrap();
        browser.open(line[at..].trim_end());
        browser.wait_for("document.body.dataset.link === 'up'");
        browser.wait_for("document.getElementById('outline').getAttribute('d').length > 0");
        page
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn text(browser: &mut Chromium, id: &str) -> String {
    let text = browser.evaluate(&format!("document.getElementById('{id}').textContent"));
    text.as_str().unwrap().to_owned()
}

/// Returns a number of the circle: `cx`, `cy` or `r`.
fn circle(browser: &mut Chromium, name: &str) -> f64 {
    let value = browser.evaluate(&format!(
        "Number(document.getElementById('circle').getAttribute('{name}'))"
    ));
    value.as_f64().unwrap()
}

/// Drags a handle by so many pixels of the screen.
fn drag(browser: &mut Chromium, handle: &str, by: [f64; 2]) {
    let from = browser.middle_of(handle);
    browser.drag(from, [from[0] + by[0], from[1] + by[1]]);
}

/// Waits until the program has answered the newest change.
fn settle(browser: &mut Chromium) {
    std::thread::sleep(std::time::Duration::from_millis(500));
    browser.wait_for("document.getElementById('outline').getAttribute('d').length > 0");
}

const CENTRE: &str = ".handle[data-kind=centre] .dot";
const RIM: &str = ".handle[data-kind=rim] .dot";

#[test]
fn ball_and_ground_are_adjusted_composed_and_written() {
    let Some(mut browser) = browser("ball_and_ground_are_adjusted_composed_and_written") else {
        return;
    };
    browser.resize(1280, 800);
    let mut page = Page::open(&mut browser, &["empty.jpg", "ball1.jpg", "ball2.jpg"]);
    assert!(text(&mut browser, "ball-pill").starts_with("outline seen: 8"));
    assert_eq!(text(&mut browser, "seen"), text(&mut browser, "ball-pill"));
    keep("photo-page.png", &browser.screenshot(false));
    // By the mouse, and back by the keys.
    let (x, radius) = (circle(&mut browser, "cx"), circle(&mut browser, "r"));
    drag(&mut browser, CENTRE, [60.0, 0.0]);
    let moved = circle(&mut browser, "cx");
    assert!(moved > x + 20.0, "{x} to {moved}");
    settle(&mut browser);
    browser.wait_for("document.getElementById('ball-pill').dataset.tone === 'warn'");
    keep("photo-page-beside.png", &browser.screenshot(false));
    browser.evaluate("document.querySelector('.handle[data-kind=centre]').focus()");
    browser.press("ArrowRight", 39);
    assert!(circle(&mut browser, "cx") > moved);
    browser.evaluate(&format!(
        "(async () => {{ const h = document.querySelector('.handle[data-kind=centre]'); \
         while (document.getElementById('circle').getAttribute('cx') > {x}) \
         h.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'ArrowLeft', shiftKey: true }})); }})()"
    ));
    drag(&mut browser, RIM, [4.0, 0.0]);
    assert!(circle(&mut browser, "r") > radius);
    settle(&mut browser);
    browser.wait_for("document.getElementById('ball-pill').dataset.tone === 'good'");
    // The ground from a rectangle, which starts on the assumed ground.
    browser.evaluate("document.querySelector('[name=ground][value=corners]').click()");
    drag(&mut browser, ".handle[data-kind=corner] .dot", [5.0, 4.0]);
    settle(&mut browser);
    browser.wait_for("document.getElementById('ground-facts').textContent.includes('Error')");
    keep("photo-page-corners.png", &browser.screenshot(false));
    browser.evaluate("document.getElementById('compose').click()");
    browser.wait_for("!document.getElementById('composite').hidden");
    browser.wait_for("document.getElementById('composite').naturalWidth === 480");
    assert!(text(&mut browser, "lines").contains("check: the ball put back"));
    browser.wait_for("!document.getElementById('done').disabled");
    keep("photo-page-composite.png", &browser.screenshot(false));
    browser.evaluate("document.getElementById('done').click()");
    browser.wait_for("document.body.dataset.ended === 'yes'");
    assert!(text(&mut browser, "phase-text").contains("is written"));
    let mut printed = String::new();
    page.printed.read_to_string(&mut printed).unwrap();
    assert!(page.program.wait().unwrap().success());
    assert!(printed.contains("--ground "), "{printed}");
    let out = std::fs::read(page.folder.path().join("out.png")).unwrap();
    assert_eq!(Picture::from_file_bytes(&out).unwrap().width, 480);
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn page_of_a_phone_is_used_by_touch_and_without_a_ball() {
    let Some(mut browser) = browser("page_of_a_phone_is_used_by_touch_and_without_a_ball") else {
        return;
    };
    browser.resize(390, 844);
    let _page = Page::open(&mut browser, &["empty.jpg", "empty.jpg"]);
    assert!(text(&mut browser, "ball-trouble").contains("No ball was found"));
    let before = [circle(&mut browser, "cx"), circle(&mut browser, "cy")];
    let from = browser.middle_of(CENTRE);
    browser.swipe(from, [from[0] - 40.0, from[1] + 30.0]);
    let after = [circle(&mut browser, "cx"), circle(&mut browser, "cy")];
    assert!(
        after[0] < before[0] - 20.0 && after[1] > before[1] + 10.0,
        "{before:?} {after:?}"
    );
    let tilt = "document.querySelector('[name=ground][value=tilt]').checked";
    browser.wait_for(tilt);
    let fits = "document.documentElement.scrollWidth <= document.documentElement.clientWidth";
    browser.wait_for(fits);
    keep("photo-page-phone.png", &browser.screenshot(true));
    assert_eq!(browser.complaints(), [""; 0]);
}
