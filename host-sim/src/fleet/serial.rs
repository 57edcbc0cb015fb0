//! Real boards on serial ports, in real time: hardware in the loop.
//!
//! The board's bus goes over a UART. Steps are begun on the grid of real time, and a step whose answer is not
//! there 20 ms later has missed its deadline: the flight waits for it, since the world is simulated and can, and
//! the miss is counted and shown. So results are those of every other backend, to the bit, however slow or
//! damaged the link is; how punctual the board was stands beside them.

use super::{
    Board, BoardError, BoardFault, BoardFigures, BoardReport,
    bus::{BusClient, LinkKind, Transport},
};
use serial2::SerialPort;
use skyroost_firmware::{
    STEP_US,
    board::bus::Report,
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{key::Key, units::TimePs};
use std::{
    io,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, Sender, channel},
    },
    time::{Duration, Instant},
};

/// Bits a second on the wire; the image's UART has the same.
pub const BAUD: u32 = 921_600;
/// A request without an answer for this long is sent again: more than a good exchange takes (the worst step 6 ms,
/// the wire some 11 us a byte), and little enough for a second one within the step's 20 ms. One that comes too
/// early costs its bytes and nothing else.
const RESEND_AFTER: Duration = Duration::from_millis(10);
/// Bytes of the radio in a message: short, as every damaged byte costs a whole message.
const RADIO_PART: u8 = 48;
/// Parts of a step that may be on their way at once: where one byte in a hundred is damaged, about two in a row
/// arrive.
const WINDOW: usize = 6;
/// Time from one step to the next.
const PERIOD: Duration = Duration::from_micros(STEP_US as u64);

/// Opens boards, one port after the other.
pub(crate) struct Ports {
    ports: Vec<PathBuf>,
    pace: Arc<Pace>,
}

impl Ports {
    pub(super) fn new(ports: &[PathBuf]) -> Self {
        Self { ports: ports.to_vec(), pace: Arc::new(Pace::default()) }
    }

    /// Starts the board of a drone: drone 1 is at the first port.
    pub(crate) fn start(&self, config: AgentConfig, key: Option<Key>) -> Result<SerialBoard, BoardError> {
        let drone = config.id.0;
        let path = &self.ports[usize::from(drone) - 1];
        let failed = |fault| BoardError { drone, port: Some(path.clone()), fault, log: Vec::new() };
        let port = open(path).map_err(|error| failed(BoardFault::NotStarted(error.to_string())))?;
        let link = LinkKind { resend_after: Some(RESEND_AFTER), radio_part: RADIO_PART, window: WINDOW };
        let mut bus = BusClient::new(Wire { port, timeout: Duration::ZERO }, link);
        bus.begin(&config, key).map_err(failed)?;
        let speaker = Speaker { bus, punctuality: Punctuality::default() };
        let (jobs, to_do) = channel();
        let (done, answers) = channel();
        std::thread::Builder::new()
            .name(format!("drone {drone}"))
            .spawn(move || speaker.run(&to_do, &done))
            .map_err(|error| failed(BoardFault::NotStarted(format!("no thread for it: {error}"))))?;
        let pace = Arc::clone(&self.pace);
        Ok(SerialBoard { drone, port: path.clone(), pace, jobs, answers })
    }
}

/// The first port that is there twice, be it by two names.
pub(super) fn first_repeated(ports: &[PathBuf]) -> Option<&PathBuf> {
    // A port that is not there has no other name; it is refused when it is opened.
    let devices: Vec<PathBuf> =
        ports.iter().map(|port| port.canonicalize().unwrap_or_else(|_| port.clone())).collect();
    (0..ports.len()).find(|&at| devices[..at].contains(&devices[at])).map(|at| &ports[at])
}

fn open(path: &Path) -> io::Result<SerialPort> {
    let mut port = SerialPort::open(path, BAUD)?;
    port.set_write_timeout(PERIOD)?;
    // What a board said before is not for this flight.
    port.discard_buffers()?;
    Ok(port)
}

/// A serial port as a transport of the bus.
struct Wire {
    port: SerialPort,
    timeout: Duration,
}

impl Transport for Wire {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self.port.write_all(bytes) {
            // A port that takes no more has nobody behind it: the silence that follows will be noticed.
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(()),
            result => result.map_err(unplugged),
        }
    }

    fn receive(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if timeout != self.timeout {
            self.port.set_read_timeout(timeout)?;
            self.timeout = timeout;
        }
        match self.port.read(bytes) {
            Ok(0) => Err(io::Error::new(io::ErrorKind::NotConnected, GONE)),
            Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => {
                Ok(0)
            }
            result => result.map_err(unplugged),
        }
    }
}

const GONE: &str = "the port is gone; has it been unplugged?";

/// Says what the system means when a device is taken away.
fn unplugged(error: io::Error) -> io::Error {
    use rustix::io::Errno;
    match Errno::from_io_error(&error) {
        Some(Errno::IO | Errno::NXIO | Errno::NODEV) => io::Error::new(io::ErrorKind::NotConnected, GONE),
        _ => error,
    }
}

/// Real time as all boards of a flight share it.
#[derive(Debug, Default)]
struct Pace {
    /// When simulated time was zero; moved on when the flight falls behind.
    zero: Mutex<Option<Instant>>,
}

impl Pace {
    /// Waits until it is `now` in real time, and returns when that was.
    fn wait_for(&self, now: TimePs) -> Instant {
        let since_zero = Duration::from_micros(u64::try_from(now.as_us()).unwrap_or(0));
        let due = {
            let mut zero = self.zero.lock().unwrap_or_else(PoisonError::into_inner);
            let present = Instant::now();
            let start = zero.get_or_insert_with(|| present.checked_sub(since_zero).unwrap_or(present));
            let behind = present.saturating_duration_since(*start + since_zero);
            if behind > PERIOD {
                // Nothing is gained by hurrying after lost time.
                *start += behind;
            }
            *start + since_zero
        };
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        due
    }
}

/// How punctual a board was.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Punctuality {
    /// Steps whose answer was not there at the end of their 20 ms.
    pub missed_deadlines: u32,
    /// Longest time from the beginning of a step to its answer, milliseconds.
    pub worst_answer_ms: f64,
    /// Frames that came damaged, either way.
    pub damaged: u64,
    /// Requests that had to be sent again.
    pub resent: u64,
}

/// One board on a serial port. A thread of its own speaks with it, so that what is damaged on the way to one board
/// keeps no other waiting.
pub struct SerialBoard {
    drone: u16,
    port: PathBuf,
    pace: Arc<Pace>,
    jobs: Sender<Job>,
    answers: Receiver<Result<Answer, BoardFault>>,
}

/// What is asked of a board.
enum Job {
    /// A step, due to begin at an instant.
    Step(TimePs, Box<Inputs>, Instant),
    /// A start from nothing.
    Restart(Box<AgentConfig>, Option<Key>),
    /// How it fared.
    Report,
}

/// What a board answers.
enum Answer {
    Stepped(Box<Outputs>),
    Restarted,
    Report(Box<BoardReport>),
}

/// The thread of a board.
struct Speaker {
    bus: BusClient<Wire>,
    punctuality: Punctuality,
}

impl Speaker {
    fn run(mut self, jobs: &Receiver<Job>, answers: &Sender<Result<Answer, BoardFault>>) {
        for job in jobs {
            let answer = match job {
                Job::Step(now, inputs, due) => self.step(now, &inputs, due),
                Job::Restart(config, key) => self.bus.begin(&config, key).map(|()| Answer::Restarted),
                Job::Report => self.report(),
            };
            let failed = answer.is_err();
            if answers.send(answer).is_err() || failed {
                return;
            }
        }
    }

    fn step(&mut self, now: TimePs, inputs: &Inputs, due: Instant) -> Result<Answer, BoardFault> {
        let mut outputs = Box::<Outputs>::default();
        self.bus.begin_step(now, inputs)?;
        self.bus.end_step(&mut outputs)?;
        let took = due.elapsed();
        let punctuality = &mut self.punctuality;
        punctuality.missed_deadlines += u32::from(took > PERIOD);
        punctuality.worst_answer_ms = punctuality.worst_answer_ms.max(took.as_secs_f64() * 1e3);
        Ok(Answer::Stepped(outputs))
    }

    fn report(&mut self) -> Result<Answer, BoardFault> {
        let Report { counters, link, steps, stack_used, .. } = self.bus.report()?;
        let counted = self.bus.counters();
        let punctuality =
            Punctuality { damaged: counted.damaged, resent: counted.resent, ..self.punctuality };
        Ok(Answer::Report(Box::new(BoardReport {
            counters: Counters::from_array(counters),
            board: Some(BoardFigures {
                link,
                steps,
                stack_used: (stack_used > 0).then_some(stack_used),
                punctuality: Some(punctuality),
                ..BoardFigures::default()
            }),
        })))
    }
}

impl SerialBoard {
    fn failed(&self, fault: BoardFault) -> BoardError {
        BoardError { drone: self.drone, port: Some(self.port.clone()), fault, log: Vec::new() }
    }

    fn ask(&self, job: Job) -> Result<(), BoardError> {
        self.jobs.send(job).map_err(|_| self.ended())
    }

    fn answer(&self) -> Result<Answer, BoardError> {
        self.answers.recv().map_err(|_| self.ended())?.map_err(|fault| self.failed(fault))
    }

    /// The thread has ended, which it does after a fault only.
    fn ended(&self) -> BoardError {
        self.failed(BoardFault::Ended("it has failed before".to_owned()))
    }
}

impl Board for SerialBoard {
    fn begin_step(&mut self, now: TimePs, inputs: &Inputs, _: &mut Outputs) -> Result<(), BoardError> {
        let due = self.pace.wait_for(now);
        self.ask(Job::Step(now, Box::new(inputs.clone()), due))
    }

    fn end_step(&mut self, outputs: &mut Outputs) -> Result<(), BoardError> {
        match self.answer()? {
            Answer::Stepped(found) => *outputs = *found,
            Answer::Report(_) | Answer::Restarted => unreachable!("answers come in the order of the jobs"),
        }
        Ok(())
    }

    fn restart(&mut self, config: AgentConfig, key: Option<Key>) -> Result<(), BoardError> {
        self.ask(Job::Restart(Box::new(config), key))?;
        match self.answer()? {
            Answer::Restarted => Ok(()),
            _ => unreachable!("answers come in the order of the jobs"),
        }
    }

    fn report(&mut self) -> Result<BoardReport, BoardError> {
        self.ask(Job::Report)?;
        match self.answer()? {
            Answer::Report(report) => Ok(*report),
            Answer::Stepped(_) | Answer::Restarted => unreachable!("answers come in the order of the jobs"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_that_falls_behind_does_not_hurry_after() {
        let pace = Pace::default();
        let at = |step: i64| pace.wait_for(TimePs::from_us(step * STEP_US));
        let first = at(0);
        assert!(at(1) - first == PERIOD, "on the grid");
        std::thread::sleep(5 * PERIOD);
        let late = at(2);
        assert!(late - first >= 6 * PERIOD, "begun when it was asked for");
        assert!(at(3) - late == PERIOD, "and on the grid again");
    }

    #[test]
    fn a_port_is_the_same_by_any_name() {
        let repeated = |ports: &[&str]| {
            let ports: Vec<PathBuf> = ports.iter().map(PathBuf::from).collect();
            first_repeated(&ports).cloned()
        };
        assert_eq!(repeated(&["/dev/null", "/dev/zero", "/dev/no-such-port"]), None);
        assert_eq!(
            repeated(&["/dev/null", "/dev/zero", "/dev/../dev/null"]),
            Some("/dev/../dev/null".into())
        );
        assert_eq!(repeated(&["/no-such-port", "/no-such-port"]), Some("/no-such-port".into()));
    }

    #[test]
    fn a_port_that_is_not_there_is_named() {
        let ports = Ports::new(&["/dev/no-such-port".into()]);
        let config = AgentConfig::new(skyroost_protocol::units::DroneId(1));
        let Err(error) = ports.start(config, None) else { panic!("started") };
        assert!(error.to_string().contains("/dev/no-such-port"), "{error}");
    }
}
