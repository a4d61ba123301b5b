//! What goes to the devices of this process and back.

use std::sync::atomic::{AtomicU64, Ordering};

/// What went so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traffic {
    /// Bytes that went to devices.
    pub uploaded_bytes: u64,
    /// Bytes that came back: pictures, and the times of passes.
    pub downloaded_bytes: u64,
    /// How often something came back.
    pub readbacks: u64,
    /// How often work was submitted.
    pub submissions: u64,
}

static UPLOADED: AtomicU64 = AtomicU64::new(0);
static DOWNLOADED: AtomicU64 = AtomicU64::new(0);
static READBACKS: AtomicU64 = AtomicU64::new(0);
static SUBMISSIONS: AtomicU64 = AtomicU64::new(0);

/// What went so far.
pub fn traffic() -> Traffic {
    let [uploaded_bytes, downloaded_bytes, readbacks, submissions] =
        [&UPLOADED, &DOWNLOADED, &READBACKS, &SUBMISSIONS].map(|count| count.load(Ordering::Relaxed));
    Traffic { uploaded_bytes, downloaded_bytes, readbacks, submissions }
}

/// Counts bytes that go to a device.
pub(super) fn count_upload(bytes: usize) {
    UPLOADED.fetch_add(bytes as u64, Ordering::Relaxed);
}

/// Counts bytes that come back together.
pub(super) fn count_readback(bytes: u64) {
    DOWNLOADED.fetch_add(bytes, Ordering::Relaxed);
    READBACKS.fetch_add(1, Ordering::Relaxed);
}

/// Counts a submission.
pub(super) fn count_submission() {
    SUBMISSIONS.fetch_add(1, Ordering::Relaxed);
}
