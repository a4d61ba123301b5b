//! Files that appear under their name only when they are complete.

use super::error::{Problem, Result};
use super::source::with_path;
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Writes a file beside `path` and moves it there when `write` has succeeded.
///
/// If anything fails, the previous file at `path` is still there, and no other file remains.
pub fn replace(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> std::result::Result<(), Problem>,
) -> Result<()> {
    with_path(path, || {
        let target = target(path)?;
        let (temporary, file) = Temporary::beside(&target)?;
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        write(&mut writer)?;
        let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
        // Some systems do not rename an open file. Elsewhere it stays locked until it has its name.
        let locked = cfg!(unix).then_some(file);
        temporary.rename(&target)?;
        drop(locked);
        Ok(())
    })
}

/// Writes `bytes` to `path` as [`replace`] does.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    replace(path, |writer| Ok(writer.write_all(bytes)?))
}

/// The path that is replaced: symbolic links are followed, and a device or a folder is never replaced.
fn target(path: &Path) -> std::result::Result<PathBuf, Problem> {
    let target = match fs::canonicalize(path) {
        Ok(existing) => existing,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(path.to_owned()),
        Err(error) => return Err(error.into()),
    };
    if target.is_file() {
        Ok(target)
    } else if target.is_dir() {
        Err(Problem::Argument("is a folder; a picture needs the name of a file".into()))
    } else {
        Err(Problem::Argument("is a pipe or a device; pictures go to regular files".into()))
    }
}

/// As much of a name as leaves room for more: file systems allow 255 bytes.
fn beginning(name: &OsStr) -> String {
    const MOST_BYTES: usize = 200;
    let name = name.to_string_lossy();
    name.char_indices()
        .take_while(|(at, one)| at + one.len_utf8() <= MOST_BYTES)
        .map(|(_, one)| one)
        .collect()
}

/// A file that removes itself unless it is renamed.
///
/// It is locked while it is open, and the system ends the lock with the process: a file of such a name that can be
/// locked is one that its process did not live to finish. A process's number says less, for it is soon another's, or
/// that of a process on another machine.
struct Temporary(Option<PathBuf>);

impl Temporary {
    fn beside(target: &Path) -> std::result::Result<(Self, File), Problem> {
        static COUNTER: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().ok_or_else(|| Problem::Argument("is not the name of a file".into()))?;
        loop {
            let count = COUNTER.fetch_add(1, Ordering::Relaxed);
            let hidden = format!(".{}.{}-{count}.part", beginning(name), std::process::id());
            let path = target.with_file_name(hidden);
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) if is_held(&file, &path) => return Ok((Self(Some(path)), file)),
                // Whoever removes unfinished files came between the making and the lock.
                Ok(_) => (),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => (),
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn rename(mut self, target: &Path) -> io::Result<()> {
        if let Some(path) = &self.0 {
            fs::rename(path, target)?;
            self.0 = None;
        }
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(path) = &self.0 {
            // Another error is already being returned, which says more than this one would.
            let _ = fs::remove_file(path);
        }
    }
}

/// Locks a new file, and tells whether it is still there and not another's.
///
/// Where there are no locks, nobody else locks it either, and it is as safe.
fn is_held(file: &File, path: &Path) -> bool {
    !matches!(file.try_lock(), Err(TryLockError::WouldBlock)) && path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg_attr(not(unix), ignore = "an open file cannot be renamed")]
    fn a_file_is_locked_until_it_has_its_name() {
        let folder = std::env::temp_dir().join(format!("dofsim-atomic-{}", std::process::id()));
        fs::create_dir(&folder).unwrap();
        let target = folder.join("a.txt");
        let lock = |path: &Path| File::open(path).unwrap().try_lock();
        replace(&target, |writer| {
            let part = fs::read_dir(&folder)?.next().unwrap()?.path();
            assert!(matches!(lock(&part), Err(TryLockError::WouldBlock)));
            Ok(writer.write_all(b"whole")?)
        })
        .unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"whole");
        assert!(lock(&target).is_ok());
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_file_that_was_taken_for_an_unfinished_one_is_not_held() {
        let path = std::env::temp_dir().join(format!("dofsim-taken-{}", std::process::id()));
        let file = File::create(&path).unwrap();
        let other = File::open(&path).unwrap();
        other.lock().unwrap();
        assert!(!is_held(&file, &path));
        fs::remove_file(&path).unwrap();
        other.unlock().unwrap();
        assert!(!is_held(&file, &path));
    }
}
