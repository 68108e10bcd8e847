//! The arm in motion: each tick a step of the core's controller from where the arm is, held within the pace.
//!
//! The paced posture, not the controller's own, is what the next tick starts from. So the arm never runs after a
//! posture that it has to catch up with, a new target in mid-motion needs no special case, and wherever the pace does
//! not bind the motion is the core's to the bit.
//!
//! A target beyond the arm's length is moved to it. A motion that no longer gets nearer to its target ends: a target
//! that joint limits keep out of reach is approached as far as it goes, and then the arm is still.

use sinew::chain::{Chain, Kind, Shift, human_arm};
use sinew::controller::{Controller, Limits, State};
use sinew::stepper::{AnyStepper, Stepper, Transpose};
use sinew::synergy::{Model, Paced, Synergy};
use sinew::target::Position;
use sinew::{Error, real::Real};
use sinew_protocol::{DOFS, Mode};

use crate::pace::Pace;
use crate::planner::Planner;
use crate::{PERIOD, RATE_HZ};

/// The default arm's upper arm, forearm and hand, metres: a median adult's (Winter 2009, *Biomechanics and motor
/// control of human movement*, section 4.1, at 1.72 m).
pub const SEGMENTS: [f64; 3] = [0.32, 0.25, 0.09];

/// A tip nearer than this to its target is there, metres.
pub const NEAR: f32 = 2e-3;

/// Getting nearer by less than this, metres, or by less than the pace lets the arm's length go in so many ticks...
const PROGRESS: f32 = 5e-4;
const PROGRESS_TICKS: f32 = 4.0;
/// ...for so many ticks ends a motion...
const PATIENCE: u32 = RATE_HZ / 2;
/// ...and for so many halves its speed.
const FADE: f32 = RATE_HZ as f32 / 8.0;

/// A sigmoid that is half way later than this, seconds, is not waited for.
const LATEST: f32 = 20.0;

/// How a synergy makes the arm move.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// The stepper.
    pub stepper: AnyStepper<f32>,
    /// Its rate λ.
    pub rate: f32,
    /// The synergy, in ticks.
    pub synergy: Paced<f32, DOFS>,
    /// When the last sigmoid is half way, seconds: before that a motion may seem not to get nearer.
    pub delay: f32,
}

impl Style {
    /// With a synergy of a model and its parameters, in the paper's order.
    ///
    /// # Errors
    /// None that a period of the control loop gives.
    // Once in the flash: there are exponentials in it.
    #[inline(never)]
    pub fn new(
        stepper: AnyStepper<f32>,
        rate: f32,
        synergy: &Synergy<f32, DOFS>,
        model: Model,
        parameters: &[f32],
    ) -> Result<Self, Error> {
        let at = |k: usize| parameters.get(k).copied().unwrap_or(0.0);
        let middle = |offset: f32, slope: f32| if slope > 0.0 { offset / slope } else { 0.0 };
        let delay = match model {
            Model::A | Model::B => 0.0,
            Model::C => middle(at(DOFS), at(DOFS + 1)),
            Model::D => (0..DOFS).fold(0.0, |latest: f32, i| {
                latest.most(middle(at(DOFS + i), at(2 * DOFS + i)))
            }),
        };
        Ok(Style {
            stepper,
            rate,
            synergy: synergy.paced(PERIOD)?,
            delay: delay.least(LATEST),
        })
    }
}

/// The arm.
#[derive(Clone, Debug)]
pub struct Arm {
    chain: Chain<f32, DOFS>,
    /// No point farther from the base is within reach, metres.
    length: f32,
    /// Of a motion that no map plans.
    style: Style,
    planner: Option<Planner>,
    /// Of the motion that runs.
    now: Style,
    pace: Pace,
    mode: Mode,
    target: Option<Position<f32>>,
    /// How far the target was moved to be within the arm's length, metres.
    moved: f32,
    q: [f32; DOFS],
    /// The last tick's step.
    step: [f32; DOFS],
    /// Of the motion that runs, as far as it has come.
    motion: State<f32, DOFS>,
    /// The tip's distance to its target, metres, the least so far, and when that was.
    distance: f32,
    nearest: f32,
    nearest_at: u32,
}

impl Arm {
    /// The default arm, at rest, bare of a synergy.
    ///
    /// # Errors
    /// None: the numbers are valid.
    pub fn new(pace: Pace) -> Result<Self, Error> {
        let [upper_arm, forearm, hand] = SEGMENTS;
        let chain = human_arm(upper_arm, forearm, hand)?;
        let bare = Style {
            stepper: AnyStepper::Transpose(Transpose),
            rate: <Transpose as Stepper<f32>>::RATE as f32,
            synergy: Synergy::a(1.0)?.paced(PERIOD)?,
            delay: 0.0,
        };
        let motion = controller(&chain, &bare)?.start([0.0; DOFS]);
        let mut arm = Arm {
            length: length(&chain),
            chain,
            style: bare,
            planner: None,
            now: bare,
            pace,
            mode: Mode::Holding,
            target: None,
            moved: 0.0,
            q: [0.0; DOFS],
            step: [0.0; DOFS],
            motion,
            distance: 0.0,
            nearest: 0.0,
            nearest_at: 0,
        };
        arm.put([0.0; DOFS]);
        Ok(arm)
    }

    /// Says where the arm is: within its limits, at rest.
    pub fn put(&mut self, q: [f32; DOFS]) {
        for i in 0..DOFS {
            self.q[i] = q[i].within(self.chain.lower()[i], self.chain.upper()[i]);
        }
        self.step = [0.0; DOFS];
        self.mode = Mode::Holding;
    }

    /// Another chain.
    pub fn set_chain(&mut self, chain: Chain<f32, DOFS>) {
        self.length = length(&chain);
        self.chain = chain;
    }

    /// Whether a rate λ is one.
    ///
    /// # Errors
    /// What the controller refuses.
    pub fn check_rate(&self, rate: f32) -> Result<(), Error> {
        let style = Style { rate, ..self.style };
        controller(&self.chain, &style).map(|_| ())
    }

    /// Another synergy, of a [checked](Self::check_rate) rate.
    pub fn set_style(&mut self, style: Style) {
        self.style = style;
    }

    /// A map to plan with, or another one, of a [checked](Self::check_rate) rate.
    pub fn set_planner(&mut self, planner: Planner) {
        self.planner = Some(planner);
    }

    /// Other limits of speed and acceleration.
    pub fn set_pace(&mut self, pace: Pace) {
        self.pace = pace;
    }

    /// Begins a motion with the arm's synergy. In mid-motion it goes on from where the arm is and as fast as it is, and the
    /// synergy's sigmoids begin anew.
    ///
    /// # Errors
    /// A coordinate that is NaN or infinite; then nothing changes.
    pub fn go_to(&mut self, target: [f32; 3]) -> Result<(), Error> {
        let style = self.style;
        self.begin(&style, target)
    }

    /// The same with the synergy that the map gives for a reach in about `seconds`. How far to trust that, from 0 to 1;
    /// none, where there is no map.
    ///
    /// # Errors
    /// A number that is NaN or infinite, or a time that is not above 0; then nothing changes.
    pub fn reach(&mut self, target: [f32; 3], seconds: f32) -> Result<Option<f32>, Error> {
        let Some(planner) = &self.planner else {
            return Ok(None);
        };
        // To where it is asked for, as on a host: a target out of reach is moved only after that.
        let (style, confidence) = planner.plan(target, seconds)?;
        self.begin(&style, target)?;
        Ok(Some(confidence))
    }

    fn begin(&mut self, style: &Style, target: [f32; 3]) -> Result<(), Error> {
        let [x, y, z] = Position::new(target)?.coordinates();
        let (_, base) = self.chain.base();
        let from = [x - base[0], y - base[1], z - base[2]];
        let far = Real::sqrt(from[0] * from[0] + from[1] * from[1] + from[2] * from[2]);
        let scale = if far > self.length {
            self.length / far
        } else {
            1.0
        };
        let within = |i: usize| base[i] + scale * from[i];
        let target = Position::new([within(0), within(1), within(2)])?;
        self.motion = controller(&self.chain, style)?.start(self.q);
        self.target = Some(target);
        self.moved = (far - self.length).most(0.0);
        self.now = *style;
        self.mode = Mode::Moving;
        self.nearest = f32::MAX;
        self.nearest_at = 0;
        Ok(())
    }

    /// Brakes and keeps the posture.
    pub fn hold(&mut self) {
        self.mode = Mode::Holding;
        self.target = None;
        self.distance = 0.0;
    }

    /// Brakes, and lets nothing but [`hold`](Self::hold) end it.
    pub fn stop(&mut self) {
        self.hold();
        self.mode = Mode::Stopped;
    }

    /// One period.
    pub fn tick(&mut self) {
        let next = self.wanted();
        let (lower, upper) = (self.chain.lower(), self.chain.upper());
        for i in 0..DOFS {
            let q = self.q[i];
            let want = next[i] - q;
            let step = self
                .pace
                .step(want, self.step[i], q - lower[i], upper[i] - q);
            let paced = if step == want { next[i] } else { q + step };
            // Of an arm that was put outside new limits only the way back is left.
            let within = paced.within(lower[i].least(q), upper[i].most(q));
            // The step as meant, not as rounded: at a low speed an angle's last bit is much of a step.
            self.step[i] = if within == paced { step } else { within - q };
            self.q[i] = within;
        }
    }

    /// The posture after a tick without limits of speed and acceleration.
    fn wanted(&mut self) -> [f32; DOFS] {
        let (Mode::Moving, Some(target)) = (self.mode, self.target) else {
            return self.q;
        };
        let Ok(controller) = controller(&self.chain, &self.now) else {
            return self.q;
        };
        controller.place(&mut self.motion, self.q);
        let at = self.chain.forward(self.motion.angles());
        controller.advance(&mut self.motion, &at, &target);
        let next = *self.motion.angles();
        let (tip, columns) = (at.tip(), at.columns());
        self.look(tip, target.coordinates());
        let share = self.share(&next, &columns);
        if share < 1.0 {
            return core::array::from_fn(|i| self.q[i] + share * (next[i] - self.q[i]));
        }
        next
    }

    /// How much of the way to `next` the pace leaves: what of it brings the tip to rest at the target, at the latest.
    fn share(&self, next: &[f32; DOFS], columns: &[[f32; 3]; DOFS]) -> f32 {
        let mut longest = 0.0;
        let mut tip = [0.0; 3];
        for i in 0..DOFS {
            let step = next[i] - self.q[i];
            longest = Real::abs(step).most(longest);
            for r in 0..3 {
                tip[r] += columns[i][r] * step;
            }
        }
        // At this direction and speed the target is `distance / tip` steps away.
        let tip = Real::sqrt(tip[0] * tip[0] + tip[1] * tip[1] + tip[2] * tip[2]);
        let room = longest * self.distance / tip.most(1e-12);
        // The longer it gets no nearer, the slower: a stepper that swings about the nearest reach comes to rest there.
        let stalled = (self.motion.ticks() - self.nearest_at) as f32 / FADE;
        self.pace.share(longest, room) / (1.0 + stalled * stalled)
    }

    /// Whether the tip still gets nearer; ends the motion where it does not.
    fn look(&mut self, tip: [f32; 3], target: [f32; 3]) {
        let [x, y, z] = [tip[0] - target[0], tip[1] - target[1], tip[2] - target[2]];
        self.distance = Real::sqrt(x * x + y * y + z * z);
        // Once it is there nothing is waited for.
        let waits = self.motion.ticks() as f32 * PERIOD <= self.now.delay && self.distance > NEAR;
        let progress = PROGRESS.least(self.length * self.pace.most() * PROGRESS_TICKS);
        if waits || self.distance < self.nearest - progress {
            self.nearest = self.distance;
            self.nearest_at = self.motion.ticks();
        } else if self.motion.ticks() - self.nearest_at > PATIENCE {
            self.mode = Mode::Holding;
        }
    }

    /// What it does.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether nothing moves, and nothing is about to.
    pub fn is_at_rest(&self) -> bool {
        self.mode != Mode::Moving && self.step == [0.0; DOFS]
    }

    /// Whether the motion ended without reaching its target.
    pub fn is_short(&self) -> bool {
        self.mode == Mode::Holding && self.target.is_some() && self.distance + self.moved > NEAR
    }

    /// The joint vector, rad (or m).
    pub fn angles(&self) -> &[f32; DOFS] {
        &self.q
    }

    /// The chain.
    pub fn chain(&self) -> &Chain<f32, DOFS> {
        &self.chain
    }

    /// The tip, metres in the base frame.
    pub fn tip(&self) -> [f32; 3] {
        self.chain.forward(&self.q).tip()
    }

    /// How far the tip is from its target, metres; 0 where there is none.
    pub fn distance(&self) -> f32 {
        self.distance
    }

    /// Ticks since the motion began.
    pub fn ticks(&self) -> u32 {
        self.motion.ticks()
    }
}

/// The core's controller for this arm.
#[inline(always)]
fn controller<'a>(
    chain: &'a Chain<f32, DOFS>,
    style: &Style,
) -> Result<Controller<'a, f32, AnyStepper<f32>, DOFS>, Error> {
    Controller::paced(
        chain,
        style.stepper,
        style.synergy,
        style.rate,
        Limits::Clamped,
    )
}

/// The sum of a chain's offsets and slides, metres: its tip is never farther from its base.
fn length(chain: &Chain<f32, DOFS>) -> f32 {
    let long = |shift: &Shift<f32>| match *shift {
        Shift::None => 0.0,
        Shift::Along(_, by) => Real::abs(by),
        Shift::General([x, y, z]) => Real::sqrt(x * x + y * y + z * z),
    };
    let mut sum = long(&chain.tip_transform().1);
    for (i, link) in chain.links().iter().enumerate() {
        sum += long(&link.shift);
        if link.kind == Kind::Prismatic {
            sum += Real::abs(chain.lower()[i]).most(Real::abs(chain.upper()[i]));
        }
    }
    sum
}
