//! Values that belong to one process.

use std::mem::ManuallyDrop;

/// A value of the process that made it. In a forked child its threads are gone and its driver's state is a stale copy,
/// so that it is neither used there nor freed.
pub struct ProcessLocal<T> {
    process: u32,
    value: ManuallyDrop<T>,
}

impl<T> ProcessLocal<T> {
    pub fn new(value: T) -> ProcessLocal<T> {
        ProcessLocal { process: std::process::id(), value: ManuallyDrop::new(value) }
    }

    /// The value, in its own process.
    pub fn get(&self) -> Option<&T> {
        (self.process == std::process::id()).then_some(&*self.value)
    }
}

impl<T> Drop for ProcessLocal<T> {
    fn drop(&mut self) {
        if self.process == std::process::id() {
            // SAFETY: the value is dropped here only, and nothing follows.
            unsafe { ManuallyDrop::drop(&mut self.value) }
        }
    }
}
