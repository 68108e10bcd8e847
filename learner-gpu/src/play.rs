//! Plays a reach on the arm controller over its line: a serial device, or a TCP port (QEMU's UART).

use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use sinew_protocol::{
    DOFS, Envelope, Faults, MOST_FRAME, Mode, Receiver, Refusal, Reply, Report, Request, encode,
};

/// How long a reply may take: a flash sector takes two seconds to erase.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long to one that takes no flash: before the controller finds the line silent, there is time to ask again.
const SHORT_PATIENCE: Duration = Duration::from_millis(150);

/// From one report to the next.
const PAUSE: Duration = Duration::from_millis(20);

/// How long a motion may take.
const LONGEST: Duration = Duration::from_secs(60);

/// Why a reach could not be played.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlayError {
    /// The port cannot be opened, or failed.
    #[error("the port: {0}")]
    Port(#[from] io::Error),
    /// Nothing came back in time, nor when asked again.
    #[error("the controller does not answer")]
    Silent,
    /// A request was refused.
    #[error("the controller refused: {0:?}")]
    Refused(Refusal),
    /// A reply that does not belong to the request.
    #[error("the controller answered with something else: {0:?}")]
    Unexpected(Box<Reply>),
    /// A request that is no frame.
    #[error("a request does not fit a frame")]
    TooLong,
    /// Told to by the one who plays: the arm holds.
    #[error("stopped, and the arm holds")]
    Stopped,
    /// The arm does not come to rest.
    #[error("the arm is not at rest after {} s", LONGEST.as_secs())]
    Endless,
}

/// The line to a controller.
pub struct Port {
    out: Box<dyn Write>,
    replies: mpsc::Receiver<Envelope<Reply>>,
    sequence: u32,
}

impl Port {
    /// Opens `PATH`, a serial device, or `HOST:PORT`.
    ///
    /// # Errors
    /// What the system says: nothing there, nobody listening, no serial device.
    pub fn open(name: &str) -> io::Result<Self> {
        if name.contains(':') && !name.starts_with('/') {
            let stream = connect(name)?;
            stream.set_nodelay(true)?;
            return Ok(Self::new(stream.try_clone()?, stream));
        }
        let device = OpenOptions::new().read(true).write(true).open(name)?;
        set_up(&device)?;
        Ok(Self::new(device.try_clone()?, device))
    }

    /// On any two ends.
    pub fn new(back: impl Read + Send + 'static, out: impl Write + 'static) -> Self {
        let (sender, replies) = mpsc::channel();
        thread::spawn(move || {
            let mut receiver = Receiver::new();
            for byte in io::BufReader::new(back).bytes().map_while(Result::ok) {
                if let Some(Ok(reply)) = receiver.take(byte)
                    && sender.send(reply).is_err()
                {
                    break;
                }
            }
        });
        Port {
            out: Box::new(out),
            replies,
            sequence: 0,
        }
    }

    /// A request's reply. The controller may have a higher number, from an earlier host or from a request whose reply was
    /// lost: then this one goes on from it. So a request whose reply was lost is carried out twice, one that was lost itself
    /// once.
    ///
    /// # Errors
    /// A refusal; silence; the port's.
    pub fn ask(&mut self, request: &Request) -> Result<Reply, PlayError> {
        match self.once(request)? {
            Reply::Refused(Refusal::Replayed(last)) => {
                self.sequence = last;
                match self.once(request)? {
                    Reply::Refused(refusal) => Err(PlayError::Refused(refusal)),
                    reply => Ok(reply),
                }
            }
            Reply::Refused(refusal) => Err(PlayError::Refused(refusal)),
            reply => Ok(reply),
        }
    }

    fn once(&mut self, request: &Request) -> Result<Reply, PlayError> {
        self.sequence = self.sequence.wrapping_add(1);
        let message = Envelope {
            sequence: self.sequence,
            body: request.clone(),
        };
        let mut buffer = [0; MOST_FRAME];
        let frame = encode(&message, &mut buffer).map_err(|_| PlayError::TooLong)?;
        let patience = match request {
            Request::LoadChain(_)
            | Request::LoadMap(_)
            | Request::LoadSynergy(_)
            | Request::SetLimits(_) => PATIENCE,
            _ => SHORT_PATIENCE,
        };
        let last = PATIENCE.max(2 * patience);
        let began = Instant::now();
        // A line without flow control loses bytes. Under the same number the request is carried out once.
        while began.elapsed() < last {
            // A zero first ends whatever noise came before.
            self.out.write_all(&[0])?;
            self.out.write_all(frame)?;
            self.out.flush()?;
            if let Some(reply) = self.reply(patience)? {
                return Ok(reply);
            }
        }
        Err(PlayError::Silent)
    }

    /// The reply to the request sent last; none where that was lost on its way, as far as this much patience tells.
    fn reply(&self, patience: Duration) -> Result<Option<Reply>, PlayError> {
        let until = Instant::now() + patience;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.replies.recv_timeout(left) {
                Ok(reply) if reply.sequence == self.sequence => return Ok(Some(reply.body)),
                // What was garbled has no number: the request, or noise before it.
                Ok(Envelope {
                    sequence: 0,
                    body: Reply::Refused(Refusal::Garbled | Refusal::TooLong),
                }) => {
                    thread::sleep(PAUSE);
                    return Ok(None);
                }
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(RecvTimeoutError::Disconnected) => return Err(PlayError::Silent),
            }
        }
    }

    /// How the arm is.
    ///
    /// # Errors
    /// As [`Port::ask`].
    pub fn report(&mut self) -> Result<Report, PlayError> {
        match self.ask(&Request::Report)? {
            Reply::Report(report) if is_finite(&report) => Ok(report),
            other => Err(PlayError::Unexpected(Box::new(other))),
        }
    }

    /// A request that is only possible at rest: asked again while the arm brakes.
    fn at_rest(&mut self, request: &Request) -> Result<Reply, PlayError> {
        let began = Instant::now();
        loop {
            match self.ask(request) {
                Err(PlayError::Refused(Refusal::Moving)) if began.elapsed() < PATIENCE => {
                    thread::sleep(PAUSE);
                }
                outcome => return outcome,
            }
        }
    }

    /// Loads what is given and begins a motion to `target` (metres): with the synergy that is loaded, or, where it is
    /// told how many seconds the reach is to take, with one of the map's, and then how far that is to be trusted. The
    /// controller's limits stay as they are.
    ///
    /// # Errors
    /// As [`Port::ask`].
    pub fn begin(
        &mut self,
        load: &[Request],
        target: [f32; 3],
        seconds: Option<f32>,
    ) -> Result<Option<f32>, PlayError> {
        self.ask(&Request::Hold)?;
        for request in load {
            self.at_rest(request)?;
        }
        // Faults from before are not this motion's.
        self.report()?;
        let request = match seconds {
            Some(seconds) => Request::Reach { target, seconds },
            None => Request::GoTo(target),
        };
        match self.ask(&request)? {
            Reply::Done => Ok(None),
            Reply::Reaching(confidence) => Ok(Some(confidence)),
            other => Err(PlayError::Unexpected(Box::new(other))),
        }
    }

    /// Tells `each` report until the arm is at rest: the last one. Holds it where `stop` was set meanwhile.
    ///
    /// # Errors
    /// As [`Port::ask`]; or an arm that does not come to rest, or was to hold.
    pub fn watch(
        &mut self,
        stop: &AtomicBool,
        mut each: impl FnMut(&Report),
    ) -> Result<Report, PlayError> {
        let began = Instant::now();
        while began.elapsed() < LONGEST {
            if stop.load(Ordering::Relaxed) {
                self.ask(&Request::Hold)?;
                return Err(PlayError::Stopped);
            }
            let report = self.report()?;
            each(&report);
            if report.mode != Mode::Moving {
                return Ok(report);
            }
            thread::sleep(PAUSE);
        }
        Err(PlayError::Endless)
    }
}

/// Whether a report has no number that is none.
fn is_finite(report: &Report) -> bool {
    let numbers = report.angles.iter().chain(&report.tip);
    numbers.chain([&report.distance]).all(|x| x.is_finite())
}

/// To the first address of `HOST:PORT` that answers.
fn connect(name: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "no such host");
    for address in name.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// Bytes as they are, at the firmware's 115,200 baud.
#[cfg(unix)]
fn set_up(device: &File) -> io::Result<()> {
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
    let mut line = tcgetattr(device)?;
    line.make_raw();
    line.set_speed(115_200)?;
    Ok(tcsetattr(device, OptionalActions::Flush, &line)?)
}

/// As the system has set it up (`mode COM3 BAUD=115200`).
#[cfg(not(unix))]
fn set_up(_: &File) -> io::Result<()> {
    Ok(())
}

/// The names of faults, with commas between.
pub fn faults(faults: Faults) -> String {
    let names = [
        (Faults::SILENT, "the line was silent"),
        (Faults::SHORT, "the hand is short of its target"),
        (Faults::OVERRUN, "a tick overran"),
        (Faults::STORAGE, "stored settings were not valid"),
    ];
    let names = names
        .into_iter()
        .filter_map(|(fault, name)| faults.has(fault).then_some(name));
    names.collect::<Vec<_>>().join(", ")
}

/// Telemetry as CSV: ticks since the motion began, the mode, the angles (rad), the tip and its distance to the target
/// (m), what the last tick took and the most since the line before (the controller's clock), faults as a set of bits.
pub fn csv(reports: &[Report]) -> String {
    let mut text = String::from("ticks,mode,");
    for i in 1..=DOFS {
        let _ = write!(text, "q{i},");
    }
    text.push_str("x,y,z,distance,cost,worst_cost,faults\n");
    for report in reports {
        let mode = match report.mode {
            Mode::Holding => "holding",
            Mode::Moving => "moving",
            Mode::Stopped => "stopped",
        };
        let _ = write!(text, "{},{mode}", report.ticks);
        for x in report.angles.iter().chain(&report.tip) {
            let _ = write!(text, ",{x}");
        }
        let Report {
            distance,
            cost,
            worst_cost,
            faults: Faults(bits),
            ..
        } = report;
        let _ = writeln!(text, ",{distance},{cost},{worst_cost},{bits}");
    }
    text
}
