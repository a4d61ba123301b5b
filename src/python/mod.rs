//! The bindings.

pub mod files;
