//! Any bytes as a JPEG, which has no checksum: what is read as a picture is none without its end.
#![no_main]

use _dofsim::files::read_raster;
use dofsim_fuzz::{check, quiet_panics, read_file};
use libfuzzer_sys::fuzz_target;

const START: &[u8] = b"\xff\xd8\xff";
const END: &[u8] = b"\xff\xd9";

fuzz_target!(init: quiet_panics(), |bytes: &[u8]| {
    let Some(rest) = bytes.get(START.len()..) else { return };
    let whole = [START, rest].concat();
    let Ok(raster) = read_file(&whole, |path| read_raster(path, false)) else { return };
    check(&raster);
    let end = whole.windows(END.len()).position(|two| two == END).expect("what is read has an end");
    assert!(read_file(&whole[..end], |path| read_raster(path, false)).is_err(), "a picture without its end was read");
});
