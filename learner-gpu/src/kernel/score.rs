//! A member's score: its motions synthesised and compared with the recordings (SPEC sections 4 to 6). Mirror of
//! `score.wgsl`.
//!
//! The tick itself is the core's: its source is generic, so here it runs on SIMD lanes as it runs in `f64`.

use sinew::chain::Chain;
use sinew::controller::Controller;
use sinew::kinematics::Kinematics;
use sinew::metric::MotionDistance;
use sinew::real::Real;
use sinew::synergy::Synergy;
use sinew::target::Position;

use crate::lanes::Instructions;
use crate::problem::Settings;
use crate::task::{Task, TaskError};

/// The mean score over a set's motions of as many members as there are lanes in a `T` of a level of instructions.
///
/// For each number of DoFs and kind of lanes this is compiled once, for all who call it: what is inside is large,
/// and most of what there is to compile.
#[inline(never)]
pub fn mean<S: Instructions, T: Real, const N: usize>(
    motions: &[Ready<T, N>],
    settings: &Settings,
    parameters: &[T],
) -> T {
    S::proof().vectorize(
        #[inline(always)]
        || {
            let mut sum = T::zero();
            for motion in motions {
                sum = sum + motion.score(settings, parameters);
            }
            sum / T::count(motions.len() as u32)
        },
    )
}

/// One motion made ready for N DoFs and a scalar.
#[derive(Clone, Debug)]
pub struct Ready<T, const N: usize> {
    chain: Chain<T, N>,
    initial: [T; N],
    target: Position<T>,
    /// Frames of landmarks, the tip last; metres.
    reference: Vec<Vec<[f64; 3]>>,
    /// How many landmarks, from the first on, are where they were recorded.
    still: usize,
    /// The other landmarks in `f32`: to convert them at each tick takes lanes longer than to subtract them.
    coarse: Vec<Vec<[f32; 3]>>,
    /// What a metre costs that the hand ends further than [`THERE`] from the target.
    arrival: f32,
}

/// A hand this near its target is there, metres: 1 cm is what counts, and a little of it is kept for rounding.
pub const THERE: f32 = 0.009;

impl<T: Real, const N: usize> Ready<T, N> {
    /// A task's motion.
    ///
    /// # Errors
    /// What is wrong with the chain, or a posture of another size.
    pub fn new(task: &Task) -> Result<Self, TaskError> {
        let chain = task.chain.build::<N>()?;
        let still = task.still(&chain);
        let coarse = |frame: &Vec<[f64; 3]>| {
            let beyond = frame.iter().skip(still);
            beyond.map(|point| point.map(|x| x as f32)).collect()
        };
        Ok(Ready {
            chain: chain.cast(),
            initial: task.posture()?,
            target: task.goal()?,
            reference: task.reference.clone(),
            still,
            coarse: task.reference.iter().map(coarse).collect(),
            arrival: 0.0,
        })
    }

    /// The same, where a hand that does not arrive costs so much a metre.
    pub fn arriving(self, arrival: f32) -> Self {
        Ready { arrival, ..self }
    }

    /// What a metre costs of what this distance from the target, metres, is more than [`THERE`].
    pub fn arrival(&self, left: f32) -> f32 {
        if left > THERE { self.arrival } else { 0.0 }
    }

    /// The mean distance in metres between the recording and the motion synthesised with these parameters, and what it
    /// costs where the hand does not arrive; 1e9 where the parameters are no synergy's.
    #[inline(always)]
    pub fn score(&self, settings: &Settings, parameters: &[T]) -> T {
        let mut distance = MotionDistance::new();
        let frames = self.reference.len();
        let end = self.synthesise(
            settings,
            parameters,
            frames,
            #[inline(always)]
            |frame, at, _| {
                let still = self.still;
                // Which of the two is known when this is compiled.
                if T::EPSILON > f64::EPSILON {
                    if let Some(points) = self.coarse.get(frame) {
                        let points = points.iter();
                        let points = points.map(|&[x, y, z]| [of(x), of(y), of(z)]);
                        distance.add(at.distance_beyond(still, points));
                    }
                } else if let Some(points) = self.reference.get(frame) {
                    let points = points.iter().skip(still);
                    let points = points.map(|&[x, y, z]| [T::of(x), T::of(y), T::of(z)]);
                    distance.add(at.distance_beyond(still, points));
                }
            },
        );
        match end {
            Ok(tip) if self.arrival > 0.0 => {
                let target = self.target.coordinates();
                let [x, y, z] = std::array::from_fn(|r| tip[r] - target[r]);
                let left = (x * x + y * y + z * z).sqrt() - T::of(THERE.into());
                let short = left.within(T::zero(), T::of(1e9));
                distance.mean() + T::of(self.arrival.into()) * short
            }
            Ok(_) => distance.mean(),
            Err(_) => T::of(1e9),
        }
    }

    /// How many landmarks are compared, over all frames.
    pub fn landmarks(&self) -> usize {
        self.reference.iter().map(Vec::len).sum()
    }

    /// How far each landmark is in each frame from where it was recorded: x, y and z of the first landmark in frame 0, and
    /// so on, metres. Nothing where the parameters are no synergy's.
    #[inline(always)]
    pub fn apart(&self, settings: &Settings, parameters: &[T], mut visit: impl FnMut(T)) {
        let _ = self.synthesise(
            settings,
            parameters,
            self.reference.len(),
            #[inline(always)]
            |frame, at, _| {
                let recorded = self.reference.get(frame).into_iter().flatten();
                for (landmark, recorded) in at.landmarks().zip(recorded) {
                    for c in 0..3 {
                        visit(landmark[c] - T::of(recorded[c]));
                    }
                }
            },
        );
    }

    /// Runs the controller for `frames` frames, of which the first is the initial posture. `visit` sees each frame's
    /// number, forward kinematics and joint vector. What comes back is where the tip is in the last.
    ///
    /// # Errors
    /// Parameters or settings that the core refuses.
    #[inline(always)]
    pub fn synthesise(
        &self,
        settings: &Settings,
        parameters: &[T],
        frames: usize,
        mut visit: impl FnMut(usize, &Kinematics<'_, T, N>, &[T; N]),
    ) -> Result<[T; 3], sinew::Error> {
        let synergy = Synergy::<T, N>::from_parameters(settings.model.into(), parameters)?;
        let (lambda, dt) = (T::of(settings.lambda), T::of(settings.dt()));
        let stepper = settings.stepper.stepper::<T>();
        let controller =
            Controller::new(&self.chain, stepper, synergy, lambda, dt, settings.limits())?;
        let mut state = controller.start(self.initial);
        // One forward kinematics a frame, for who looks on and for the tick.
        let mut at = self.chain.forward_within(state.angles());
        for frame in 0..frames {
            visit(frame, &at, state.angles());
            if frame + 1 < frames {
                controller.advance(&mut state, &at, &self.target);
                at.move_within(state.angles());
            }
        }
        Ok(at.tip())
    }
}

/// A single as a number.
#[inline(always)]
fn of<T: Real>(x: f32) -> T {
    T::of(f64::from(x))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, Problem, StepperKind};

    /// The score with every landmark compared.
    fn in_full<T: Real>(task: &Task, settings: &Settings, parameters: &[T]) -> T {
        let mut distance = MotionDistance::new();
        let ready = Ready::<T, 7>::new(task).unwrap();
        let frames = task.reference.len();
        ready
            .synthesise(settings, parameters, frames, |frame, at, _| {
                let recorded = task.reference[frame].iter();
                distance.add(at.distance(recorded.map(|point| point.map(T::of))));
            })
            .unwrap();
        distance.mean()
    }

    #[test]
    fn a_shoulder_at_rest_is_not_compared_and_changes_no_bit() {
        let problem = Problem::of_sample(&[0, 5], StepperKind::Transpose, ModelKind::C);
        let settings = &problem.settings;
        let parameters = [0.4, -0.2, 0.3, 1.5, 0.1, 0.2, -0.3, 4.0, 8.0];
        let coarse = parameters.map(|x| x as f32);
        for task in &problem.tasks {
            assert_eq!(task.still::<7>(&task.chain.build().unwrap()), 1);
            let ready = Ready::<f64, 7>::new(task).unwrap();
            let score = ready.score(settings, &parameters);
            assert_eq!(score, in_full(task, settings, &parameters));
            let ready = Ready::<f32, 7>::new(task).unwrap();
            let score = ready.score(settings, &coarse);
            assert_eq!(score, in_full(task, settings, &coarse));
        }
    }

    #[test]
    fn a_shoulder_that_was_elsewhere_in_one_frame_is_compared() {
        let problem = Problem::of_sample(&[0], StepperKind::Transpose, ModelKind::A);
        let settings = &problem.settings;
        let before = Ready::<f64, 7>::new(&problem.tasks[0]).unwrap();
        let mut task = problem.tasks[0].clone();
        task.reference[7][0] = [0.0, 0.3, 0.4];
        assert_eq!(task.still::<7>(&task.chain.build().unwrap()), 0);
        let after = Ready::<f64, 7>::new(&task).unwrap();
        // Half a metre, of one of four landmarks in one of the frames.
        let more = 0.5 / 4.0 / task.reference.len() as f64;
        let found = after.score(settings, &[1.0]) - before.score(settings, &[1.0]);
        assert!((found - more).abs() < 1e-12, "{found} {more}");
    }
}
