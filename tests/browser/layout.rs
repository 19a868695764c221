//! Layout, themes, contrast, text sizes and keyboard.

use crate::support::chromium::Chromium;
use crate::support::show::Show;
use crate::{browser, keep, open};
use serde_json::Value;
use std::time::Duration;

/// Names and sizes: telephone, desktop, 4K.
const SIZES: [(&str, u32, u32); 3] = [
    ("phone", 390, 844),
    ("desktop", 1280, 800),
    ("4k", 3840, 2160),
];

/// Opens every part of the page that is folded.
const UNFOLD: &str = "(() => { document.querySelectorAll('details').forEach((d) => { d.open = true; }); \
    document.querySelectorAll('.help').forEach((b) => b.click()); })()";

/// Lists texts that are smaller than 12 px, or whose contrast with what is behind them is below
/// WCAG's AA: 4.5, or 3 for large text. Colours are read as the browser computes them.
const TEXTS: &str = r"(() => {
  const parse = (text) => { const n = text.match(/[\d.]+/g).map(Number); return text.startsWith('color(srgb') ? [...n.slice(0, 3).map((x) => 255 * x), n[3] ?? 1] : [n[0], n[1], n[2], n[3] ?? 1]; };
  const over = ([r, g, b, a], [R, G, B]) => [r * a + R * (1 - a), g * a + G * (1 - a), b * a + B * (1 - a)];
  const behind = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor); layers.push(c); if (c[3] === 1) break; }
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const luminance = (rgb) => { const [r, g, b] = rgb.map((x) => { const c = x / 255; return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4; }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const contrast = (a, b) => { const [x, y] = [luminance(a), luminance(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
  const found = [];
  let count = 0;
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const text = walker.currentNode.textContent.trim();
    if (!text || !element.checkVisibility() || element.closest('noscript, script, .sr, .skip, option')) continue;
    count += 1;
    const style = getComputedStyle(element);
    const size = parseFloat(style.fontSize);
    if (size < 12) found.push(`${size} px: ${text}`);
    const back = behind(element);
    const ratio = contrast(over(parse(style.color), back), back);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) found.push(`${ratio.toFixed(2)}: ${text}`);
  }
  for (const canvas of document.querySelectorAll('.chart canvas')) {
    const back = behind(canvas);
    const ratio = contrast(parse(getComputedStyle(canvas).outlineColor), back);
    if (ratio < 4.5) found.push(`${ratio.toFixed(2)}: labels of ${canvas.id}`);
  }
  return [count, found];
})()";

fn theme(browser: &mut Chromium, theme: &str) {
    browser.evaluate(&format!(
        "(() => {{ const t = document.getElementById('theme'); t.value = '{theme}'; \
         t.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
    ));
}

#[test]
fn every_text_is_large_and_clear_enough_at_every_size_in_both_themes() {
    let Some(mut browser) =
        browser("every_text_is_large_and_clear_enough_at_every_size_in_both_themes")
    else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.evaluate(UNFOLD);
    for (name, width, height) in SIZES {
        browser.resize(width, height);
        for colours in ["light", "dark"] {
            theme(&mut browser, colours);
            std::thread::sleep(Duration::from_millis(700));
            let texts = browser.evaluate(TEXTS);
            assert!(texts[0].as_u64() > Some(100), "{texts}");
            assert_eq!(texts[1], Value::Array(Vec::new()), "{name}, {colours}");
            let wide = browser.evaluate("document.documentElement.scrollWidth");
            assert_eq!(wide, width, "{name} scrolls sideways");
            keep(&format!("{name}-{colours}.png"), &browser.screenshot(false));
        }
    }
    assert_eq!(browser.complaints(), [""; 0]);
}

/// The longest reasons that the rig gives stand in the page's narrowest place.
#[test]
fn long_reasons_do_not_widen_the_page_on_a_telephone() {
    let Some(mut browser) = browser("long_reasons_do_not_widen_the_page_on_a_telephone") else {
        return;
    };
    let show = Show::start();
    let reason =
        "estimating it takes longer than `stale_after_ms` of [environment] on this machine";
    browser.resize(390, 844);
    open(&mut browser, &show);
    show.shared
        .update(|s| s.lighting.stale = Some(reason.to_owned()));
    browser
        .wait_for("document.getElementById('light-flag').textContent.includes('stale_after_ms')");
    let wide = browser.evaluate("document.documentElement.scrollWidth");
    assert_eq!(wide, 390);
    assert_eq!(browser.complaints(), [""; 0]);
}

/// Share of the screen below the head of the page that no card covers, of its width between the margins.
const EMPTY: &str = "(() => {
  const main = document.querySelector('main').getBoundingClientRect();
  const all = (innerHeight - main.top) * main.width;
  const seen = [...document.querySelectorAll('main .card')].map((card) => card.getBoundingClientRect());
  const covered = seen.map((r) => Math.max(0, Math.min(r.bottom, innerHeight) - r.top) * r.width);
  return 1 - covered.reduce((a, b) => a + b, 0) / all;
})()";

#[test]
fn wide_screens_are_filled() {
    let Some(mut browser) = browser("wide_screens_are_filled") else {
        return;
    };
    let show = Show::start();
    browser.resize(3840, 2160);
    open(&mut browser, &show);
    std::thread::sleep(Duration::from_secs(1));
    let empty = browser.evaluate(EMPTY).as_f64().unwrap();
    assert!(empty < 0.15, "{empty:.2} of the screen is empty");
    // The cards stand in the document's order again on other screens.
    browser.resize(1280, 800);
    browser.wait_for(
        "document.querySelector('.stage .timing') && document.querySelector('.condition .balance')",
    );
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn the_theme_follows_the_system_until_the_viewer_chooses() {
    let Some(mut browser) = browser("the_theme_follows_the_system_until_the_viewer_chooses") else {
        return;
    };
    let show = Show::start();
    browser.prefer_colours("light");
    open(&mut browser, &show);
    let ground = "getComputedStyle(document.documentElement).backgroundColor";
    let light = browser.evaluate(ground);
    browser.prefer_colours("dark");
    let dark = browser.evaluate(ground);
    assert_ne!(light, dark);
    theme(&mut browser, "light");
    assert_eq!(browser.evaluate(ground), light);
    // The choice outlives the page.
    browser.open(&format!("http://{}/", show.address));
    browser.wait_for("document.body.dataset.link === 'up'");
    assert_eq!(browser.evaluate(ground), light);
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn the_picture_stays_in_view_on_a_telephone() {
    let Some(mut browser) = browser("the_picture_stays_in_view_on_a_telephone") else {
        return;
    };
    let show = Show::start();
    browser.resize(390, 844);
    open(&mut browser, &show);
    for control in ["shadow_strength", "exposure_mode"] {
        browser.evaluate(&format!(
            "document.querySelector('[data-name={control}]').scrollIntoView({{ block: 'end' }})"
        ));
        let shown = browser.evaluate("(() => { const r = document.getElementById('picture').getBoundingClientRect(); return r.top >= 0 && r.bottom <= innerHeight && r.height > 150; })()");
        assert_eq!(shown, true, "at {control}");
        let covered = browser.evaluate(&format!("document.querySelector('[data-name={control}]').getBoundingClientRect().top >= document.querySelector('.picture').getBoundingClientRect().bottom"));
        assert_eq!(covered, true, "{control} is under the picture");
    }
    keep("phone-scrolled.png", &browser.screenshot(false));
}

#[test]
fn a_wide_screen_is_used() {
    let Some(mut browser) = browser("a_wide_screen_is_used") else {
        return;
    };
    let show = Show::start();
    for (width, height) in [(1920, 1080), (3840, 2160)] {
        browser.resize(width, height);
        open(&mut browser, &show);
        let used = browser.evaluate("Math.max(...[...document.querySelectorAll('.card')].map((c) => c.getBoundingClientRect().right)) - Math.min(...[...document.querySelectorAll('.card')].map((c) => c.getBoundingClientRect().left))");
        let share = used.as_f64().unwrap() / f64::from(width);
        assert!(share > 0.95, "{share} of {width} px");
        // Picture, settings and condition stand side by side, without scrolling.
        let tops = browser.evaluate("['.picture', '.adjust', '.devices'].map((c) => document.querySelector(c).getBoundingClientRect()).every((r, i, all) => r.top < innerHeight / 2 && (i === 0 || r.left >= all[i - 1].right))");
        assert_eq!(tops, true, "{width}");
    }
}

#[test]
fn everything_is_reached_by_keyboard() {
    let Some(mut browser) = browser("everything_is_reached_by_keyboard") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.evaluate("document.getElementById('research-card').open = true");
    // Every control that can be used; of a group of radio buttons, the chosen one. A disabled
    // button may become usable meanwhile, so only those of now count.
    browser.evaluate(
        "(() => { window.wanted = [...document.querySelectorAll('a[href], button, input, select, summary')].filter((e) => \
         e.checkVisibility() && !e.matches(':disabled') && !(e.type === 'radio' && !e.checked)); })()",
    );
    let wanted = browser.evaluate("wanted.length").as_u64().unwrap();
    assert!(wanted > 25, "{wanted} controls");
    browser.evaluate("(() => { window.visited = new Set(); window.hidden = []; document.activeElement.blur(); })()");
    for _ in 0..wanted + 20 {
        browser.press("Tab", 9);
        let round = browser.evaluate(
            "(() => { const e = document.activeElement; if (e === document.body || visited.has(e)) return visited.size > 0 && visited.has(e); \
             visited.add(e); const shows = (x) => x && getComputedStyle(x).outlineStyle !== 'none' && parseFloat(getComputedStyle(x).outlineWidth) > 0; \
             if (!shows(e) && !shows(e.nextElementSibling)) hidden.push(e.outerHTML); return false; })()",
        );
        if round == true {
            break;
        }
    }
    let missed = browser.evaluate(
        "wanted.filter((e) => e.isConnected && !visited.has(e)).map((e) => e.outerHTML.slice(0, 120))",
    );
    assert_eq!(missed, Value::Array(Vec::new()), "cannot be reached");
    let hidden = browser.evaluate("hidden");
    assert_eq!(hidden, Value::Array(Vec::new()), "focus cannot be seen");
    assert_eq!(browser.complaints(), [""; 0]);
}

#[test]
fn every_setting_has_a_help_text_for_keyboard_and_touch() {
    let Some(mut browser) = browser("every_setting_has_a_help_text_for_keyboard_and_touch") else {
        return;
    };
    let show = Show::start();
    browser.resize(390, 844);
    open(&mut browser, &show);
    let without = browser.evaluate("[...document.querySelectorAll('#settings .row[data-name]')].filter((row) => !row.querySelector('.help') || row.querySelector('.help-text').textContent.length < 20).length");
    assert_eq!(without, 0);
    let unnamed = browser.evaluate("[...document.querySelectorAll('button, select, input')].filter((e) => !(e.ariaLabel || e.textContent.trim() && e.tagName === 'BUTTON' || e.labels?.length)).map((e) => e.outerHTML)");
    assert_eq!(unnamed, Value::Array(Vec::new()), "without a label");
    browser.evaluate("document.querySelector('[data-name=light_count] .help').focus()");
    browser.press("Enter", 13);
    browser.wait_for("document.getElementById('light_count-help').checkVisibility()");
    browser.wait_for(
        "document.querySelector('[data-name=light_count] .help').ariaExpanded === 'true'",
    );
    browser.tap("[data-name=light_count] .help");
    browser.wait_for("!document.getElementById('light_count-help').checkVisibility()");
    assert_eq!(browser.complaints(), [""; 0]);
}
