//! One control tick (SPEC section 2; the paper's figure 1): optimise, apply the synergy, integrate, clamp.

use crate::Error;
use crate::chain::{Chain, Kind, MOST_LENGTH};
use crate::kinematics::Kinematics;
use crate::math::MOST_ANGLE;
use crate::real::Real;
use crate::stepper::Stepper;
use crate::synergy::{Paced, Synergy, check_rate};
use crate::target::Target;

/// Whether a tick keeps the DoFs within the chain's limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limits {
    /// It does.
    Clamped,
    /// It does not (as in the paper's experiments); angles still stay within ±8192 rad, slides within ±10 km.
    Free,
}

/// Everything about a motion that does not change while it runs.
#[derive(Clone, Copy, Debug)]
pub struct Controller<'a, T, S, const N: usize> {
    chain: &'a Chain<T, N>,
    stepper: S,
    synergy: Paced<T, N>,
    /// λ·dt.
    gain: T,
    lower: [T; N],
    upper: [T; N],
}

/// Where a motion is: the joint vector, the time in ticks since it began, and how far its sigmoids are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<T, const N: usize> {
    q: [T; N],
    tick: u32,
    rests: [T; N],
}

impl<T: Real, const N: usize> State<T, N> {
    /// The joint vector: radians or metres.
    #[inline(always)]
    pub fn angles(&self) -> &[T; N] {
        &self.q
    }

    /// How many ticks have run.
    #[inline(always)]
    pub fn ticks(&self) -> u32 {
        self.tick
    }
}

impl<'a, T: Real, S: Stepper<T>, const N: usize> Controller<'a, T, S, N> {
    /// A controller for a chain. `lambda` is the stepper's rate λ ([`Stepper::RATE`] is the SPEC's default), `dt` the
    /// period in seconds.
    ///
    /// # Errors
    /// λ or dt that is not finite, not positive, or above 1e6.
    #[inline(always)]
    pub fn new(
        chain: &'a Chain<T, N>,
        stepper: S,
        synergy: Synergy<T, N>,
        lambda: T,
        dt: T,
        limits: Limits,
    ) -> Result<Self, Error> {
        Self::paced(chain, stepper, synergy.paced(dt)?, lambda, limits)
    }

    /// The same of a synergy in steps of its period, without an exponential: for firmware that cannot keep a controller,
    /// which borrows its chain, and makes one for every tick.
    ///
    /// # Errors
    /// λ that is not finite, not positive, or above 1e6.
    #[inline(always)]
    pub fn paced(
        chain: &'a Chain<T, N>,
        stepper: S,
        synergy: Paced<T, N>,
        lambda: T,
        limits: Limits,
    ) -> Result<Self, Error> {
        check_rate(lambda)?;
        let (mut lower, mut upper) = (chain.lower, chain.upper);
        if limits == Limits::Free {
            for ((lo, hi), kind) in lower.iter_mut().zip(&mut upper).zip(chain.kinds()) {
                let most = match kind {
                    Kind::Revolute => MOST_ANGLE,
                    Kind::Prismatic => MOST_LENGTH,
                };
                (*lo, *hi) = (T::of(-most), T::of(most));
            }
        }
        Ok(Controller {
            chain,
            stepper,
            gain: lambda * synergy.dt,
            synergy,
            lower,
            upper,
        })
    }

    /// The state at a motion's beginning: `q` moved within the limits (to the lower one where it is NaN).
    #[inline(always)]
    pub fn start(&self, q: [T; N]) -> State<T, N> {
        let mut state = State {
            q,
            tick: 0,
            rests: self.synergy.rests(),
        };
        self.place(&mut state, q);
        state
    }

    /// Another joint vector at the same time, moved within the limits: for who changes it between ticks, as a speed limit
    /// does.
    #[inline(always)]
    pub fn place(&self, state: &mut State<T, N>, q: [T; N]) {
        for i in 0..N {
            state.q[i] = q[i].within(self.lower[i], self.upper[i]);
        }
    }

    /// One tick: the state one period later. What comes out is finite and within the limits, whatever the target.
    #[inline(always)]
    pub fn tick<const M: usize>(&self, state: &mut State<T, N>, target: &impl Target<T, M>) {
        let at = self.chain.forward_within(&state.q);
        self.advance(state, &at, target);
    }

    /// [`tick`](Self::tick) for who has the forward kinematics of the state's joint vector at hand already.
    #[inline(always)]
    pub fn advance<const M: usize>(
        &self,
        state: &mut State<T, N>,
        at: &Kinematics<'_, T, N>,
        target: &impl Target<T, M>,
    ) {
        let error = target.error(at);
        let step = self.stepper.step(&at.columns::<M>(), &error, self.gain);
        let step = self.synergy.apply(&step, &mut state.rests);
        for i in 0..N {
            // A step that is no number moves nothing.
            let step = T::select(step[i].is_sane(), step[i], T::zero());
            state.q[i] = (state.q[i] + step).within(self.lower[i], self.upper[i]);
        }
        state.tick = state.tick.saturating_add(1);
    }
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;
    use crate::stepper::{Damped, SelectivelyDamped, Transpose};

    #[test]
    fn a_rate_and_a_period_are_positive() {
        let error = Error::OutOfRange {
            what: "λ and the period must be positive and below 1e6",
            joint: None,
        };
        let arm = crate::chain::human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
        let synergy = Synergy::a(1.0).unwrap();
        for x in [0.0, -0.0, -1.0, 1e6, f64::INFINITY, f64::NAN] {
            for (lambda, dt) in [(x, 0.01), (100.0, x)] {
                let made = Controller::new(&arm, Transpose, synergy, lambda, dt, Limits::Clamped);
                assert_eq!(made.map(|_| ()), Err(error), "{x}");
            }
        }
    }

    #[test]
    fn a_damping_lies_in_its_range() {
        for x in [0.0, 0.9e-3, 1.1e3, -1.0, f64::INFINITY, f64::NAN] {
            let what = "the damping must be from 0.001 to 1000";
            let error = Error::OutOfRange { what, joint: None };
            assert_eq!(Damped::new(x), Err(error), "{x}");
        }
        for x in [0.0, -1.0, 6.4, f64::INFINITY, f64::NAN] {
            let what = "the greatest angle must be above 0 and up to 2π";
            let error = Error::OutOfRange { what, joint: None };
            assert_eq!(SelectivelyDamped::new(x), Err(error), "{x}");
        }
        assert!(Damped::new(1e-3f32).is_ok() && Damped::new(1e3f32).is_ok());
        assert!(SelectivelyDamped::new(core::f32::consts::TAU).is_ok());
    }

    #[test]
    fn a_motion_starts_within_the_limits() {
        let arm = crate::chain::human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
        let synergy = Synergy::a(1.0).unwrap();
        let start = |limits, q: f64| {
            let controller = Controller::new(&arm, Transpose, synergy, 100.0, 0.01, limits);
            *controller.unwrap().start([q; 7]).angles()
        };
        assert_eq!(start(Limits::Clamped, 100.0), *arm.upper());
        assert_eq!(start(Limits::Clamped, f64::NAN), *arm.lower());
        assert_eq!(start(Limits::Clamped, f64::NEG_INFINITY), *arm.lower());
        assert_eq!(start(Limits::Free, 100.0), [100.0; 7]);
        assert_eq!(start(Limits::Free, f64::INFINITY), [MOST_ANGLE; 7]);
    }
}
