//! Channels that deep samples have beside colour and coverage, merged as the samples are.
//!
//! Samples that became a layer have shares in it: of their light what passes those before them, and of what is seen of the
//! layer their own coverage past those. A sample that is not merged keeps its values, to the bit.

/// Channels of samples. Each holds those of all pixels one after another.
pub enum Carried<'a> {
    /// Channels side by side, each with what it holds.
    Means(Vec<(Held, &'a [f32])>),
    /// Ids and their coverage, in turn.
    Ids(Vec<&'a [f32]>),
}

/// What a channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Held {
    /// Premultiplied light or coverage: samples go over each other.
    Light,
    /// Anything else: a mean, weighted by what is seen of each sample. What is not finite has no weight.
    Data,
}

/// What a sample has in a layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Its index among all samples.
    pub sample: usize,
    /// The part of its light that comes from the layer.
    pub light: f32,
    /// The coverage that is seen of it there.
    pub seen: f32,
}

impl Carried<'_> {
    /// The number of channels.
    pub fn channels(&self) -> usize {
        match self {
            Self::Means(channels) => channels.len(),
            Self::Ids(channels) => channels.len(),
        }
    }

    /// Appends the values of a layer that samples with these shares became.
    pub fn append(&self, shares: &[Share], out: &mut Vec<f32>) {
        match self {
            Self::Means(channels) => {
                out.extend(channels.iter().map(|(held, values)| held.merged(shares, values)));
            }
            Self::Ids(channels) => append_ids(shares, channels, out),
        }
    }
}

impl Held {
    fn merged(self, shares: &[Share], values: &[f32]) -> f32 {
        match self {
            Self::Light => {
                let sum: f64 = shares.iter().map(|s| f64::from(s.light) * f64::from(values[s.sample])).sum();
                sum as f32
            }
            Self::Data => {
                let finite = shares.iter().filter(|s| values[s.sample].is_finite());
                let [sum, weight] = finite.fold([0.0; 2], |[sum, weight], s| {
                    let seen = f64::from(s.seen);
                    [sum + seen * f64::from(values[s.sample]), weight + seen]
                });
                if weight > 0.0 { (sum / weight) as f32 } else { values[shares[0].sample] }
            }
        }
    }
}

/// Appends as many ids as samples have, those of most coverage first. The ids of a sample share what is seen of it as they
/// share its coverage, and those of the layer all of what is seen.
fn append_ids(shares: &[Share], channels: &[&[f32]], out: &mut Vec<f32>) {
    let mut all: Vec<(u32, f64)> = Vec::new();
    for share in shares {
        let pairs = || channels.chunks_exact(2).map(|pair| [pair[0][share.sample], pair[1][share.sample]]);
        let whole: f64 = pairs().map(|[_, coverage]| f64::from(coverage.max(0.0))).sum();
        for [id, coverage] in pairs().filter(|[_, coverage]| *coverage > 0.0) {
            let seen = f64::from(share.seen) * f64::from(coverage) / whole;
            // By its bits: an id may be that of no number.
            match all.iter_mut().find(|(known, _)| *known == id.to_bits()) {
                Some((_, coverage)) => *coverage += seen,
                None => all.push((id.to_bits(), seen)),
            }
        }
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    let sum = |ids: &[(u32, f64)]| ids.iter().map(|(_, coverage)| coverage).sum::<f64>();
    let kept = &all[..all.len().min(channels.len() / 2)];
    let scale = if kept.is_empty() { 0.0 } else { sum(&all) / sum(kept) };
    let ranks = kept.iter().flat_map(|&(id, coverage)| [f32::from_bits(id), (coverage * scale) as f32]);
    out.extend(ranks.chain(std::iter::repeat(0.0)).take(channels.len()));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(sample: usize, light: f32, seen: f32) -> Share {
        Share { sample, light, seen }
    }

    #[test]
    fn light_goes_over_and_data_are_weighted_by_what_is_seen() {
        let shares = [share(0, 1.0, 0.5), share(1, 0.5, 0.25)];
        assert_eq!(Held::Light.merged(&shares, &[0.25, 1.0]), 0.75);
        assert_eq!(Held::Data.merged(&shares, &[1.0, 4.0]), 2.0);
        assert_eq!(Held::Data.merged(&shares, &[f32::INFINITY, 4.0]), 4.0);
        assert!(Held::Data.merged(&shares, &[f32::NAN, f32::INFINITY]).is_nan());
    }

    #[test]
    fn ids_add_up_to_what_is_seen_and_the_most_come_first() {
        let shares = [share(0, 1.0, 0.125), share(1, 0.875, 0.75)];
        let ids: [&[f32]; 4] = [&[7.0, 9.0], &[0.25, 0.5], &[8.0, 7.0], &[0.0, 0.25]];
        let mut out = Vec::new();
        append_ids(&shares, &ids, &mut out);
        assert_eq!(out, [9.0, 0.5, 7.0, 0.375]);
        out.clear();
        append_ids(&shares, &ids[..2], &mut out);
        assert_eq!(out, [9.0, 0.875]);
        out.clear();
        append_ids(&[], &ids, &mut out);
        assert_eq!(out, [0.0; 4]);
    }
}
