//! `sinew bench`: how fast each place is that a search can run on.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use indicatif::ProgressBar;
use serde_json::{Value, json};
use sinew_learn::bench::{Bench, BenchError, Case, Effort, Operations, Path, Rates, StartUp};
use sinew_learn::kernel::proposal::ISLAND;
use sinew_learn::problem::{ModelKind, StepperKind};
use sinew_learn::task::{Arm, Task, facing};
use sinew_learn::{cpu, output, recordings};

use super::{Failure, can_be_put, print, table};

/// Measure how fast every place is that a search can run on: scalars, SIMD lanes, GPUs
///
/// The unit is a million candidate·motion·frames a second (median, least to greatest of interleaved rounds), then how many
/// times scalar f32 that is (the median of the rounds' ratios), and the share of the most that the place's device computes,
/// measured in the same run. One case is the base (the first of each list below); each axis is varied alone from there.
#[derive(clap::Args)]
#[command(args_override_self = true)]
pub struct Arguments {
    /// Recordings (CSV), or folders of them [default: the sample that ships with the project]
    recordings: Vec<PathBuf>,
    /// Fewer cases and shorter rounds: some twenty seconds
    #[arg(long)]
    quick: bool,
    /// Only places with one of these in their names, such as f32,avx2,gpu
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    paths: Vec<String>,
    /// Steppers [default: transpose and three more]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    steppers: Vec<StepperKind>,
    /// Models [default: c, d]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    models: Vec<ModelKind>,
    /// Motions, each with a population of its own [default: 14, 1, 192]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    motions: Vec<u32>,
    /// Members of each population, taken up to a multiple of 64 [default: 2048, 64, 16384 and a million]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    populations: Vec<u32>,
    /// Times that each is measured
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    rounds: u16,
    /// Also write all of it to FILE
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What is varied.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Axis {
    Stepper,
    Model,
    Motions,
    Population,
}

impl Axis {
    const ALL: [Axis; 4] = [Axis::Stepper, Axis::Model, Axis::Motions, Axis::Population];

    fn name(self) -> &'static str {
        match self {
            Axis::Stepper => "stepper",
            Axis::Model => "model",
            Axis::Motions => "motions",
            Axis::Population => "population",
        }
    }

    /// Where a case lies on it.
    fn of(self, case: &Case) -> String {
        match self {
            Axis::Stepper => stepper_name(case.stepper).to_owned(),
            Axis::Model => format!("S_{:?}", case.model),
            Axis::Motions => case.motions.to_string(),
            Axis::Population => case.population.to_string(),
        }
    }
}

fn stepper_name(stepper: StepperKind) -> &'static str {
    match stepper {
        StepperKind::Transpose => "Jᵀ",
        StepperKind::NormalisedTranspose => "NJᵀ",
        StepperKind::PseudoInverse => "J⁺",
        StepperKind::Damped => "damped",
        StepperKind::SelectivelyDamped => "selectively damped",
    }
}

/// All that was measured.
struct Report {
    paths: Vec<Path>,
    peaks: Vec<Result<f64, BenchError>>,
    /// First, and again.
    start_ups: Vec<(String, Result<[StartUp; 2], BenchError>)>,
    /// The base first.
    cases: Vec<(Case, Vec<Result<Rates, BenchError>>)>,
    operations: Vec<((StepperKind, ModelKind), Operations)>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let recordings = match arguments.recordings.as_slice() {
        [] => recordings::shipped(),
        paths => recordings::read(paths),
    }
    .map_err(Failure::input)?;
    let motions: Vec<_> = recordings.iter().map(|one| one.motion.clone()).collect();
    let arm = Arm::Human(facing(&motions));
    let tasks = recordings
        .iter()
        .map(|one| {
            Task::new(&one.motion, &arm, 60.0)
                .map_err(|error| Failure::Input(format!("{}: {error}", one.file)))
        })
        .collect::<Result<Vec<Task>, Failure>>()?;
    let bench = Bench::new(tasks).map_err(Failure::input)?;
    let paths = chosen(&arguments.paths)?;
    if let Some(path) = &arguments.json {
        can_be_put(path)?;
    }

    let stop = super::search::stop()?;
    print(&format!(
        "{}: {}; {} recordings at 60 Hz\n",
        cpu::processor(),
        cpu::describe(),
        recordings.len()
    ))?;
    let Some(report) = measured(arguments, &bench, paths, &stop).map_err(Failure::run)? else {
        return Err(Failure::Stopped("stopped".to_owned()));
    };
    print(&told(&report))?;
    if let Some(path) = &arguments.json {
        let text = format!("{:#}\n", as_json(&report));
        output::replace(path, text.as_bytes())
            .map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
        print(&format!("written to {}\n", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The places to measure.
fn chosen(names: &[String]) -> Result<Vec<Path>, Failure> {
    let all = Path::all();
    if names.is_empty() {
        return Ok(all);
    }
    let has = |path: &Path, name: &String| path.name().to_lowercase().contains(name);
    let names: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    if let Some(name) = names.iter().find(|name| !all.iter().any(|p| has(p, name))) {
        let there: Vec<String> = all.iter().map(Path::name).collect();
        return Err(Failure::Input(format!(
            "--paths: no place has {name:?} in its name; there are: {}",
            there.join("; ")
        )));
    }
    let keep = |path: &Path| names.iter().any(|name| has(path, name));
    Ok(all.into_iter().filter(keep).collect())
}

/// The cases: the base, then each axis varied alone.
fn cases(arguments: &Arguments) -> Vec<Case> {
    fn or<T: Clone>(given: &[T], usual: &[T]) -> Vec<T> {
        if given.is_empty() { usual } else { given }.to_vec()
    }
    let quick = arguments.quick;
    let steppers = or(&arguments.steppers, &StepperKind::ALL[..4]);
    let models = or(&arguments.models, &[ModelKind::C, ModelKind::D]);
    let few: (&[u32], &[u32]) = (&[14, 1], &[2048, 64, 16_384]);
    let many: (&[u32], &[u32]) = (&[14, 1, 192], &[2048, 64, 16_384, 1 << 20]);
    let usual = if quick { few } else { many };
    let motions = or(&arguments.motions, usual.0);
    let populations = or(&arguments.populations, usual.1);
    let members = |population: u32| (population as usize).next_multiple_of(ISLAND);
    let base = Case {
        stepper: steppers[0],
        model: models[0],
        motions: motions[0] as usize,
        population: members(populations[0]),
    };
    let mut cases = vec![base];
    let mut put = |case: Case| {
        if !cases.contains(&case) {
            cases.push(case);
        }
    };
    steppers
        .iter()
        .for_each(|&stepper| put(Case { stepper, ..base }));
    models.iter().for_each(|&model| put(Case { model, ..base }));
    motions.iter().for_each(|&motions| {
        put(Case {
            motions: motions as usize,
            ..base
        });
    });
    populations.iter().for_each(|&population| {
        put(Case {
            population: members(population),
            ..base
        });
    });
    cases
}

/// Everything, unless it was stopped.
fn measured(
    arguments: &Arguments,
    bench: &Bench,
    paths: Vec<Path>,
    stop: &AtomicBool,
) -> Result<Option<Report>, BenchError> {
    let effort = Effort {
        rounds: arguments.rounds.into(),
        seconds: if arguments.quick { 0.03 } else { 0.1 },
        most_ticks: if arguments.quick { 1 << 22 } else { 1 << 24 },
    };
    let cases = cases(arguments);
    let bar = ProgressBar::new(cases.len() as u64 + 1);
    let says = |words: String| {
        if std::io::stderr().is_terminal() {
            bar.inc(1);
        } else {
            super::tell!("{words}");
        }
    };
    says("measuring what each device does at most".to_owned());
    let base = cases[0];
    let mut start_ups = Vec::new();
    for path in &paths {
        if let Path::Device(adapter) = path {
            let both = || {
                let first = bench.start_up(&base, adapter)?;
                Ok([first, bench.start_up(&base, adapter)?])
            };
            start_ups.push((path.name(), both()));
        }
    }
    let peaks = paths.iter().map(|path| path.peak(0.2)).collect();
    let mut report = Report {
        paths,
        peaks,
        start_ups,
        cases: Vec::new(),
        operations: Vec::new(),
    };
    for (number, case) in cases.iter().enumerate() {
        says(format!("case {} of {}", number + 1, cases.len()));
        let method = (case.stepper, case.model);
        if !report.operations.iter().any(|(known, _)| *known == method) {
            let operations = bench.operations(case.stepper, case.model)?;
            report.operations.push((method, operations));
        }
        match bench.measure(case, &report.paths, &effort, stop) {
            Some(rates) => report.cases.push((*case, rates)),
            None => return Ok(None),
        }
    }
    // Again, in case something else ran the first time.
    for (path, peak) in report.paths.iter().zip(&mut report.peaks) {
        if let (Ok(before), Ok(after)) = (&*peak, path.peak(0.2)) {
            *peak = Ok(before.max(after));
        }
    }
    bar.finish_and_clear();
    Ok(Some(report))
}

impl Report {
    /// Operations of a frame.
    fn operations(&self, case: &Case) -> f64 {
        let method = (case.stepper, case.model);
        let found = self.operations.iter().find(|(known, _)| *known == method);
        found.map_or(f64::NAN, |(_, operations)| operations.total())
    }

    /// The share of its device's most that a path reaches.
    fn share(&self, case: &Case, path: usize, rates: &Rates) -> Option<f64> {
        let peak = self.peaks.get(path)?.as_ref().ok()?;
        Some(rates.median() * 1e6 * self.operations(case) / peak)
    }
}

/// What a person sees.
fn told(report: &Report) -> String {
    let mut text = String::new();
    for (name, start_up) in &report.start_ups {
        text += &match start_up {
            Ok([first, again]) => format!(
                "{name} starts in {:.2} s (device {:.2} s, kernel and first dispatch {:.2} s), again in {:.2} s\n",
                first.device + first.kernel,
                first.device,
                first.kernel,
                again.device + again.kernel
            ),
            Err(error) => format!("{name} does not start: {error}\n"),
        };
    }
    let Some((base, _)) = report.cases.first() else {
        return text;
    };
    for axis in Axis::ALL {
        let alone = |case: &Case| {
            Axis::ALL
                .iter()
                .all(|&other| other == axis || other.of(case) == other.of(base))
        };
        let cases: Vec<_> = report
            .cases
            .iter()
            .filter(|(case, _)| alone(case))
            .collect();
        // An axis of one place is in the first table already.
        if cases.len() < 2 && axis != Axis::Stepper {
            continue;
        }
        let others = Axis::ALL.iter().filter(|&&other| other != axis);
        let others: Vec<String> = others
            .map(|other| match other {
                Axis::Motions => format!("{} motions", base.motions),
                Axis::Population => format!("population {}", base.population),
                other => other.of(base),
            })
            .collect();
        text += &format!(
            "\nMillion candidate·motion·frames a second, median (least to greatest), times scalar f32, share of the device's most; {}\n",
            others.join(", ")
        );
        let mut rows = vec![vec![axis.name().to_owned()]];
        let mut counts = vec!["operations a frame".to_owned()];
        for (case, _) in &cases {
            rows[0].push(axis.of(case));
            counts.push(format!("{:.0}", report.operations(case)));
        }
        let single = report
            .paths
            .iter()
            .position(|path| matches!(path, Path::Single));
        for (number, path) in report.paths.iter().enumerate() {
            let mut row = vec![path.name()];
            for (case, all) in &cases {
                row.push(match &all[number] {
                    Ok(rates) => {
                        let (least, greatest) = rates.range();
                        let share = report.share(case, number, rates);
                        let share = share.map_or("?".to_owned(), |s| format!("{:.0}", 100.0 * s));
                        let times = match single.map(|single| &all[single]) {
                            Some(Ok(single)) => format!("{:.1}× ", rates.to(single)),
                            _ => String::new(),
                        };
                        format!(
                            "{:.1} ({least:.1} to {greatest:.1}) {times}{share} %",
                            rates.median()
                        )
                    }
                    Err(_) => "failed".to_owned(),
                });
            }
            rows.push(row);
        }
        rows.push(counts);
        text += &table(&rows);
    }
    text += "\nMost, billion operations a second\n";
    let rows: Vec<Vec<String>> = report
        .paths
        .iter()
        .zip(&report.peaks)
        .map(|(path, peak)| {
            let peak = match peak {
                Ok(peak) => format!("{:.0}", peak / 1e9),
                Err(error) => error.to_string(),
            };
            vec![path.name(), peak]
        })
        .collect();
    text += &table(&rows);
    for (case, rates) in &report.cases {
        for (path, rates) in report.paths.iter().zip(rates) {
            if let Err(error) = rates {
                text += &format!("{} on {case:?}: {error}\n", path.name());
            }
        }
    }
    text
}

/// What a program reads.
fn as_json(report: &Report) -> Value {
    let rates = |(case, rates): &(Case, Vec<Result<Rates, BenchError>>)| {
        let each = report.paths.iter().zip(rates).enumerate();
        let each: Vec<Value> = each
            .map(|(number, (path, rates))| match rates {
                Ok(rates) => json!({
                    "path": path.name(), "median": rates.median(), "rounds": rates,
                    "share": report.share(case, number, rates),
                }),
                Err(error) => json!({ "path": path.name(), "error": error.to_string() }),
            })
            .collect();
        json!({ "case": case, "rates": each })
    };
    let peaks = report.paths.iter().zip(&report.peaks).map(
        |(path, peak)| json!({ "path": path.name(), "operations_a_second": peak.as_ref().ok() }),
    );
    let start_ups = report.start_ups.iter().map(|(name, start_up)| {
        json!({ "path": name, "seconds_first_and_again": start_up.as_ref().ok() })
    });
    let operations = report
        .operations
        .iter()
        .map(|((stepper, model), operations)| {
            json!({ "stepper": stepper, "model": model, "a_frame": operations })
        });
    json!({
        "unit": "million candidate·motion·frames a second",
        "processor": cpu::processor(),
        "lanes": cpu::describe(),
        "start_up": start_ups.collect::<Vec<_>>(),
        "most": peaks.collect::<Vec<_>>(),
        "operations": operations.collect::<Vec<_>>(),
        "cases": report.cases.iter().map(rates).collect::<Vec<_>>(),
    })
}
