//! Errors of the decoder as errors of this crate.

use crate::files::error::Problem;

impl From<::exr::error::Error> for Problem {
    fn from(error: ::exr::error::Error) -> Self {
        use ::exr::error::Error;
        match error {
            Error::Io(error) => error.into(),
            Error::NotSupported(what) => Self::Unsupported {
                found: what.into_owned(),
                accepted: "flat (not deep) channels with a sample for every pixel, compressed by RLE, ZIP, \
                           ZIPS, PIZ, PXR24, B44, B44A, DWAA, DWAB or not",
            },
            Error::Invalid(what) => Self::Damaged(what.into_owned()),
            Error::Aborted => Self::Damaged("reading was broken off".into()),
        }
    }
}
