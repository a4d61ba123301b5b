//! Large buffers.

/// `n` zeros that will all be written to: in huge pages where the system has them, for a page fault costs more
/// than the work on a page.
pub fn zeros<T: Copy + Default>(n: usize) -> Vec<T> {
    let zeros = vec![T::default(); n];
    advise_huge_pages(&zeros);
    zeros
}

#[cfg(target_os = "linux")]
fn advise_huge_pages<T>(buffer: &[T]) {
    /// The size of a huge page on x86-64 and, by default, on AArch64; elsewhere the advice is merely coarser.
    const HUGE: usize = 2 << 20;
    let range = buffer.as_ptr_range();
    let (start, end) = (range.start.addr().next_multiple_of(HUGE), range.end.addr() / HUGE * HUGE);
    if start < end {
        let first = range.start.wrapping_byte_add(start - range.start.addr()).cast_mut();
        // SAFETY: the pages lie inside the buffer, and the advice does not change what they hold. Whether it was
        // taken does not matter.
        unsafe { libc::madvise(first.cast(), end - start, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn advise_huge_pages<T>(_: &[T]) {}
