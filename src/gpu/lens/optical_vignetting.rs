//! The second stop in the form that shaders use: see `shaders/lens/optical_vignetting.wgsl`.

use crate::gpu::shader::shared;
use crate::plan::lens::optical_vignetting::PupilClip;

shared! {
    pub struct SecondStop {
        centre: [f32; 2],
        per_px: f32,
        first: u32,
        lean: [f32; 2],
        directions: u32,
        distances: u32,
    }
}

impl SecondStop {
    /// The second stop in front of an opening, for a tilted focus plane, and its table of open parts, which is stored
    /// at index `first`.
    pub fn new(clip: Option<&PupilClip>, lean: [f64; 2], first: usize) -> (SecondStop, Vec<f32>) {
        let none = SecondStop {
            centre: [0.0; 2],
            per_px: 0.0,
            first: first as u32,
            lean: lean.map(|v| v as f32),
            directions: 0,
            distances: 0,
        };
        let Some(clip) = clip else { return (none, Vec::new()) };
        let (open, [directions, distances]) = clip.table();
        let second_stop = SecondStop {
            centre: clip.second_stop().centre.map(|v| v as f32),
            per_px: clip.second_stop().per_px as f32,
            directions: directions as u32,
            distances: distances as u32,
            ..none
        };
        (second_stop, open)
    }
}
