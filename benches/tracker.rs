//! What a tracker's reading costs, and a pose drawn on from it.
//!
//! `cargo bench --bench tracker`
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DQuat, DVec3};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_sync::{HistoryConfig, PoseHistory};
use std::hint::black_box;

/// A hand's motion at an instant, seconds.
fn by_hand(seconds: f64) -> RigidTransform {
    let swing = |rate: f64| (rate * seconds).sin();
    let turn = DVec3::new(swing(3.1), swing(2.3), 0.5) * 0.3;
    let place = DVec3::new(swing(2.9), swing(4.1), swing(3.3)) * 0.1;
    RigidTransform::new(DQuat::from_scaled_axis(turn), place)
}

/// A history that is full, and how many readings it has taken.
fn full(rate: i64) -> (PoseHistory, i64) {
    let mut history = PoseHistory::new(HistoryConfig::default());
    for k in 0..2000 {
        push(&mut history, rate, k);
    }
    (history, 2000)
}

fn push(history: &mut PoseHistory, rate: i64, k: i64) -> MonotonicTime {
    let at = MonotonicTime::from_nanos(1_000_000_000 + k * 1_000_000_000 / rate);
    history.push(at, by_hand(k as f64 / rate as f64));
    at
}

fn readings(c: &mut Criterion) {
    for rate in [120, 240] {
        let (mut history, mut k) = full(rate);
        c.bench_function(&format!("a reading, {rate} a second"), |b| {
            b.iter(|| {
                k += 1;
                push(&mut history, rate, k)
            });
        });
        let newest = push(&mut history, rate, k + 1);
        c.bench_function(&format!("40 ms ahead, {rate} a second"), |b| {
            b.iter(|| black_box(history.at(newest.offset_nanos(40_000_000))));
        });
    }
}

criterion_group!(benches, readings);
criterion_main!(benches);
