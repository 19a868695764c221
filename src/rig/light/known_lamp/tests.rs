use super::*;
use crate::light::places::tests::source;

pub(in crate::light) fn lamp() -> Known {
    Known {
        id: 1,
        direction: Vec3::X,
        distance: LampDistance::FAR,
        applied: LampDistance::FAR,
        plane: None,
        factor: Vec3::ONE,
        tries: 0,
        met: None,
    }
}

/// Whether a lamp that passes sources at these angles, picture by picture, is forgotten.
fn passes(angles: impl IntoIterator<Item = [f32; 2]>) -> bool {
    let mut known = lamp();
    let mut parted = false;
    for angles in angles {
        let others = [source(2, angles[0]), source(3, angles[1])];
        parted |= known.parts(&others);
    }
    parted
}

#[test]
fn lamp_that_passes_another_is_not_certain_afterwards() {
    assert!(passes([[0.4, 1.0], [0.1, 1.0], [0.3, 1.0]]));
    // Close together for ever, or never close.
    assert!(!passes([[0.1, 1.0], [0.22, 1.0], [0.15, 1.0]]));
    assert!(!passes([[0.3, 1.0], [0.22, 0.9], [0.3, 0.8]]));
}

#[test]
fn source_that_vanishes_beside_a_lamp_leaves_it_certain() {
    let mut known = lamp();
    assert!(!known.parts(&[source(2, 0.1)]));
    assert!(!known.parts(&[source(3, 0.5)]));
    assert_eq!(known.met, None);
}

#[test]
fn views_and_shadows_are_combined() {
    let of = |inverse, sigma| LampDistance { inverse, sigma };
    let far = LampDistance::FAR;
    assert_eq!(combined(of(1.0, 0.1), None), of(1.0, 0.1));
    assert_eq!(combined(far, Some((of(1.0, 0.1), true))), of(1.0, 0.1));
    // Not certainly near.
    assert_eq!(combined(far, Some((of(0.2, 0.1), true))), far);
    let both = combined(of(1.0, 0.2), Some((of(1.2, 0.1), true)));
    assert!(
        (both.inverse - 1.16).abs() < 1e-3 && both.sigma < 0.1,
        "{both:?}"
    );
    // They contradict: two places may show two things.
    let other = of(3.0, 0.1);
    assert_eq!(combined(of(1.0, 0.1), Some((other, true))), other);
    assert_eq!(combined(of(1.0, 0.1), Some((other, false))).inverse, 1.0);
    // What is stated is not changed.
    assert_eq!(combined(of(1.0, 0.0), Some((other, true))), of(1.0, 0.0));
}
