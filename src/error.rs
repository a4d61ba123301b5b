//! The one error type of the core: what was wrong with an argument, or with a device.

/// Why a call was refused or stopped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// An argument has an unusable value; the text names argument, value and what is accepted.
    #[error("{0}")]
    Value(String),
    /// The device asked for cannot be used; the text says what to do.
    #[error("{0}")]
    Device(String),
    /// The caller asked for the work to stop.
    #[error("the render was cancelled")]
    Cancelled,
}

/// The result of everything in the core that can be refused.
pub type Result<T> = std::result::Result<T, Error>;

/// Shorthand for an [`Error::Value`] built like `format!`.
macro_rules! value_error {
    ($($arg:tt)*) => { $crate::error::Error::Value(format!($($arg)*)) };
}
pub(crate) use value_error;
