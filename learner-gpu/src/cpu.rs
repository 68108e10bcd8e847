//! The search on the CPU: islands over threads, members over SIMD lanes.

use rayon::prelude::*;

use crate::kernel::anneal::{Island, Place};
use crate::kernel::score::Ready;
use crate::lanes::{Instructions, Lanes, dispatch};
pub use crate::lanes::{SimdLevel, describe, processor};
use crate::problem::{Problem, with_dofs};
use crate::task::TaskError;

/// Ticks of all members between two looks at whether to stop: some tens of milliseconds.
const TICKS_A_LOOK: u64 = 2_000_000;

/// Runs every island of the problem on the machine's widest lanes: see [`advance_on`].
///
/// # Errors
/// A task whose chain the core refuses.
pub fn advance(
    problem: &Problem,
    islands: &mut [Island],
    from: u32,
    to: u32,
    is_due: impl Fn() -> bool,
) -> Result<u32, TaskError> {
    advance_on(SimdLevel::widest(), problem, islands, from, to, is_due)
}

/// Runs every island of the problem from generation `from` until `to`, and returns the generation reached: less where
/// it was due to be put down, but the same for all islands. Islands are those of set 0, then those of set 1, and so on. The level
/// and the number of threads change no bit.
///
/// # Errors
/// A task whose chain the core refuses.
pub fn advance_on(
    level: SimdLevel,
    problem: &Problem,
    islands: &mut [Island],
    from: u32,
    to: u32,
    is_due: impl Fn() -> bool,
) -> Result<u32, TaskError> {
    let dofs = problem.dofs();
    with_dofs!(dofs, N => {
        dispatch!(level.0, S => advance_lanes::<S, N>(problem, islands, from, to, is_due))
    }, else Err(TaskError::Dofs { found: dofs }))
}

fn advance_lanes<S: Instructions, const N: usize>(
    problem: &Problem,
    islands: &mut [Island],
    from: u32,
    to: u32,
    is_due: impl Fn() -> bool,
) -> Result<u32, TaskError> {
    let bounds = problem.settings.bounds(N);
    let ready = |&task: &usize| problem.tasks.get(task).map(Ready::<Lanes<S>, N>::new);
    let sets: Vec<Vec<Ready<Lanes<S>, N>>> = problem
        .sets
        .iter()
        .map(|set| set.iter().filter_map(ready).collect())
        .collect::<Result<_, _>>()?;
    let generations_a_look =
        (TICKS_A_LOOK / problem.frames_a_generation().max(1)).clamp(1, 1000) as u32;

    let mut at = from;
    while at < to && !is_due() {
        let next = to.min(at + generations_a_look);
        let numbered = islands
            .chunks_mut(problem.islands.max(1))
            .zip(&sets)
            .enumerate();
        let places: Vec<_> = numbered
            .flat_map(|(set, (islands, motions))| {
                islands
                    .iter_mut()
                    .enumerate()
                    .map(move |(island, state)| (set, island, motions, state))
            })
            .collect();
        places
            .into_par_iter()
            // Motions next to each other are often as long: whoever is done first takes the next.
            .with_max_len(1)
            .for_each(|(set, island, motions, state)| {
                let place = Place {
                    settings: &problem.settings,
                    bounds: &bounds,
                    motions,
                    seed: problem.seed,
                    set: set as u32,
                    island: island as u32,
                };
                S::proof().vectorize(
                    #[inline(always)]
                    || {
                        for generation in at..next {
                            place.generation(state, generation);
                        }
                    },
                );
            });
        at = next;
    }
    Ok(at)
}
