//! Large buffers whose memory is reused by later renders: touching a fresh page costs more than the work on it.

use bytemuck::Pod;
use rayon::prelude::*;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, TryLockError};

/// Number of values that a worker fills at a time.
const CHUNK_LEN: usize = 1 << 14;

/// Plain values, in memory that is kept for the next buffer of about this size.
pub struct Buffer<T: Pod> {
    words: Vec<u64>,
    len: usize,
    values: PhantomData<T>,
}

impl<T: Pod> Buffer<T> {
    /// `len` uninitialised values: each has to be written before it is read.
    pub fn unset(len: usize) -> Buffer<T> {
        let mut words = take((len * size_of::<T>()).div_ceil(size_of::<u64>()));
        if cfg!(debug_assertions) {
            // NaN, so that tests notice values that are read too early.
            words.fill(u64::MAX);
        }
        Buffer { words, len, values: PhantomData }
    }
}

impl<T: Pod + Send + Sync> Buffer<T> {
    /// `len` copies of one value.
    pub fn full(len: usize, value: T) -> Buffer<T> {
        let mut buffer = Buffer::unset(len);
        buffer.par_chunks_mut(CHUNK_LEN).for_each(|chunk| chunk.fill(value));
        buffer
    }

    /// Several slices concatenated.
    pub fn concat(pieces: &[&[T]]) -> Buffer<T> {
        let mut buffer = Buffer::unset(pieces.iter().map(|piece| piece.len()).sum());
        let mut rest = &mut *buffer;
        for piece in pieces {
            let (own, behind) = rest.split_at_mut(piece.len());
            own.copy_from_slice(piece);
            rest = behind;
        }
        buffer
    }

    /// One value for each of `from`.
    pub fn of_each<A: Sync>(from: &[A], value: impl Fn(&A) -> T + Send + Sync) -> Buffer<T> {
        let mut buffer = Buffer::unset(from.len());
        let chunks = buffer.par_chunks_mut(CHUNK_LEN).zip(from.par_chunks(CHUNK_LEN));
        chunks.for_each(|(out, from)| out.iter_mut().zip(from).for_each(|(out, from)| *out = value(from)));
        buffer
    }
}

impl<T: Pod> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }
}

impl<T: Pod> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.len]
    }
}

impl<T: Pod + Send + Sync> Clone for Buffer<T> {
    fn clone(&self) -> Buffer<T> {
        Buffer::from(&**self)
    }
}

impl<T: Pod + Send + Sync> From<&[T]> for Buffer<T> {
    fn from(values: &[T]) -> Buffer<T> {
        Buffer::of_each(values, |v| *v)
    }
}

impl<T: Pod + PartialEq> PartialEq for Buffer<T> {
    fn eq(&self, other: &Buffer<T>) -> bool {
        **self == **other
    }
}

impl<T: Pod + fmt::Debug> fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<T: Pod> FromIterator<T> for Buffer<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Buffer<T> {
        let values: Vec<T> = values.into_iter().collect();
        let mut buffer = Buffer::unset(values.len());
        buffer.copy_from_slice(&values);
        buffer
    }
}

impl<T: Pod> Drop for Buffer<T> {
    fn drop(&mut self) {
        give_back(std::mem::take(&mut self.words));
    }
}

/// Memory that no buffer uses at the moment.
struct Idle {
    words: Vec<u64>,
    /// The time at which it was returned.
    since: u64,
}

/// The unused memory, the longest unused first.
struct Store {
    idle: Vec<Idle>,
    /// The words that are in use, and the most that ever were.
    in_use: usize,
    most_in_use: usize,
    /// Number of buffers that were handed out so far.
    time: u64,
}

static STORE: Mutex<Store> = Mutex::new(Store::EMPTY);

/// Memory that was not reused for this many buffers is returned to the system: a few renders' worth.
const KEPT_FOR: u64 = 128;
/// The largest amount of unused memory, in words: 1 GiB, as much as a render of 8 million pixels leaves. What is in use and
/// what is unused are together at most this much, or the most that was in use at once.
const KEPT_WORDS: usize = 1 << 27;

/// The store, unless it is locked. Another thread locks it only for an instant. In a forked process whose parent held
/// the lock, it stays locked; memory then comes from the system and is returned to it.
fn store() -> Option<MutexGuard<'static, Store>> {
    match STORE.try_lock() {
        Ok(store) => Some(store),
        Err(TryLockError::Poisoned(store)) => Some(store.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

impl Store {
    const EMPTY: Store = Store { idle: Vec::new(), in_use: 0, most_in_use: 0, time: 0 };

    /// The smallest memory of `n` words or not many more; or none, and the memory that is to be freed for new one.
    fn take(&mut self, n: usize) -> (Option<Vec<u64>>, Vec<Idle>) {
        self.time += 1;
        let fits = |idle: &Idle| (n..=n + n / 4).contains(&idle.words.len());
        let found = (0..self.idle.len()).filter(|&i| fits(&self.idle[i]));
        let smallest = found.min_by_key(|&i| self.idle[i].words.len());
        let words = smallest.map(|i| self.idle.remove(i).words);
        self.in_use += words.as_ref().map_or(n, Vec::len);
        self.most_in_use = self.most_in_use.max(self.in_use);
        (words, self.stale())
    }

    /// Keeps memory, and returns the memory that is to be freed in exchange.
    fn keep(&mut self, words: Vec<u64>) -> Vec<Idle> {
        // A store that was locked has not counted what it was asked for.
        self.in_use = self.in_use.saturating_sub(words.len());
        self.idle.push(Idle { words, since: self.time });
        self.stale()
    }

    /// The unused memory that is not kept any longer, taken out.
    fn stale(&mut self) -> Vec<Idle> {
        let most = KEPT_WORDS.min(KEPT_WORDS.max(self.most_in_use).saturating_sub(self.in_use));
        let mut total: usize = self.idle.iter().map(|idle| idle.words.len()).sum();
        let stale = self.idle.iter().take_while(|idle| {
            let too_much = total > most;
            total -= idle.words.len();
            too_much || self.time - idle.since > KEPT_FOR
        });
        let stale = stale.count();
        self.idle.drain(..stale).collect()
    }
}

fn take(n: usize) -> Vec<u64> {
    // Memory that is no longer wanted is freed after the lock has been released, and before new memory is asked for.
    let (kept, stale) = store().map_or_else(Default::default, |mut store| store.take(n));
    drop(stale);
    kept.unwrap_or_else(|| zeros(n))
}

fn give_back(words: Vec<u64>) {
    let _stale = if words.is_empty() { None } else { store().map(|mut store| store.keep(words)) };
}

/// `n` zeros that will all be written, and that outlive the render: in huge pages if the system has them.
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
        // SAFETY: the pages lie inside the buffer, and the advice does not change their content. Whether the system
        // follows the advice does not matter.
        unsafe { libc::madvise(first.cast(), end - start, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(not(target_os = "linux"))]
fn advise_huge_pages<T>(_: &[T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_about_the_size_is_used_again() {
        let mut store = Store::EMPTY;
        assert!(store.keep(vec![1; 100]).is_empty());
        assert!(store.keep(vec![2; 110]).is_empty());
        let mut taken = |n: usize| store.take(n).0.map(|words| words.len());
        assert_eq!([120, 40, 96, 96, 96].map(&mut taken), [None, None, Some(100), Some(110), None]);
    }

    #[test]
    fn what_nobody_wants_is_freed() {
        let mut store = Store::EMPTY;
        store.keep(vec![0; 1000]);
        for _ in 0..KEPT_FOR {
            let words = store.take(10).0.unwrap_or_else(|| vec![0; 10]);
            assert!(store.keep(words).is_empty());
        }
        let (words, freed) = store.take(10);
        assert_eq!(freed.iter().map(|idle| idle.words.len()).collect::<Vec<_>>(), [1000]);
        assert!(store.keep(words.unwrap()).is_empty());
        assert_eq!(store.idle.len(), 1);
    }

    #[test]
    fn no_more_than_the_limit_is_kept() {
        let mut store = Store::EMPTY;
        store.keep(vec![0; KEPT_WORDS / 2]);
        store.keep(vec![0; KEPT_WORDS / 2]);
        assert_eq!(store.keep(vec![0; 1]).len(), 1);
    }

    #[test]
    fn what_does_not_fit_makes_room_for_what_is_in_use() {
        let mut store = Store::EMPTY;
        let half = KEPT_WORDS / 2;
        // Half of the limit is unused, and as much is taken anew: both together are the limit.
        store.keep(vec![0; half]);
        assert!(store.take(half / 2).1.is_empty());
        assert!(store.take(half / 2).1.is_empty());
        assert_eq!(store.take(1000).1.iter().map(|idle| idle.words.len()).collect::<Vec<_>>(), [half]);
        // What once was in use may be kept.
        assert!(store.take(2 * KEPT_WORDS).1.is_empty());
        assert!(store.keep(vec![0; half]).is_empty());
    }

    #[test]
    fn buffers_hold_what_was_written() {
        let mut odd = Buffer::<u16>::unset(5);
        odd.copy_from_slice(&[1, 2, 3, 4, 5]);
        assert_eq!(odd.clone(), odd);
        assert_eq!(odd.len(), 5);
        assert_eq!(*Buffer::of_each(&[1.5f32, 2.0], |v| 2.0 * v), [3.0, 4.0]);
        assert_eq!(*Buffer::concat(&[&[1u8, 2], &[], &[3]]), [1, 2, 3]);
        assert!(Buffer::<f32>::unset(0).is_empty());
    }
}
