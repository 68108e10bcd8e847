//! The controller as the line sees it: requests in, replies out, and a watchdog for when nothing comes.

use embedded_storage::nor_flash::NorFlash;
use sinew::Error;
use sinew_protocol::{
    Envelope, Faults, FrameError, Limits, Mode, Reason, Receiver, Refusal, Reply, Report, Request,
    Settings, encode,
};

use crate::arm::Arm;
use crate::pace::Pace;
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

impl<F: NorFlash> Node<F> {
    /// With what the store holds, or the defaults.
    ///
    /// # Errors
    /// None: the defaults are valid.
    pub fn new(mut store: Store<F>) -> Result<Self, Error> {
        let limits = Limits::DEFAULT;
        let arm = Arm::new(pace(&limits))?;
        let saved = store.load();
        let lost = saved.is_none() && !store.is_blank();
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
        if lost || saved.is_some_and(|settings| node.apply(&settings).is_err()) {
            node.faults.add(Faults::STORAGE);
        }
        Ok(node)
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Says where the arm is; for a board that can tell.
    pub fn put(&mut self, q: [f32; sinew_protocol::DOFS]) {
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
        if sequence <= self.sequence {
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
            }
            Request::LoadSynergy(synergy) => {
                self.change(|settings| settings.synergy = Some(synergy.clone()))?;
            }
            Request::LoadChain(chain) => {
                self.change(|settings| settings.chain = Some(chain.clone()))?;
            }
            Request::SetLimits(limits) => self.change(|settings| settings.limits = *limits)?,
        }
        Ok(Reply::Done)
    }

    /// Changes the settings: in the store first, so that what moves the arm is what a reset brings back.
    fn change(&mut self, edit: impl FnOnce(&mut Settings)) -> Result<(), Refusal> {
        if !self.arm.is_at_rest() {
            return Err(Refusal::Moving);
        }
        let mut settings = self.store.load().unwrap_or_default();
        edit(&mut settings);
        // Tried on a copy: what is refused changes nothing.
        let before = self.arm.clone();
        self.apply(&settings)?;
        if self.store.save(settings).is_err() {
            self.arm = before;
            return Err(Refusal::Storage);
        }
        Ok(())
    }

    /// Settings into the arm, all of them or none.
    fn apply(&mut self, settings: &Settings) -> Result<(), Refusal> {
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
        let chain = settings
            .chain
            .as_ref()
            .map(convert::chain)
            .transpose()
            .map_err(convert::refusal)?;
        if let Some(synergy) = &settings.synergy {
            let style = convert::style(synergy).map_err(convert::refusal)?;
            self.arm.set_style(style).map_err(convert::refusal)?;
        }
        if let Some(chain) = chain {
            self.arm.set_chain(chain);
        }
        self.arm.set_pace(pace(&settings.limits));
        self.silence = ticks(silence_ms);
        Ok(())
    }

    fn report(&mut self) -> Report {
        let mut faults = core::mem::take(&mut self.faults);
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
