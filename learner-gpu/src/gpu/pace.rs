//! How much to give the device at once: some tens of milliseconds, as measured, so that no watchdog takes it for hung
//! and the host can stop.

use std::time::Duration;

/// How long a dispatch is meant to take, seconds.
const AIM: f64 = 0.04;

/// Nothing is known yet: little enough for a slow device.
const FIRST: f64 = 400_000.0;

/// A device's speed as seen so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pace {
    /// Ticks of a dispatch as long as it is meant to be.
    ticks: f64,
}

impl Pace {
    pub fn new() -> Self {
        Pace { ticks: FIRST }
    }

    /// Dispatches of so many ticks, to begin with.
    #[cfg(test)]
    pub fn fixed(ticks: u64) -> Self {
        Pace {
            ticks: ticks as f64,
        }
    }

    /// How many generations of so many ticks to run at once: at least one.
    pub fn generations(&self, ticks: u64) -> u32 {
        (self.ticks / ticks.max(1) as f64).clamp(1.0, 10_000.0) as u32
    }

    /// How many islands, from the beginning of this list of their ticks, to run at once: at least one.
    pub fn islands(&self, ticks: &[u64], generations: u32) -> usize {
        let mut left = self.ticks / f64::from(generations.max(1));
        let fit = ticks.iter().take_while(|&&ticks| {
            left -= ticks as f64;
            left >= 0.0
        });
        fit.count().clamp(1, ticks.len().max(1))
    }

    /// How many motions of a set to score at once, where one of all islands at hand takes so many ticks: at least one.
    pub fn motions(&self, ticks: u64) -> u32 {
        self.generations(ticks)
    }

    /// Learns from a dispatch. The pace rises step by step: a small dispatch says little of a large one.
    pub fn measured(&mut self, ticks: u64, took: Duration) {
        let full = ticks as f64 * AIM / took.as_secs_f64().max(1e-5);
        self.ticks = full.clamp(self.ticks / 4.0, self.ticks * 4.0);
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
            ran = u64::from(pace.generations(1_000)) * 1_000;
            pace.measured(ran, Duration::from_secs_f64(ran as f64 / 10e6));
        }
        assert!((380_000..=400_000).contains(&ran), "{ran}");
    }

    #[test]
    fn a_generation_too_long_for_one_dispatch_is_split_by_islands() {
        let pace = Pace::new();
        let islands = [150_000; 10];
        assert_eq!(pace.generations(islands.iter().sum()), 1);
        assert_eq!(pace.islands(&islands, 1), 2);
        assert_eq!(pace.islands(&[1_000_000], 1), 1);
    }
}
