#![allow(clippy::unwrap_used)]

use super::*;
use crate::radiometric::drawn::normal;
use glam::DVec2;
use penumbra_camera::Vignetting;
use penumbra_camera::vignetting::polynomial;

fn readings(k: [f64; 3], groups: usize, each: usize, noise: f64) -> Vec<Reading> {
    (0..groups * each)
        .map(|i| {
            let (group, n) = (i / each, i % each);
            let q = ((group * 7 + n * 13) % 41) as f64 / 41.0;
            // The light went down meanwhile.
            let light = -0.3 * (n as f64 / each as f64);
            let log = light + (0.1 + 0.02 * group as f64).ln() + polynomial(&k, q).ln();
            Reading {
                group,
                picture: n,
                q,
                log: log + noise * normal(3, i as u64),
                variance: 1e-4,
            }
        })
        .collect()
}

#[test]
fn a_known_fall_off_comes_back_within_its_error() {
    for truth in [[-0.3, 0.0, 0.0], [-0.2, -0.15, 0.0], [0.0, 0.0, 0.0]] {
        let mut all = readings(truth, 40, 12, 0.01);
        // A hand passed through.
        for r in all.iter_mut().step_by(17) {
            r.log -= 0.8;
        }
        let found = fit(&all).unwrap();
        let edge = polynomial(&truth, found.farthest);
        let off = (found.edge() - edge).abs();
        assert!(off < 4.0 * found.edge_sigma, "{truth:?} {found:?}");
        assert!(found.edge_sigma < 0.01 && off < 0.01, "{found:?}");
    }
}

#[test]
fn what_says_nothing_gives_nothing() {
    assert_eq!(fit(&[]), None);
    // Every thing seen once.
    assert_eq!(fit(&readings([-0.3, 0.0, 0.0], 400, 1, 0.01)), None);
    // All equally far from the middle.
    let mut ring = readings([-0.3, 0.0, 0.0], 40, 12, 0.01);
    ring.iter_mut().for_each(|r| r.q = 0.5);
    assert_eq!(fit(&ring), None);
}

#[test]
fn no_lens_brightens_without_end() {
    let of = |k| Vignetting {
        centre: DVec2::new(320.0, 240.0),
        radius: 400.0,
        coefficients: k,
        sigma: [0.0; 3],
    };
    assert!(of([-0.4, 0.05, 0.0]).is_possible((640, 480)));
    assert!(!of([-1.2, 0.0, 0.0]).is_possible((640, 480)));
    assert!(!of([4.0, 0.0, 0.0]).is_possible((640, 480)));
    let corrections = of([-0.4, 0.0, 0.0]).corrections((640, 480));
    assert!((corrections[240 * 640 + 320] - 1.0).abs() < 1e-6);
    assert!((corrections[0] - 1.0 / 0.6).abs() < 1e-4);
}
