//! Any bytes as an OpenEXR file: what it lists, and all channels of its first part in either window.
#![no_main]

use _dofsim::files::openexr::{View, parts, read};
use dofsim_fuzz::{quiet_panics, read_file};
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: quiet_panics(), |bytes: &[u8]| {
    read_file(bytes, |path| {
        let Ok(parts) = parts(path) else { return };
        let Some(first) = parts.first() else { return };
        for (view, window) in [(View::Display, first.display_window), (View::Data, first.data_window)] {
            if let Ok(raster) = read(path, 0, &first.channels, view, f32::INFINITY) {
                assert_eq!((raster.width, raster.height), (window.width, window.height));
                assert_eq!(raster.channels, first.channels.len());
            }
        }
    });
});
