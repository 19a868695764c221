//! Playback of a recording: pause, position, loop.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{
    browser, keep, open, open_replay, picture_region, share_that_differs, wait_for_motion,
};
use serde_json::Value;
use std::time::Duration;

/// A value of `/status`.
fn status(browser: &mut Chromium, path: &str) -> Value {
    browser.evaluate(&format!(
        "fetch('/status').then((r) => r.json()).then((s) => s.{path})"
    ))
}

fn scrub(browser: &mut Chromium, thousandths: u32) {
    browser.evaluate(&format!(
        "(() => {{ const p = document.getElementById('position'); p.value = '{thousandths}'; \
         p.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    ));
}

/// Whether the rig shows a picture of after a jump.
fn jumped(number: u32) -> String {
    format!("fetch('/status').then((r) => r.json()).then((s) => s.playback.jumps === {number})")
}

#[test]
fn recording_is_paused_scrubbed_and_played_on() {
    let Some(mut browser) = browser("recording_is_paused_scrubbed_and_played_on") else {
        return;
    };
    let _program = open_replay(&mut browser);
    browser.wait_for("document.getElementById('play').checkVisibility()");
    wait_for_motion(&mut browser);
    browser.evaluate("document.getElementById('play').click()");
    browser.wait_for("document.getElementById('play').textContent === 'Play'");
    // At its beginning no pose is known, so nothing virtual is shown.
    scrub(&mut browser, 500);
    browser.wait_for(&jumped(1));
    browser.wait_for("document.getElementById('state-pill').textContent === 'paused'");
    std::thread::sleep(Duration::from_millis(800));
    let still = picture_region(&mut browser);
    let progress = status(&mut browser, "session.progress");
    std::thread::sleep(Duration::from_millis(800));
    let later = picture_region(&mut browser);
    assert!(share_that_differs(&still, &later) < 0.002, "it moves");
    assert_eq!(status(&mut browser, "session.progress"), progress);
    // Settings take effect meanwhile.
    browser.evaluate("document.querySelector('[name=virtual_object_visible]').click()");
    browser.wait_for("!document.querySelector('#settings [data-pending]')");
    crate::wait_for_picture(&mut browser, "lost its object", |p| {
        share_that_differs(&still, p) > 0.01
    });
    browser.evaluate("document.querySelector('[name=virtual_object_visible]').click()");
    // It goes where the slider goes, back and forth, and stays paused.
    for (jump, thousandths) in [(2, 750), (3, 250)] {
        scrub(&mut browser, thousandths);
        browser.wait_for(&jumped(jump));
        let share = f64::from(thousandths) / 1000.0;
        let at = status(&mut browser, "session.progress").as_f64().unwrap();
        assert!((at - share).abs() < 0.05, "{at} instead of {share}");
        browser.wait_for(&format!(
            "Math.abs(document.getElementById('position').value - {thousandths}) < 50"
        ));
    }
    assert_eq!(status(&mut browser, "playback.paused"), true);
    keep("playback.png", &browser.screenshot(false));
    browser.evaluate("document.getElementById('play').click()");
    browser.wait_for("document.getElementById('state-pill').textContent === 'replaying'");
    wait_for_motion(&mut browser);
    // Without the loop it pauses at its end instead of ending.
    browser.evaluate("document.getElementById('repeat').click()");
    browser.wait_for("fetch('/status').then((r) => r.json()).then((s) => !s.playback.repeat)");
    browser.wait_for("document.getElementById('play').textContent === 'Play'");
    let loops = status(&mut browser, "session.loops");
    // Played on, it starts again, and pauses at its end again.
    browser.evaluate("document.getElementById('play').click()");
    browser.wait_for(&format!(
        "fetch('/status').then((r) => r.json()).then((s) => s.session.loops > {loops} && s.playback.paused)"
    ));
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn playback_that_cannot_be_controlled_says_why() {
    let Some(mut browser) = browser("playback_that_cannot_be_controlled_says_why") else {
        return;
    };
    let show = Show::start();
    open(&mut browser, &show);
    assert_eq!(
        browser.evaluate("document.getElementById('playback').hidden"),
        true
    );
    let closed = Some("every picture is being written to a file");
    show.shared.open_playback(true, Some(12.0), closed);
    browser.wait_for("document.getElementById('playback').checkVisibility()");
    browser.wait_for("document.getElementById('playback-hint').textContent.includes('every picture is being written')");
    assert_eq!(
        browser.evaluate("document.getElementById('play').disabled"),
        true
    );
    assert_eq!(browser.complaints(), [""; 0]);
}
