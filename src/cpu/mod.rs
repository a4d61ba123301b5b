//! The CPU path.

pub mod lens;
pub mod resolve;
