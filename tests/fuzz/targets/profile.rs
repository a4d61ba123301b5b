//! Any bytes as what a picture has beside its pixels, a colour profile or Exif: they change none of its pixels.
//!
//! Everything around these bytes is sound, checksums too, so that they reach whoever parses them.
#![no_main]

use _dofsim::files::{Raster, Samples, read_raster};
use dofsim_fuzz::{quiet_panics, read_file};
use libfuzzer_sys::fuzz_target;

const PNG: &[u8] = include_bytes!("../seeds/raster/rgb.png");
const JPEG: &[u8] = include_bytes!("../seeds/jpeg/rgb.jpg");
const WEBP: &[u8] = include_bytes!("../seeds/raster/rgb.webp");

fuzz_target!(init: quiet_panics(), |bytes: &[u8]| {
    let Some((&chosen, bytes)) = bytes.split_first() else { return };
    let (plain, with) = match chosen % 6 {
        0 => (PNG, png(b"iCCP", &[b"profile\0\0", bytes].concat())),
        1 => (PNG, png(b"iCCP", &[b"profile\0\0", &*stored(bytes)].concat())),
        2 => (PNG, png(b"eXIf", bytes)),
        3 => (JPEG, jpeg(0xe2, &[b"ICC_PROFILE\0", bytes].concat())),
        4 => (JPEG, jpeg(0xe1, &[b"Exif\0\0", bytes].concat())),
        _ => (WEBP, webp(bytes)),
    };
    let pixels = |file: &[u8]| read_file(file, |path| read_raster(path, false)).map(|Raster { samples, .. }| match samples {
        Samples::U8(values) => values,
        _ => panic!("a sample of another type"),
    });
    if let Ok(found) = pixels(&with) {
        assert_eq!(Ok(found), pixels(plain).map_err(|_| "the picture without it is sound"));
    }
});

/// A PNG with one more chunk behind its header.
fn png(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    // Its signature, and the chunk of its header: length, kind, 13 bytes and checksum.
    const HEADER: usize = 8 + 4 + 4 + 13 + 4;
    let body = [kind, data].concat();
    let length = (data.len() as u32).to_be_bytes();
    let checksum = crc32fast::hash(&body).to_be_bytes();
    [&PNG[..HEADER], &length, &body, &checksum, &PNG[HEADER..]].concat()
}

/// Bytes as zlib stores those that it cannot deflate, in one block.
fn stored(bytes: &[u8]) -> Vec<u8> {
    let bytes = &bytes[..bytes.len().min(usize::from(u16::MAX))];
    let length = bytes.len() as u16;
    // Adler's checksum: the sum of the bytes and one, and the sum of all these sums.
    let (low, high) = bytes.iter().fold((1, 0), |(low, high), &byte| {
        let low = (low + u32::from(byte)) % 65521;
        (low, (high + low) % 65521)
    });
    let checksum = (high << 16 | low).to_be_bytes();
    [b"\x78\x01\x01", &length.to_le_bytes()[..], &(!length).to_le_bytes(), bytes, &checksum].concat()
}

/// A JPEG with one more segment behind its first marker.
fn jpeg(marker: u8, data: &[u8]) -> Vec<u8> {
    let data = &data[..data.len().min(usize::from(u16::MAX) - 2)];
    let length = (data.len() as u16 + 2).to_be_bytes();
    [&JPEG[..2], &[0xff, marker], &length, data, &JPEG[2..]].concat()
}

/// A WebP of the extended kind, with a profile before its picture.
fn webp(profile: &[u8]) -> Vec<u8> {
    const HAS_PROFILE: u8 = 1 << 5;
    let picture = &WEBP[12..];
    let size = read_file(WEBP, |path| read_raster(path, false)).map(|raster| (raster.width, raster.height));
    let (width, height) = size.unwrap_or_else(|_| panic!("the picture without it is sound"));
    let side = |pixels: usize| (pixels as u32 - 1).to_le_bytes();
    let extended = [&[HAS_PROFILE, 0, 0, 0], &side(width)[..3], &side(height)[..3]].concat();
    let body = [b"WEBP", &*chunk(b"VP8X", &extended), &chunk(b"ICCP", profile), picture].concat();
    chunk(b"RIFF", &body)
}

/// A chunk of RIFF, of even length.
fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let padding = &[0][..data.len() % 2];
    [kind, &(data.len() as u32).to_le_bytes()[..], data, padding].concat()
}
