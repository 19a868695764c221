//! Settings: each control is confirmed by the rig's own state.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{browser, keep, open};
use penumbra_config::{LightPlacement, Technique};
use penumbra_status::Settings;
use penumbra_status::planes::PlanesState;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Moves a slider or chooses an option.
fn set(browser: &mut Chromium, name: &str, value: &str) {
    browser.evaluate(&format!(
        "(() => {{ const f = document.querySelector('[name={name}]'); f.value = '{value}'; \
         f.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    ));
}

fn click(browser: &mut Chromium, selector: &str) {
    browser.evaluate(&format!("document.querySelector('{selector}').click()"));
}

fn value(browser: &mut Chromium, name: &str) -> String {
    let value = browser.evaluate(&format!("document.querySelector('[name={name}]').value"));
    value.as_str().unwrap_or_default().to_owned()
}

/// The requested settings.
fn requested(show: &Show) -> Settings {
    show.shared.settings_receiver().borrow().clone()
}

const CONFIRMED: &str = "!document.querySelector('#settings [data-pending]')";

#[test]
fn a_change_is_kept_when_another_control_is_touched_at_once() {
    let Some(mut browser) = browser("a_change_is_kept_when_another_control_is_touched_at_once")
    else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    // In one task of the page, so all within the delay of the first slider.
    browser.evaluate(
        "(() => { const slide = (name, value) => { const f = document.querySelector(`[name=${name}]`); \
         f.value = value; f.dispatchEvent(new Event('input', { bubbles: true })); }; \
         slide('shadow_strength', 0.25); slide('planes_skip_below', 0.03); slide('exposure_key', 0.4); \
         document.querySelector('[name=indirect_light]').click(); \
         document.querySelector('[name=light_placement][value=grid]').click(); })()",
    );
    browser.wait_for(CONFIRMED);
    let settings = requested(&show);
    let sliders = (
        settings.shadow_strength,
        settings.planes_skip_below,
        settings.exposure_key,
    );
    assert_eq!(sliders, (0.25, 0.03, 0.4));
    assert!(!settings.indirect_light);
    assert_eq!(settings.light_placement, LightPlacement::Grid);
    assert_eq!(value(&mut browser, "shadow_strength"), "0.25");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn a_slow_rig_confirms_late_and_nothing_is_said_to_be_refused() {
    let Some(mut browser) = browser("a_slow_rig_confirms_late_and_nothing_is_said_to_be_refused")
    else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    show.held.store(true, Ordering::Relaxed);
    std::thread::sleep(Duration::from_millis(100));
    set(&mut browser, "light_count", "96");
    std::thread::sleep(Duration::from_secs(6));
    // The choice stands, marked as not active yet, and the page says what it waits for.
    assert_eq!(value(&mut browser, "light_count"), "96");
    browser.wait_for("document.querySelector('[data-name=light_count]').matches('[data-pending]')");
    let note = browser.evaluate("document.getElementById('adjust-note').textContent");
    assert_eq!(note, "With the next picture: Dome lights");
    assert_eq!(
        browser.evaluate("document.getElementById('light_count-trouble').hidden"),
        true
    );
    // A page that is opened now shows the same.
    open_again(&mut browser, &show);
    browser.wait_for("document.querySelector('[data-name=light_count]').matches('[data-pending]')");
    show.held.store(false, Ordering::Relaxed);
    browser.wait_for(CONFIRMED);
    assert_eq!(value(&mut browser, "light_count"), "96");
    assert_eq!(browser.complaints(), [""; 0]);
}

fn open_again(browser: &mut Chromium, show: &Show) {
    browser.open(&format!("http://{}/", show.address));
    browser.wait_for("document.body.dataset.link === 'up'");
}

#[test]
fn a_refused_change_says_why_and_the_control_returns_to_the_rigs_value() {
    let Some(mut browser) =
        browser("a_refused_change_says_why_and_the_control_returns_to_the_rigs_value")
    else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.evaluate("document.querySelector('[name=exposure_ev]').max = 20");
    click(&mut browser, "[name=exposure_mode][value=manual]");
    set(&mut browser, "exposure_ev", "12");
    browser.wait_for("document.getElementById('exposure_ev-trouble').checkVisibility()");
    let reason = browser.evaluate("document.getElementById('exposure_ev-trouble').textContent");
    assert_eq!(reason, "12 is out of range; choose a number from -8 to 3");
    assert_eq!(value(&mut browser, "exposure_ev"), "0");
    keep("refused.png", &browser.screenshot(false));
    // The reason stays until the control is changed, and a valid value removes it.
    std::thread::sleep(Duration::from_secs(1));
    browser.wait_for("document.getElementById('exposure_ev-trouble').checkVisibility()");
    set(&mut browser, "exposure_ev", "1");
    browser.wait_for("!document.getElementById('exposure_ev-trouble').checkVisibility()");
    browser.wait_for(CONFIRMED);
    assert_eq!(requested(&show).exposure_ev, 1.0);
}

#[test]
fn a_bake_shows_its_progress_and_can_be_cancelled() {
    let Some(mut browser) = browser("a_bake_shows_its_progress_and_can_be_cancelled") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    set(&mut browser, "technique", "shadowing-planes");
    browser.wait_for(CONFIRMED);
    show.held.store(true, Ordering::Relaxed);
    std::thread::sleep(Duration::from_millis(100));
    show.shared.update(|s| {
        s.planes.state = PlanesState::Baking {
            done: 10,
            total: 40,
        };
    });
    click(&mut browser, "#research-card > summary");
    browser.wait_for("document.getElementById('technique-progress').checkVisibility()");
    browser.wait_for("document.querySelector('#technique-progress progress').value === 0.25");
    browser.wait_for("document.getElementById('technique-hint').textContent.includes('25 %')");
    keep("bake.png", &browser.screenshot(false));
    click(&mut browser, "#technique-cancel");
    browser
        .wait_for("document.querySelector('[name=technique]').value === 'image-based-shadowing'");
    assert_eq!(requested(&show).technique, Technique::ImageBasedShadowing);
    show.held.store(false, Ordering::Relaxed);
    browser.wait_for("!document.getElementById('technique-progress').checkVisibility()");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn undo_redo_and_reset() {
    let Some(mut browser) = browser("undo_redo_and_reset") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.wait_for("document.getElementById('undo').disabled");
    // The steps of one slide are one change.
    for value in ["0.9", "0.8", "0.7"] {
        set(&mut browser, "shadow_strength", value);
    }
    browser.wait_for("!document.getElementById('undo').disabled");
    browser.wait_for(CONFIRMED);
    set(&mut browser, "light_count", "24");
    browser.wait_for(CONFIRMED);
    click(&mut browser, "#undo");
    browser.wait_for("document.querySelector('[name=light_count]').value === '64'");
    // By keyboard.
    browser.evaluate("document.body.dispatchEvent(new KeyboardEvent('keydown', { key: 'z', ctrlKey: true, bubbles: true }))");
    browser.wait_for("document.querySelector('[name=shadow_strength]').value === '1'");
    assert_eq!(requested(&show), Settings::default());
    browser.wait_for("document.getElementById('undo').disabled");
    click(&mut browser, "#redo");
    browser.wait_for("document.querySelector('[name=shadow_strength]').value === '0.7'");
    click(&mut browser, "#reset");
    browser.wait_for("document.getElementById('reset').disabled");
    assert_eq!(requested(&show), Settings::default());
    click(&mut browser, "#undo");
    browser.wait_for("document.querySelector('[name=shadow_strength]').value === '0.7'");
    assert_eq!(requested(&show).shadow_strength, 0.7);
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn presets_are_applied_kept_and_deleted() {
    let Some(mut browser) = browser("presets_are_applied_kept_and_deleted") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    let choose = |browser: &mut Chromium, name: &str| {
        browser.evaluate(&format!(
            "(() => {{ const p = document.getElementById('preset'); p.value = '{name}'; \
             p.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
        ));
    };
    let preset = |name: &str| format!("document.getElementById('preset').value === '{name}'");
    browser.wait_for(&preset("As configured"));
    choose(&mut browser, "Supan 2006");
    browser.wait_for("document.querySelector('[name=light_placement][value=grid]').checked");
    assert_eq!(requested(&show).light_placement, LightPlacement::Grid);
    set(&mut browser, "shadow_strength", "0.3");
    browser.wait_for(CONFIRMED);
    browser.evaluate("document.getElementById('preset-name').value = 'Evening'");
    click(&mut browser, "#preset-form [type=submit]");
    browser.wait_for(&preset("Evening"));
    choose(&mut browser, "As configured");
    browser.wait_for("document.getElementById('reset').disabled");
    assert_eq!(requested(&show), Settings::default());
    // It is still there in a page that is opened later.
    open_again(&mut browser, &show);
    browser.wait_for("document.getElementById('preset').options.length > 6");
    choose(&mut browser, "Evening");
    browser.wait_for("document.querySelector('[name=shadow_strength]').value === '0.3'");
    assert_eq!(requested(&show).shadow_strength, 0.3);
    keep("presets.png", &browser.screenshot(false));
    browser.wait_for("!document.getElementById('preset-delete').disabled");
    click(&mut browser, "#preset-delete");
    browser.wait_for(
        "![...document.getElementById('preset').options].some((o) => o.value === 'Evening')",
    );
    assert_eq!(browser.complaints(), [""; 0]);
}
