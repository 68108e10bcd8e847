//! The five steppers against plain transcriptions of their formulas through nalgebra's decompositions, and what holds
//! of each (SPEC section 2).

use nalgebra::{DMatrix, DVector, Dyn};
use proptest::prelude::*;
use sinew::chain::human_arm;
use sinew::real::Real;
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Stepper, Transpose,
};
use sinew_tests::for_its_size;
use sinew_tests::random::{Arm, arm};

/// Singular values below this part of the greatest are dropped (SPEC section 2).
const CUT_OFF: f64 = 1e-4;

type Svd = nalgebra::SVD<f64, Dyn, Dyn>;

/// One step's input, as nalgebra sees it: of an `f32` stepper exactly the `f32` numbers.
struct Input {
    jacobian: DMatrix<f64>,
    error: DVector<f64>,
}

impl Input {
    fn new<T: Real + Into<f64>, const M: usize, const N: usize>(
        jacobian: &[[T; M]; N],
        error: &[T; M],
    ) -> Self {
        Input {
            jacobian: DMatrix::from_fn(M, N, |r, i| jacobian[i][r].into()),
            error: vector(error),
        }
    }

    /// Nalgebra's singular value decomposition; none where a singular value lies within this part of the cut-off, so
    /// that rounding decides whether it counts, or where the matrix is nearly 0.
    fn svd(&self, near: f64) -> Option<Svd> {
        let svd = self.multiplied_up()?;
        let most = svd.singular_values.max();
        let decides = |value: &f64| (value / (CUT_OFF * most)).ln().abs() < near;
        let comparable = most > 1e-3 && !svd.singular_values.iter().any(decides);
        comparable.then_some(svd)
    }

    /// A decomposition that multiplies up to the matrix. One in a hundred of nalgebra 0.35's does not (some are off by
    /// a tenth); then that of the mirrored matrix, mirrored back, mostly does.
    fn multiplied_up(&self) -> Option<Svd> {
        let rows = self.jacobian.nrows();
        [0.0, 0.4, 0.7, 1.1].iter().find_map(|&slant| {
            let normal = DVector::from_fn(rows, |r, _| slant * r as f64 + 0.1).normalize();
            let mirror = DMatrix::identity(rows, rows) - &normal * normal.transpose() * 2.0;
            let mut svd = (&mirror * &self.jacobian).svd(true, true);
            svd.u = svd.u.map(|u| &mirror * u);
            let off = (svd.clone().recompose().ok()? - &self.jacobian).norm();
            (off <= 1e-13 * svd.singular_values.max()).then_some(svd)
        })
    }
}

/// The singular values that count, the greatest first.
fn counting(svd: &Svd) -> Vec<f64> {
    let least = CUT_OFF * svd.singular_values.max();
    let values = svd.singular_values.iter().copied();
    let mut values: Vec<f64> = values.filter(|&value| value > least).collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

fn vector<T: Real + Into<f64>, const N: usize>(values: &[T; N]) -> DVector<f64> {
    DVector::from_iterator(N, values.iter().map(|&x| x.into()))
}

/// An arm in a posture and what is left to its target, 6 rows of which some tests use 3.
fn task() -> impl Strategy<Value = (Arm, [f64; 6])> {
    (arm(), prop::array::uniform6(-1.0..1.0))
}

/// The arm's Jacobian and the error in a scalar.
fn inputs<T: Real, const M: usize, const N: usize>(
    (arm, error): &(Arm, [f64; 6]),
) -> ([[T; M]; N], [T; M]) {
    let at = arm.chain::<N>();
    let jacobian = at.forward(&arm.q()).columns::<M>();
    let error = std::array::from_fn(|r| T::of(error[r]));
    (jacobian.map(|column| column.map(T::of)), error)
}

/// All five, with their default settings.
fn all<T: Real>() -> [AnyStepper<T>; 5] {
    [
        AnyStepper::Transpose(Transpose),
        AnyStepper::NormalisedTranspose(NormalisedTranspose),
        AnyStepper::PseudoInverse(PseudoInverse),
        AnyStepper::Damped(Damped::default()),
        AnyStepper::SelectivelyDamped(SelectivelyDamped::default()),
    ]
}

/// J⁺ against nalgebra's.
fn pseudo_inverse_matches<T: Real + Into<f64>, const M: usize, const N: usize>(
    jacobian: &[[T; M]; N],
    error: &[T; M],
    near: f64,
) {
    let input = Input::new(jacobian, error);
    let Some(svd) = input.svd(near) else {
        return;
    };
    let counting = counting(&svd);
    let cut_off = CUT_OFF * svd.singular_values.max();
    let expected = svd.pseudo_inverse(cut_off).unwrap() * &input.error;
    let found = vector(&PseudoInverse.step(jacobian, error, T::one()));
    let (most, least) = (counting[0], counting[counting.len() - 1]);
    // J⁺ΔX moves by about κ·ε of its size, and LDLᵀ, used up to κ = 30, squares κ; nalgebra is off by 1e-13.
    let condition = most / least;
    let condition = condition.max(condition.min(30.0).powi(2));
    let bound = (100.0 * T::EPSILON + 2e-13) * condition * input.error.norm() / least;
    let off = (&found - &expected).norm();
    assert!(off <= bound, "{off:e} > {bound:e}: {found} {expected}");
}

fn check_pseudo_inverse<const N: usize>(task: &(Arm, [f64; 6])) {
    fn each<T: Real + Into<f64>, const M: usize, const N: usize>(
        task: &(Arm, [f64; 6]),
        near: f64,
    ) {
        let (jacobian, error) = inputs::<T, M, N>(task);
        pseudo_inverse_matches(&jacobian, &error, near);
    }
    each::<f64, 3, N>(task, 1e-6);
    each::<f64, 6, N>(task, 1e-6);
    each::<f32, 3, N>(task, 0.3);
    each::<f32, 6, N>(task, 0.3);
}

/// Jᵀ(JJᵀ + μ²I)⁻¹ΔX.
fn check_damped<const N: usize>(task: &(Arm, [f64; 6]), mu: f64) {
    fn each<T: Real + Into<f64>, const M: usize, const N: usize>(task: &(Arm, [f64; 6]), mu: f64) {
        let (jacobian, error) = inputs::<T, M, N>(task);
        let input = Input::new(&jacobian, &error);
        let j = &input.jacobian;
        let square = T::of(mu).into().powi(2);
        let normal = j * j.transpose() + DMatrix::identity(M, M) * square;
        let expected = j.transpose() * normal.try_inverse().unwrap() * &input.error;
        let damped = Damped::new(T::of(mu)).unwrap();
        let found = vector(&damped.step(&jacobian, &error, T::one()));
        let condition = 1.0 + (j.norm() / mu).powi(2);
        let bound = 100.0 * T::EPSILON * condition * input.error.norm() / (2.0 * mu);
        let off = (&found - &expected).norm();
        assert!(off <= bound, "{off:e} > {bound:e}: {found} {expected}");
    }
    each::<f64, 3, N>(task, mu);
    each::<f64, 6, N>(task, mu);
    each::<f32, 3, N>(task, mu);
    each::<f32, 6, N>(task, mu);
}

/// Buss and Kim 2005, section 3, for one end effector and with the singular values that count; as they write it.
fn selectively_damped(input: &Input, svd: Svd, gamma_max: f64) -> DVector<f64> {
    let (u, v_t) = (svd.u.unwrap(), svd.v_t.unwrap());
    let sigma = svd.singular_values;
    let clamp_max_abs = |v: DVector<f64>, d: f64| match v.amax() {
        largest if largest <= d => v,
        largest => v * (d / largest),
    };
    let rho: Vec<f64> = input
        .jacobian
        .column_iter()
        .map(|column| column.norm())
        .collect();
    let mut sum = DVector::zeros(rho.len());
    for k in (0..sigma.len()).filter(|&k| sigma[k] > CUT_OFF * sigma.max()) {
        let v = v_t.row(k).transpose();
        let alpha = u.column(k).dot(&input.error);
        let n = u.column(k).norm();
        let m: f64 = v
            .iter()
            .zip(&rho)
            .map(|(v, rho)| v.abs() * rho / sigma[k])
            .sum();
        let gamma = (n / m).min(1.0) * gamma_max;
        sum += clamp_max_abs(v * (alpha / sigma[k]), gamma);
    }
    clamp_max_abs(sum, gamma_max)
}

fn check_selectively_damped<const N: usize>(task: &(Arm, [f64; 6]), gamma_max: f64) {
    fn each<T: Real + Into<f64>, const M: usize, const N: usize>(
        task: &(Arm, [f64; 6]),
        gamma_max: f64,
        (near, tolerance): (f64, f64),
    ) {
        let (jacobian, error) = inputs::<T, M, N>(task);
        let input = Input::new(&jacobian, &error);
        let Some(svd) = input.svd(near) else {
            return;
        };
        // Of two equal singular values the singular vectors are anyone's choice, and the result depends on it.
        if counting(&svd)
            .windows(2)
            .any(|pair| pair[1] > pair[0] * (1.0 - near))
        {
            return;
        }
        let expected = selectively_damped(&input, svd, gamma_max);
        let stepper = SelectivelyDamped::new(T::of(gamma_max)).unwrap();
        let found = vector(&stepper.step(&jacobian, &error, T::one()));
        let off = (&found - &expected).amax();
        assert!(
            off <= tolerance,
            "{off:e} > {tolerance:e}: {found} {expected}"
        );
    }
    // A step is as long as the greatest angle allows, and `f32` rounds it accordingly.
    let single = 1e-3 * gamma_max.max(1.0);
    each::<f64, 3, N>(task, gamma_max, (1e-3, 1e-9));
    each::<f64, 6, N>(task, gamma_max, (1e-3, 1e-9));
    each::<f32, 3, N>(task, gamma_max, (0.1, single));
    each::<f32, 6, N>(task, gamma_max, (0.1, single));
}

fn check_normalised_transpose<const N: usize>(task: &(Arm, [f64; 6]), gain: f64) {
    fn each<T: Real + Into<f64>, const M: usize, const N: usize>(
        task: &(Arm, [f64; 6]),
        gain: f64,
    ) {
        let (jacobian, error) = inputs::<T, M, N>(task);
        let input = Input::new(&jacobian, &error);
        let step = vector(&NormalisedTranspose.step(&jacobian, &error, T::of(gain)));
        let rounding = 100.0 * T::EPSILON;
        assert!(step.norm() <= gain * (1.0 + rounding), "longer than λ·dt");

        let direction = input.jacobian.transpose() * &input.error;
        if direction.norm() < 1e-6 {
            return;
        }
        let across = &step - &direction * (step.dot(&direction) / direction.norm_squared());
        assert!(across.norm() <= rounding * gain, "not along JᵀΔX");
        // The squared distance falls along the step, and would not fall less had the step been shorter: at its end the
        // minimum may be reached but is not passed.
        let moved = &input.jacobian * &step;
        let left = &input.error - &moved;
        assert!(
            left.dot(&moved) >= -rounding * input.error.norm() * moved.norm(),
            "the minimum is passed"
        );
        // It stops short of λ·dt only at the minimum.
        if step.norm() < gain * (1.0 - rounding) {
            assert!(left.dot(&moved) <= rounding * input.error.norm() * moved.norm());
        }
    }
    each::<f64, 3, N>(task, gain);
    each::<f64, 6, N>(task, gain);
    each::<f32, 3, N>(task, gain);
    each::<f32, 6, N>(task, gain);
}

fn check_descent<const N: usize>(task: &(Arm, [f64; 6])) {
    fn each<const M: usize, const N: usize>(task: &(Arm, [f64; 6])) {
        let (jacobian, error) = inputs::<f64, M, N>(task);
        let input = Input::new(&jacobian, &error);
        let downhill = input.jacobian.transpose() * &input.error;
        for stepper in all::<f64>() {
            let step = vector(&stepper.step(&jacobian, &error, 0.1));
            let along = step.dot(&downhill);
            assert!(
                along >= -1e-9 * step.norm() * downhill.norm(),
                "{stepper:?}: {along:e}"
            );
        }
    }
    each::<3, N>(task);
    each::<6, N>(task);
}

proptest! {
    #[test]
    fn the_pseudo_inverse_is_that_of_the_singular_values(task in task()) {
        for_its_size!(task.0, check_pseudo_inverse(&task));
    }

    #[test]
    fn damped_least_squares_is_its_formula(task in task(), mu in prop_oneof![Just(0.05), 0.02..2.0]) {
        for_its_size!(task.0, check_damped(&task, mu));
    }

    #[test]
    fn selective_damping_is_that_of_buss_and_kim(task in task(), most in prop_oneof![Just(0.785), 0.01..6.0]) {
        for_its_size!(task.0, check_selectively_damped(&task, most));
    }

    #[test]
    fn the_normalised_transpose_never_passes_its_minimum(task in task(), gain in prop_oneof![1e-3..0.2, 0.2..20.0]) {
        for_its_size!(task.0, check_normalised_transpose(&task, gain));
    }

    #[test]
    fn no_step_goes_uphill(task in task()) {
        for_its_size!(task.0, check_descent(&task));
    }
}

/// The human arm's columns at a posture.
fn human<T: Real, const M: usize>(q: [f64; 7]) -> [[T; M]; 7] {
    let arm = human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
    arm.cast::<T>().forward(&q.map(T::of)).columns()
}

/// Hanging, held to the front and to the side, with the hand in line.
const STRAIGHT: [[f64; 7]; 3] = [
    [0.0; 7],
    [1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.3, -1.2, 0.4, 0.0, 0.7, 0.0, 0.0],
];

#[test]
fn a_straight_arm_is_singular_and_the_step_stays_finite() {
    fn each<T: Real + Into<f64>>() {
        for q in STRAIGHT {
            let columns = human::<T, 3>(q);
            let values = Input::new(&columns, &[T::zero(); 3])
                .jacobian
                .singular_values();
            assert!(values.min() < 1e-6 * values.max(), "{values:?}");
            let arm = human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
            let tip = arm.forward(&q).tip();
            for scale in [-2.0, -1.0, -1e-3, 1e-6, 1.0, 1e4] {
                let error = tip.map(|x| T::of(x * scale));
                for stepper in all::<T>() {
                    let step = stepper.step(&columns, &error, T::of(0.1)).map(Into::into);
                    let largest = step.iter().fold(0.0f64, |most, x| most.max(x.abs()));
                    // Along the arm nothing can be won: what rounding leaves of it must stay small.
                    assert!(step.iter().all(|x| x.is_finite()), "{stepper:?}: {step:?}");
                    assert!(
                        largest <= 0.1 * (1.0 + scale.abs()),
                        "{stepper:?}: {step:?}"
                    );
                }
            }
        }
    }
    each::<f32>();
    each::<f64>();
}

#[test]
fn at_a_singularity_the_pseudo_inverse_is_still_that_of_the_singular_values() {
    // Across the straight arm, not along it: the singular direction is dropped.
    for q in STRAIGHT {
        for error in [[0.1, 0.2, -0.05], [0.0, 0.0, 0.3], [1.0, -1.0, 0.5]] {
            pseudo_inverse_matches(&human::<f64, 3>(q), &error, 0.1);
            pseudo_inverse_matches(&human::<f32, 3>(q), &error.map(|x| x as f32), 0.1);
            let error = [error[0], error[1], error[2], 0.3, -0.2, 0.1];
            pseudo_inverse_matches(&human::<f64, 6>(q), &error, 0.1);
            pseudo_inverse_matches(&human::<f32, 6>(q), &error.map(|x| x as f32), 0.1);
        }
    }
}

#[test]
fn singular_values_near_the_cut_off_are_kept_above_and_dropped_below() {
    for (least, kept) in [
        (1.01e-4, true),
        (0.99e-4, false),
        (1e-2, true),
        (0.0, false),
    ] {
        let columns = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0 * least]];
        let step = PseudoInverse.step(&columns, &[1.0, 1.0, 1.0], 1.0);
        let expected = if kept { 0.5 / least } else { 0.0 };
        assert!(
            (step[2] - expected).abs() <= 1e-9 * expected,
            "{least}: {step:?}"
        );
        assert!((step[0] - 0.5).abs() < 1e-12 && (step[1] - 1.0).abs() < 1e-12);
    }
}

#[test]
fn where_nothing_moves_nothing_is_done() {
    fn each<T: Real + Into<f64>>() {
        for stepper in all::<T>() {
            for (columns, error) in [([[0.0; 3]; 2], [1.0; 3]), ([[1.0, 2.0, 3.0]; 2], [0.0; 3])] {
                let columns: [[T; 3]; 2] = columns.map(|column: [f64; 3]| column.map(T::of));
                let step = stepper.step(&columns, &error.map(T::of), T::one());
                assert!(
                    step.into_iter().all(|x| x.into() == 0.0),
                    "{stepper:?}: {step:?}"
                );
            }
        }
    }
    each::<f32>();
    each::<f64>();
}
