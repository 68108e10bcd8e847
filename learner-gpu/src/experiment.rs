//! What the paper's experiments compare (its section 4, figures 3 and 4), and the numbers that it prints.
//!
//! Both figures show, over the same recordings, the mean, least and greatest distance that each model reached with each
//! inverse kinematics, and by how much a richer model lowers the mean.

use serde::Serialize;

use crate::problem::{ModelKind, StepperKind, mean};

/// A richer model is worse on a motion if its distance is greater by more than this, cm: less is rounding.
pub const TIE_CM: f64 = 1e-4;

/// Distances of a set of motions, cm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Their mean.
    pub mean_cm: f64,
    /// The least.
    pub least_cm: f64,
    /// The greatest.
    pub greatest_cm: f64,
}

impl Spread {
    /// Of distances in cm; zeros of none.
    pub fn of(distances: &[f64]) -> Self {
        let Some(&first) = distances.first() else {
            return Spread {
                mean_cm: 0.0,
                least_cm: 0.0,
                greatest_cm: 0.0,
            };
        };
        Spread {
            mean_cm: mean(distances.iter().copied()),
            least_cm: distances.iter().copied().fold(first, f64::min),
            greatest_cm: distances.iter().copied().fold(first, f64::max),
        }
    }
}

/// What a model gains over a poorer one on the same motions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gain {
    /// The share by which the mean distance falls; negative where it rises.
    pub reduction: f64,
    /// On how many motions the richer model ends above the poorer one, by more than [`TIE_CM`]. Where the poorer model
    /// is a case of the richer one (S_A of S_B, S_C of S_D), that is the search's failing and not the model's.
    pub worse_on: usize,
}

impl Gain {
    /// From the distances (cm, motion by motion) of a poorer model to those of a richer one.
    pub fn of(poorer: &[f64], richer: &[f64]) -> Self {
        let before = mean(poorer.iter().copied());
        let worse = |(poorer, richer): &(&f64, &f64)| **richer > **poorer + TIE_CM;
        Gain {
            reduction: match before > 0.0 {
                true => 1.0 - mean(richer.iter().copied()) / before,
                false => 0.0,
            },
            worse_on: poorer.iter().zip(richer).filter(worse).count(),
        }
    }
}

/// What the paper prints of a model: on its own 14 reaches, so to be compared in kind and not in size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Printed {
    /// The mean distance, cm.
    pub mean_cm: Option<f64>,
    /// The least, cm.
    pub least_cm: Option<f64>,
    /// The share by which the mean falls.
    pub reduction: Option<f64>,
}

/// Figure 3: a model, and what it gains over the model before it.
///
/// The paper says by how much "more" S_C and S_D lower the mean, not of which mean; it is read here as the share of the
/// mean of the model before.
pub fn figure_3(model: ModelKind) -> Printed {
    let (mean_cm, least_cm, reduction) = match model {
        ModelKind::A => (None, None, None),
        ModelKind::B => (None, None, Some(0.55)),
        ModelKind::C => (None, Some(0.90), Some(0.13)),
        ModelKind::D => (Some(1.35), None, Some(0.10)),
    };
    Printed {
        mean_cm,
        least_cm,
        reduction,
    }
}

/// Figure 4: S_C with an inverse kinematics, and what it gains over S_A with the same.
pub fn figure_4(stepper: StepperKind, model: ModelKind) -> Printed {
    let (mean_cm, reduction) = match (stepper, model) {
        (StepperKind::Transpose, ModelKind::C) => (Some(2.15), Some(0.34)),
        (StepperKind::PseudoInverse, ModelKind::C) => (Some(1.71), Some(0.66)),
        (StepperKind::NormalisedTranspose, ModelKind::C) => (Some(2.26), Some(0.47)),
        _ => (None, None),
    };
    Printed {
        mean_cm,
        least_cm: None,
        reduction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_the_mean_and_the_ends() {
        let spread = Spread::of(&[2.0, 1.0, 6.0]);
        assert_eq!(
            (spread.mean_cm, spread.least_cm, spread.greatest_cm),
            (3.0, 1.0, 6.0)
        );
        assert_eq!(Spread::of(&[]).mean_cm, 0.0);
    }

    #[test]
    fn a_gain_is_of_the_means_and_counts_the_motions_that_lost() {
        let gain = Gain::of(&[4.0, 2.0, 2.0], &[1.0, 2.5, 2.5]);
        assert_eq!((gain.reduction, gain.worse_on), (0.25, 2));
        // What differs by rounding is no loss.
        assert_eq!(Gain::of(&[1.0], &[1.0 + 0.5 * TIE_CM]).worse_on, 0);
        assert_eq!(Gain::of(&[1.0], &[1.0 + 2.0 * TIE_CM]).worse_on, 1);
        assert!(Gain::of(&[1.0], &[2.0]).reduction < 0.0);
        assert_eq!(Gain::of(&[0.0], &[0.0]).reduction, 0.0);
    }

    #[test]
    fn the_paper_prints_a_reduction_wherever_it_compares() {
        let steps = [ModelKind::B, ModelKind::C, ModelKind::D];
        assert!(
            steps
                .iter()
                .all(|&model| figure_3(model).reduction.is_some())
        );
        assert_eq!(figure_3(ModelKind::A).reduction, None);
        // The damped steppers are ours.
        let printed = StepperKind::ALL.map(|stepper| figure_4(stepper, ModelKind::C).reduction);
        assert_eq!(printed.iter().flatten().count(), 3);
    }
}
