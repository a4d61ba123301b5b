//! The one error type of the core: a problem with an argument, or with a device.

/// The reason why a call was refused or stopped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// An argument has an unusable value; the text names argument, value and what is accepted.
    #[error("{0}")]
    Value(String),
    /// The requested device cannot be used; the text says what to do.
    #[error("{0}")]
    Device(String),
    /// The device has not enough memory.
    #[error("{0}")]
    Memory(String),
    /// The caller asked for the work to stop.
    #[error("the render was cancelled")]
    Cancelled,
}

/// The result of every function of the core that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Shorthand for an [`Error::Value`] with the arguments of `format!`.
macro_rules! value_error {
    ($($arg:tt)*) => { $crate::error::Error::Value(format!($($arg)*)) };
}
pub(crate) use value_error;
