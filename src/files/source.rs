//! Open files, limits for their headers' claims, and errors with their paths.

use super::error::{FileError, Problem, Result};
use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// An open file and its length in bytes.
pub struct Source {
    pub reader: BufReader<File>,
    pub length: u64,
}

/// Opens a regular file.
pub(super) fn open(path: &Path) -> std::result::Result<Source, Problem> {
    check_regular(path)?;
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    Ok(Source { reader: BufReader::with_capacity(1 << 16, file), length })
}

/// Refuses pipes and devices before they are opened: to open a pipe is to wait for whoever writes into it.
pub fn check_regular(path: &Path) -> std::result::Result<(), Problem> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_file() || kind.is_dir() {
        return Ok(());
    }
    Err(Problem::Unsupported {
        found: "a pipe or a device".into(),
        accepted: "regular files, because they are not read front to back",
    })
}

/// The number of bytes that any file may claim, however short it is: a flat picture compresses almost without limit.
const ALWAYS_ALLOWED: u64 = 256 << 20;

/// The largest expansion of one byte by deflate, the tightest of the lossless codecs here, plus half as much again.
const EXPANSION: u64 = 1536;

/// Refuses a header that claims more bytes of pixels than a file of this length can hold.
pub(super) fn check_claim(claimed: u128, length: u64) -> std::result::Result<(), Problem> {
    let most = u128::from(length) * u128::from(EXPANSION) + u128::from(ALWAYS_ALLOWED);
    if claimed > most || usize::try_from(claimed).is_err() {
        return Err(Problem::Oversized { claimed, length });
    }
    Ok(())
}

/// Runs `work`, adds the path to its error, and turns a panic inside a decoder into an error.
pub(super) fn with_path<T>(path: &Path, work: impl FnOnce() -> std::result::Result<T, Problem>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|panic| Err(Problem::from_panic(panic.as_ref())))
        .map_err(|problem| FileError { path: path.to_owned(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_is_held_against_the_length_of_the_file() {
        assert!(check_claim(60_000 * 60_000 * 3, 1024).is_err());
        assert!(check_claim(4096 * 4096 * 16, 1024).is_ok());
        assert!(check_claim(u128::MAX, u64::MAX).is_err());
    }

    #[test]
    fn a_panic_becomes_an_error_that_names_the_file() {
        let error = with_path::<()>(Path::new("a.exr"), || panic!("sample bug")).unwrap_err();
        assert_eq!(error.to_string(), "a.exr: damaged file: the decoder gave up (sample bug)");
    }
}
