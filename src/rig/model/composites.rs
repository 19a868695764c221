//! Composited pictures on their way into a recording.

use crate::recorder::Bench;
use crate::{check, small};
use penumbra_capture::sync::threads;
use penumbra_interface::{Clock, SystemClock};
use penumbra_picture::Picture;
use penumbra_session::Session;
use penumbra_status::recording::RecordingState;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn picture() -> Arc<Picture> {
    Arc::new(Picture {
        width: 8,
        height: 8,
        rgba: vec![100; 8 * 8 * 4],
    })
}

#[test]
fn every_picture_is_recorded_or_counted() {
    check(|| {
        let bench = Bench::new();
        bench
            .recorder
            .start(&bench.path("a.mcap"), None, true)
            .unwrap();
        bench.hub.deliver(small(0));
        let composites = Arc::clone(&bench.composites);
        let compose = move || (0..4).for_each(|_| composites.offer(&picture(), SystemClock.now()));
        let frame_loop = threads::spawn("compositor", compose).unwrap();
        frame_loop.join().unwrap();
        let recording = bench.recorder.stop().unwrap();
        assert_eq!(recording.state, RecordingState::Finished);
        assert_eq!(recording.composites + recording.composites_dropped, 4);
        assert!(!Session::open(&bench.path("a.mcap")).unwrap().truncated());
    });
}

/// The frame loop goes on while a recording ends and another one starts.
#[test]
fn pictures_during_the_end_of_a_recording_harm_neither_it_nor_the_next() {
    check(|| {
        let bench = Bench::new();
        bench
            .recorder
            .start(&bench.path("a.mcap"), None, true)
            .unwrap();
        let offered = Arc::<AtomicU64>::default();
        let composites = Arc::clone(&bench.composites);
        let count = Arc::clone(&offered);
        let compose = move || {
            for _ in 0..4 {
                composites.offer(&picture(), SystemClock.now());
                count.fetch_add(1, Ordering::Relaxed);
            }
        };
        let frame_loop = threads::spawn("compositor", compose).unwrap();
        let before = offered.load(Ordering::Relaxed);
        let first = bench.recorder.stop().unwrap();
        bench
            .recorder
            .start(&bench.path("b.mcap"), None, true)
            .unwrap();
        frame_loop.join().unwrap();
        let second = bench.recorder.stop().unwrap();
        let seen = [first, second].map(|r| r.composites + r.composites_dropped);
        assert!(
            seen[0] >= before && seen[0] + seen[1] <= 4,
            "{before}: {seen:?}"
        );
        assert!(!bench.composites.wanted());
    });
}
