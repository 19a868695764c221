use super::*;
use crate::radiometric::synthetic::normal;
use glam::DVec2;
use penumbra_camera::Vignetting;
use penumbra_camera::vignetting::polynomial;

fn readings(k: [f64; 3], groups: usize, each: usize, noise: f64) -> Vec<Reading> {
    (0..groups * each)
        .map(|i| {
            let (group, n) = (i / each, i % each);
            let q = ((group * 7 + n * 13) % 41) as f64 / 41.0;
            // The light fades over the pictures.
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
fn recovers_vignetting_within_its_error() {
    for ground_truth in [[-0.3, 0.0, 0.0], [-0.2, -0.15, 0.0], [0.0, 0.0, 0.0]] {
        let mut all = readings(ground_truth, 40, 12, 0.01);
        // A hand passes through the picture.
        for r in all.iter_mut().step_by(17) {
            r.log -= 0.8;
        }
        let found = fit(&all).unwrap();
        let edge = polynomial(&ground_truth, found.max_rho_squared);
        let error = (found.edge_brightness() - edge).abs();
        assert!(error < 4.0 * found.edge_sigma, "{ground_truth:?} {found:?}");
        assert!(found.edge_sigma < 0.01 && error < 0.01, "{found:?}");
    }
}

#[test]
fn refuses_uninformative_readings() {
    assert_eq!(fit(&[]), None);
    // Every surface point was seen once.
    assert_eq!(fit(&readings([-0.3, 0.0, 0.0], 400, 1, 0.01)), None);
    // All readings at one distance from the centre.
    let mut ring = readings([-0.3, 0.0, 0.0], 40, 12, 0.01);
    ring.iter_mut().for_each(|r| r.q = 0.5);
    assert_eq!(fit(&ring), None);
}

#[test]
fn rejects_impossible_vignetting() {
    let lens = |k| Vignetting {
        centre: DVec2::new(320.0, 240.0),
        radius: 400.0,
        coefficients: k,
        sigma: [0.0; 3],
    };
    assert!(lens([-0.4, 0.05, 0.0]).is_possible((640, 480)));
    assert!(!lens([-1.2, 0.0, 0.0]).is_possible((640, 480)));
    assert!(!lens([4.0, 0.0, 0.0]).is_possible((640, 480)));
    let corrections = lens([-0.4, 0.0, 0.0]).corrections((640, 480));
    assert!((corrections[240 * 640 + 320] - 1.0).abs() < 1e-6);
    assert!((corrections[0] - 1.0 / 0.6).abs() < 1e-4);
}
