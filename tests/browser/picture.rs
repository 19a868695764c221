//! The comparison of the composited picture with the camera's.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{browser, keep, open, open_replay};

/// Sets the line, in per cent of the width.
fn wipe(browser: &mut Chromium, percent: u32) {
    browser.evaluate(&format!(
        "(() => {{ const w = document.getElementById('wipe'); w.value = '{percent}'; \
         w.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    ));
}

/// Share of the pixels of the two halves of one pair that differ by more than 24, in the whole
/// picture and in a frame along its border.
const DIFFERENCES: &str = r"(() => {
  const pair = document.getElementById('pair');
  const [w, h] = [pair.naturalWidth, pair.naturalHeight / 2];
  const canvas = new OffscreenCanvas(w, 2 * h);
  const context = canvas.getContext('2d');
  context.drawImage(pair, 0, 0);
  const data = context.getImageData(0, 0, w, 2 * h).data;
  let [all, border, borders] = [0, 0, 0];
  for (let y = 0; y < h; y += 1) for (let x = 0; x < w; x += 1) {
    const [a, b] = [4 * (y * w + x), 4 * ((y + h) * w + x)];
    const differs = [0, 1, 2].some((c) => Math.abs(data[a + c] - data[b + c]) > 24);
    const edge = x < 24 || y < 24 || x >= w - 24 || y >= h - 24;
    all += differs; border += differs && edge; borders += edge;
  }
  return [all / (w * h), border / borders];
})()";

#[test]
fn wipe_compares_the_picture_with_the_cameras_of_the_same_frame() {
    let Some(mut browser) = browser("wipe_compares_the_picture_with_the_cameras_of_the_same_frame")
    else {
        return;
    };
    let _program = open_replay(&mut browser);
    browser.evaluate("document.getElementById('compare').click()");
    browser.wait_for("document.getElementById('pair').naturalHeight === 960");
    // The stream of the composited picture is closed: nobody looks at it.
    browser.wait_for("fetch('/status').then(r => r.json()).then(s => s.stream.viewers === 1)");
    // At the recording's beginning no pose is known, so nothing virtual is shown.
    browser.wait_for(&format!("{DIFFERENCES}[0] > 0.01"));
    // The camera moves. The halves are of the same frame if they agree where nothing is virtual.
    for _ in 0..5 {
        let differences = browser.evaluate(DIFFERENCES);
        let [all, border] = [0, 1].map(|i| differences[i].as_f64().unwrap());
        assert!(all < 0.5, "{all}");
        assert!(border < 0.001, "another frame: {border}");
        std::thread::sleep(std::time::Duration::from_millis(150));
    }
    wipe(&mut browser, 60);
    browser.wait_for("document.getElementById('wipe-canvas').width === 640");
    keep("wipe.png", &browser.screenshot(false));
    browser.evaluate("document.getElementById('compare').click()");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    browser.wait_for("fetch('/status').then(r => r.json()).then(s => s.stream.viewers === 1)");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn wipe_follows_mouse_touch_and_keyboard() {
    let Some(mut browser) = browser("wipe_follows_mouse_touch_and_keyboard") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    assert!(
        !show.shared.wants_pair(),
        "costs nothing when nobody compares"
    );
    browser.evaluate("document.getElementById('compare').click()");
    browser.wait_for("document.getElementById('wipe-canvas').width === 640");
    assert!(show.shared.wants_pair() && !show.shared.wants_picture());
    // The middle of the picture, left and right of the line: the virtual ball is orange.
    let orange = "(() => { const o = new OffscreenCanvas(640, 1).getContext('2d', { willReadFrequently: true }); o.drawImage(document.getElementById('wipe-canvas'), 0, -240); const d = o.getImageData(0, 0, 640, 1).data; let n = 0; for (let x = 0; x < 640; x += 1) n += d[4 * x] > d[4 * x + 2] + 60 && d[4 * x] > 100; return n; })()";
    wipe(&mut browser, 0);
    browser.wait_for(&format!("{orange} > 60"));
    wipe(&mut browser, 100);
    browser.wait_for(&format!("{orange} === 0"));
    let value = "document.getElementById('wipe').value";
    let [x, y] = browser.middle_of("#wipe-canvas");
    browser.drag([x, y], [x - 100.0, y]);
    browser.wait_for(&format!("{value} > 20 && {value} < 40"));
    browser.tap("#wipe-canvas");
    browser.wait_for(&format!("{value} === '50'"));
    browser.evaluate("document.getElementById('wipe').focus()");
    browser.press("ArrowRight", 39);
    browser.wait_for(&format!("{value} === '51'"));
    assert_eq!(
        browser.evaluate("document.getElementById('wipe-text').textContent"),
        "51 %"
    );
    assert_eq!(browser.complaints(), [""; 0]);
}
