//! Which backend a search is faster on, by measurement.
//!
//! A few generations of the problem itself are timed on each, and as many as most searches run are forecast from them. (The
//! descents between them run on the CPU either way.) Only speed hangs on what is chosen: what a backend computes does
//! not depend on having been measured.

use std::fmt;
use std::time::Instant;

use crate::cpu;
use crate::gpu::{Gpu, GpuError, Which};
use crate::kernel::anneal::Island;
use crate::learn::{Backend, LEAST_GENERATIONS, LearnError, Search};
use crate::problem::Problem;
use crate::task::TaskError;

/// Generations that the CPU is through with sooner than this, seconds, are not worth a device's start.
const SHORT: f64 = 0.5;
/// A generation that takes longer than this, seconds, says enough of larger ones.
const ENOUGH: f64 = 0.02;
/// And in any case this, seconds.
const LONG: f64 = 0.5;
/// A device is full when four times the work takes more than so many times as long.
const FULL: f64 = 3.0;
/// Generations that are timed at once.
const TIMED: u32 = 2;

/// Why a backend was taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// The CPU is through before a device has begun.
    Short {
        /// Seconds that it takes.
        this: f64,
        /// For so many generations.
        generations: u32,
    },
    /// There is no device.
    NoDevice(String),
    /// It is the faster.
    Faster {
        /// Seconds that it takes.
        this: f64,
        /// And the other.
        other: f64,
        /// For so many generations.
        generations: u32,
        /// What the other is.
        name: String,
    },
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reason::Short { this, generations } => write!(
                f,
                "measured: {this:.2} s for {generations} generations, too little to start a GPU for"
            ),
            Reason::NoDevice(error) => write!(f, "no GPU path: {error}"),
            Reason::Faster {
                this,
                other,
                generations,
                name,
            } => write!(
                f,
                "measured: {this:.2} s for {generations} generations against {other:.2} s on {name}"
            ),
        }
    }
}

/// The faster backend for a search that begins with these islands and runs at most so many generations.
///
/// # Errors
/// A task that the core refuses.
pub fn faster(
    problem: &Problem,
    islands: &[Island],
    generations: u32,
) -> Result<(Backend, Reason), LearnError> {
    let generations = generations.min(LEAST_GENERATIONS);
    let on_cpu = forecast(problem, generations, false, |sample, islands| {
        let mut islands = islands.to_vec();
        let began = Instant::now();
        cpu::advance(sample, &mut islands, 1, 1 + TIMED, || false)?;
        Ok::<_, TaskError>(began.elapsed().as_secs_f64())
    })?;
    if on_cpu < SHORT {
        let reason = Reason::Short {
            this: on_cpu,
            generations,
        };
        return Ok((Backend::Cpu, reason));
    }
    match on_device(problem, islands, generations) {
        Ok((device, on_device)) if on_device < on_cpu => {
            let reason = Reason::Faster {
                this: on_device,
                other: on_cpu,
                generations,
                name: "the CPU".to_owned(),
            };
            let device = Box::new(device);
            let or_cpu = true;
            Ok((Backend::Gpu { device, or_cpu }, reason))
        }
        Ok((device, on_device)) => {
            let reason = Reason::Faster {
                this: on_cpu,
                other: on_device,
                generations,
                name: device.adapter().to_string(),
            };
            Ok((Backend::Cpu, reason))
        }
        // What the device cannot do, the CPU may.
        Err(error) => Ok((Backend::Cpu, Reason::NoDevice(error.to_string()))),
    }
}

/// The device with the islands on it, and how long the search would take there from now on.
fn on_device(
    problem: &Problem,
    islands: &[Island],
    generations: u32,
) -> Result<(Gpu, f64), GpuError> {
    let mut device = Gpu::new(problem, islands, Which::Best)?;
    let seconds = forecast(problem, generations, true, |sample, islands| {
        device.replace(sample, islands)?;
        // One that does not count: drivers move buffers at first use.
        device.advance(1, 2, || false)?;
        let began = Instant::now();
        device.advance(2, 2 + TIMED, || false)?;
        Ok::<_, GpuError>(began.elapsed().as_secs_f64())
    })?;
    device.replace(problem, islands)?;
    Ok((device, seconds))
}

/// Seconds for so many generations of a search, from what `timed` says that [`TIMED`] generations of a part of it take: a part
/// large enough, and, where a place is `wide`, one for which it takes longer than for a smaller part. One that is not full
/// takes as long for many islands as for one.
fn forecast<E>(
    problem: &Problem,
    generations: u32,
    wide: bool,
    mut timed: impl FnMut(&Problem, &[Island]) -> Result<f64, E>,
) -> Result<f64, E> {
    let (mut part, mut before) = (1, None);
    loop {
        let sample = sample(problem, part);
        let took = timed(&sample, &Search::new(&sample).islands)? / f64::from(TIMED);
        let share =
            sample.frames_a_generation() as f64 / problem.frames_a_generation().max(1) as f64;
        let is_full = !wide || before.is_some_and(|before| took > FULL * before);
        if share >= 1.0 || took > LONG || took > ENOUGH && is_full {
            return Ok(took / share.max(1e-9) * f64::from(generations));
        }
        before = Some(took);
        part *= 4;
    }
}

/// So many islands of a problem, or all: some sets, or a part of the first.
fn sample(problem: &Problem, islands: usize) -> Problem {
    let sets = (islands / problem.islands.max(1)).clamp(1, problem.sets.len().max(1));
    Problem {
        // The tasks stay: a kernel is made for all of them.
        sets: problem.sets.iter().take(sets).cloned().collect(),
        islands: islands.clamp(1, problem.islands.max(1)),
        ..problem.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, StepperKind};

    fn problem(islands: usize) -> Problem {
        Problem {
            islands,
            seed: 1,
            ..Problem::of_sample(&[0, 1, 2], StepperKind::Transpose, ModelKind::C)
        }
    }

    #[test]
    fn a_forecast_is_that_of_work_that_takes_as_long_as_its_frames() {
        let problem = problem(32);
        let mut largest = 0;
        let seconds = forecast(&problem, 100, false, |sample, islands| {
            assert_eq!(islands.len(), sample.sets.len() * sample.islands);
            let frames = sample.frames_a_generation();
            largest = largest.max(frames);
            Ok::<_, ()>(frames as f64 * f64::from(TIMED) * 1e-6)
        })
        .unwrap();
        let whole = problem.frames_a_generation();
        assert!((seconds / (100.0 * whole as f64 * 1e-6) - 1.0).abs() < 1e-9);
        // What is long enough is not made longer.
        assert!(largest < whole);
    }

    #[test]
    fn a_place_that_is_not_full_is_given_more_before_it_is_forecast() {
        let problem = problem(32);
        let whole = problem.frames_a_generation() as f64;
        // Up to half of the work takes as long as any.
        let seconds = forecast(&problem, 100, true, |sample, _| {
            let share = sample.frames_a_generation() as f64 / whole;
            Ok::<_, ()>(f64::from(TIMED) * 0.1 * (2.0 * share).max(1.0))
        });
        assert!((seconds.unwrap() / 20.0 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_short_search_stays_on_the_cpu() {
        let problem = problem(1);
        let islands = vec![Island::new(problem.genes()); 3];
        let (backend, reason) = faster(&problem, &islands, 2).unwrap();
        assert!(matches!(backend, Backend::Cpu));
        assert!(matches!(reason, Reason::Short { .. }), "{reason}");
    }

    #[test]
    fn a_long_search_takes_what_is_faster_or_all_there_is() {
        let problem = problem(512);
        let islands = vec![Island::new(problem.genes()); 3 * 512];
        let (backend, reason) = faster(&problem, &islands, 1000).unwrap();
        println!("{reason}");
        match reason {
            Reason::Faster { this, other, .. } => assert!(this <= other),
            Reason::NoDevice(_) => assert!(matches!(backend, Backend::Cpu)),
            Reason::Short { .. } => panic!("{reason}"),
        }
    }
}
