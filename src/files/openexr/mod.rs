//! OpenEXR: any number of parts and channels, scan lines or tiles, half, float and unsigned samples.
//!
//! The blocks of a file are compressed separately, so they are encoded and decoded on several threads. The threads
//! end with the call: a thread pool that outlives it would hang in a process forked afterwards, and Python's
//! `multiprocessing` forks.

mod deep;
mod deep_header;
mod error;
mod parallel;
mod read;
mod unpack;
mod write;

pub use deep::{Deep, read_deep};
pub use read::{Attributes, Part, View, Window, attributes, deep_part, parts, read};
pub use write::{Channel, Layer, Values, compression, write};
