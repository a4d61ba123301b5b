//! The format of a file, detected from its first bytes and not from its name.

use super::error::{Problem, Result};
use super::source::{open, with_path};
use std::io::Read;
use std::path::Path;

/// A file format that dofsim reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// OpenEXR.
    Exr,
    /// Portable Network Graphics.
    Png,
    /// Joint Photographic Experts Group.
    Jpeg,
    /// WebP.
    WebP,
    /// Windows bitmap.
    Bmp,
    /// Radiance HDR, with a shared exponent.
    Hdr,
    /// Tagged Image File Format.
    Tiff,
    /// Portable float map.
    Pfm,
    /// One NumPy array.
    Npy,
    /// A ZIP archive of NumPy arrays.
    Npz,
}

impl Kind {
    /// The short name used in messages and by the Python side.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Png => "png",
            Self::Jpeg => "jpeg",
            Self::WebP => "webp",
            Self::Bmp => "bmp",
            Self::Hdr => "hdr",
            Self::Tiff => "tiff",
            Self::Pfm => "pfm",
            Self::Npy => "npy",
            Self::Npz => "npz",
        }
    }
}

const KINDS: [(&[u8], Kind); 15] = [
    (b"\x76\x2f\x31\x01", Kind::Exr),
    (b"\x89PNG\r\n\x1a\n", Kind::Png),
    (b"\xff\xd8\xff", Kind::Jpeg),
    (b"RIFF", Kind::WebP),
    (b"BM", Kind::Bmp),
    (b"#?", Kind::Hdr),
    (b"II*\0", Kind::Tiff),
    (b"MM\0*", Kind::Tiff),
    (b"II+\0", Kind::Tiff),
    (b"MM\0+", Kind::Tiff),
    (b"PF", Kind::Pfm),
    (b"Pf", Kind::Pfm),
    (b"\x93NUMPY", Kind::Npy),
    (b"PK\x03\x04", Kind::Npz),
    (b"PK\x05\x06", Kind::Npz),
];

/// Formats that users often have instead of the accepted ones, so that errors can name them.
const FOREIGN: [(&[u8], &str); 4] = [
    (b"GIF8", "a GIF picture"),
    (b"P6", "a PPM picture"),
    (b"\x89HDF", "an HDF5 file"),
    (b"PIEH", "a Sintel or Middlebury .dpt/.flo file"),
];

/// Detects the format of a file from its first bytes.
pub fn kind(path: &Path) -> Result<Kind> {
    with_path(path, || {
        let mut start = Vec::with_capacity(12);
        open(path)?.reader.take(12).read_to_end(&mut start)?;
        match KINDS.iter().find(|(magic, _)| start.starts_with(magic)) {
            Some(&(_, kind)) => Ok(kind),
            None => Err(Problem::Unsupported {
                found: describe(&start),
                accepted: "OpenEXR, PNG, JPEG, WebP, BMP, Radiance HDR, TIFF, PFM, NPY and NPZ files",
            }),
        }
    })
}

fn describe(start: &[u8]) -> String {
    if start.is_empty() {
        return "an empty file".into();
    }
    if start.get(4..8) == Some(b"ftyp") {
        return "a HEIC or AVIF picture or a film (dofsim.photo reads HEIC and AVIF)".into();
    }
    match FOREIGN.iter().find(|(magic, _)| start.starts_with(magic)) {
        Some(&(_, name)) => name.into(),
        None => {
            format!("an unknown format that begins with \"{}\"", start[..start.len().min(8)].escape_ascii())
        }
    }
}
