//! What runs on a device: at most as much at a time as one submission should take.

use super::device::{Gpu, lock};
use super::pace::{Running, Submission, Work};
use super::traffic;
use crate::cancel::Cancel;
use crate::error::Result;
use std::time::{Duration, Instant};

/// The interval at which a wait checks for cancellation.
const CANCEL_INTERVAL: Duration = Duration::from_millis(20);

impl Gpu {
    /// Submits what was recorded, as soon as nothing else keeps the device busy for long.
    pub(super) fn submit(
        &self,
        recorded: wgpu::CommandEncoder,
        work: Work,
        cancel: &Cancel,
    ) -> Result<Submission> {
        let recorded = recorded.finish();
        while let Some(oldest) = self.in_the_way_of(&work) {
            self.wait(&oldest, cancel)?;
        }
        cancel.check()?;
        let mut submissions = lock(&self.submissions);
        let index = self.queue.submit([recorded]);
        submissions.count += 1;
        traffic::count_submission();
        let submission = Submission { number: submissions.count, index };
        let began = submissions.running.is_empty().then(Instant::now);
        submissions.running.push_back(Running { submission: submission.clone(), work, began });
        lock(&self.pace).count();
        Ok(submission)
    }

    /// Gives back the memory of all buffers that are no longer held, once nothing runs that uses them. Uploads that no
    /// submission followed are still on their way until then.
    pub(super) fn reclaim(&self, cancel: &Cancel) -> Result<()> {
        let nothing = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let last = self.submit(nothing, Work::default(), cancel)?;
        self.release();
        self.wait(&last, cancel)
    }

    /// The oldest of what runs, if this work would come on top of too much.
    fn in_the_way_of(&self, work: &Work) -> Option<Submission> {
        let submissions = lock(&self.submissions);
        let running = submissions.running.iter().map(|running| running.work.seconds).sum::<f64>();
        let oldest = submissions.running.front().map(|running| running.submission.clone());
        oldest.filter(|_| running + work.seconds > self.submission.as_secs_f64())
    }

    /// Waits for the end of what was submitted.
    pub(super) fn wait(&self, submission: &Submission, cancel: &Cancel) -> Result<()> {
        let mut timeout = Duration::ZERO;
        loop {
            let submission_index = Some(submission.index.clone());
            match self.device.poll(wgpu::PollType::Wait { submission_index, timeout: Some(timeout) }) {
                Ok(_) => break,
                Err(wgpu::PollError::Timeout) => cancel.check()?,
                Err(error) => return Err(self.error(error)),
            }
            timeout = CANCEL_INTERVAL;
        }
        // What had ended before it was waited for did so nobody knows when.
        self.ended(submission, (timeout > Duration::ZERO).then(Instant::now));
        Ok(())
    }

    /// Notes that a submission has ended, and learns from it if it is known when.
    fn ended(&self, submission: &Submission, now: Option<Instant>) {
        let mut submissions = lock(&self.submissions);
        let running = &mut submissions.running;
        while running.front().is_some_and(|first| first.submission.number <= submission.number) {
            let Some(first) = running.pop_front() else { break };
            let is_this = first.submission.number == submission.number;
            if let (true, Some(began), Some(now)) = (is_this, first.began, now) {
                lock(&self.pace).learn(&first.work, now.duration_since(began));
            }
            if let Some(next) = running.front_mut() {
                next.began = now.filter(|_| is_this);
            }
        }
    }
}
