//! What a view sees and the reference does not, resampled onto the pixels of the reference.
//!
//! Neighbouring pixels of a view that are on one surface are the corners of a piece of it. Pieces are drawn on the grid of the
//! reference, so that a surface has neither holes nor doubled rims however it is stretched or squeezed.

use super::depth_map::{DepthMap, SAME_PX, another};
use super::evidence::Evidence;
use super::lamps::{self, LampPixel, LampQuad};
use super::source::{Source, Strip};
use crate::scene::edges::{DOWN, EDGE, RIGHT};
use std::ops::Range;

/// What a view sees of a surface at a pixel of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fragment {
    pub index: usize,
    pub disparity: f32,
    /// How far two fragments of one surface may be apart in disparity.
    pub tolerance: f32,
    /// Whether it was elsewhere when the view was taken.
    pub moved: bool,
    /// How well the view sees it: pixels of the view to one of the reference, at most 1, times how far it is trusted.
    pub weight: f32,
    /// How much of the pixel it covers.
    pub coverage: f32,
    /// Times its coverage.
    pub color: [f32; 4],
}

/// A pixel of a view in the picture of the reference.
#[derive(Clone, Copy)]
struct Corner {
    x: f32,
    y: f32,
    disparity: f32,
    trust: f32,
    hidden: bool,
    moved: bool,
    /// How much of it its surface leaves bare.
    bare: f32,
    /// Times its coverage.
    color: [f32; 4],
}

impl Corner {
    /// A pixel that shows one surface.
    #[inline(always)]
    fn whole(source: &Source, index: usize) -> Option<Corner> {
        if source.connectivity[index] & EDGE != 0 || source.evidence[index] == Evidence::Contradicts {
            return None;
        }
        let hidden = source.evidence[index] == Evidence::Hidden;
        Corner::new(source, index, index, 0.0, source.view.color_at(index), hidden)
    }

    /// The surface at pixel `sample` as it is at another pixel.
    #[inline(always)]
    fn new(
        source: &Source,
        sample: usize,
        index: usize,
        bare: f32,
        color: [f32; 4],
        hidden: bool,
    ) -> Option<Corner> {
        let seen = source.to_reference.continued(sample, index)?;
        Some(Corner {
            x: seen.x as f32,
            y: seen.y as f32,
            disparity: seen.disparity as f32,
            trust: source.trust(index % source.depth.width, index / source.depth.width),
            hidden,
            moved: source.to_reference.has_moved(sample),
            bare,
            color,
        })
    }
}

/// The rows of the reference that are drawn, and what limits what is drawn.
pub struct Canvas<'a> {
    pub rows: Range<usize>,
    pub reference: DepthMap<'a>,
    /// Whether a lens can see a point at this disparity behind a pixel.
    pub visible: &'a (dyn Fn(usize, f32) -> bool + Sync),
}

/// Draws what a source sees behind the reference's surfaces.
pub fn draw(source: &Source, canvas: &Canvas, out: &mut Vec<Fragment>) {
    let (first, last) = (canvas.rows.start as f32, (canvas.rows.end - 1) as f32);
    let mut rows = [Vec::new(), Vec::new()];
    for strip in source.strips.iter().filter(|strip| strip.y[0] <= last && strip.y[1] >= first) {
        corners(source, strip, &mut rows);
        draw_strip(source, strip, &rows, canvas, out);
    }
    for quad in source.lamps.quads.iter().filter(|quad| quad.y[0] <= last && quad.y[1] >= first) {
        draw_quad_of_lamp(source, quad, canvas, out);
    }
}

/// The corners of a strip: two rows.
fn corners(source: &Source, strip: &Strip, rows: &mut [Vec<Option<Corner>>; 2]) {
    let width = source.depth.width;
    for (row, out) in rows.iter_mut().enumerate() {
        let y = strip.row + row;
        out.clear();
        out.extend(strip.columns.clone().map(|x| Corner::whole(source, y * width + x)));
    }
}

fn draw_strip(
    source: &Source,
    strip: &Strip,
    [above, below]: &[Vec<Option<Corner>>; 2],
    canvas: &Canvas,
    out: &mut Vec<Fragment>,
) {
    let width = source.depth.width;
    for i in 0..strip.columns.len() - 1 {
        let corners = [above[i], above[i + 1], below[i], below[i + 1]];
        if !corners.iter().flatten().any(|corner| corner.hidden) {
            continue;
        }
        let at = strip.row * width + strip.columns.start + i;
        let joined = |index: usize, bit: u8| source.connectivity[index] & bit != 0;
        let (top, bottom) = (joined(at, RIGHT), joined(at + width, RIGHT));
        let (left, right) = (joined(at, DOWN), joined(at + 1, DOWN));
        let mut piece = |a: usize, b: usize, c: usize, joined: bool| {
            if let (Some(a), Some(b), Some(c), true) = (corners[a], corners[b], corners[c], joined)
                && (a.hidden || b.hidden || c.hidden)
            {
                draw_piece(source, [a, b, c], canvas, out);
            }
        };
        // Both pieces need the diagonal, whose ends are joined if there is a way over a third corner.
        if corners[1].is_some() && corners[2].is_some() {
            piece(0, 1, 2, top && left);
            piece(3, 2, 1, bottom && right);
        } else {
            piece(1, 3, 0, top && right);
            piece(2, 0, 3, left && bottom);
        }
    }
}

/// Draws what a lamp covers between four pixels, but for pieces that show nothing else: those are drawn already.
fn draw_quad_of_lamp(source: &Source, quad: &LampQuad, canvas: &Canvas, out: &mut Vec<Fragment>) {
    let DepthMap { width, disparity, .. } = source.depth;
    let [least, most] = quad.disparities;
    let behind = |index: usize| source.k * (least - disparity[index]);
    let in_front = |index: usize| source.k * (disparity[index] - most);
    let is_lamp = |pixel: &&LampPixel| (least..=most).contains(&disparity[pixel.sample]);
    let places = lamps::corners(quad.index, width);
    let mixed = places.map(|at| source.lamps.at(at).filter(is_lamp));
    let is_whole =
        |i: usize| mixed[i].is_none() && behind(places[i]) <= SAME_PX && in_front(places[i]) <= SAME_PX;
    let corner = |i: usize| {
        let at = places[i];
        if let Some(lamp) = mixed[i] {
            let color = lamp.color.map(|c| lamp.coverage * c);
            let corner = Corner::new(source, lamp.sample, at, 1.0 - lamp.coverage, color, true)?;
            let is_seen = lamp.evidence != Evidence::Contradicts;
            return is_seen.then_some(Corner { trust: lamp.visible * corner.trust, ..corner });
        }
        if is_whole(i) {
            return Corner::whole(source, at);
        }
        if in_front(at) > 0.0 {
            return None;
        }
        // It sees past the lamp, which is continued from beside it.
        let lamp = [1, 2, 3].into_iter().find_map(|other| mixed[i ^ other])?;
        Corner::new(source, lamp.sample, at, 1.0, [0.0; 4], true)
    };
    let corners = [0, 1, 2, 3].map(corner);
    let whole = [0, 1, 2, 3].map(|i| is_whole(i) && corners[i].is_some());
    // The diagonal along which the other pieces of these four pixels are drawn.
    let pieces = if whole[0] && whole[3] && !(whole[1] && whole[2]) {
        [[1, 3, 0], [2, 0, 3]]
    } else {
        [[0, 1, 2], [3, 2, 1]]
    };
    for piece in pieces.into_iter().filter(|piece| !piece.iter().all(|i| whole[*i])) {
        if let [Some(a), Some(b), Some(c)] = piece.map(|i| corners[i]) {
            draw_piece(source, [a, b, c], canvas, out);
        }
    }
}

/// Draws a triangle: one fragment for each pixel whose centre it contains.
fn draw_piece(source: &Source, [a, b, c]: [Corner; 3], canvas: &Canvas, out: &mut Vec<Fragment>) {
    let DepthMap { width, .. } = canvas.reference;
    // Twice the area. A piece that is seen from behind is drawn the other way round.
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    let (b, c, area) = if area < 0.0 { (c, b, -area) } else { (b, c, area) };
    if area.is_nan() || area <= 0.0 {
        return;
    }
    let least = |p: f32, q: f32, r: f32| p.min(q).min(r).ceil();
    let most = |p: f32, q: f32, r: f32| p.max(q).max(r).floor();
    let x0 = least(a.x, b.x, c.x).max(0.0);
    let x1 = most(a.x, b.x, c.x).min((width - 1) as f32);
    let y0 = least(a.y, b.y, c.y).max(canvas.rows.start as f32);
    let y1 = most(a.y, b.y, c.y).min((canvas.rows.end - 1) as f32);
    if x0 > x1 || y0 > y1 {
        return;
    }
    for y in y0 as usize..=y1 as usize {
        for x in x0 as usize..=x1 as usize {
            let (px, py) = (x as f32, y as f32);
            let opposite_a = side(b, c, px, py);
            let opposite_b = side(c, a, px, py);
            let opposite_c = side(a, b, px, py);
            let (Some(wa), Some(wb), Some(wc)) = (opposite_a, opposite_b, opposite_c) else { continue };
            let all = wa + wb + wc;
            if all <= 0.0 {
                continue;
            }
            let (wa, wb, wc) = (wa / all, wb / all, wc / all);
            let mean = |of: fn(&Corner) -> f32| wa * of(&a) + wb * of(&b) + wc * of(&c);
            let (index, disparity) = (y * width + x, mean(|corner| corner.disparity));
            let hidden = another(canvas.reference.behind_px(index, disparity, source.k));
            // Two pieces make a pixel of the view.
            let weight = hidden * mean(|corner| corner.trust) * area.recip().min(1.0);
            if weight > 0.0 && (canvas.visible)(index, disparity) {
                out.push(Fragment {
                    index,
                    disparity,
                    tolerance: 1.0 / source.k,
                    moved: a.moved || b.moved || c.moved,
                    weight,
                    coverage: 1.0 - mean(|corner| corner.bare),
                    color: std::array::from_fn(|i| wa * a.color[i] + wb * b.color[i] + wc * c.color[i]),
                });
            }
        }
    }
}

/// On which side of the line from `p` to `q` a place lies: `None` outside. A place on the line is inside of one of the two
/// pieces that share it: of the one for which the line is a top or a left one.
#[inline(always)]
fn side(p: Corner, q: Corner, x: f32, y: f32) -> Option<f32> {
    let (dx, dy) = (q.x - p.x, q.y - p.y);
    let side = dx * (y - p.y) - dy * (x - p.x);
    let inside = side > 0.0 || (side == 0.0 && (dy < 0.0 || (dy == 0.0 && dx > 0.0)));
    inside.then_some(side)
}
