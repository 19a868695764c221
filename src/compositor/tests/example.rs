//! Runs the example of the README and checks its picture.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../examples/compose_one.rs"]
#[expect(dead_code, reason = "`main` of the example is not called here")]
mod compose_one;

use compose_one::{GREY, SIZE};

#[test]
fn example_draws_a_lit_box_with_a_shadow() {
    let Some(picture) = compose_one::compose_one().unwrap() else {
        println!("SKIPPED example_draws_a_lit_box_with_a_shadow: no adapter");
        return;
    };
    assert_eq!((picture.width, picture.height), SIZE);
    let (width, height) = SIZE;
    // Far from the box hardly any light is blocked: the table keeps the code of the camera.
    for (x, y) in [(0, 0), (width - 1, 0), (width - 1, height - 1)] {
        let code = picture.rgb(x, y)[0];
        assert!(code <= GREY && GREY - code <= 6, "({x}, {y}): {code}");
    }
    // The top of the white box reflects the sky: the linear value 0.5 has the code 188.
    let [r, g, b] = picture.rgb(165, 52);
    assert!((180..=200).contains(&r), "{r}");
    assert!(r.abs_diff(g) <= 1 && g.abs_diff(b) <= 1, "{r} {g} {b}");
    // The table in front of the box is in its shadow.
    let shadow = (100..220).map(|x| picture.rgb(x, 128)[0]).min().unwrap();
    assert!(shadow < GREY - 25, "{shadow}");
    let changed = picture
        .rgba
        .chunks_exact(4)
        .filter(|p| p[0] != GREY)
        .count();
    assert!((10_000..76_800).contains(&changed), "{changed}");
}
