//! The reaches that tests learn from.

use sinew_learn::csv;
use sinew_learn::gpu::adapters;
use sinew_learn::motion::Motion;
use sinew_learn::problem::{ModelKind, Problem, Settings, StepperKind};
use sinew_learn::task::{Arm, Task, TaskError, facing};

use crate::shared;

/// The 14 recorded reaches of one seated person: forward with either arm, and across. None where the recordings are
/// not here.
///
/// # Panics
/// A recording that is here and cannot be read: a test must not pass over it.
pub fn recorded() -> Option<Vec<Motion>> {
    let forward = ["FL", "FR"].map(|kind| (kind, 5));
    let across = ["AL", "AR"].map(|kind| (kind, 2));
    recorded_of("ADL004", &[forward, across].concat())
}

/// 20 reaches of another person, as many forward as across.
///
/// # Panics
/// As [`recorded`].
pub fn recorded_of_another() -> Option<Vec<Motion>> {
    recorded_of("ADL015", &["FL", "FR", "AL", "AR"].map(|kind| (kind, 5)))
}

/// Of each kind so many trials of a person.
fn recorded_of(person: &str, kinds: &[(&str, u32)]) -> Option<Vec<Motion>> {
    let folder = shared("data/ue_adl")?.join(person);
    let names = kinds
        .iter()
        .flat_map(|&(kind, trials)| (1..=trials).map(move |trial| format!("{kind}{trial}")));
    let read = |name| {
        let file = folder.join(format!("{person}_{name}.csv"));
        csv::read(file).unwrap_or_else(|error| panic!("{error}"))
    };
    Some(names.map(read).collect())
}

/// One parameter vector a motion, for human arms, 60 Hz, limits off: the paper's experiments.
///
/// # Errors
/// A motion without a usable reach.
pub fn problem(
    reaches: &[Motion],
    stepper: StepperKind,
    model: ModelKind,
    islands: usize,
) -> Result<Problem, TaskError> {
    let arm = Arm::Human(facing(reaches));
    let task = |reach| Task::new(reach, &arm, 60.0);
    let tasks: Vec<Task> = reaches.iter().map(task).collect::<Result<_, _>>()?;
    Ok(Problem {
        sets: (0..tasks.len()).map(|task| vec![task]).collect(),
        tasks,
        settings: Settings {
            stepper,
            model,
            lambda: stepper.rate(),
            rate_hz: 60.0,
            clamped: false,
        },
        islands,
        seed: 1,
    })
}

/// Whether the GPU path has anything to run on. Where it has not, says so: the test that asked has nothing to test.
pub fn there_is_an_adapter() -> bool {
    let there = !adapters().is_empty();
    if !there {
        println!("skipped: no adapter for the GPU path");
    }
    there
}
