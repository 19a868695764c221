//! Test of the example `calibrate_lens`.

#[path = "../examples/calibrate_lens.rs"]
#[expect(dead_code, reason = "its `main` prints")]
mod calibrate_lens;

use calibrate_lens::{calibrate, known_lens, parameter_names, parameters};

#[test]
fn example_finds_lens_within_four_standard_deviations() {
    let known = known_lens();
    let found = calibrate(&known, 1).unwrap();
    assert!(found.views.iter().all(|view| view.used));
    for (name, (value, sigma, known)) in parameter_names(&known).zip(parameters(&found, &known)) {
        let error = value - known;
        assert!(sigma > 0.0, "{name} has no standard deviation");
        assert!(error.abs() < 4.0 * sigma, "{name}: {error} of {sigma}");
    }
    // Without this bound, standard deviations of any size would pass.
    let relative = found.sigma[0] / known.focal.x;
    assert!(
        relative < 0.005,
        "relative standard deviation of fx: {relative}"
    );
}
