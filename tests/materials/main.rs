//! Glossy surfaces under environment maps: the prefiltered chain is compared with plain numerical
//! integration and with the paper's chain of box-filtered maps. `--nocapture` shows the table of
//! errors.

mod integral;
mod maps;

use glam::Vec3;
use integral::{Integrator, View, boxed, prefiltered, reflectance};
use maps::{SPOT, real, rendered};
use penumbra_lighting::CubeMap;
use penumbra_lighting::box_chain::box_chain;
use penumbra_lighting::compact_source_specular::excesses;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::lobes::{Family, Levels, phong_parameter, widths};
use penumbra_lighting::place::{LightPlace, Seen};
use penumbra_lighting::prefilter::{Prefilter, level_count};
use penumbra_lighting::sources::{Layout, SampleGrid, Source, SourceFinder, SourceSettings};
use std::f32::consts::{PI, TAU};
use std::sync::LazyLock;

const SIZE: u32 = 128;
const ROUGHNESSES: [f32; 6] = [0.1, 0.2, 0.35, 0.5, 0.75, 1.0];
const EXPONENTS: [f32; 5] = [1.0, 5.0, 20.0, 100.0, 1000.0];
const SLANTS: [f32; 3] = [0.98, 0.6, 0.2];

static PREFILTER: LazyLock<Prefilter> = LazyLock::new(|| Prefilter::new(SIZE).with_phong(true));
static INTEGRATOR: LazyLock<Integrator> = LazyLock::new(|| Integrator::new(SIZE));

fn lobes() -> impl Iterator<Item = (Family, f32, f32)> {
    let ggx = ROUGHNESSES.map(|r| (Family::Ggx, r, r));
    let phong = EXPONENTS.map(|e| (Family::Phong, e, phong_parameter(e)));
    ggx.into_iter().chain(phong)
}

/// Surfaces in all directions, and some that mirror the spot or its surroundings.
fn views() -> Vec<View> {
    let mut all = Vec::new();
    for (k, n_dot_v) in SLANTS.into_iter().enumerate() {
        for j in 0..6 {
            let towards = if j < 3 {
                (SPOT.normalize() + SPOT.any_orthonormal_vector() * [0.0, 0.1, 0.5][j]).normalize()
            } else {
                let z = 0.9 - 0.3 * (3 * k + j) as f32 / 2.0;
                let (sin, cos) = (2.4 * (5 * k + j) as f32).sin_cos();
                Vec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
            };
            let (a, b) = towards.any_orthonormal_pair();
            let (sin, cos) = (1.7 * j as f32).sin_cos();
            let n = towards * n_dot_v + (a * cos + b * sin) * (1.0 - n_dot_v * n_dot_v).sqrt();
            let v = n * (2.0 * n.dot(towards)) - towards;
            all.push(View {
                n: n.normalize(),
                v: v.normalize(),
            });
        }
    }
    all
}

/// Builds the chain as the program does: sources are detected and left out of the levels.
fn chain(map: &[Vec3]) -> CubeMap {
    let grid = CubeGrid::new(SIZE);
    let samples = SampleGrid {
        directions: &grid.directions,
        solid_angles: &grid.solid_angles,
        layout: Layout::Cube(&grid.neighbours()),
    };
    let sources = SourceFinder::default().find(samples, map, true, &SourceSettings::default());
    let mut without = map.to_vec();
    for (i, flux) in sources.iter().flat_map(|s| &s.parts) {
        without[*i as usize] -= *flux / grid.solid_angles[*i as usize];
    }
    let seen = |s: &Source| Seen {
        direction: s.direction,
        irradiance: s.flux,
        angular_radius: (s.solid_angle / PI).sqrt(),
    };
    let far: Vec<_> = (sources.iter().map(|s| (seen(s), LightPlace::FAR))).collect();
    let widths: Vec<f32> = widths(SIZE, level_count(SIZE)).collect();
    PREFILTER.apply_without(map, &excesses(&grid, map, &without, &far, &widths))
}

/// Root mean square errors over the views, relative to the root mean square of the ground truth.
struct Errors {
    lobe: (Family, f32),
    prefiltered: f64,
    boxed: f64,
    /// Sum of the squared ground truth.
    size: f64,
}

fn errors(maps: &[Vec<Vec3>]) -> Vec<Vec<Errors>> {
    let chains: Vec<CubeMap> = maps.iter().map(|m| chain(m)).collect();
    let axis = Vec3::new(0.5, -0.7, 0.5).normalize();
    let boxes: Vec<CubeMap> = maps.iter().map(|m| box_chain(SIZE, m, axis)).collect();
    let views = views();
    let mut all: Vec<Vec<Errors>> = maps.iter().map(|_| Vec::new()).collect();
    for (family, shown, p) in lobes() {
        let levels = Levels::new(family, SIZE, level_count(SIZE));
        let mut sums = vec![[0.0; 3]; maps.len()];
        for view in &views {
            let truths = INTEGRATOR.integrals(family, p, view, maps);
            for (i, truth) in truths.iter().enumerate() {
                let ours = prefiltered(&chains[i], &levels, (family, p), view, true);
                let theirs = boxed(&boxes[i], family, p, view);
                for c in 0..3 {
                    sums[i][0] += (f64::from(ours[c]) - truth[c]).powi(2);
                    sums[i][1] += (f64::from(theirs[c]) - truth[c]).powi(2);
                    sums[i][2] += truth[c] * truth[c];
                }
            }
        }
        for (list, [ours, theirs, truth]) in all.iter_mut().zip(sums) {
            list.push(Errors {
                lobe: (family, shown),
                prefiltered: (ours / truth).sqrt(),
                boxed: (theirs / truth).sqrt(),
                size: truth,
            });
        }
    }
    all
}

/// Root mean square error over all lobes of a family.
fn overall(list: &[Errors], family: Family, of: impl Fn(&Errors) -> f64) -> f64 {
    let of_family = || list.iter().filter(|e| e.lobe.0 == family);
    let sum: f64 = of_family().map(|e| of(e).powi(2) * e.size).sum();
    (sum / of_family().map(|e| e.size).sum::<f64>()).sqrt()
}

fn print(name: &str, list: &[Errors]) {
    for e in list {
        let (ours, theirs) = (100.0 * e.prefiltered, 100.0 * e.boxed);
        eprintln!(
            "{name:>12} {:?} {:>6}: {ours:6.2} % box {theirs:6.1} %",
            e.lobe.0, e.lobe.1
        );
    }
}

#[test]
fn constant_light_is_scaled_by_the_albedo() {
    let all = errors(&[vec![Vec3::new(0.3, 1.0, 2.0); 6 * (SIZE * SIZE) as usize]]);
    print("constant", &all[0]);
    for e in &all[0] {
        // GGX's sum has 1024 half vectors.
        let limit = if e.lobe.0 == Family::Phong {
            2e-3
        } else {
            8e-3
        };
        assert!(e.prefiltered < limit, "{:?}: {}", e.lobe, e.prefiltered);
    }
}

#[test]
fn gradients_are_reproduced() {
    let all = errors(&[rendered(SIZE, |d| {
        Vec3::new(1.0 + 0.8 * d.z, 1.0 - 0.5 * d.x, 1.0 + 0.9 * d.y)
    })]);
    print("gradient", &all[0]);
    for e in &all[0] {
        let limit = if e.lobe.0 == Family::Phong {
            0.025
        } else {
            0.05
        };
        assert!(e.prefiltered < limit, "{:?}: {}", e.lobe, e.prefiltered);
    }
}

#[test]
fn small_source_is_closer_than_from_the_papers_chain() {
    let all = errors(&[rendered(SIZE, maps::spot)]);
    print("spot", &all[0]);
    for e in &all[0] {
        let limit = if e.lobe.0 == Family::Phong { 0.06 } else { 0.1 };
        assert!(e.prefiltered < limit, "{:?}: {}", e.lobe, e.prefiltered);
        assert!(e.prefiltered < e.boxed, "{:?}", e.lobe);
    }
}

/// Surfaces that mirror the outline of the large window or its surroundings, at all slants.
fn views_of_outline(n_dot_v: f32) -> impl Iterator<Item = View> {
    let at = move |(k, far): (u16, f32)| {
        let angle = f32::from(k) / 24.0 * TAU;
        let on_edge = |x: f32| far * (1.4 * x).clamp(-1.0, 1.0);
        let [y, z] = [angle.cos(), angle.sin()].map(on_edge);
        let towards =
            Vec3::new(1.0, y * maps::WINDOW.0, maps::WINDOW.1 + z * maps::WINDOW.2).normalize();
        let (a, b) = towards.any_orthonormal_pair();
        let (sin, cos) = (1.7 * f32::from(k)).sin_cos();
        let n = towards * n_dot_v + (a * cos + b * sin) * (1.0 - n_dot_v * n_dot_v).sqrt();
        let v = n * (2.0 * n.dot(towards)) - towards;
        View {
            n: n.normalize(),
            v: v.normalize(),
        }
    };
    let all = (0..24).flat_map(|k| [0.9, 1.0, 1.1, 1.25, 1.4].map(|far| (k, far)));
    all.map(at)
}

/// A bright window in a dark room shows the shape of the lobe: round ones are not enough.
#[test]
fn outline_of_a_window_shows_the_lobe() {
    let map = rendered(SIZE, maps::window);
    let filtered = chain(&map);
    let levels = Levels::new(Family::Ggx, SIZE, level_count(SIZE));
    for (roughness, limit) in [(0.15, 0.1), (0.22, 0.12), (0.35, 0.14), (0.5, 0.2)] {
        let (mut round, mut long, mut size) = (0.0, 0.0, 0.0);
        for n_dot_v in [0.97, 0.8, 0.6, 0.4, 0.25, 0.15] {
            let [mut of_round, mut of_long, mut of_truth] = [0.0; 3];
            for view in views_of_outline(n_dot_v) {
                let truth =
                    INTEGRATOR.integrals(Family::Ggx, roughness, &view, std::slice::from_ref(&map))
                        [0][1];
                let error = |long| {
                    let lobe = (Family::Ggx, roughness);
                    let ours = prefiltered(&filtered, &levels, lobe, &view, long);
                    (f64::from(ours.y) - truth).powi(2)
                };
                of_round += error(false);
                of_long += error(true);
                of_truth += truth * truth;
            }
            let [r, l] = [of_round, of_long].map(|sum| (sum / of_truth).sqrt());
            eprintln!(
                "      window {roughness:>4} n·v {n_dot_v:>4}: {:5.1} % round {:5.1} %",
                100.0 * l,
                100.0 * r
            );
            assert!(l < limit, "{roughness} {n_dot_v}: {l}");
            round += of_round;
            long += of_long;
            size += of_truth;
        }
        let [round, long] = [round, long].map(|sum| (sum / size).sqrt());
        assert!(long < 0.6 * round, "{roughness}: {long} {round}");
    }
}

#[test]
fn photographed_maps_are_closer_than_from_the_papers_chain() {
    let Some(maps) = real(SIZE) else { return };
    let (names, texels): (Vec<_>, Vec<_>) = maps.into_iter().unzip();
    // The sun outdoors is a hundred thousand times as bright as the sky.
    let limit = [[0.08, 0.06], [0.03, 0.02]];
    for ((name, list), limit) in names.iter().zip(errors(&texels)).zip(limit) {
        print(name, &list);
        for (family, limit) in [Family::Ggx, Family::Phong].into_iter().zip(limit) {
            let ours = overall(&list, family, |e| e.prefiltered);
            let theirs = overall(&list, family, |e| e.boxed);
            eprintln!(
                "{name} {family:?}: {:.1} % against {:.1} %",
                100.0 * ours,
                100.0 * theirs
            );
            assert!(
                ours < limit && ours < theirs,
                "{name} {family:?}: {ours} {theirs}"
            );
        }
        for e in &list {
            assert!(e.prefiltered < e.boxed, "{name} {:?}", e.lobe);
        }
    }
}

/// Helmholtz reciprocity: l to v equals v to l. (The prefiltered look-up is not reciprocal; the
/// underlying model is.)
#[test]
fn both_models_are_reciprocal() {
    for (family, _, p) in lobes() {
        for view in views() {
            let (a, b) = view.n.any_orthonormal_pair();
            let l = (view.n * 0.5 + a * 0.3 - b * 0.6).normalize();
            let back = View { n: view.n, v: l };
            let forth = reflectance(family, p, &view, l) / f64::from(view.n.dot(l));
            let back = reflectance(family, p, &back, view.v) / f64::from(view.n_dot_v());
            assert!(
                (forth - back).abs() <= 2e-3 * forth.max(1e-6),
                "{family:?} {p}"
            );
        }
    }
}
