//! What the targets share: files of any bytes, and what is asked of pictures read from them.

use _dofsim::files::{Raster, Samples};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Leaves panics to whoever catches them: the readers do, for decoders that meet what they were not made for. What
/// nobody catches ends the fuzzer all the same.
pub fn quiet_panics() {
    std::panic::set_hook(Box::new(|_| ()));
}

/// What `read` makes of a file that holds these bytes.
pub fn read_file<T>(bytes: &[u8], read: impl FnOnce(&Path) -> T) -> T {
    /// Processes that fuzz side by side each have their own.
    static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
        let folder = Path::new("/dev/shm");
        let folder = if folder.is_dir() { folder.to_owned() } else { std::env::temp_dir() };
        folder.join(format!("dofsim-fuzz-{}", std::process::id()))
    });
    std::fs::write(&*FILE, bytes).expect("the folder of temporary files can be written to");
    read(&FILE)
}

/// Panics unless a picture has as many samples as its size says.
pub fn check(raster: &Raster) {
    let samples = match &raster.samples {
        Samples::U8(v) => v.len(),
        Samples::U16(v) => v.len(),
        Samples::U32(v) => v.len(),
        Samples::F16(v) => v.len(),
        Samples::F32(v) => v.len(),
        Samples::F64(v) => v.len(),
    };
    assert_eq!(samples, raster.width * raster.height * raster.channels);
    assert!((1..=4).contains(&raster.channels) && samples > 0);
}
