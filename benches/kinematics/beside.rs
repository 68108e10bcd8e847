//! Forward kinematics and the Jacobian of the Franka Panda in `f64`: ours beside what a user would pick instead, in one
//! process, taking turns over the same postures. `run` beside this file makes what is compared with and starts it.
//!
//! With `--pinocchio LIBRARY` (from `pinocchio.cpp`) Pinocchio takes part. Everybody's results are compared with ours
//! to 1e-10 first: nobody is timed at something else.

use std::env;
use std::hint::black_box;
use std::time::Instant;

use libloading::{Library, Symbol};
use nalgebra::{Matrix3, SMatrix, Vector3};
use sinew_benches::{
    Everything, forward, forward_and_jacobian, k, panda, panda_description, postures,
};

/// Turns that everybody takes, after a tenth as many to warm up.
const TURNS: usize = 2000;
/// Calls in one turn: short, so that whatever else the machine does meets everybody alike.
const CALLS: u32 = 128;

/// Computes all postures once.
type Turn<'a> = dyn FnMut(&[[f64; 7]]) + 'a;

/// Who is timed at one of the two tasks.
struct Contender<'a> {
    name: &'static str,
    turn: Box<Turn<'a>>,
    /// Nanoseconds a call, turn by turn.
    times: Vec<f64>,
}

impl<'a> Contender<'a> {
    fn new(name: &'static str, turn: impl FnMut(&[[f64; 7]]) + 'a) -> Self {
        Contender {
            name,
            turn: Box::new(turn),
            times: Vec::new(),
        }
    }

    fn median(&mut self) -> f64 {
        self.times.sort_by(f64::total_cmp);
        self.times[self.times.len() / 2]
    }
}

fn main() {
    let arm = panda();
    let postures = postures(&arm, CALLS);
    let theirs = k::Panda::new();
    let pinocchio = pinocchio_library().map(Pinocchio::new);

    for q in &postures {
        let ours = forward_and_jacobian(&arm, q);
        agrees("k", &ours, &everything_by_k(&theirs, q));
        if let Some(pinocchio) = &pinocchio {
            for way in ["forward_and_jacobian", "forward_and_frame_jacobian"] {
                agrees("Pinocchio", &ours, &pinocchio.everything(way, q));
            }
        }
    }
    println!("results agree to 1e-10 over {CALLS} postures");

    let mut contenders = vec![
        Contender::new("sinew", |postures| {
            for q in postures {
                black_box(&forward(&arm, black_box(q)));
            }
        }),
        Contender::new("k", |postures| {
            for q in postures {
                black_box(&theirs.forward(black_box(q)));
            }
        }),
    ];
    if let Some(pinocchio) = &pinocchio {
        contenders.push(Contender::new("Pinocchio", |q| {
            pinocchio.call("forward", q)
        }));
    }
    compare("forward kinematics", &mut contenders, &postures);

    let mut contenders = vec![
        Contender::new("sinew", |postures| {
            for q in postures {
                black_box(&forward_and_jacobian(&arm, black_box(q)));
            }
        }),
        Contender::new("k", |postures| {
            for q in postures {
                black_box(&theirs.forward_and_jacobian(black_box(q)));
            }
        }),
    ];
    if let Some(pinocchio) = &pinocchio {
        contenders.push(Contender::new("Pinocchio, all joints", |q| {
            pinocchio.call("forward_and_jacobian", q)
        }));
        contenders.push(Contender::new("Pinocchio, one frame", |q| {
            pinocchio.call("forward_and_frame_jacobian", q)
        }));
    }
    compare(
        "forward kinematics and Jacobian",
        &mut contenders,
        &postures,
    );
}

/// Lets everybody take turns, and prints the medians.
fn compare(task: &str, contenders: &mut [Contender], postures: &[[f64; 7]]) {
    for turn in 0..TURNS + TURNS / 10 {
        for contender in contenders.iter_mut() {
            let began = Instant::now();
            (contender.turn)(postures);
            if turn >= TURNS / 10 {
                let took = began.elapsed().as_nanos() as f64;
                contender.times.push(took / postures.len() as f64);
            }
        }
    }
    println!("\n{task:<34}{:>9}{:>10}", "ns a call", "to sinew");
    let ours = contenders.first_mut().map_or(f64::NAN, Contender::median);
    for contender in contenders {
        let median = contender.median();
        println!(
            "  {:<32}{median:>9.1}{:>9.2}×",
            contender.name,
            median / ours
        );
    }
}

fn agrees(who: &str, ours: &Everything, theirs: &Everything) {
    let apart = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    let worst = apart(&ours.0, &theirs.0)
        .max(apart(ours.1.as_flattened(), theirs.1.as_flattened()))
        .max(apart(ours.2.as_slice(), theirs.2.as_slice()));
    assert!(worst < 1e-10, "{who} differs by {worst}");
}

fn everything_by_k(panda: &k::Panda, q: &[f64; 7]) -> Everything {
    let pose = panda.forward(q);
    let (jacobian, again) = panda.forward_and_jacobian(q);
    let again = again.expect("it has just been computed");
    assert!((again.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
    (
        pose.translation.vector.into(),
        pose.rotation.to_rotation_matrix().into_inner().into(),
        SMatrix::from_fn(|r, c| jacobian[(r, c)]),
    )
}

/// The library that `--pinocchio` names.
fn pinocchio_library() -> Option<Library> {
    let mut arguments = env::args().skip(1);
    arguments.find(|argument| argument == "--pinocchio")?;
    let path = arguments.next().expect("--pinocchio needs the library");
    // SAFETY: it is the one that `run` has just built from the file beside this one.
    Some(unsafe { Library::new(path) }.expect("the library can be loaded"))
}

/// Pinocchio, through that library.
struct Pinocchio(Library);

impl Pinocchio {
    fn new(library: Library) -> Self {
        let arm = panda_description();
        let joints = arm
            .joints
            .iter()
            .map(|joint| (joint.translation, joint.rotation));
        let placements: Vec<f64> = joints
            .chain([(arm.tip.translation, arm.tip.rotation)])
            .flat_map(|(translation, rotation)| translation.into_iter().chain(rotation))
            .collect();
        // SAFETY: the signature is the one in pinocchio.cpp, which reads 8 times 7 numbers.
        unsafe {
            let open: Symbol<unsafe extern "C" fn(*const f64)> =
                library.get("open_arm").expect("it is in the library");
            open(placements.as_ptr());
        }
        Pinocchio(library)
    }

    fn call(&self, way: &str, postures: &[[f64; 7]]) {
        // SAFETY: the signature is the one in pinocchio.cpp, which reads `len` times 7 numbers.
        unsafe {
            let way: Symbol<unsafe extern "C" fn(*const f64, usize)> =
                self.0.get(way).expect("it is in the library");
            way(postures.as_flattened().as_ptr(), postures.len());
        }
    }

    fn everything(&self, way: &str, q: &[f64; 7]) -> Everything {
        self.call(way, &[*q]);
        let (mut position, mut axes) = (Vector3::zeros(), Matrix3::zeros());
        let mut jacobian = SMatrix::<f64, 6, 7>::zeros();
        // SAFETY: the signature is the one in pinocchio.cpp, which writes 3, 9 and 42 numbers, column by column.
        unsafe {
            let result: Symbol<unsafe extern "C" fn(*mut f64, *mut f64, *mut f64)> =
                self.0.get("result").expect("it is in the library");
            result(
                position.as_mut_ptr(),
                axes.as_mut_ptr(),
                jacobian.as_mut_ptr(),
            );
        }
        (position.into(), axes.into(), jacobian)
    }
}
