//! How much to give the device at once: some tens of milliseconds, as measured, so that no watchdog takes it for hung
//! and the host can stop.

use std::time::Duration;

/// How long a dispatch is meant to take, seconds.
const AIM: f64 = 0.04;

/// Nothing is known yet: little enough for a slow device.
const FIRST: f64 = 400_000.0;

/// And this many ticks one after the other.
const FIRST_DEEP: f64 = 4_000.0;

/// A device's speed as seen so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pace {
    /// Ticks of a dispatch as long as it is meant to be: what a device that is full computes.
    ticks: f64,
    /// Ticks of it that come one after the other: on a device that is not full they decide how long it takes.
    deep: f64,
}

impl Pace {
    pub fn new() -> Self {
        Pace {
            ticks: FIRST,
            deep: FIRST_DEEP,
        }
    }

    /// Dispatches of so many ticks, to begin with.
    #[cfg(test)]
    pub fn fixed(ticks: u64) -> Self {
        Pace {
            ticks: ticks as f64,
            ..Pace::new()
        }
    }

    /// How many generations of so many ticks, of which so many come one after the other, to run at once: at least one.
    pub fn generations(&self, ticks: u64, deep: u64) -> u32 {
        let fit = (self.ticks / ticks.max(1) as f64).min(self.deep / deep.max(1) as f64);
        fit.clamp(1.0, 10_000.0) as u32
    }

    /// How many islands of so many to run at once, where one motion of each takes so many ticks at most: at least one.
    pub fn islands(&self, count: usize, ticks: u64) -> usize {
        let fit = self.ticks / ticks.max(1) as f64;
        (fit as usize).clamp(1, count.max(1))
    }

    /// How many of the islands' motions to run at once, where one takes so many ticks: at least one.
    pub fn motions(&self, ticks: u64) -> u32 {
        (self.ticks / ticks.max(1) as f64).clamp(1.0, 1e9) as u32
    }

    /// Learns from what ran at once, so many ticks, of which so many came one after the other. The pace rises step by
    /// step: little says little of much.
    pub fn measured(&mut self, ticks: u64, deep: u64, took: Duration) {
        let full = AIM / took.as_secs_f64().max(1e-5);
        let learned = |now: f64, ran: u64| (ran as f64 * full).clamp(now / 4.0, now * 4.0);
        self.ticks = learned(self.ticks, ticks);
        self.deep = learned(self.deep, deep);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispatches_grow_until_they_take_as_long_as_they_are_meant_to() {
        // 10 million ticks a second.
        let mut pace = Pace::new();
        let mut ran = 0;
        for _dispatch in 0..20 {
            ran = u64::from(pace.generations(1_000, 10)) * 1_000;
            pace.measured(ran, ran / 100, Duration::from_secs_f64(ran as f64 / 10e6));
        }
        assert!((380_000..=400_000).contains(&ran), "{ran}");
    }

    #[test]
    fn a_generation_too_long_for_one_dispatch_is_split_by_islands_and_then_by_motions() {
        let pace = Pace::new();
        assert_eq!(pace.generations(1_500_000, 50), 1);
        assert_eq!(pace.islands(10, 150_000), 2);
        assert_eq!(pace.islands(1, 1_000_000), 1);
        // 128 threads, 50 frames a motion.
        assert_eq!(pace.motions(128 * 50), 62);
    }

    #[test]
    fn few_threads_run_no_longer_than_a_dispatch_is_meant_to() {
        // A device that is never full: only how deep it goes counts, 10 µs a tick.
        let mut pace = Pace::new();
        let mut deep = 0;
        for _dispatch in 0..20 {
            deep = u64::from(pace.generations(50 * 64, 50)) * 50;
            pace.measured(deep * 64, deep, Duration::from_secs_f64(deep as f64 * 1e-5));
        }
        assert_eq!(deep, 4_000);
        // Wide ones that came before do not let a narrow one go deeper.
        for _dispatch in 0..20 {
            pace.measured(1_000_000_000, 100, Duration::from_secs_f64(1e-3));
        }
        assert_eq!(pace.generations(50 * 64, 50) * 50, 4_000);
    }
}
