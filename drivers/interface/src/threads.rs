//! Starts threads: each has a name, and the owner of its handle joins it.

use std::io;
use std::thread::{Builder, JoinHandle};

/// Starts a named thread of low priority, for background work.
///
/// # Errors
/// The system has no more threads.
pub fn spawn_background<T: Send + 'static>(
    name: &str,
    job: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    spawn(name, move || {
        lower_priority();
        job()
    })
}

/// Lowers the priority of the calling thread alone. Linux accepts a thread's number in place of
/// a process's here; other systems would lower the complete process, so nothing is done there. If
/// the system refuses, the work runs at normal priority.
fn lower_priority() {
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{getpriority_process, setpriority_process};
        let this = Some(rustix::thread::gettid());
        let normal = getpriority_process(this).unwrap_or_default();
        let _ = setpriority_process(this, normal + NICENESS);
    }
}

/// Added to the thread's niceness. At 5 the thread still gets a quarter of a busy core; at 10 it would
/// get a tenth, and the light estimate would lag on a busy machine.
#[cfg(target_os = "linux")]
const NICENESS: i32 = 5;

/// Starts a named thread.
///
/// # Errors
/// The system has no more threads.
#[expect(
    clippy::disallowed_methods,
    reason = "this is the one place that starts threads"
)]
pub fn spawn<T: Send + 'static>(
    name: &str,
    job: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    Builder::new().name(name.to_owned()).spawn(job)
}

/// Number of processors that the program may use.
#[must_use]
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Does a `job` for each of `items` and returns when all are done; with several items, on as many
/// threads as the machine has processors.
pub fn for_each<T: Send>(items: Vec<T>, job: impl Fn(T) + Sync) {
    let workers = processors().min(items.len());
    if workers < 2 {
        items.into_iter().for_each(job);
        return;
    }
    let waiting = std::sync::Mutex::new(items.into_iter());
    let next = || waiting.lock().ok().and_then(|mut items| items.next());
    let work = || {
        while let Some(item) = next() {
            job(item);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..workers {
            scope.spawn(work);
        }
        work();
    });
}

/// What `find` returns for each of `items` and its number, in their order; on all processors, `chunk` items at
/// a time.
pub fn map<A: Sync, B: Send>(
    items: &[A],
    chunk: usize,
    find: impl Fn(usize, &A) -> B + Sync,
) -> Vec<B> {
    let mut found: Vec<Option<B>> = items.iter().map(|_| None).collect();
    let chunks = items.chunks(chunk).zip(found.chunks_mut(chunk));
    for_each(chunks.enumerate().collect(), |(number, (items, found))| {
        for (i, (item, found)) in items.iter().zip(found).enumerate() {
            *found = Some(find(number * chunk + i, item));
        }
    });
    found.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn every_item_is_done_once() {
        for count in [0, 1, 2, 100] {
            let mut done = vec![0; count];
            let calls = AtomicUsize::new(0);
            super::for_each(done.iter_mut().collect(), |item| {
                *item += 1;
                calls.fetch_add(1, Ordering::Relaxed);
            });
            assert_eq!(done, vec![1; count]);
            assert_eq!(calls.into_inner(), count);
        }
    }

    #[test]
    fn mapped_items_keep_their_order_and_number() {
        for count in [0, 1, 7, 100] {
            let items: Vec<usize> = (0..count).map(|i| 10 * i).collect();
            let found = super::map(&items, 8, |number, item| (number, *item));
            let expected: Vec<_> = (0..count).map(|i| (i, 10 * i)).collect();
            assert_eq!(found, expected);
        }
    }
}
