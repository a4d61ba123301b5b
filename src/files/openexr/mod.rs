//! OpenEXR: any number of parts and channels, scan lines or tiles, half, float and unsigned samples.
//!
//! The blocks of a file are compressed one by one, so they are coded on several threads. The threads live no
//! longer than the call: a thread pool that outlives it would hang in a process forked afterwards, and
//! Python's `multiprocessing` forks.

mod read;
mod write;

pub use read::{Part, View, Window, parts, read};
pub use write::{Channel, Layer, Values, compression, write};

use super::Problem;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// More threads than this wait for the one that reads or writes the file.
const MOST_THREADS: usize = 8;

/// Calls `work` with 0, 1, .. `count - 1`, on several threads, and returns the first error met.
fn for_each_parallel(
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

impl From<::exr::error::Error> for Problem {
    fn from(error: ::exr::error::Error) -> Self {
        use ::exr::error::Error;
        match error {
            Error::Io(error) => error.into(),
            Error::NotSupported(what) => Self::Unsupported {
                found: what.into_owned(),
                accepted: "flat (not deep) channels with a sample for every pixel, compressed by RLE, ZIP, \
                           ZIPS, PIZ, PXR24, B44, B44A, DWAA, DWAB or not",
            },
            Error::Invalid(what) => Self::Damaged(what.into_owned()),
            Error::Aborted => Self::Damaged("reading was broken off".into()),
        }
    }
}
