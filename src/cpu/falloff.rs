//! Falloff: the lens darkens the picture away from the axis.

use crate::optics::Falloff;
use crate::picture::Size;
use crate::plan::lens::optical_vignetting::PupilClip;
use rayon::prelude::*;

/// Darkens the `lights` first channels of an interleaved picture. `clip` gives the part of the opening that the
/// second stop leaves open.
pub fn darken(picture: &mut [f32], size: Size, lights: usize, falloff: &Falloff, clip: Option<&PupilClip>) {
    let clip = clip.filter(|_| falloff.optical);
    picture.par_chunks_mut(size.width * size.channels).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_mut(size.channels).enumerate() {
            let (x, y) = (x as f64, y as f64);
            let passes = falloff.cos4(x, y) * clip.map_or(1.0, |clip| clip.open(x, y));
            pixel[..lights].iter_mut().for_each(|v| *v *= passes as f32);
        }
    });
}
