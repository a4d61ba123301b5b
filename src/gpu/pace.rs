//! How much work is submitted to a device at once.
//!
//! Drivers end work that takes long: Windows after 2 s, Linux's driver for AMD after 10 s. And what has been submitted
//! cannot be cancelled. So a job is submitted in pieces, of which one runs while the next is recorded. How long work
//! takes is learned from the pieces before. Only where a job is cut depends on it, and no result.

use std::collections::{HashMap, VecDeque};
use std::time::{Duration, Instant};

/// The time that a submission should take.
pub const SUBMISSION: Duration = Duration::from_millis(100);
/// Seconds for a unit of work of a shader that has not run yet: more than on most GPUs, so that the first submission is
/// too short rather than too long. A unit is an invocation, or one of its lens samples.
const UNKNOWN: f64 = 1e-8;
/// The largest factor by which one measurement changes what is expected.
const MOST_CHANGE: f64 = 8.0;
/// Seconds per unit below which no work is expected to be.
const LEAST: f64 = 1e-15;

/// The work of one submission: units of each shader, and how long it is expected to take.
#[derive(Debug, Clone, Default)]
pub struct Work {
    pub seconds: f64,
    shaders: Vec<&'static str>,
}

impl Work {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.shaders.is_empty()
    }
}

/// What has been learned about a device.
#[derive(Default)]
pub struct Pace {
    seconds_per_unit: HashMap<&'static str, f64>,
    measured: Measured,
}

/// The submissions so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Measured {
    /// Number of submissions.
    pub submissions: u64,
    /// The longest one whose end was waited for, in seconds.
    pub longest_s: f64,
}

impl Pace {
    fn expected(&self, shader: &str, units: f64) -> f64 {
        self.seconds_per_unit.get(shader).unwrap_or(&UNKNOWN) * units
    }

    /// Whether a pass still belongs into a submission that should take `limit`.
    pub fn fits(&self, work: &Work, shader: &str, units: f64, limit: Duration) -> bool {
        work.is_empty() || work.seconds + self.expected(shader, units) <= limit.as_secs_f64()
    }

    /// The number of items, one at least, that one pass does within `limit`; `units` is the work of each.
    pub fn items(&self, shader: &str, units: &[f64], limit: Duration) -> usize {
        let mut left = limit.as_secs_f64() - self.expected(shader, units.first().copied().unwrap_or(0.0));
        let more = units.iter().skip(1).take_while(|units| {
            left -= self.expected(shader, **units);
            left >= 0.0
        });
        (1 + more.count()).min(units.len())
    }

    /// Adds a pass to a submission.
    pub fn add(&self, work: &mut Work, shader: &'static str, units: f64) {
        work.seconds += self.expected(shader, units);
        work.shaders.push(shader);
    }

    /// Counts a submission.
    pub fn count(&mut self) {
        self.measured.submissions += 1;
    }

    /// Learns how long a submission took.
    pub fn learn(&mut self, work: &Work, took: Duration) {
        let took = took.as_secs_f64();
        self.measured.longest_s = self.measured.longest_s.max(took);
        if work.seconds <= 0.0 {
            return;
        }
        let change = (took / work.seconds).clamp(1.0 / MOST_CHANGE, MOST_CHANGE);
        let mut shaders = work.shaders.clone();
        shaders.sort_unstable();
        shaders.dedup();
        for shader in shaders {
            let seconds = self.seconds_per_unit.entry(shader).or_insert(UNKNOWN);
            *seconds = (*seconds * change).max(LEAST);
        }
    }

    /// The submissions so far.
    pub fn measured(&self) -> Measured {
        self.measured
    }
}

/// Work that was submitted.
#[derive(Clone)]
pub struct Submission {
    pub number: u64,
    pub index: wgpu::SubmissionIndex,
}

/// Work that may still run.
pub struct Running {
    pub submission: Submission,
    pub work: Work,
    /// When it began to run, if that is known: the device does one submission after the other.
    pub began: Option<Instant>,
}

/// All work that may still run, the oldest first.
#[derive(Default)]
pub struct Submissions {
    pub running: VecDeque<Running>,
    /// Number of submissions so far.
    pub count: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_millis(100);

    /// Submits items as long as there are some, to a device that takes so long for each unit and for each submission.
    /// Returns how long each submission took.
    fn submit(pace: &mut Pace, items: usize, units: f64, per_unit: f64, overhead: f64) -> Vec<f64> {
        let all = vec![units; items];
        let (mut first, mut times) = (0, Vec::new());
        while first < items {
            let mut work = Work::default();
            let count = pace.items("test", &all[first..], LIMIT);
            pace.add(&mut work, "test", units * count as f64);
            let took = overhead + per_unit * units * count as f64;
            pace.learn(&work, Duration::from_secs_f64(took));
            times.push(took);
            first += count;
        }
        times
    }

    #[test]
    fn submissions_come_near_to_their_limit_on_slow_and_fast_devices() {
        for per_unit in [1e-11, 1e-9, 1e-7] {
            // Ten seconds of work in items of a hundredth of a second or less.
            let items = 2000;
            let units = 10.0 / items as f64 / per_unit;
            let times = submit(&mut Pace::default(), items, units, per_unit, 2e-4);
            let settled = &times[times.len() / 2..times.len() - 1];
            assert!(settled.iter().all(|t| (0.05..0.12).contains(t)), "{per_unit}: {times:?}");
            assert!(times.iter().all(|t| *t < 1.1), "{per_unit}: {times:?}");
        }
    }

    #[test]
    fn an_item_that_is_too_long_is_submitted_alone() {
        let times = submit(&mut Pace::default(), 5, 1e9, 1e-9, 0.0);
        assert_eq!(times, [1.0; 5]);
    }

    #[test]
    fn a_pass_that_does_not_fit_waits_for_the_next_submission() {
        let (pace, mut work) = (Pace::default(), Work::default());
        assert!(pace.fits(&work, "test", 1e12, LIMIT));
        pace.add(&mut work, "test", 6e6);
        assert!(pace.fits(&work, "test", 3.9e6, LIMIT));
        assert!(!pace.fits(&work, "test", 4.1e6, LIMIT));
    }
}
