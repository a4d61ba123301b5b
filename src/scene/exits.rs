//! Exits: where the rays behind a pixel leave the foreground, and the hidden surface that they tell of.

use super::edges::CONNECTED_PX;
use super::recipe::{Cargo, Source};

/// Directions in which rays march from a hidden pixel: exits 16 pixels away are 6 pixels apart.
pub const DIRECTIONS: usize = 16;
/// Exits whose shifts differ by less are on one surface: each is within a step of the one that most exits agree on.
pub const SAME_SURFACE_PX: f32 = 2.0;

/// Where a ray left the foreground.
#[derive(Clone, Copy)]
pub struct Exit {
    pub distance: f32,
    pub s: f32,
    /// The colour that goes on behind the foreground, and which part of the pixel's light that is.
    pub color: [f32; 4],
    pub light: f32,
    pub source: Source,
    /// How much it counts: less and less as the lens hardly reaches it.
    pub share: f32,
}

/// The surface on which the rays of all directions agree.
#[derive(Clone)]
pub struct Found<L> {
    pub s: f32,
    pub color: [f32; 4],
    pub carried: L,
}

/// The shift that most exits agree on; nearer exits count more.
fn surface_of(exits: &[Exit]) -> Option<f32> {
    // The arrays are padded with entries that agree with nothing, so that the loops have a fixed length.
    let (mut s, mut weight, mut votes) = ([f32::NAN; DIRECTIONS], [0.0; DIRECTIONS], [0.0f32; DIRECTIONS]);
    for (i, h) in exits.iter().enumerate() {
        (s[i], weight[i]) = (h.s, h.share / (h.distance * h.distance));
    }
    for (other, weight) in s.iter().zip(weight).take(exits.len()) {
        for (votes, s) in votes.iter_mut().zip(s) {
            *votes += if (other - s).abs() < CONNECTED_PX { weight } else { 0.0 };
        }
    }
    let found = votes.into_iter().zip(s).take(exits.len());
    found.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, s)| s)
}

/// The mean of the middle quarter of some values with weights, in the order of size. A median would jump as a value is
/// added, however little that counts.
fn middle_mean(values: &mut [(f32, f32)]) -> f32 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let all: f32 = values.iter().map(|(_, weight)| weight).sum();
    let (from, to) = (0.375 * all, 0.625 * all);
    let (mut before, mut sum) = (0.0, 0.0);
    for (value, weight) in values {
        let within = (before + *weight).min(to) - f32::max(before, from);
        sum += within.max(0.0) * *value;
        before += *weight;
    }
    sum / (to - from)
}

/// The hidden surface, merged from the exits around it. The first `lights` channels of their colours hold light.
pub fn merge<C: Cargo>(exits: &[Exit], lights: usize, cargo: &C) -> Option<Found<C::Load>> {
    let surface = surface_of(exits)?;
    let on_surface = |h: &&Exit| (h.s - surface).abs() < SAME_SURFACE_PX;

    // What is bright for one ray alone must not be smeared over the whole hidden region.
    let brightness = |h: &Exit| h.color[..lights].iter().sum::<f32>();
    let (mut all, mut n) = ([(0.0, 0.0); DIRECTIONS], 0);
    for h in exits.iter().filter(on_surface) {
        all[n] = (brightness(h), h.share);
        n += 1;
    }
    let most = 4.0 * middle_mean(&mut all[..n]).max(f32::MIN_POSITIVE);
    // All of what is up to twice as bright as that, and nothing from four times on.
    let typical = |h: &Exit| (2.0 - 2.0 * brightness(h) / most).clamp(0.0, 1.0);
    let weighed = exits.iter().filter(on_surface).map(|h| (h, h.share * typical(h) / h.distance));

    let (mut weight, mut s, mut color) = (0.0, 0.0, [0.0; 4]);
    for (h, w) in weighed.clone() {
        weight += w;
        s += w * h.s;
        for (sum, c) in color.iter_mut().zip(h.color) {
            *sum += w * c;
        }
    }
    if weight <= 0.0 {
        return None;
    }
    let mut carried = cargo.nothing();
    weighed
        .filter(|(_, w)| *w > 0.0)
        .for_each(|(h, w)| cargo.add(&mut carried, w / weight, h.light, h.source));
    Some(Found { s: s / weight, color: color.map(|c| c / weight), carried })
}
