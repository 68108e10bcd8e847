//! How many instructions the main kernels execute, beside what was recorded in `counts.json`: nothing gets slower
//! unnoticed. Start it as `benches/counts`, which has Valgrind installed.
//!
//! ```text
//! benches/counts             # fails if a kernel executes 2 % more than recorded
//! benches/counts --record    # records what is counted now
//! ```
//!
//! Callgrind counts this program twice for every kernel, running it few times and more; the difference is the
//! kernel's own, without start-up. (No framework: gungraun would have a runner of its own version installed, to do
//! what two runs of Valgrind do.)
//!
//! A count belongs to a compiler and an instruction set. With another `rustc` than the recorded one a kernel may
//! execute 10 % more, which a lost inlining still exceeds; it says so, and that the counts want recording. On another
//! architecture or operating system nothing is compared, and it says so; nor are lanes of another width.

use std::collections::BTreeMap;
use std::env;
use std::error::Error;
use std::fs;
use std::hint::black_box;
use std::process::{Command, ExitCode};
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};
use sinew::chain::Chain;
use sinew::metric::{MotionDistance, posture_distance};
use sinew::real::Real;
use sinew::stepper::{Damped, NormalisedTranspose, PseudoInverse, Stepper, Transpose};
use sinew::target::Position;
use sinew_benches::{
    START, TARGET, arm, controller, forward_and_jacobian, panda, postures, shipped,
};
use sinew_learn::cpu;
use sinew_learn::kernel::anneal::Island;
use sinew_learn::kernel::proposal::GENE;
use sinew_learn::refine::{Landscape, Start};

/// A kernel by name, two numbers of times to run it, and how.
type Kernel = (&'static str, [u32; 2], fn(u32));

/// A kernel whose name says `lanes` runs on the machine's SIMD lanes.
const KERNELS: [Kernel; 12] = [
    (
        "tick, transpose, f32",
        [100, 1100],
        ticks_of::<f32, Transpose>,
    ),
    (
        "tick, transpose, f64",
        [100, 1100],
        ticks_of::<f64, Transpose>,
    ),
    (
        "tick, normalised transpose, f32",
        [100, 1100],
        ticks_of::<f32, NormalisedTranspose>,
    ),
    (
        "tick, normalised transpose, f64",
        [100, 1100],
        ticks_of::<f64, NormalisedTranspose>,
    ),
    (
        "tick, pseudo-inverse, f32",
        [100, 1100],
        ticks_of::<f32, PseudoInverse>,
    ),
    (
        "tick, pseudo-inverse, f64",
        [100, 1100],
        ticks_of::<f64, PseudoInverse>,
    ),
    (
        "tick, damped, f32",
        [100, 1100],
        ticks_of::<f32, Damped<f32>>,
    ),
    (
        "tick, damped, f64",
        [100, 1100],
        ticks_of::<f64, Damped<f64>>,
    ),
    ("forward and jacobian, panda, f64", [100, 1100], forwards),
    ("metric, posture, f32", [100, 1100], metrics),
    ("generation of an island, lanes", [1, 5], generations),
    ("descent on a reach, lanes", [1, 6], descents),
];

/// What a kernel may execute more than recorded.
const MORE: f64 = 0.02;
/// The same with another compiler.
const MORE_WITH_ANOTHER_COMPILER: f64 = 0.10;

/// Where the counts are recorded.
const RECORD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/counts.json");

/// What was counted, and what the counts belong to.
#[derive(Serialize, Deserialize)]
struct Counts {
    rustc: String,
    target: String,
    lanes: String,
    instructions: BTreeMap<String, u64>,
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments.as_slice() {
        ["run", name, times] => {
            let kernel = KERNELS.iter().find(|kernel| kernel.0 == *name);
            kernel.ok_or("no such kernel")?.2(times.parse()?);
            Ok(ExitCode::SUCCESS)
        }
        ["lanes"] => {
            println!("{}", cpu::describe());
            Ok(ExitCode::SUCCESS)
        }
        ["--record"] => {
            let counts = Counts::taken()?;
            fs::write(RECORD, serde_json::to_string_pretty(&counts)? + "\n")?;
            println!("recorded {} counts", counts.instructions.len());
            Ok(ExitCode::SUCCESS)
        }
        [] => {
            let recorded: Counts = serde_json::from_str(&fs::read_to_string(RECORD)?)?;
            let target = target();
            if recorded.target != target {
                println!(
                    "not compared: the record is of {}, this is {target}",
                    recorded.target
                );
                return Ok(ExitCode::SUCCESS);
            }
            Ok(compare(&recorded, &Counts::taken()?))
        }
        _ => Err("usage: counts [--record]".into()),
    }
}

/// Prints every count beside the recorded one; fails where one has grown.
fn compare(recorded: &Counts, now: &Counts) -> ExitCode {
    let mut most = MORE;
    if recorded.rustc != now.rustc {
        most = MORE_WITH_ANOTHER_COMPILER;
        println!("recorded with {}, this is {}:", recorded.rustc, now.rustc);
        println!(
            "up to {:.0} % more passes; record the counts again with --record",
            100.0 * most
        );
    }
    println!("{:<36}{:>10}{:>10}", "instructions", "recorded", "now");
    let (mut grown, mut passed) = (0, 0);
    for (name, &count) in &now.instructions {
        let Some(&before) = recorded.instructions.get(name) else {
            println!(
                "{name:<36}{:>10}{count:>10}  FAILED: not recorded, see --record",
                "-"
            );
            grown += 1;
            continue;
        };
        let change = count as f64 / before as f64 - 1.0;
        let verdict = if name.contains("lanes") && recorded.lanes != now.lanes {
            format!(
                "not compared: recorded on {}, this is {}",
                recorded.lanes, now.lanes
            )
        } else if change > most {
            grown += 1;
            format!(
                "{:+.1} %  FAILED: more than {:.0} %",
                100.0 * change,
                100.0 * most
            )
        } else {
            passed += 1;
            let less = if change < -MORE {
                "  less: record it with --record"
            } else {
                ""
            };
            format!("{:+.1} %{less}", 100.0 * change)
        };
        println!("{name:<36}{before:>10}{count:>10}  {verdict}");
    }
    println!("{passed} passed, {grown} failed");
    if grown == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

impl Counts {
    /// Everything counted now.
    fn taken() -> Result<Self, Box<dyn Error>> {
        let rustc = env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
        let rustc = Command::new(rustc).arg("-V").output()?;
        let (lanes, _) = valgrind(&["lanes"])?;
        let mut instructions = BTreeMap::new();
        for (name, [few, more], _) in KERNELS {
            let count = |times: u32| valgrind(&["run", name, &times.to_string()]);
            let (few, more, times) = (count(few)?.1, count(more)?.1, u64::from(more - few));
            let own = more
                .checked_sub(few)
                .ok_or("fewer instructions for more work")?;
            instructions.insert(name.to_owned(), (own + times / 2) / times);
        }
        Ok(Counts {
            rustc: String::from_utf8(rustc.stdout)?.trim().to_owned(),
            target: target(),
            lanes: lanes.trim().to_owned(),
            instructions,
        })
    }
}

fn target() -> String {
    format!("{}-{}", env::consts::ARCH, env::consts::OS)
}

/// What this program prints with these arguments, and how many instructions it executes, on one thread.
fn valgrind(arguments: &[&str]) -> Result<(String, u64), Box<dyn Error>> {
    let run = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(env::current_exe()?)
        .args(arguments)
        .env("RAYON_NUM_THREADS", "1")
        .output()
        .map_err(|error| format!("valgrind does not start: {error}"))?;
    let said = String::from_utf8_lossy(&run.stderr);
    let count = said
        .lines()
        .find_map(|line| line.split("Collected : ").nth(1));
    match count {
        Some(count) if run.status.success() => {
            Ok((String::from_utf8(run.stdout)?, count.trim().parse()?))
        }
        _ => Err(format!("valgrind: {said}").into()),
    }
}

/// Ticks of the human arm with S_C, forward kinematics among them, one after the other as a reach has them.
fn ticks_of<T: Real, S: Stepper<T> + Default>(times: u32) {
    let chain: Chain<T, 7> = arm().cast();
    let controller = controller(&chain, S::default());
    let mut state = controller.start(START.map(T::of));
    let target = Position::new(TARGET.map(T::of)).expect("it is a place");
    for _ in 0..times {
        controller.tick(&mut state, black_box(&target));
        black_box(&mut state);
    }
}

fn forwards(times: u32) {
    let chain = panda();
    let q = postures(&chain, 1);
    for _ in 0..times {
        black_box(&forward_and_jacobian(&chain, black_box(&q[0])));
    }
}

/// The distance of one posture's four landmarks, added to that of a motion.
fn metrics(times: u32) {
    let chain: Chain<f32, 7> = arm().cast();
    let landmarks = |q: f32| -> [[f32; 3]; 4] {
        let at = chain.forward(&[q; 7]);
        let mut landmarks = at.landmarks();
        std::array::from_fn(|_| landmarks.next().unwrap_or_default())
    };
    let (a, b) = (landmarks(0.1), landmarks(0.2));
    let mut distance = MotionDistance::new();
    for _ in 0..times {
        distance.add(posture_distance(black_box(&a), black_box(&b)));
    }
    black_box(distance.mean());
}

/// Generations of one island of 64 members, each scored on the sample's first reach: proposals, ticks, distances.
fn generations(times: u32) {
    let problem = shipped(1, 1);
    let mut islands = [Island::new(problem.genes())];
    cpu::advance(&problem, &mut islands, 0, times, || false).expect("it can be learned");
    black_box(&islands);
}

/// Descents on the sample's first reach, each from the middle of all bounds: slopes, steps, trials.
fn descents(times: u32) {
    let problem = shipped(1, 1);
    let landscape = Landscape::new(&problem).expect("it can be learned");
    let start = Start {
        set: 0,
        genes: vec![GENE / 2; problem.genes()],
        beat: f32::INFINITY,
    };
    let starts = vec![start; times as usize];
    black_box(landscape.refine(&starts, &AtomicBool::new(false)));
}
