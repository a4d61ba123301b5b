//! Values that belong to one process.

use std::mem::ManuallyDrop;

/// A value of the process that made it. In a forked child, the threads behind the value are gone and the driver's
/// state is a stale copy, so the value is neither used nor freed there.
pub struct ProcessLocal<T> {
    process: u32,
    value: ManuallyDrop<T>,
}

impl<T> ProcessLocal<T> {
    pub fn new(value: T) -> ProcessLocal<T> {
        ProcessLocal { process: std::process::id(), value: ManuallyDrop::new(value) }
    }

    /// The value, if this is the process that made it.
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
