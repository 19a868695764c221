//! Virtual objects are moved on the picture.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{Program, browser, keep, open, picture_region};
use std::time::{Duration, Instant};

/// Middle and number of the pixels of the red teapot in the picture, pixels of the page.
fn teapot(browser: &mut Chromium) -> ([f64; 2], usize) {
    let picture = picture_region(browser);
    let is_red = |p: &image::Rgb<u8>| p[0] > 120 && p[0] / 2 > p[1].max(p[2]);
    let red = picture.enumerate_pixels().filter(|(_, _, p)| is_red(p));
    let at: Vec<_> = red.map(|(x, y, _)| [f64::from(x), f64::from(y)]).collect();
    let mean = |i: usize| at.iter().map(|p| p[i]).sum::<f64>() / at.len().max(1) as f64;
    ([mean(0), mean(1)], at.len())
}

/// Waits until the teapot is as wanted.
fn wait_for_teapot(browser: &mut Chromium, what: &str, holds: impl Fn([f64; 2], usize) -> bool) {
    let deadline = Instant::now() + Duration::from_secs(90);
    loop {
        let (middle, size) = teapot(browser);
        if holds(middle, size) {
            return;
        }
        assert!(Instant::now() < deadline, "{what}: {middle:?}, {size}");
        std::thread::sleep(Duration::from_millis(200));
    }
}

const SHOWN: &str = "fetch('/status').then((r) => r.json()).then((s) => s.objects.requested > 0 && s.objects.requested === s.objects.shown)";

fn slide(browser: &mut Chromium, id: &str, value: &str) {
    browser.evaluate(&format!(
        "(() => {{ const f = document.getElementById('{id}'); f.value = '{value}'; \
         f.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    ));
}

/// A page of a paused replay in which objects can be moved.
fn paused(browser: &mut Chromium, address: &str) {
    browser.resize(1280, 800);
    browser.open(address);
    browser.wait_for("document.body.dataset.link === 'up'");
    browser.wait_for("document.getElementById('picture').naturalWidth === 640");
    browser.wait_for("!document.getElementById('move').disabled");
    browser.evaluate("document.getElementById('play').click()");
    browser.wait_for("document.getElementById('state-pill').textContent === 'paused'");
    // At its beginning no pose is known, so nothing virtual is shown.
    slide(browser, "position", "500");
    browser.wait_for("fetch('/status').then((r) => r.json()).then((s) => s.playback.jumps === 1 && s.registration.source === 'tracker')");
    browser.evaluate("document.getElementById('move').click()");
    std::thread::sleep(Duration::from_millis(800));
}

#[test]
fn an_object_is_dragged_turned_and_scaled() {
    let Some(mut browser) = browser("an_object_is_dragged_turned_and_scaled") else {
        return;
    };
    let (_program, address) = Program::replay();
    paused(&mut browser, &address);
    let (middle, size) = teapot(&mut browser);
    assert!(size > 5000, "{size} red pixels");
    let corner = browser.evaluate("(() => { const r = document.getElementById('picture').getBoundingClientRect(); return [r.x, r.y]; })()");
    let corner = [0, 1].map(|i| corner[i].as_f64().unwrap());
    let from = [0, 1].map(|i| corner[i] + middle[i]);
    browser.drag(from, [from[0] - 90.0, from[1] + 40.0]);
    browser.wait_for("document.getElementById('object').value === '0'");
    browser.wait_for(SHOWN);
    wait_for_teapot(&mut browser, "not dragged", |now, _| {
        now[0] < middle[0] - 40.0 && now[1] > middle[1] + 10.0
    });
    keep("object-moved.png", &browser.screenshot(false));
    // Undone and redone, by button and by keyboard.
    let (moved, _) = teapot(&mut browser);
    browser.evaluate("document.getElementById('object-undo').click()");
    let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 3.0 && (a[1] - b[1]).abs() < 3.0;
    wait_for_teapot(&mut browser, "not undone", |now, _| near(now, middle));
    browser.wait_for("document.getElementById('object-undo').disabled");
    browser.evaluate(&shortcut("y"));
    wait_for_teapot(&mut browser, "not redone", |now, _| near(now, moved));
    browser.wait_for("document.getElementById('object-redo').disabled");
    browser.evaluate(&shortcut("z"));
    wait_for_teapot(&mut browser, "not undone by key", |now, _| {
        near(now, middle)
    });
    browser.evaluate("document.getElementById('object-redo').click()");
    wait_for_teapot(&mut browser, "not redone", |now, _| near(now, moved));
    slide(&mut browser, "size", "-1");
    wait_for_teapot(&mut browser, "not smaller", |_, now| now < size / 2);
    browser.wait_for("document.getElementById('size-text').textContent === '50 %'");
    slide(&mut browser, "turn", "90");
    browser.wait_for("fetch('/status').then((r) => r.json()).then((s) => Math.abs(s.objects.list[0].turn_deg - 90) < 0.01 && s.objects.shown === s.objects.requested)");
    // By keyboard.
    let x = "fetch('/status').then((r) => r.json()).then((s) => s.objects.list[0].offset_m[0])";
    let before = browser.evaluate(x).as_f64().unwrap();
    browser.evaluate("document.getElementById('object').focus()");
    browser.press("ArrowRight", 39);
    browser.wait_for(&format!(
        "{x}.then((x) => Math.abs(x - {before} - 0.01) < 1e-6)"
    ));
    browser.evaluate("document.getElementById('object-reset').click()");
    wait_for_teapot(&mut browser, "not back", |now, pixels| {
        (now[0] - middle[0]).abs() < 3.0 && pixels.abs_diff(size) < size / 10
    });
    // Putting back is a move, too; before it are the step by key, the turn, the size and the drag.
    for _ in 0..4 {
        browser.evaluate("document.getElementById('object-undo').click()");
        browser.wait_for(SHOWN);
    }
    wait_for_teapot(&mut browser, "not undone", |now, _| near(now, moved));
    browser.evaluate("document.getElementById('object-undo').click()");
    wait_for_teapot(&mut browser, "not undone", |now, _| near(now, middle));
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Presses a key with Ctrl, as far as the page can tell.
fn shortcut(key: &str) -> String {
    format!(
        "document.body.dispatchEvent(new KeyboardEvent('keydown', \
         {{ key: '{key}', ctrlKey: true, bubbles: true, cancelable: true }}))"
    )
}

#[test]
fn nothing_is_picked_beside_the_objects_and_the_sky_takes_none() {
    let Some(mut browser) = browser("nothing_is_picked_beside_the_objects_and_the_sky_takes_none")
    else {
        return;
    };
    let (_program, address) = Program::replay();
    paused(&mut browser, &address);
    let post = |body: &str| {
        format!(
            "fetch('/objects', {{ method: 'POST', headers: {{ 'Content-Type': 'application/json' }}, body: '{body}' }}).then((r) => r.json())"
        )
    };
    let answer = browser.evaluate(&post(r#"{"at": [0.02, 0.98]}"#));
    assert!(answer["object"].is_null(), "{answer}");
    // The ground is there, at its height.
    assert!(
        answer["real_m"][2].as_f64().unwrap().abs() < 0.01,
        "{answer}"
    );
    let answer = browser.evaluate(&post(r#"{"object": 7, "scale": 2}"#));
    assert_eq!(answer["error"], "object: there is no object 7");
    browser.evaluate(&post(r#"{"object": 0, "scale": 99}"#));
    let scale = browser
        .evaluate("fetch('/status').then((r) => r.json()).then((s) => s.objects.list[0].scale)");
    assert_eq!(scale, 1, "refused");
}

#[test]
fn without_virtual_objects_the_button_says_why_it_is_closed() {
    let Some(mut browser) = browser("without_virtual_objects_the_button_says_why_it_is_closed")
    else {
        return;
    };
    let show = Show::start();
    open(&mut browser, &show);
    assert_eq!(
        browser.evaluate("document.getElementById('move').disabled"),
        true
    );
    browser
        .wait_for("document.getElementById('move-hint').textContent.includes('no virtual object')");
}
