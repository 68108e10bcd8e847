//! From a joint's angle to a hobby servo's pulse.
//!
//! pulse = zero + per_radian · q, held within [least, most]. Calibrate by sending the pulses of two known postures.

use core::convert::Infallible;

use embedded_hal::pwm::SetDutyCycle;
use sinew::real::Real;

/// A PWM channel of any timer: none of them can fail.
pub type Channel<'a> = &'a mut dyn SetDutyCycle<Error = Infallible>;

/// One servo's calibration, in microseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// The pulse at q = 0.
    pub zero: f32,
    /// How much longer it gets for a radian; negative where the servo turns the other way.
    pub per_radian: f32,
    /// The shortest pulse the servo takes.
    pub least: f32,
    /// The longest.
    pub most: f32,
}

impl Calibration {
    /// A common servo: 1,500 µs in the middle, 2,000 µs for half a turn, 500 to 2,500 µs.
    pub const COMMON: Calibration = Calibration {
        zero: 1500.0,
        per_radian: 2000.0 / core::f32::consts::PI,
        least: 500.0,
        most: 2500.0,
    };

    /// The same servo mounted the other way round.
    pub const fn reversed(self) -> Self {
        Calibration {
            per_radian: -self.per_radian,
            ..self
        }
    }

    /// The same servo with another pulse at q = 0.
    pub const fn with_zero(self, zero: f32) -> Self {
        Calibration { zero, ..self }
    }

    /// The pulse for an angle, microseconds.
    pub fn pulse(&self, q: f32) -> f32 {
        (self.zero + self.per_radian * q).within(self.least, self.most)
    }

    /// Sends an angle, on a channel whose period is `frame` microseconds.
    pub fn send(&self, q: f32, frame: f32, channel: Channel<'_>) {
        let duty = self.pulse(q) / frame * f32::from(channel.max_duty_cycle());
        // Rounded; within [0, max] by construction, and the cast saturates.
        let duty = (duty + 0.5) as u16;
        let Ok(()) = channel.set_duty_cycle(duty.min(channel.max_duty_cycle()));
    }

    /// Sends no pulses: the servo is free.
    pub fn release(channel: Channel<'_>) {
        let Ok(()) = channel.set_duty_cycle_fully_off();
    }
}
