//! The errors of reading and writing files.

use std::any::Any;
use std::io;
use std::path::PathBuf;

/// The result of reading or writing a file.
pub type Result<T> = std::result::Result<T, FileError>;

/// A problem and the file that has it.
#[derive(Debug, thiserror::Error)]
#[error("{}", printable(&format!("{}: {problem}", path.display())))]
pub struct FileError {
    /// The file that was to be read or written.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: Problem,
}

/// A text without control characters, such as colours and new lines, which a file may have put into it.
fn printable(text: &str) -> String {
    let shown = |one: char| if one.is_control() { one.escape_default().to_string() } else { one.to_string() };
    text.chars().map(shown).collect()
}

/// The problem with a file, or with the data to be written to it.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The operating system refused.
    #[error("{0}")]
    Io(io::Error),
    /// The bytes contradict the format.
    #[error("damaged file: {0}")]
    Damaged(String),
    /// An intact file of a kind that is not read here.
    #[error("found {found}; accepted: {accepted}")]
    Unsupported {
        /// The kind of the file.
        found: String,
        /// The kinds that are accepted.
        accepted: &'static str,
    },
    /// A header that claims more than the file can hold.
    #[error(
        "damaged file: its header claims {claimed} bytes of pixels, which a file of {length} bytes cannot hold"
    )]
    Oversized {
        /// Bytes of pixels according to the header.
        claimed: u128,
        /// Bytes on disk.
        length: u64,
    },
    /// Something that the caller asked for does not exist or does not fit.
    #[error("{0}")]
    Argument(String),
}

impl Problem {
    /// A decoder panicked, because it met bytes that it was not prepared for.
    pub(super) fn from_panic(panic: &(dyn Any + Send)) -> Self {
        let message = panic
            .downcast_ref::<&str>()
            .map(ToString::to_string)
            .or_else(|| panic.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "no message".into());
        Self::Damaged(format!("the decoder gave up ({message})"))
    }
}

impl From<io::Error> for Problem {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::Damaged("it ends too early".into()),
            // A seek beyond any file, by an offset that the file contains.
            io::ErrorKind::InvalidInput => Self::Damaged("it points outside itself".into()),
            // Decoders report their own findings as I/O errors without an error number of the system.
            _ if error.raw_os_error().is_none() => Self::Damaged(error.to_string()),
            _ => Self::Io(error),
        }
    }
}
