//! Processor time of each thread of this process.

use std::collections::BTreeMap;

/// Nanoseconds of processor time by thread name; threads of one name are added up.
pub type ThreadTimes = BTreeMap<String, u64>;

/// Returns the processor time of all running threads; empty if the system does not report it.
#[cfg(target_os = "linux")]
#[must_use]
pub fn current() -> ThreadTimes {
    let mut times = ThreadTimes::new();
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    for task in tasks.flatten() {
        // A thread may end between the listing and the reading.
        let read = |name: &str| std::fs::read_to_string(task.path().join(name)).ok();
        let (Some(name), Some(spent)) = (read("comm"), read("schedstat").and_then(|s| spent(&s)))
        else {
            continue;
        };
        *times.entry(name.trim_end().to_owned()).or_default() += spent;
    }
    times
}

/// Returns the processor time of all running threads; empty if the system does not report it.
#[cfg(not(target_os = "linux"))]
#[must_use]
pub fn current() -> ThreadTimes {
    ThreadTimes::new()
}

/// Parses `schedstat`: nanoseconds on a processor, nanoseconds of waiting for one, time slices. The
/// hundredths of a second in `stat` are too coarse for a capture thread.
#[cfg(target_os = "linux")]
fn spent(schedstat: &str) -> Option<u64> {
    schedstat.split_whitespace().next()?.parse().ok()
}

/// Returns the processor time from `before` to `after`.
#[must_use]
pub fn between(before: &ThreadTimes, after: &ThreadTimes) -> ThreadTimes {
    let since = |(name, spent): (&String, &u64)| {
        let earlier = before.get(name).copied().unwrap_or(0);
        (name.clone(), spent.saturating_sub(earlier))
    };
    after.iter().map(since).collect()
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn working_threads_use_processor_time_and_waiting_ones_do_not() {
        let (sender, receiver) = crossbeam_channel::bounded::<()>(0);
        let idle =
            penumbra_interface::threads::spawn("idle-thread", move || receiver.recv()).unwrap();
        let busy = penumbra_interface::threads::spawn("busy-thread", || {
            let before = current();
            let begun = Instant::now();
            while begun.elapsed() < Duration::from_millis(60) {
                std::hint::black_box(0);
            }
            between(&before, &current())
        });
        let spent = busy.unwrap().join().unwrap();
        drop(sender);
        let _ = idle.join();
        assert!(spent["busy-thread"] > 10_000_000, "{spent:?}");
        assert!(spent["idle-thread"] < 5_000_000, "{spent:?}");
    }
}
