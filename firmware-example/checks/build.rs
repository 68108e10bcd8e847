//! Makes a table of reaches from recordings: the learner's sample, and people's where they are to be had.
//!
//! Of each: the arm's segment lengths (medians), the posture nearest to the first frame of the way out, the tip's last
//! position, and its orientation in the posture nearest to the last frame (SPEC section 5).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use nalgebra::{SMatrix, SVector};
use sinew::chain::{Chain, human_arm};

type Point = [f64; 3];

/// The fourteen reaches of one person that the paper's tables are compared with.
const RECORDED: [&str; 14] = [
    "FL1", "FL2", "FL3", "FL4", "FL5", "FR1", "FR2", "FR3", "FR4", "FR5", "AL1", "AL2", "AR1",
    "AR2",
];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").ok_or(io::ErrorKind::NotFound)?);
    let sample = root.join("../../learner-gpu/sample");
    let people = root.join("../../../shared/data/ue_adl/ADL004");
    let made = (1..=14).map(|k| sample.join(format!("reach_{k:02}.csv")));
    let recorded = RECORDED
        .iter()
        .map(|name| people.join(format!("ADL004_{name}.csv")));
    let mut table = String::from("/// The reaches.\npub const REACHES: &[Reach] = &[\n");
    for path in made.chain(recorded).filter(|path| path.exists()) {
        table += &reach(&path)?;
        println!("cargo:rerun-if-changed={}", path.display());
    }
    table += "];\n";
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or(io::ErrorKind::NotFound)?);
    fs::write(out.join("reaches.rs"), table)?;
    // The firmware brings its board's own map.
    if env::var_os("CARGO_FEATURE_ARM").is_some() {
        return Ok(());
    }
    let map = match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
        Ok("riscv32") => "memory/riscv.x",
        _ => "memory/cortex-m.x",
    };
    fs::copy(root.join(map), out.join("memory.x"))?;
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed={map}");
    Ok(())
}

/// A line of the table.
fn reach(path: &Path) -> io::Result<String> {
    let wrong = |what: &str| io::Error::other(format!("{}: {what}", path.display()));
    let text = fs::read_to_string(path)?;
    let mut frames: Vec<[Point; 3]> = Vec::new();
    for line in text.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map_while(|x| x.parse().ok()).collect();
        let [_, s @ .., phase] = numbers.as_slice() else {
            return Err(wrong("a short line"));
        };
        if *phase == 1.0 && s.len() == 12 {
            let point = |k: usize| [0, 1, 2].map(|r| s[3 * k + r] - s[r]);
            frames.push([point(1), point(2), point(3)]);
        }
    }
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
        return Err(wrong("no way out"));
    };
    let median = |length: &dyn Fn(&[Point; 3]) -> f64| {
        let mut all: Vec<f64> = frames.iter().map(length).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let lengths = [
        median(&|f| distance(f[0], [0.0; 3])),
        median(&|f| distance(f[1], f[0])),
        median(&|f| distance(f[2], f[1])),
    ];
    let arm = human_arm(lengths[0], lengths[1], lengths[2]).map_err(|e| wrong(&e.to_string()))?;
    let start = fit(&arm, first);
    let turned = arm.forward(&fit(&arm, last)).tip_pose().rotation.coords;
    let mut line = String::new();
    let name = path
        .file_stem()
        .and_then(|name| name.to_str())
        .unwrap_or("?");
    writeln!(
        line,
        "    Reach {{ name: {name:?}, lengths: {lengths:?}, start: {:?}, target: {:?}, turned: {:?} }},",
        start.map(|x| x as f32),
        last[2].map(|x| x as f32),
        [turned.x as f32, turned.y as f32, turned.z as f32, turned.w as f32],
    )
    .map_err(io::Error::other)?;
    Ok(line)
}

fn distance(a: Point, b: Point) -> f64 {
    (0..3).map(|r| (a[r] - b[r]).powi(2)).sum::<f64>().sqrt()
}

/// The posture within limits nearest to elbow, wrist and hand: Levenberg and Marquardt's method.
fn fit(arm: &Chain<f64, 7>, wanted: &[Point; 3]) -> [f64; 7] {
    let residual = |q: &[f64; 7]| {
        let landmarks: Vec<Point> = arm.forward(q).landmarks().skip(1).collect();
        SVector::<f64, 9>::from_fn(|k, _| wanted[k / 3][k % 3] - landmarks[k / 3][k % 3])
    };
    let mut q = [0.3, 0.1, 0.0, 1.2, 0.0, 0.0, 0.0];
    let mut damping = 1e-2;
    for _ in 0..300 {
        let here = residual(&q);
        let mut slope = SMatrix::<f64, 9, 7>::zeros();
        for i in 0..7 {
            let mut moved = q;
            moved[i] += 1e-6;
            slope.set_column(i, &((here - residual(&moved)) / 1e-6));
        }
        let normal = slope.transpose() * slope + SMatrix::<f64, 7, 7>::identity() * damping;
        let Some(step) = normal.lu().solve(&(slope.transpose() * here)) else {
            break;
        };
        let mut next = q;
        for i in 0..7 {
            next[i] = (q[i] + step[i]).clamp(arm.lower()[i], arm.upper()[i]);
        }
        if residual(&next).norm() < here.norm() {
            (q, damping) = (next, f64::max(damping / 3.0, 1e-9));
        } else {
            damping *= 4.0;
        }
    }
    q
}
