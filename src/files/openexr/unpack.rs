//! The lossless codecs that deep blocks may be stored by.

use super::deep_header::Compression;
use crate::files::error::Problem;
use std::borrow::Cow;
use zune_inflate::{DeflateDecoder, DeflateOptions};

/// The `length` bytes that were packed. What packing would not have made shorter is stored as it was.
pub fn unpack(packed: &[u8], length: usize, compression: Compression) -> Result<Cow<'_, [u8]>, Problem> {
    let unpacked = match compression {
        _ if packed.len() == length => return Ok(Cow::Borrowed(packed)),
        Compression::None => None,
        Compression::Rle => runs(packed, length),
        Compression::Zip => {
            let options =
                DeflateOptions::default().set_limit(length).set_size_hint(most(packed.len(), length));
            DeflateDecoder::new_with_options(packed, options).decode_zlib().ok()
        }
    };
    match unpacked.filter(|bytes| bytes.len() == length) {
        Some(bytes) => Ok(Cow::Owned(joined(&bytes))),
        None => Err(Problem::Damaged("a block of pixels cannot be unpacked".into())),
    }
}

/// The most bytes that deflate or runs make of one.
pub const EXPANSION: usize = 1032;

/// The most bytes that deflate or runs make of so many.
fn most(packed: usize, length: usize) -> usize {
    packed.saturating_mul(EXPANSION).min(length)
}

/// Runs of bytes: a number from 0 on says one less than how often the next byte is repeated, a negative one how many bytes
/// follow as they are.
fn runs(packed: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(most(packed.len(), length));
    let mut rest = packed;
    while let Some((&number, behind)) = rest.split_first() {
        let number = i32::from(number as i8);
        if number < 0 {
            let (bytes, behind) = behind.split_at_checked(number.unsigned_abs() as usize)?;
            out.extend_from_slice(bytes);
            rest = behind;
        } else {
            let (byte, behind) = behind.split_first()?;
            out.resize(out.len() + number as usize + 1, *byte);
            rest = behind;
        }
        if out.len() > length {
            return None;
        }
    }
    Some(out)
}

/// Undoes what is done before packing: bytes at even places come first and those at odd places after them, and each is
/// stored as its difference from the one before, plus 128.
fn joined(bytes: &[u8]) -> Vec<u8> {
    let mut sums = bytes.to_vec();
    let mut before = 0u8;
    for (i, byte) in sums.iter_mut().enumerate() {
        if i > 0 {
            *byte = byte.wrapping_add(before).wrapping_sub(128);
        }
        before = *byte;
    }
    let (even, odd) = sums.split_at(sums.len().div_ceil(2));
    let mut out = vec![0; sums.len()];
    for (pair, (even, odd)) in out.chunks_exact_mut(2).zip(even.iter().zip(odd)) {
        pair.copy_from_slice(&[*even, *odd]);
    }
    if even.len() > odd.len()
        && let (Some(last), Some(byte)) = (out.last_mut(), even.last())
    {
        *last = *byte;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_repeated_or_copied() {
        let packed = [3u8, 7, (-2i8) as u8, 1, 2];
        assert_eq!(runs(&packed, 6), Some(vec![7, 7, 7, 7, 1, 2]));
        assert_eq!(runs(&packed, 5), None);
        assert_eq!(runs(&packed[..4], 6), None);
        assert_eq!(runs(&packed[..1], 6), None);
    }

    #[test]
    fn halves_are_joined() {
        // Values 10 20 30 40 50: even places 10 30 50, odd ones 20 40; then differences plus 128.
        let differences = [10u8, 148, 148, 98, 148];
        assert_eq!(joined(&differences), [10, 20, 30, 40, 50]);
        assert_eq!(joined(&differences[..1]), [10]);
        assert!(joined(&[]).is_empty());
    }

    #[test]
    fn what_is_not_shorter_is_stored_as_it_was() {
        for compression in [Compression::None, Compression::Rle, Compression::Zip] {
            assert_eq!(&*unpack(&[1, 2, 3], 3, compression).unwrap(), [1, 2, 3]);
            assert!(unpack(&[1, 2, 3], 4, compression).is_err());
        }
    }
}
