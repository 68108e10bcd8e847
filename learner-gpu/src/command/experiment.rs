//! `sinew experiment`: the paper's experiments (its section 4) on any recordings.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueEnum;
use serde::Serialize;
use sinew_learn::checkpoint::{Checkpoint, Keeper};
use sinew_learn::experiment::{Gain, Printed, Spread, figure_3, figure_4};
use sinew_learn::learn::{Backend, Search};
use sinew_learn::map;
use sinew_learn::motion::Point;
use sinew_learn::output;
use sinew_learn::problem::{ModelKind, Problem, Settings, StepperKind, mean};
use sinew_learn::speed::{Shape, correlation, hand_speed};
use sinew_learn::synergies::Synergies;
use sinew_learn::synthesis::synthesize;
use sinew_learn::task::Task;

use super::search::{
    self, Options, Steering, backend, can_be_written, computed_by, named, steps, stopped,
    synergies, taken_up,
};
use super::{Failure, print, table};

/// Repeat the paper's experiments on any recordings, one parameter vector for each
///
/// Each search is the one that `sinew learn` does with the same options. Stopped with Ctrl-C an experiment keeps in --out
/// where it was, and the same command goes on from there.
#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    experiment: Experiment,
}

#[derive(clap::Subcommand)]
enum Experiment {
    Models(Models),
    Steppers(Steppers),
    Speed(Speed),
    Transfer(Transfer),
}

/// Compare the synergy models S_A, S_B, S_C and S_D (figure 3)
///
/// The paper does not say which inverse kinematics its figure is of.
#[derive(clap::Args)]
#[command(args_override_self = true)]
struct Models {
    #[command(flatten)]
    steering: Steering,
    #[command(flatten)]
    options: Options,
    /// Write models.csv (a row a recording and model) and models.json (everything) to this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Compare S_C with S_A under several inverse kinematics (figure 4)
#[derive(clap::Args)]
#[command(args_override_self = true)]
struct Steppers {
    /// Which inverse kinematics, with commas between; each with its own default rate λ
    #[arg(long, value_enum, value_name = "STEPPERS", value_delimiter = ',',
          default_values = ["transpose", "pseudo-inverse", "normalised-transpose"])]
    stepper: Vec<StepperKind>,
    #[command(flatten)]
    options: Options,
    /// Write steppers.csv (a row a recording, model and stepper) and steppers.json (everything) to this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Compare the hand's speed over time of the recording, S_A and S_C, and how bell-shaped it is (figure 5)
///
/// The paper does not say which inverse kinematics its figure is of.
#[derive(clap::Args)]
#[command(args_override_self = true)]
struct Speed {
    #[command(flatten)]
    steering: Steering,
    #[command(flatten)]
    options: Options,
    /// Write speed.csv (a row a recording, curve and frame), shape.csv (a row a recording and curve) and speed.json
    /// (everything else) to this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Learn a map from few recordings of a person, with another person's map and without it: distance over number of reaches
///
/// Reaches to learn from are chosen by draws, six times; the distances are means over the person's other reaches.
#[derive(clap::Args)]
#[command(args_override_self = true)]
struct Transfer {
    /// The other person's synergies, with a map
    #[arg(long, value_name = "SYNERGIES.json")]
    known: PathBuf,
    /// The most reaches to learn from
    #[arg(long, default_value_t = 14)]
    most: usize,
    /// What each joint's synergy is made of
    #[arg(long, value_enum, default_value = "c")]
    model: ModelKind,
    #[command(flatten)]
    steering: Steering,
    #[command(flatten)]
    options: Options,
    /// Write transfer.csv (a row a number of reaches) and transfer.json (everything) to this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    match &arguments.experiment {
        Experiment::Models(arguments) => models(arguments),
        Experiment::Steppers(arguments) => steppers(arguments),
        Experiment::Speed(arguments) => speed(arguments),
        Experiment::Transfer(arguments) => transfer(arguments),
    }
}

fn models(arguments: &Models) -> Result<ExitCode, Failure> {
    let Steering { stepper, lambda } = arguments.steering;
    let models = [ModelKind::A, ModelKind::B, ModelKind::C, ModelKind::D];
    let plan = models.map(|model| arguments.options.settings(stepper, lambda, model));
    let plan = plan.into_iter().collect::<Result<Vec<_>, _>>()?;
    let tasks = arguments.options.tasks(&arguments.options.recordings()?)?;
    let files = ["models.csv", "models.json"];
    let out = Out::new("models", arguments.out.as_deref(), &files)?;
    let learned = searches(&arguments.options, plan, &tasks, &out)?;
    // Each model against the one before it.
    let row = |k: usize, this: &Learned| {
        let before = k.checked_sub(1).and_then(|before| learned.get(before));
        Row::new(this, before, figure_3(this.settings.model))
    };
    let rows: Vec<Row> = learned.iter().enumerate().map(|(k, l)| row(k, l)).collect();
    out.distances(3, &tasks, &learned, &rows)?;
    print(&format!(
        "the paper's figure 3 on {} recordings: distance in cm, each model against the one above it\n{}{NESTING}",
        tasks.len(),
        comparison(&rows)
    ))?;
    out.end()
}

fn steppers(arguments: &Steppers) -> Result<ExitCode, Failure> {
    let mut plan: Vec<Settings> = Vec::new();
    for &stepper in &arguments.stepper {
        for model in [ModelKind::A, ModelKind::C] {
            let settings = arguments.options.settings(stepper, None, model)?;
            // Named twice is searched once.
            if !plan.contains(&settings) {
                plan.push(settings);
            }
        }
    }
    let tasks = arguments.options.tasks(&arguments.options.recordings()?)?;
    let files = ["steppers.csv", "steppers.json"];
    let out = Out::new("steppers", arguments.out.as_deref(), &files)?;
    let learned = searches(&arguments.options, plan, &tasks, &out)?;
    let row = |this: &Learned| {
        let Settings { stepper, model, .. } = this.settings;
        let bare = learned.iter().find(|bare| {
            model == ModelKind::C
                && bare.settings.model == ModelKind::A
                && bare.settings.stepper == stepper
        });
        Row::new(this, bare, figure_4(stepper, model))
    };
    let rows: Vec<Row> = learned.iter().map(row).collect();
    out.distances(4, &tasks, &learned, &rows)?;
    print(&format!(
        "the paper's figure 4 on {} recordings: distance in cm, S_C against S_A with the same inverse kinematics\n{}",
        tasks.len(),
        comparison(&rows)
    ))?;
    out.end()
}

fn speed(arguments: &Speed) -> Result<ExitCode, Failure> {
    let Steering { stepper, lambda } = arguments.steering;
    let models = [ModelKind::A, ModelKind::C];
    let plan = models.map(|model| arguments.options.settings(stepper, lambda, model));
    let plan = plan.into_iter().collect::<Result<Vec<_>, _>>()?;
    let tasks = arguments.options.tasks(&arguments.options.recordings()?)?;
    let files = ["speed.csv", "shape.csv", "speed.json"];
    let out = Out::new("speed", arguments.out.as_deref(), &files)?;
    let learned = searches(&arguments.options, plan, &tasks, &out)?;
    let mut curves = Vec::new();
    for (index, task) in tasks.iter().enumerate() {
        curves.extend(curves_of(index, task, &learned)?);
    }
    out.speeds(&curves, &learned)?;
    print(&format!(
        "the paper's figure 5 on {} recordings, {}: peaks of the hand's speed, when it is greatest (share of the duration),\n\
         and its correlation with the minimum-jerk bell (bell) and with the recorded speed (rec.)\n{}",
        tasks.len(),
        name(stepper),
        bells(&tasks, &curves)
    ))?;
    out.end()
}

fn transfer(arguments: &Transfer) -> Result<ExitCode, Failure> {
    let Steering { stepper, lambda } = arguments.steering;
    let options = &arguments.options;
    let settings = options.settings(stepper, lambda, arguments.model)?;
    let tasks = options.tasks(&options.recordings()?)?;
    let problem = options.problem(settings, tasks, false);
    let known = search::known_map(&arguments.known, &problem)?;
    let files = ["transfer.csv", "transfer.json"];
    let out = Out::new("transfer", arguments.out.as_deref(), &files)?;
    let stop = search::stop()?;
    // Whatever is set for the others, fits of many small sets are for the CPU.
    let checkpoint = out.checkpoint(1, &problem, &Backend::Cpu);
    let mut search = taken_up(checkpoint.as_ref(), Search::new(&problem));
    let keeper = Keeper::new(&stop, checkpoint.as_ref());
    let tell = steps("learning from");
    let rows = map::transfer(
        &mut search,
        &problem,
        &known,
        arguments.most,
        options.generations,
        &keeper.telling(&tell),
    );
    let Some(rows) = rows.map_err(Failure::run)? else {
        return Err(stopped(&search, &keeper, checkpoint.as_ref()));
    };
    out.transfer(&settings, &rows)?;
    let headings = [
        "reaches",
        "known, predicted",
        "known, adapted",
        "predicted alone",
        "affine alone",
        "one vector alone",
    ];
    let mut cells = vec![headings.map(str::to_owned).to_vec()];
    for row in &rows {
        let cm = |cm: Option<f64>| cm.map_or(String::new(), |cm| format!("{cm:.3}"));
        let reaches = std::iter::once(row.reaches.to_string());
        cells.push(reaches.chain(row.columns().map(cm)).collect());
    }
    print(&format!(
        "distance in cm on those of {} recordings that were not learned from; known: {}\n{}",
        problem.tasks.len(),
        arguments.known.display(),
        table(&cells)
    ))?;
    out.end()
}

/// What a table of nested models says in words.
const NESTING: &str = "S_A is a case of S_B, and S_C one of S_D: where those are worse, it is the search that failed\n";

/// What one search learned.
struct Learned {
    settings: Settings,
    synergies: Synergies,
}

impl Learned {
    fn distances(&self) -> Vec<f64> {
        let motions = self.synergies.motions.iter();
        motions.map(|motion| motion.distance_cm).collect()
    }
}

/// The most searches of a plan: S_A and S_C, with every inverse kinematics.
const MOST_SEARCHES: usize = 2 * StepperKind::ALL.len();

/// Runs the searches of a plan one after the other on the same tasks.
fn searches(
    options: &Options,
    plan: Vec<Settings>,
    tasks: &[Task],
    out: &Out<'_>,
) -> Result<Vec<Learned>, Failure> {
    let stop = search::stop()?;
    let mut learned = Vec::new();
    // The searches on the CPU: a richer model's begins where a poorer's ends, and does not repeat it.
    let mut ended: Vec<(Problem, Search)> = Vec::new();
    let count = plan.len();
    for (k, settings) in plan.into_iter().enumerate() {
        let problem = options.problem(settings, tasks.to_vec(), false);
        let mut search = Search::new(&problem);
        for (other, ended) in &ended {
            search.build_on(&problem, other, ended);
        }
        let kept = out.kept(k + 1);
        let (mut backend, why) = backend(options, &problem, &search, kept.as_deref())?;
        let (backend_name, device) = named(&backend);
        super::tell!("backend {backend_name}: {device}{why}");
        super::tell!(
            "search {} of {count}: {}, {}",
            k + 1,
            symbol(settings.model),
            name(settings.stepper)
        );
        let checkpoint = out.checkpoint(k + 1, &problem, &backend);
        search = taken_up(checkpoint.as_ref(), search);
        let keeper = Keeper::new(&stop, checkpoint.as_ref());
        let most = options.generations;
        let found = search::run(&mut search, &problem, &mut backend, most, &keeper)?;
        // An experiment that goes on does not do this search again.
        keeper.keep(&search);
        let Some((_, winners)) = found.filter(|_| !keeper.stopped()) else {
            return Err(stopped(&search, &keeper, checkpoint.as_ref()));
        };
        // The CPU may have taken over.
        let (backend_name, device) = named(&backend);
        let synergies = synergies(&problem, &search, &winners, backend_name, device)?;
        learned.push(Learned {
            settings,
            synergies,
        });
        if let Backend::Cpu = backend {
            ended.push((problem, search));
        }
    }
    Ok(learned)
}

/// The paper's name for a model.
fn symbol(model: ModelKind) -> String {
    format!("S_{model:?}")
}

/// A stepper's name on the command line.
fn name(stepper: StepperKind) -> String {
    let value = stepper.to_possible_value();
    value.map_or_else(String::new, |value| value.get_name().to_owned())
}

/// One bar of figure 3 or 4.
#[derive(Serialize)]
struct Row {
    model: String,
    stepper: String,
    #[serde(flatten)]
    spread: Spread,
    /// What it is compared with, where it is.
    against: Option<String>,
    gain: Option<Gain>,
    paper: Printed,
}

impl Row {
    fn new(learned: &Learned, against: Option<&Learned>, paper: Printed) -> Self {
        let distances = learned.distances();
        Row {
            model: symbol(learned.settings.model),
            stepper: name(learned.settings.stepper),
            spread: Spread::of(&distances),
            against: against.map(|against| symbol(against.settings.model)),
            gain: against.map(|against| Gain::of(&against.distances(), &distances)),
            paper,
        }
    }
}

/// The bars as a table.
fn comparison(rows: &[Row]) -> String {
    let cm = |x: f64| format!("{x:.3}");
    let printed = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.2}"));
    let change = |x: Option<f64>, digits: usize| {
        x.map_or_else(String::new, |x| format!("{:+.digits$} %", -100.0 * x))
    };
    let headings = [
        "",
        "mean",
        "least",
        "greatest",
        "change",
        "worse on",
        "paper: mean",
        "least",
        "change",
    ];
    let mut cells = vec![headings.map(str::to_owned).to_vec()];
    for row in rows {
        let worse = row.gain.map(|gain| gain.worse_on.to_string());
        cells.push(vec![
            format!("{}, {}", row.model, row.stepper),
            cm(row.spread.mean_cm),
            cm(row.spread.least_cm),
            cm(row.spread.greatest_cm),
            change(row.gain.map(|gain| gain.reduction), 1),
            worse.unwrap_or_default(),
            printed(row.paper.mean_cm),
            printed(row.paper.least_cm),
            change(row.paper.reduction, 0),
        ]);
    }
    table(&cells)
}

/// One curve of figure 5.
#[derive(Serialize)]
struct Curve {
    /// The recording's index.
    #[serde(skip)]
    task: usize,
    recording: String,
    /// `recorded`, or the model.
    curve: String,
    #[serde(flatten)]
    shape: Shape,
    /// The correlation with the recorded speed.
    #[serde(rename = "recorded_correlation")]
    recorded: f64,
    #[serde(skip)]
    speed: Vec<f64>,
    #[serde(skip)]
    rate_hz: f64,
}

/// A recording's curves: recorded, then as each search learned it.
fn curves_of(index: usize, task: &Task, learned: &[Learned]) -> Result<Vec<Curve>, Failure> {
    let rate_hz = learned.first().map_or(1.0, |first| first.settings.rate_hz);
    let speed = |frames: &[Vec<Point>]| {
        let hand = frames.iter().filter_map(|frame| frame.last().copied());
        hand_speed(&hand.collect::<Vec<Point>>(), rate_hz)
    };
    let recorded = speed(&task.reference);
    let mut speeds = vec![("recorded".to_owned(), recorded.clone())];
    for Learned {
        settings,
        synergies,
    } in learned
    {
        if let Some(motion) = synergies.motions.get(index) {
            let made = synthesize(synergies, motion, motion.target, motion.frames)
                .map_err(Failure::input)?;
            speeds.push((symbol(settings.model), speed(&made.points)));
        }
    }
    let curve = |(curve, speed): (String, Vec<f64>)| Curve {
        task: index,
        recording: task.name.clone(),
        curve,
        shape: Shape::of(&speed),
        recorded: correlation(&speed, &recorded),
        speed,
        rate_hz,
    };
    Ok(speeds.into_iter().map(curve).collect())
}

/// The mean shape of all curves of a name.
#[derive(Serialize)]
struct Bells {
    curve: String,
    peaks: f64,
    /// On how many recordings there is a single peak.
    single_peaked: usize,
    peak_at: f64,
    #[serde(rename = "minimum_jerk_correlation")]
    minimum_jerk: f64,
    #[serde(rename = "recorded_correlation")]
    recorded: f64,
}

/// The means, recorded first.
fn means(curves: &[Curve]) -> Vec<Bells> {
    let first = curves.iter().take_while(|curve| curve.task == 0);
    let of = |name: &str| {
        let mine: Vec<&Curve> = curves.iter().filter(|curve| curve.curve == name).collect();
        let mean = |pick: fn(&Curve) -> f64| mean(mine.iter().map(|&curve| pick(curve)));
        Bells {
            curve: name.to_owned(),
            peaks: mean(|curve| curve.shape.peaks as f64),
            single_peaked: mine.iter().filter(|curve| curve.shape.peaks == 1).count(),
            peak_at: mean(|curve| curve.shape.peak_at),
            minimum_jerk: mean(|curve| curve.shape.minimum_jerk),
            recorded: mean(|curve| curve.recorded),
        }
    };
    first.map(|curve| of(&curve.curve)).collect()
}

/// The shapes as a table: a row a recording, then the means.
fn bells(tasks: &[Task], curves: &[Curve]) -> String {
    let means = means(curves);
    let (mut names, mut headings) = (vec![String::new()], vec!["recording".to_owned()]);
    for bells in &means {
        let own = bells.curve == "recorded";
        names.extend([bells.curve.as_str(), "", ""].map(str::to_owned));
        headings.extend(["peaks", "at", "bell"].map(str::to_owned));
        if !own {
            names.push(String::new());
            headings.push("rec.".to_owned());
        }
    }
    let mut rows = vec![names, headings];
    for (index, task) in tasks.iter().enumerate() {
        let mut row = vec![task.name.clone()];
        for curve in curves.iter().filter(|curve| curve.task == index) {
            row.push(curve.shape.peaks.to_string());
            row.push(format!("{:.2}", curve.shape.peak_at));
            row.push(format!("{:.2}", curve.shape.minimum_jerk));
            if curve.curve != "recorded" {
                row.push(format!("{:.2}", curve.recorded));
            }
        }
        rows.push(row);
    }
    let mut row = vec!["mean".to_owned()];
    let mut single = vec!["with a single peak".to_owned()];
    for bells in &means {
        row.push(format!("{:.2}", bells.peaks));
        row.push(format!("{:.2}", bells.peak_at));
        row.push(format!("{:.2}", bells.minimum_jerk));
        single.extend([
            bells.single_peaked.to_string(),
            String::new(),
            String::new(),
        ]);
        if bells.curve != "recorded" {
            row.push(format!("{:.2}", bells.recorded));
            single.push(String::new());
        }
    }
    rows.extend([row, single]);
    table(&rows)
}

/// Where an experiment's files go, if anywhere.
struct Out<'a> {
    experiment: &'static str,
    folder: Option<&'a Path>,
}

/// Everything that an experiment was set to and found.
#[derive(Serialize)]
struct Report<'a, R> {
    version: u32,
    experiment: &'a str,
    /// The paper's figure that it repeats, if it does.
    figure: Option<u32>,
    results: R,
    /// Each search as `sinew learn` writes it.
    searches: Vec<&'a Synergies>,
}

impl<'a> Out<'a> {
    /// Asks before the searches whether the files can be written after them.
    fn new(
        experiment: &'static str,
        folder: Option<&'a Path>,
        files: &[&str],
    ) -> Result<Self, Failure> {
        if let Some(folder) = folder {
            can_be_written(folder, files)?;
        }
        Ok(Out { experiment, folder })
    }

    /// Where one of the searches is kept while it runs and until all of them have, where results have a folder.
    fn kept(&self, number: usize) -> Option<PathBuf> {
        let file = format!("{}-{number}.checkpoint", self.experiment);
        self.folder.map(|folder| folder.join(file))
    }

    /// The checkpoint there.
    fn checkpoint(
        &self,
        number: usize,
        problem: &Problem,
        backend: &Backend,
    ) -> Option<Checkpoint> {
        let kept = self.kept(number)?;
        Some(Checkpoint::new(kept, problem, &computed_by(backend)))
    }

    /// The files of figures 3 and 4.
    fn distances(
        &self,
        figure: u32,
        tasks: &[Task],
        learned: &[Learned],
        rows: &[Row],
    ) -> Result<(), Failure> {
        let names = "recording,model,stepper,frames,duration_s,misfit_cm,distance_cm";
        let mut cells = Vec::new();
        for Learned {
            settings,
            synergies,
        } in learned
        {
            for (task, motion) in tasks.iter().zip(&synergies.motions) {
                cells.push(vec![
                    motion.file.clone(),
                    symbol(settings.model),
                    name(settings.stepper),
                    motion.frames.to_string(),
                    ((motion.frames - 1) as f64 / settings.rate_hz).to_string(),
                    (task.misfit * 100.0).to_string(),
                    motion.distance_cm.to_string(),
                ]);
            }
        }
        self.csv(&format!("{}.csv", self.experiment), names, cells)?;
        self.json(Some(figure), rows, learned)
    }

    /// The files of figure 5.
    fn speeds(&self, curves: &[Curve], learned: &[Learned]) -> Result<(), Failure> {
        let (mut speeds, mut shapes) = (Vec::new(), Vec::new());
        for curve in curves {
            let of = [curve.recording.clone(), curve.curve.clone()];
            for (frame, speed) in curve.speed.iter().enumerate() {
                let time = frame as f64 / curve.rate_hz;
                speeds.push([&of[..], &[time.to_string(), speed.to_string()]].concat());
            }
            let shape = curve.shape;
            let numbers = [
                shape.peaks.to_string(),
                shape.peak_at.to_string(),
                shape.greatest.to_string(),
                shape.minimum_jerk.to_string(),
                curve.recorded.to_string(),
            ];
            shapes.push([&of[..], &numbers].concat());
        }
        self.csv("speed.csv", "recording,curve,time_s,speed_m_s", speeds)?;
        let names = "recording,curve,peaks,peak_at,greatest_m_s,minimum_jerk_correlation,recorded_correlation";
        self.csv("shape.csv", names, shapes)?;
        #[derive(Serialize)]
        struct Results<'a> {
            means: Vec<Bells>,
            curves: &'a [Curve],
        }
        let means = means(curves);
        self.json(Some(5), Results { means, curves }, learned)
    }

    /// The files of a transfer.
    fn transfer(&self, settings: &Settings, rows: &[map::Transfer]) -> Result<(), Failure> {
        let cells = rows.iter().map(|row| {
            let cm = |cm: Option<f64>| cm.map_or(String::new(), |cm| cm.to_string());
            let reaches = std::iter::once(row.reaches.to_string());
            reaches.chain(row.columns().map(cm)).collect()
        });
        let names = "reaches,predicted_cm,adapted_cm,predicted_alone_cm,affine_cm,constant_cm";
        self.csv("transfer.csv", names, cells.collect())?;
        #[derive(Serialize)]
        struct Results<'a> {
            settings: &'a Settings,
            rows: &'a [map::Transfer],
        }
        self.json(None, Results { settings, rows }, &[])
    }

    fn csv(&self, file: &str, names: &str, rows: Vec<Vec<String>>) -> Result<(), Failure> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let wrong = |error: csv::Error| Failure::run(format!("{file}: {error}"));
        writer.write_record(names.split(',')).map_err(wrong)?;
        for row in rows {
            writer.write_record(row).map_err(wrong)?;
        }
        let bytes = writer
            .into_inner()
            .map_err(|error| Failure::run(format!("{file}: {error}")))?;
        self.write(file, &bytes)
    }

    fn json(
        &self,
        figure: Option<u32>,
        results: impl Serialize,
        learned: &[Learned],
    ) -> Result<(), Failure> {
        let report = Report {
            version: 1,
            experiment: self.experiment,
            figure,
            results,
            searches: learned.iter().map(|learned| &learned.synergies).collect(),
        };
        let mut text = serde_json::to_string_pretty(&report).map_err(Failure::run)?;
        text.push('\n');
        self.write(&format!("{}.json", self.experiment), text.as_bytes())
    }

    fn write(&self, file: &str, bytes: &[u8]) -> Result<(), Failure> {
        let Some(folder) = self.folder else {
            return Ok(());
        };
        let path = folder.join(file);
        output::replace(&path, bytes)
            .map_err(|error| Failure::run(format!("{}: {error}", path.display())))
    }

    /// Removes what was kept of the searches, and says where the files are: the end of the command.
    fn end(&self) -> Result<ExitCode, Failure> {
        // Those of an earlier plan, which had more, go too; where one could not be written there is nothing to remove.
        for kept in (1..=MOST_SEARCHES).filter_map(|number| self.kept(number)) {
            let _ = std::fs::remove_file(kept);
        }
        if let Some(folder) = self.folder {
            print(&format!("written to {}\n", folder.display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
