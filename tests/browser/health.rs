//! Health, log and lamps: green only where green is true.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{Program, SESSION, browser, keep, open};
use penumbra_status::registration::RegistrationSource;
use penumbra_status::snapshot::{DeviceState, LampStatus, SessionState};
use serde_json::Value;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The tone of a sign; empty if it is not there.
fn tone(name: &str) -> String {
    format!(
        "([...document.querySelectorAll('#health .pill')].find((p) => p.textContent === '{name}')?.dataset.tone ?? '')"
    )
}

fn wait_for_tone(browser: &mut Chromium, name: &str, expected: &str) {
    browser.wait_for(&format!("{} === '{expected}'", tone(name)));
}

/// Names of the green signs and the tone of the whole.
fn green(browser: &mut Chromium) -> Vec<Value> {
    let found = browser.evaluate("[...document.querySelectorAll('#health .pill[data-tone=good], #state-pill[data-tone=good]')].map((p) => p.textContent)");
    found.as_array().unwrap().clone()
}

#[test]
fn green_ends_with_the_truth_of_what_it_says() {
    let Some(mut browser) = browser("green_ends_with_the_truth_of_what_it_says") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    let all = ["Picture", "Pose", "Light", "Graphics"];
    show.shared.update(|s| {
        s.devices
            .iter_mut()
            .for_each(|d| d.enter(DeviceState::Streaming, None));
    });
    for name in all {
        wait_for_tone(&mut browser, name, "good");
    }
    browser.wait_for("document.getElementById('state-pill').dataset.tone === 'good'");
    // No pose.
    show.shared
        .update(|s| s.registration.source = RegistrationSource::None);
    wait_for_tone(&mut browser, "Pose", "bad");
    browser.wait_for("document.getElementById('state-pill').dataset.tone === 'bad'");
    show.shared
        .update(|s| s.registration.source = RegistrationSource::Tracker);
    wait_for_tone(&mut browser, "Pose", "good");
    // Old light.
    show.shared
        .update(|s| s.lighting.stale = Some("no pictures of the environment".to_owned()));
    wait_for_tone(&mut browser, "Light", "bad");
    browser.wait_for("document.getElementById('health').textContent.includes('Old light: no pictures of the environment.')");
    show.shared.update(|s| s.lighting.stale = None);
    // A lost graphics device.
    show.shared.update(|s| s.adapter.losses = 1);
    wait_for_tone(&mut browser, "Graphics", "warn");
    // A device that has failed.
    show.shared.update(|s| {
        s.devices[2].enter(DeviceState::Failed, Some("/dev/ttyUSB0: no such device"));
    });
    wait_for_tone(&mut browser, "Tracker", "bad");
    keep("health-faults.png", &browser.screenshot(false));
    // The picture stands still: nothing is green any more, because nothing is known to be so now.
    show.held.store(true, Ordering::Relaxed);
    wait_for_tone(&mut browser, "Picture", "bad");
    assert_eq!(green(&mut browser), [""; 0]);
    keep("health-stale.png", &browser.screenshot(false));
    show.shared.update(|s| {
        s.session
            .enter_because(SessionState::Failed, "out of memory")
    });
    browser.wait_for(
        "document.getElementById('state-description').textContent.includes('out of memory')",
    );
    assert_eq!(browser.complaints(), [""; 0]);
    // No connection.
    drop(show);
    browser.wait_for("document.body.dataset.link === 'lost'");
    assert_eq!(green(&mut browser), [""; 0]);
    wait_for_tone(&mut browser, "Pose", "idle");
}

#[test]
fn nothing_is_green_after_a_rig_was_killed() {
    let Some(mut browser) = browser("nothing_is_green_after_a_rig_was_killed") else {
        return;
    };
    let (program, address) = Program::start(&["replay", SESSION, "--loop"]);
    browser.open(&address);
    browser.wait_for("document.body.dataset.link === 'up'");
    for name in ["Picture", "Pose", "Light", "Graphics", "Tracker"] {
        wait_for_tone(&mut browser, name, "good");
    }
    drop(program);
    browser.wait_for("document.body.dataset.link === 'lost'");
    assert_eq!(green(&mut browser), [""; 0]);
}

#[test]
fn log_shows_events_by_level() {
    let Some(mut browser) = browser("log_shows_events_by_level") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    let has = |text: &str| format!("document.getElementById('log').textContent.includes('{text}')");
    browser.wait_for(&has("sources are clipped"));
    show.shared.update(|s| s.adapter.losses += 1);
    browser.wait_for(&has("the graphics device was lost"));
    browser.evaluate("document.querySelector('[name=light_count]').value = '96'");
    browser.evaluate("document.querySelector('[name=light_count]').dispatchEvent(new Event('input', { bubbles: true }))");
    browser.wait_for(&has("light_count = 96"));
    let first = browser.evaluate("document.querySelector('#log li').textContent");
    assert!(
        first.to_string().contains("light_count"),
        "newest first: {first}"
    );
    browser.wait_for("/^[0-9:]{8}$/.test(document.querySelector('#log time').textContent)");
    let count = "document.querySelectorAll('#log li').length";
    browser.evaluate("(() => { const l = document.getElementById('log-level'); l.value = 'error'; l.dispatchEvent(new Event('change')); })()");
    browser.wait_for(&format!("{count} === 1"));
    // Repetitions are one line.
    for _ in 0..20 {
        show.shared.update(|s| s.adapter.losses += 1);
    }
    browser.wait_for(&has("(21 times)"));
    assert_eq!(browser.evaluate(count), 1);
    keep("log.png", &browser.screenshot(true));
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn lamps_are_drawn_over_the_environment_and_in_a_plan() {
    let Some(mut browser) = browser("lamps_are_drawn_over_the_environment_and_in_a_plan") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    show.shared.update(|s| {
        let near = LampStatus {
            direction: [0.0, 0.8, 0.6],
            position: Some([0.0, 0.8, 0.6]),
            distance_m: Some(1.0),
            distance_sigma_m: Some(0.1),
            clipped: 0.2,
            ..LampStatus::default()
        };
        let far = LampStatus {
            direction: [0.36, 0.48, 0.8],
            unseen: true,
            ..LampStatus::default()
        };
        s.lighting.lamps = vec![near, far];
    });
    browser.wait_for("document.querySelectorAll('#lamp-marks circle').length === 2");
    // +Y is a quarter of the width left of the middle; the elevation is 37°.
    let at = browser.evaluate("['cx', 'cy'].map((a) => Number(document.querySelector('#lamp-marks circle').getAttribute(a)))");
    let [x, y] = [0, 1].map(|i| at[i].as_f64().unwrap());
    assert!(
        (x - 128.0).abs() < 0.01 && (y - 75.5).abs() < 0.1,
        "{x}, {y}"
    );
    browser.wait_for("document.getElementById('lamp-list').textContent.includes('1: 1.00 ± 0.10 m, 20 % clipped')");
    browser.wait_for("document.getElementById('lamp-list').textContent.includes('2: too far to tell, not seen by the environment camera')");
    let dashed =
        "[...document.querySelectorAll('#lamp-marks circle')].map((c) => c.className.baseVal)";
    assert_eq!(browser.evaluate(dashed), serde_json::json!(["", "unseen"]));
    // In the plan the near lamp is above the camera, the far one a dashed line.
    let plan = browser.evaluate("(() => { const c = document.querySelector('#lamp-plan circle:not(.ring)'); return [Number(c.getAttribute('cx')), Number(c.getAttribute('cy')), document.querySelectorAll('#lamp-plan .far').length]; })()");
    assert_eq!((&plan[0], &plan[2]), (&100.into(), &1.into()));
    assert!(plan[1].as_f64() < Some(60.0), "{plan}");
    std::thread::sleep(Duration::from_millis(300));
    browser.evaluate("document.querySelector('.environment').scrollIntoView()");
    keep("lamps.png", &browser.screenshot(false));
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Pairs of labels that overlap, or that a mark of another lamp lies in.
const OVERLAPS: &str = "(() => { const found = []; for (const svg of ['lamp-marks', 'lamp-plan']) { \
    const boxes = [...document.querySelectorAll(`#${svg} text:not(.ring-text)`)].map((t) => [t.textContent, t.getBBox()]); \
    boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => { \
      const over = (from, size) => Math.min(p[from] + p[size], q[from] + q[size]) - Math.max(p[from], q[from]); \
      if (over('x', 'width') > 1 && over('y', 'height') > 1) found.push(`${svg}: ${a}, ${b}`); })); } return found; })()";

#[test]
fn labels_of_lamps_close_to_one_another_do_not_overlap() {
    let Some(mut browser) = browser("labels_of_lamps_close_to_one_another_do_not_overlap") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    let lamp = |azimuth: f64, elevation: f64, distance: f64| {
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        LampStatus {
            direction: [
                azimuth.cos() * elevation.cos(),
                azimuth.sin() * elevation.cos(),
                elevation.sin(),
            ],
            position: Some([0.0; 3]),
            distance_m: Some(distance),
            distance_sigma_m: Some(0.05),
            clipped: 0.0,
            unseen: false,
        }
    };
    // A ceiling light of six lamps, and two at the edges of the picture.
    show.shared.update(|s| {
        let row = (0..6).map(|i| lamp(30.0 + 3.0 * f64::from(i), 50.0, 1.5));
        let edges = [lamp(179.0, 85.0, 2.0), lamp(-179.0, -80.0, 2.0)];
        s.lighting.lamps = row.chain(edges).collect();
    });
    browser.wait_for("document.querySelectorAll('#lamp-marks circle').length === 8");
    for (width, height) in [(1280, 800), (390, 844)] {
        browser.resize(width, height);
        std::thread::sleep(Duration::from_millis(1200));
        browser.evaluate("document.querySelector('.environment').scrollIntoView()");
        keep(
            &format!("lamps-close-{width}.png"),
            &browser.screenshot(false),
        );
        assert_eq!(browser.evaluate(OVERLAPS), serde_json::json!([]), "{width}");
    }
    assert_eq!(browser.complaints(), [""; 0]);
}
