//! The set-up of a webcam's rig on the page.

use crate::support::show::Show;
use crate::{browser, keep, open};
use penumbra_status::GuideStatus;
use penumbra_status::registration::RegistrationSource;

const STATE: &str = "(document.querySelector('#guide [data-step=sheet]')?.dataset.state ?? '')";

#[test]
fn guide_shows_the_steps_of_a_webcam_and_nothing_on_other_rigs() {
    let Some(mut browser) = browser("guide_shows_the_steps_of_a_webcam") else {
        return;
    };
    let show = Show::start();
    browser.resize(1280, 800);
    open(&mut browser, &show);
    browser.wait_for("document.getElementById('guide-card').hidden");
    show.shared.update(|s| {
        s.guide = Some(GuideStatus {
            ball_mm: 70.0,
            tags: 10,
            steps: Vec::new(),
        });
        s.registration.source = RegistrationSource::None;
        s.registration.markers = 0;
        s.levels.mean_code = Some(9.0);
    });
    browser.wait_for(&format!("{STATE} === 'failed'"));
    browser.wait_for("document.getElementById('guide').textContent.includes('too dark')");
    keep("guide-dark.png", &browser.screenshot(false));
    show.shared.update(|s| {
        s.registration.source = RegistrationSource::Markers;
        s.registration.markers = 9;
        s.levels.mean_code = Some(110.0);
    });
    browser.wait_for(&format!("{STATE} === 'done'"));
    browser.wait_for("document.querySelectorAll('#guide li').length === 6");
    for (name, width, height) in [("desktop", 1280, 800), ("phone", 390, 844)] {
        browser.resize(width, height);
        let fits = "document.documentElement.scrollWidth <= document.documentElement.clientWidth";
        browser.wait_for(fits);
        keep(&format!("guide-{name}.png"), &browser.screenshot(false));
    }
}
