//! Plays a reach on the arm controller over its line: a serial device, or a TCP port (QEMU's UART).

use std::fs::OpenOptions;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use sinew_protocol::{
    Envelope, MOST_FRAME, Mode, Receiver, Refusal, Reply, Report, Request, encode,
};

/// How long a reply may take: a flash sector takes two seconds to erase.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long a motion may take.
const LONGEST: Duration = Duration::from_secs(60);

/// Why a reach could not be played.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlayError {
    /// The port cannot be opened, or failed.
    #[error("the port: {0}")]
    Port(#[from] io::Error),
    /// Nothing came back in time.
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
    /// Opens `PATH`, a serial device that is set up already (`stty -F PATH 115200 raw -echo`), or `HOST:PORT`.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(name: &str) -> Result<Self, PlayError> {
        if name.contains(':') && !name.starts_with('/') {
            let stream = TcpStream::connect(name)?;
            stream.set_nodelay(true)?;
            return Ok(Self::new(stream.try_clone()?, stream));
        }
        let device = OpenOptions::new().read(true).write(true).open(name)?;
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

    /// A request's reply. The controller may have a higher number from an earlier host: then this one goes on from it.
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
        self.sequence = self.sequence.saturating_add(1);
        let message = Envelope {
            sequence: self.sequence,
            body: request.clone(),
        };
        let mut buffer = [0; MOST_FRAME];
        let frame = encode(&message, &mut buffer).map_err(|_| PlayError::TooLong)?;
        // A zero first ends whatever noise came before.
        self.out.write_all(&[0])?;
        self.out.write_all(frame)?;
        self.out.flush()?;
        loop {
            match self.replies.recv_timeout(PATIENCE) {
                // A reply to noise has no number.
                Ok(reply) if reply.sequence == self.sequence => return Ok(reply.body),
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    return Err(PlayError::Silent);
                }
            }
        }
    }

    /// How the arm is.
    ///
    /// # Errors
    /// As [`Port::ask`].
    pub fn report(&mut self) -> Result<Report, PlayError> {
        match self.ask(&Request::Report)? {
            Reply::Report(report) => Ok(report),
            other => Err(PlayError::Unexpected(Box::new(other))),
        }
    }

    /// Loads what is given, goes to `target` (metres) and tells `each` report until the arm is at rest: the last one.
    ///
    /// # Errors
    /// As [`Port::ask`]; or an arm that does not come to rest.
    pub fn play(
        &mut self,
        load: &sinew_protocol::Settings,
        target: [f32; 3],
        mut each: impl FnMut(&Report),
    ) -> Result<Report, PlayError> {
        self.ask(&Request::Hold)?;
        let began = Instant::now();
        if let Some(chain) = &load.chain {
            self.ask(&Request::LoadChain(chain.clone()))?;
        }
        if let Some(synergy) = &load.synergy {
            self.ask(&Request::LoadSynergy(synergy.clone()))?;
        }
        self.ask(&Request::GoTo(target))?;
        while began.elapsed() < LONGEST {
            let report = self.report()?;
            each(&report);
            if report.mode != Mode::Moving {
                return Ok(report);
            }
            thread::sleep(Duration::from_millis(20));
        }
        Err(PlayError::Endless)
    }
}
