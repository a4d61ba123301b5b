//! Processes the blocks of a file on several threads.

use crate::files::error::Problem;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The largest number of threads; more would only wait for the one that reads or writes the file.
const MOST_THREADS: usize = 8;

/// Calls `work` with 0, 1, .. `count - 1` on several threads, and returns the first error.
pub fn for_each_parallel(
    count: usize,
    work: impl Fn(usize) -> Result<(), Problem> + Sync,
) -> Result<(), Problem> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS).min(count);
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let run = || {
        while !failed.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                break;
            }
            work(index).inspect_err(|_| failed.store(true, Ordering::Relaxed))?;
        }
        Ok(())
    };
    if threads < 2 {
        return run();
    }
    std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(run)).collect();
        handles
            .into_iter()
            .map(|handle| handle.join().unwrap_or_else(|panic| Err(Problem::from_panic(panic.as_ref()))))
            .fold(Ok(()), Result::and)
    })
}
