//! What the barrel hides, for shaders: see `shaders/lens/clip.wgsl`.

use crate::cpu::lens::Clip;
use crate::gpu::shader::shared;

shared! {
    pub struct Barrel {
        centre: [f32; 2],
        per_px: f32,
        first: u32,
        lean: [f32; 2],
        directions: u32,
        distances: u32,
    }
}

impl Barrel {
    /// A barrel before an opening under a focus plane that leans, and its table of open parts, which lies at `first`.
    pub fn new(clip: Option<&Clip>, lean: [f64; 2], first: usize) -> (Barrel, Vec<f32>) {
        let none = Barrel {
            centre: [0.0; 2],
            per_px: 0.0,
            first: first as u32,
            lean: lean.map(|v| v as f32),
            directions: 0,
            distances: 0,
        };
        let Some(clip) = clip else { return (none, Vec::new()) };
        let (open, [directions, distances]) = clip.table();
        let barrel = Barrel {
            centre: clip.barrel().centre.map(|v| v as f32),
            per_px: clip.barrel().per_px as f32,
            directions: directions as u32,
            distances: distances as u32,
            ..none
        };
        (barrel, open)
    }
}
