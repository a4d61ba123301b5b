//! Any bytes as an OpenEXR file: what it lists, all channels of its first part in either window, and its deep pixels.
#![no_main]

use _dofsim::files::openexr::{View, parts, read, read_deep};
use dofsim_fuzz::{quiet_panics, read_file};
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: quiet_panics(), |bytes: &[u8]| {
    read_file(bytes, |path| {
        if let Ok(Some(deep)) = read_deep(path, "Z", &["Z", "A"].map(String::from)) {
            assert_eq!(deep.counts.len(), deep.data_window.width * deep.data_window.height);
            let samples: usize = deep.counts.iter().map(|count| *count as usize).sum();
            assert!(deep.channels.iter().all(|(_, channel)| channel.len() == samples));
        }
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
