//! Talks to the firmware over QEMU's serial line, as a host does: `line FIRMWARE`. Prints the telemetry of a reach.

#[cfg(target_os = "none")]
compile_error!("this one runs on a host");

use std::error::Error;
use std::io::{BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver as Inbox, channel};
use std::thread;
use std::time::Duration;

use sinew_protocol::{
    Envelope, MOST_FRAME, Mode, Receiver, Refusal, Reply, Report, Request, encode,
};

type Failure = Box<dyn Error>;

/// QEMU, and its serial line.
struct Chip {
    process: Child,
    out: ChildStdin,
    replies: Inbox<Envelope<Reply>>,
    sequence: u32,
}

impl Chip {
    fn start(firmware: &str) -> Result<Self, Failure> {
        let mut process = Command::new("qemu-system-arm")
            .args([
                "-machine",
                "mps2-an386",
                "-display",
                "none",
                "-monitor",
                "none",
                "-serial",
                "stdio",
            ])
            .args(["-kernel", firmware])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let out = process.stdin.take().ok_or("no way in")?;
        let back = process.stdout.take().ok_or("no way out")?;
        let (sender, replies) = channel();
        thread::spawn(move || {
            let mut receiver = Receiver::new();
            for byte in BufReader::new(back).bytes().map_while(Result::ok) {
                if let Some(Ok(reply)) = receiver.take(byte)
                    && sender.send(reply).is_err()
                {
                    break;
                }
            }
        });
        Ok(Chip {
            process,
            out,
            replies,
            sequence: 0,
        })
    }

    fn send(&mut self, bytes: &[u8]) -> Result<Reply, Failure> {
        self.out.write_all(bytes)?;
        self.out.flush()?;
        Ok(self.replies.recv_timeout(Duration::from_secs(10))?.body)
    }

    fn ask(&mut self, body: Request) -> Result<Reply, Failure> {
        self.sequence += 1;
        let mut buffer = [0; MOST_FRAME];
        let request = Envelope {
            sequence: self.sequence,
            body,
        };
        let frame = encode(&request, &mut buffer).map_err(|e| format!("{e:?}"))?;
        self.send(frame)
    }

    fn report(&mut self) -> Result<Report, Failure> {
        match self.ask(Request::Report)? {
            Reply::Report(report) => Ok(report),
            other => Err(format!("no report: {other:?}").into()),
        }
    }
}

impl Drop for Chip {
    fn drop(&mut self) {
        // It is gone already, or it goes now.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn main() -> Result<(), Failure> {
    let firmware = std::env::args().nth(1).ok_or("which firmware?")?;
    let mut chip = Chip::start(&firmware)?;
    let first = chip.report()?;
    println!("at rest at {:.3?}", first.tip);
    match chip.send(&[1, 2, 3, 4, 0])? {
        Reply::Refused(Refusal::Garbled) => println!("noise is refused"),
        other => return Err(format!("noise: {other:?}").into()),
    }
    match chip.ask(Request::GoTo([-0.1, 0.42, -0.05]))? {
        Reply::Done => {}
        other => return Err(format!("{other:?}").into()),
    }
    for _ in 0..200 {
        thread::sleep(Duration::from_millis(50));
        let report = chip.report()?;
        println!(
            "{:5} ms  tip {:.3?}  {:.3} m left  {:?}",
            report.ticks, report.tip, report.distance, report.mode
        );
        if report.mode == Mode::Holding {
            return if report.distance < 2e-3 {
                Ok(())
            } else {
                Err("it fell short".into())
            };
        }
    }
    Err("it never came to rest".into())
}
