//! The adjoint of sharpening cells, and of widening them by their direct neighbours.

use crate::cpu::lens::frame::Frame;
use crate::memory::Buffer;
use crate::picture::Size;
use crate::plan::lens::footprint;
use crate::scene::colors::Colors;
use crate::scene::contrast::light_channels;
use crate::scene::depth_spans::{self, Cell};
use rayon::prelude::*;

/// What a cell of another layer gets.
struct Flow {
    to: Cell,
    from: usize,
    weight: f32,
}

/// What the cells of each layer contribute, from what they do once sharpened. `drawn` are the colours of the picture in
/// each layer, which decide how far.
pub fn adjoint(
    frame: &Frame,
    size: Size,
    drawn: Vec<Colors>,
    sharpened: Vec<Buffer<f32>>,
) -> Vec<Buffer<f32>> {
    let (n, layers) = (size.pixels(), &frame.scene.layers);
    // Each is let go of as its planes are made.
    let guide: Vec<Buffer<f32>> = drawn.into_iter().map(|colors| colors.to_planes()).collect();
    let kappa: Vec<Buffer<f32>> = layers
        .iter()
        .map(|layer| {
            let mut kappa = Buffer::unset(n);
            let rows = kappa.par_chunks_mut(size.width).zip(layer.s.par_chunks(size.width));
            rows.for_each(|(kappa, s)| frame.footprint.sharpening(s, frame.s_focus, kappa));
            kappa
        })
        .collect();
    let lights = light_channels(size);
    // The weight with which a cell takes of another one.
    let weight = |cell: Cell, q: Cell| {
        let light = |cell: Cell| -> [f32; 4] {
            std::array::from_fn(|c| if c < lights { guide[cell.layer][c * n + cell.index] } else { 0.0 })
        };
        footprint::guided(kappa[cell.layer][cell.index], light(cell), light(q))
    };
    let mut out: Vec<Buffer<f32>> = sharpened.clone();
    let mut flows: Vec<Flow> = Vec::new();
    for (layer, out) in out.iter_mut().enumerate() {
        let mut rows = crate::rows::bands(out.chunks_mut(n), size.width);
        let of_row = |(y, row): (usize, &mut Vec<&mut [f32]>)| {
            let mut flows = Vec::new();
            for x in 0..size.width {
                let cell = Cell { layer, index: y * size.width + x };
                if layers[layer].s[cell.index].is_nan() {
                    continue;
                }
                for q in depth_spans::neighbours(layers, size, cell) {
                    let taken = weight(cell, q);
                    let given = if q.layer == layer { weight(q, cell) } else { 0.0 };
                    for (c, row) in row.iter_mut().enumerate() {
                        let at = |index: usize| sharpened[layer][c * n + index];
                        row[x] += taken * at(cell.index) - given * at(q.index);
                    }
                    if q.layer != layer && taken != 0.0 {
                        flows.push(Flow { to: q, from: cell.index, weight: taken });
                    }
                }
            }
            flows
        };
        let found: Vec<Vec<Flow>> = rows.par_iter_mut().enumerate().map(of_row).collect();
        // Cells of other layers are few: those beside edges.
        for flow in found.into_iter().flatten() {
            flows.push(Flow { from: layer * n + flow.from, ..flow });
        }
    }
    for Flow { to, from, weight } in flows {
        let (layer, index) = (from / n, from % n);
        for c in 0..size.channels {
            out[to.layer][c * n + to.index] -= weight * sharpened[layer][c * n + index];
        }
    }
    out
}
