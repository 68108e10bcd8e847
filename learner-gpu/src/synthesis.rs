//! A motion to a new target with a learned synergy, frame by frame.

use crate::kernel::score::Ready;
use crate::motion::Point;
use crate::problem::with_dofs;
use crate::synergies::{LearnedMotion, Synergies};
use crate::task::{Task, TaskError};

/// A synthesised motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Synthesis {
    /// Frames a second.
    pub rate_hz: f64,
    /// The names of the joints.
    pub joints: Vec<String>,
    /// The names of the landmarks, the tip last, as `hand`.
    pub landmarks: Vec<String>,
    /// The joint vector of each frame: radians or metres.
    pub angles: Vec<Vec<f64>>,
    /// The landmarks of each frame, metres in the base frame.
    pub points: Vec<Vec<Point>>,
    /// How far the tip is from the target in the last frame, metres.
    pub left: f64,
}

/// The motion of `frames` frames from a learned motion's initial posture to `target` (metres, base frame), with its
/// synergy. Frame 0 is the initial posture.
///
/// # Errors
/// A chain, a target or parameters that the core refuses.
pub fn synthesize(
    synergies: &Synergies,
    motion: &LearnedMotion,
    target: Point,
    frames: usize,
) -> Result<Synthesis, TaskError> {
    let description = synergies.chain_of(motion);
    let task = Task {
        name: motion.file.clone(),
        chain: description.clone(),
        initial: motion.initial_posture.clone(),
        target,
        reference: Vec::new(),
        misfit: 0.0,
    };
    let settings = synergies.settings(motion);
    let dofs = description.joints.len();
    let (mut angles, mut points) = (Vec::new(), Vec::new());
    let run = with_dofs!(dofs, N => {
        Ready::<f64, N>::new(&task)?.synthesise(&settings, &motion.parameters, frames, |_, at, q| {
            angles.push(q.to_vec());
            points.push(at.landmarks().collect::<Vec<Point>>());
        })
    }, else return Err(TaskError::Dofs { found: dofs }));
    run.map_err(|error| TaskError::Core {
        motion: motion.file.clone(),
        error,
    })?;
    let tip = points
        .last()
        .and_then(|frame| frame.last())
        .copied()
        .unwrap_or(target);
    let names = description
        .landmarks
        .iter()
        .map(|landmark| landmark.name.clone());
    Ok(Synthesis {
        rate_hz: synergies.rate_hz,
        joints: description
            .joints
            .iter()
            .map(|joint| joint.name.clone())
            .collect(),
        landmarks: names.chain(["hand".to_owned()]).collect(),
        angles,
        points,
        left: crate::motion::distance(tip, target),
    })
}

impl Synthesis {
    /// The motion as CSV: `time`, the landmarks' positions, `phase` (1, on the way out), and a column a joint. Landmarks
    /// with the names that recordings have go by their columns (`sx` to `hz`), so that the file can be read as one.
    pub fn csv(&self) -> String {
        let column = |landmark: &String, axis: &str| match landmark.as_str() {
            "shoulder" | "elbow" | "wrist" | "hand" => {
                format!("{}{axis}", landmark.get(..1).unwrap_or_default())
            }
            other => format!("{other} {axis}"),
        };
        let quoted = |name: String| match name.contains([',', '"', '\n']) {
            true => format!("\"{}\"", name.replace('"', "\"\"")),
            false => name,
        };
        let mut names = vec!["time".to_owned()];
        for landmark in &self.landmarks {
            names.extend(["x", "y", "z"].map(|axis| column(landmark, axis)));
        }
        names.push("phase".to_owned());
        names.extend(self.joints.iter().cloned());
        let mut text = names.into_iter().map(quoted).collect::<Vec<_>>().join(",") + "\n";
        for (frame, (points, angles)) in self.points.iter().zip(&self.angles).enumerate() {
            text.push_str(&format!("{:.6}", frame as f64 / self.rate_hz));
            for x in points.iter().flatten() {
                text.push_str(&format!(",{x:.6}"));
            }
            text.push_str(",1");
            for q in angles {
                text.push_str(&format!(",{q:.6}"));
            }
            text.push('\n');
        }
        text
    }
}
