//! The controller as the line sees it: requests in, replies out, and a watchdog for when nothing comes.

use embedded_storage::nor_flash::NorFlash;
use sinew::Error;
use sinew::chain::Chain;
use sinew_protocol::{
    DOFS, Envelope, Faults, FrameError, Limits, Mode, Reason, Receiver, Refusal, Reply, Report,
    Request, Settings, encode,
};

use crate::arm::{Arm, Style};
use crate::pace::Pace;
use crate::planner::Planner;
use crate::store::Store;
use crate::{RATE_HZ, convert};

/// The arm, its line and its settings.
pub struct Node<F> {
    arm: Arm,
    store: Store<F>,
    receiver: Receiver,
    /// The last accepted sequence number.
    sequence: u32,
    /// Ticks since a valid frame, and how many hold a motion.
    silent: u32,
    silence: u32,
    faults: Faults,
    cost: u32,
    worst_cost: u32,
}

/// What settings say, as the arm takes it; none: as it is.
struct Checked {
    chain: Option<Chain<f32, DOFS>>,
    style: Option<Style>,
    planner: Option<Planner>,
    limits: Limits,
}

impl<F: NorFlash> Node<F> {
    /// With what the store holds, or the defaults.
    ///
    /// # Errors
    /// None: the defaults are valid.
    pub fn new(store: Store<F>) -> Result<Self, Error> {
        let limits = Limits::DEFAULT;
        let arm = Arm::new(pace(&limits))?;
        let mut node = Node {
            arm,
            store,
            receiver: Receiver::new(),
            sequence: 0,
            silent: 0,
            silence: ticks(limits.silence_ms),
            faults: Faults::default(),
            cost: 0,
            worst_cost: 0,
        };
        node.restore();
        Ok(node)
    }

    /// Takes what the store holds.
    // Inlined into `main`, what it needs of the stack would never be free again.
    #[inline(never)]
    fn restore(&mut self) {
        match self.store.load().map(|settings| self.check(&settings)) {
            Some(Ok(checked)) => {
                self.take(checked);
                // The chain's own limits may leave out where the default arm hangs.
                self.arm.put(*self.arm.angles());
            }
            None if self.store.is_blank() => {}
            _ => self.faults.add(Faults::STORAGE),
        }
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Says where the arm is; for a board that can tell.
    pub fn put(&mut self, q: [f32; DOFS]) {
        self.arm.put(q);
    }

    /// One period.
    pub fn tick(&mut self) {
        self.silent = self.silent.saturating_add(1);
        if self.silent > self.silence && self.arm.mode() == Mode::Moving {
            self.arm.hold();
            self.faults.add(Faults::SILENT);
        }
        self.arm.tick();
    }

    /// What the tick took of its `period`, in the board's clock.
    pub fn spent(&mut self, cost: u32, period: u32) {
        self.cost = cost;
        self.worst_cost = self.worst_cost.max(cost);
        if cost > period {
            self.faults.add(Faults::OVERRUN);
        }
    }

    /// One byte from the line; the frame to answer with, if it ended one.
    pub fn receive<'b>(&mut self, byte: u8, reply: &'b mut [u8]) -> Option<&'b [u8]> {
        let (sequence, body) = match self.receiver.take(byte)? {
            Err(FrameError::Garbled) => (0, Reply::Refused(Refusal::Garbled)),
            Err(FrameError::TooLong) => (0, Reply::Refused(Refusal::TooLong)),
            Ok(Envelope { sequence, body }) => (sequence, self.answer(sequence, &body)),
        };
        encode(&Envelope { sequence, body }, reply)
            .ok()
            .map(|frame| &*frame)
    }

    fn answer(&mut self, sequence: u32, request: &Request) -> Reply {
        // Numbers wrap: one that is less than half of all of them ahead is a later one, so that none is the last.
        if !(1..1 << 31).contains(&sequence.wrapping_sub(self.sequence)) {
            return Reply::Refused(Refusal::Replayed(self.sequence));
        }
        self.sequence = sequence;
        self.silent = 0;
        match self.carry_out(request) {
            Ok(reply) => reply,
            Err(refusal) => Reply::Refused(refusal),
        }
    }

    fn carry_out(&mut self, request: &Request) -> Result<Reply, Refusal> {
        match request {
            Request::Report => return Ok(Reply::Report(self.report())),
            Request::Hold => self.arm.hold(),
            Request::Stop => self.arm.stop(),
            Request::GoTo(target) => {
                if self.arm.mode() == Mode::Stopped {
                    return Err(Refusal::Stopped);
                }
                self.arm.go_to(*target).map_err(convert::refusal)?;
                self.faults.remove(Faults::SILENT);
            }
            Request::Reach { target, seconds } => {
                if self.arm.mode() == Mode::Stopped {
                    return Err(Refusal::Stopped);
                }
                let confidence = self.arm.reach(*target, *seconds);
                let confidence = confidence.map_err(convert::refusal)?;
                let confidence = confidence.ok_or(Refusal::NoMap)?;
                self.faults.remove(Faults::SILENT);
                return Ok(Reply::Reaching(confidence));
            }
            Request::LoadSynergy(synergy) => {
                self.change(&|settings| settings.synergy = Some(synergy.clone()))?;
            }
            Request::LoadChain(chain) => {
                self.change(&|settings| settings.chain = Some(chain.clone()))?;
            }
            Request::LoadMap(map) => self.change(&|settings| settings.map = Some(map.clone()))?,
            Request::SetLimits(limits) => self.change(&|settings| settings.limits = *limits)?,
        }
        Ok(Reply::Done)
    }

    /// Changes the settings: in the store first, so that what moves the arm is what a reset brings back.
    fn change(&mut self, edit: &dyn Fn(&mut Settings)) -> Result<(), Refusal> {
        if !self.arm.is_at_rest() {
            return Err(Refusal::Moving);
        }
        // What is stored and not valid is not what moves the arm: it is not kept either.
        let stored = self.store.load();
        let mut settings = stored
            .filter(|settings| self.check(settings).is_ok())
            .unwrap_or_default();
        edit(&mut settings);
        let checked = self.check(&settings)?;
        self.store.save(&settings).map_err(|_| Refusal::Storage)?;
        self.faults.remove(Faults::STORAGE);
        self.take(checked);
        Ok(())
    }

    /// Everything that settings say, made and checked: nothing changes yet.
    fn check(&self, settings: &Settings) -> Result<Checked, Refusal> {
        let Limits {
            speed,
            acceleration,
            silence_ms,
        } = settings.limits;
        // NaN is in no range.
        let valid = (1e-3..=100.0).contains(&speed)
            && (1e-2..=1e4).contains(&acceleration)
            && silence_ms >= 10;
        if !valid {
            return Err(Refusal::Invalid {
                reason: Reason::OutOfRange,
                joint: None,
            });
        }
        self.checked(settings).map_err(convert::refusal)
    }

    fn checked(&self, settings: &Settings) -> Result<Checked, Error> {
        let checked = Checked {
            chain: settings.chain.as_ref().map(convert::chain).transpose()?,
            style: settings.synergy.as_ref().map(convert::style).transpose()?,
            planner: settings.map.as_ref().map(convert::planner).transpose()?,
            limits: settings.limits,
        };
        let rates = [
            checked.style.as_ref().map(|style| style.rate),
            checked.planner.as_ref().map(|planner| planner.rate),
        ];
        for rate in rates.into_iter().flatten() {
            self.arm.check_rate(rate)?;
        }
        Ok(checked)
    }

    /// Into the arm.
    fn take(&mut self, checked: Checked) {
        let Checked {
            chain,
            style,
            planner,
            limits,
        } = checked;
        if let Some(chain) = chain {
            self.arm.set_chain(chain);
        }
        if let Some(style) = style {
            self.arm.set_style(style);
        }
        if let Some(planner) = planner {
            self.arm.set_planner(planner);
        }
        self.arm.set_pace(pace(&limits));
        self.silence = ticks(limits.silence_ms);
    }

    fn report(&mut self) -> Report {
        let mut faults = self.faults;
        self.faults.remove(Faults::OVERRUN);
        if self.arm.is_short() {
            faults.add(Faults::SHORT);
        }
        Report {
            mode: self.arm.mode(),
            faults,
            ticks: self.arm.ticks(),
            angles: *self.arm.angles(),
            tip: self.arm.tip(),
            distance: self.arm.distance(),
            cost: self.cost,
            worst_cost: core::mem::take(&mut self.worst_cost),
        }
    }
}

fn pace(limits: &Limits) -> Pace {
    Pace::new(limits.speed, limits.acceleration)
}

fn ticks(milliseconds: u32) -> u32 {
    milliseconds.saturating_mul(RATE_HZ / 1000)
}
