//! Crowding: where many cells are bright, they are texture rather than lamps, and a highlight has to be brighter.
//!
//! The limit is `1 + (f / MANY)^2` times as high, where `f` is the part of all cells that are above it. The more it is
//! raised, the fewer are above: so there is one such limit. A lamp among many cells that are hardly above the first limit
//! is a lamp all the same.

/// The part of all cells that are bright where the limit is twice as high. Of many bright cells each is less of the light
/// that is there, and only as many discs are drawn as a picture has room for.
const MANY: f32 = 1.0 / 64.0;
/// Cells are counted by their brightness in steps, so many in a doubling.
const PER_DOUBLING: f32 = 2.0;
/// From the limit itself to where it would be if all cells were bright: `1 + 1 / MANY^2`, between 12 and 12.5 doublings.
const STEPS: usize = 26;
/// So many halvings of the range of limits leave nothing that an `f32` could tell.
const HALVINGS: usize = 36;

/// How many cells of some blocks are bright, by how many times as bright as the limit they are, of how many in all.
#[derive(Clone, Copy)]
pub struct Crowd {
    bright: [f32; STEPS],
    cells: f32,
}

impl Crowd {
    /// So many cells, none of them bright.
    pub fn dark(cells: f32) -> Crowd {
        Crowd { bright: [0.0; STEPS], cells }
    }

    /// Counts a cell: between two steps, in part for each.
    pub fn count(&mut self, times: f32) {
        let place = (PER_DOUBLING * times.log2()).clamp(0.0, (STEPS - 1) as f32);
        let step = (place as usize).min(STEPS - 2);
        let part = place - step as f32;
        self.bright[step] += 1.0 - part;
        self.bright[step + 1] += part;
    }

    /// All of these together.
    pub fn united<'a>(crowds: impl Iterator<Item = &'a Crowd>) -> Crowd {
        let mut all = Crowd::dark(0.0);
        for crowd in crowds {
            all.bright.iter_mut().zip(crowd.bright).for_each(|(count, other)| *count += other);
            all.cells += crowd.cells;
        }
        all
    }

    /// Whether no cell is bright.
    pub fn is_dark(&self) -> bool {
        self.bright == [0.0; STEPS]
    }

    /// How many cells are above a limit that is raised so many times.
    fn above(&self, raised: f32) -> f32 {
        let step = |(i, count): (usize, &f32)| count * share_above((i as f32 / PER_DOUBLING).exp2(), raised);
        self.bright.iter().enumerate().map(step).sum()
    }

    /// How many times the limit is raised.
    pub fn raises(&self) -> f32 {
        let raised_to = |raised: f32| 1.0 + (self.above(raised) / (MANY * self.cells)).powi(2);
        let (mut lo, mut hi) = (1.0, 1.0 + MANY.recip().powi(2));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (lo + hi);
            if raised_to(middle) > middle { lo = middle } else { hi = middle }
        }
        hi
    }
}

/// How much of a cell counts as above a raised limit: all of it from there on, or from twice the first limit on, and nothing
/// up to half of it, or to the first.
fn share_above(times: f32, raised: f32) -> f32 {
    let (none, all) = ((0.5 * raised).max(1.0), raised.max(2.0));
    ((times - none) / (all - none)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raised(cells: &[(f32, f32)]) -> f32 {
        let mut crowd = Crowd::dark(6400.0);
        for &(times, count) in cells {
            (0..count as usize).for_each(|_| crowd.count(times));
        }
        crowd.raises()
    }

    #[test]
    fn the_limit_rises_with_the_square_of_what_is_above_it() {
        assert_eq!(raised(&[]), 1.0);
        // A sixty-fourth of all cells.
        assert!((raised(&[(1000.0, 100.0)]) - 2.0).abs() < 1e-5);
        assert!((raised(&[(1000.0, 300.0)]) - 10.0).abs() < 1e-4);
        // Whatever hardly stands out, and however much of it, the limit is not far above it.
        for times in [1.2f32, 2.0, 5.0] {
            let wall = raised(&[(times, 3000.0)]);
            assert!(wall > times && wall < 2.3 * times, "{times}: {wall}");
            // A lamp before it changes that by little.
            let lamp = raised(&[(times, 3000.0), (1000.0, 4.0)]);
            assert!(lamp >= wall && lamp < 1.1 * wall, "{times}: {lamp} {wall}");
        }
    }

    #[test]
    fn the_limit_changes_smoothly_as_a_wall_becomes_brighter() {
        let limits: Vec<f32> = (0..3000).map(|i| raised(&[(1.0 + 1e-3 * i as f32, 3000.0)])).collect();
        let steps = limits.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        assert!(steps.fold(0.0, f32::max) < 0.2, "{:?}", &limits[..20]);
    }
}
