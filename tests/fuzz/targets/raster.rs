//! Any bytes as a picture file: PNG, JPEG, WebP, BMP, Radiance HDR, TIFF or PFM, as they begin.
#![no_main]

use _dofsim::files::read_raster;
use dofsim_fuzz::{check, quiet_panics, read_file};
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: quiet_panics(), |bytes: &[u8]| {
    if let Ok(raster) = read_file(bytes, |path| read_raster(path, false)) {
        check(&raster);
    }
});
