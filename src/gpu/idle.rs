//! Gives the spare memory of devices back on which nothing has been computed for a while.

use super::device::Gpu;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

/// The time after which a device is idle: longer than what is between the pictures of a batch or of a person who
/// tries one focus after the other.
pub const IDLE: Duration = if cfg!(test) { Duration::from_millis(300) } else { Duration::from_secs(10) };

/// Watches a device until it is idle, unless that is being done.
pub fn watch(gpu: &Arc<Gpu>) {
    gpu.used();
    if gpu.is_watched.swap(true, Ordering::AcqRel) {
        return;
    }
    let watched = Arc::downgrade(gpu);
    let watch = move || {
        while let Some(gpu) = watched.upgrade() {
            let idle = gpu.idle_for();
            if idle >= IDLE {
                gpu.is_watched.store(false, Ordering::Release);
                gpu.release();
                return;
            }
            drop(gpu);
            thread::sleep(IDLE - idle);
        }
    };
    // Without a thread, memory is kept until the next job.
    if thread::Builder::new().name("dofsim-idle".to_owned()).spawn(watch).is_err() {
        gpu.is_watched.store(false, Ordering::Release);
    }
}
