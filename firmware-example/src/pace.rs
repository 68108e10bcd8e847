//! Limits of speed and acceleration for one DoF, in steps a tick.
//!
//! A step is how far a DoF moves in a tick. It changes by no more than `change` from one tick to the next, never
//! exceeds `most`, and is never so long that the DoF could not stop before its limit: with room r left, steps that
//! shrink by a each tick stop in time if s²/2a + s/2 + a/8 ≤ r.

use sinew::real::Real;

use crate::PERIOD;

/// The limits, for every DoF alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// The longest step, rad (or m) a tick.
    most: f32,
    /// The greatest change of a step, rad (or m) a tick².
    change: f32,
}

impl Pace {
    /// From a speed (rad/s or m/s) and an acceleration (rad/s² or m/s²), both positive.
    pub fn new(speed: f32, acceleration: f32) -> Self {
        Pace {
            most: speed * PERIOD,
            change: acceleration * PERIOD * PERIOD,
        }
    }

    /// The longest step, rad (or m) a tick.
    pub fn most(&self) -> f32 {
        self.most
    }

    /// How much of a posture's change to take: 1, or less where the longest of its steps, `longest`, is above the limit
    /// or could not be stopped within `room`. All DoFs are slowed alike, so that the hand keeps its way.
    pub fn share(&self, longest: f32, room: f32) -> f32 {
        let most = self.in_time(longest.least(self.most), room, GENTLE * self.change);
        if most < longest { most / longest } else { 1.0 }
    }

    /// The step to take where `want` is wanted: `before` is the one before, `down` and `up` the room to the limits.
    #[inline]
    pub fn step(&self, want: f32, before: f32, down: f32, up: f32) -> f32 {
        let want = want.within(-self.most, self.most);
        let want = if want < 0.0 {
            -self.in_time(-want, down, FIRM * self.change)
        } else {
            self.in_time(want, up, FIRM * self.change)
        };
        want.within(before - self.change, before + self.change)
    }

    /// The longest step up to `want` that steps `a` shorter each can end within `room`.
    #[inline]
    fn in_time(&self, want: f32, room: f32, a: f32) -> f32 {
        // The sum of steps that do not end at 0 evenly is longer, by an eighth of `a` at most.
        let room = room - 0.125 * a;
        if want * (want + a) <= 2.0 * a * room {
            return want;
        }
        if room > 0.0 {
            a * (Real::sqrt(0.25 + 2.0 * room / a) - 0.5)
        } else {
            0.0
        }
    }
}

/// A joint's limit is braked for with this share of the acceleration: the rest is for rounding.
const FIRM: f32 = 0.95;

/// A target is braked for with this share of the acceleration: the rest is for the way to turn.
const GENTLE: f32 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    /// 4 rad/s, 40 rad/s²: braking from full speed takes a tenth of a second.
    fn pace() -> Pace {
        Pace::new(4.0, 40.0)
    }

    #[test]
    fn a_dof_driven_at_its_limit_keeps_to_speed_and_acceleration_and_stops_before_it() {
        for room in [1e-6, 1e-3, 0.1, 0.7, 1.9] {
            let (mut left, mut before) = (room, 0.0f32);
            for _ in 0..2000 {
                let step = pace().step(1.0, before, 10.0, left);
                assert!(step.abs() <= 4e-3 && (step - before).abs() <= 40e-6 * 1.001);
                left -= step;
                assert!(left >= -1e-6, "{left} left of {room}");
                before = step;
            }
            assert!(left < 1e-3 && before < 40e-6, "{left} left of {room}");
        }
    }

    #[test]
    fn what_is_within_the_limits_is_left_alone() {
        assert_eq!(pace().step(1e-5, 0.0, 1.0, 1.0), 1e-5);
        assert_eq!(pace().share(1e-3, 1.0), 1.0);
        assert_eq!(pace().step(0.0, 0.0, 0.0, 0.0), 0.0);
    }

    #[test]
    fn a_share_is_of_the_longest_step() {
        let share = pace().share(8e-3, 1.0);
        assert!((share - 0.5).abs() < 1e-6);
        assert_eq!(pace().share(8e-3, 0.0), 0.0);
    }
}
