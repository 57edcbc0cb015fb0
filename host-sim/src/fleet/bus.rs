//! The host's end of the bus: a step's inputs out, its outputs back; see [`skyroost_firmware::board::bus`].

use super::BoardFault;
use skyroost_firmware::{
    board::bus::{
        ActPart, BUS_VERSION, Begin, FromBoard, MAX_ATTACHED_PART, MAX_CAPTURES_PART, MAX_RADIO_PART,
        Refusal, Report, SensePart, StepHead, ToBoard, WireConfig, decode, encode,
    },
    config::AgentConfig,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{
    SCHEMA_HASH,
    codec::Frame,
    header::{Header, Kind},
    key::Key,
    stream::{StreamDecoder, StreamFrame, encode_stream},
    units::TimePs,
};
use std::{
    io,
    time::{Duration, Instant},
};

/// A board that says nothing for this long hangs.
const SILENCE: Duration = Duration::from_secs(3);
/// A question is given up to so many times the time after which it is first asked again: a board that is slow is not buried under
/// questions, and one behind a link that damages every hundredth byte is asked some seventy times before it counts as silent.
const MOST_BACKOFF: u32 = 4;

/// The last part of it, on a link that damages nothing, in which an open frame may still end.
const SILENCE_AT_THE_END: Duration = Duration::from_secs(1);

/// What is not answered by then, though the board talks, never will be.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// Longest time that a byte takes to a board and through it: thrice that of a UART at 921,600 baud.
const BYTE_TIME: Duration = Duration::from_micros(33);

/// After damage, this much silence is enough to ask again: what was to come has come, or never will.
const SILENCE_AFTER_DAMAGE: Duration = Duration::from_millis(1);

/// A way to carry bytes to a board and back.
pub(super) trait Transport: Send {
    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`io::ErrorKind::BrokenPipe`] when the board is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Waits for bytes, at most for `timeout`; returns how many came, 0 when the time is up.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] when the board is gone.
    fn receive(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize>;
}

/// What the link is like.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkKind {
    /// Silence after which a request is sent again; none where nothing is ever lost or damaged, so that any
    /// damage is a fault.
    pub(super) resend_after: Option<Duration>,
    /// Bytes of the radio in one message.
    pub(super) radio_part: u8,
    /// Parts of a step that may be on their way at once. The board takes parts in order, so that all behind a
    /// damaged one go in vain.
    pub(super) window: usize,
}

impl LinkKind {
    /// A link that neither loses nor damages anything.
    pub(super) const LOSSLESS: Self =
        Self { resend_after: None, radio_part: MAX_RADIO_PART as u8, window: usize::MAX };
}

/// What happened on the bus, as the host saw it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct BusCounters {
    /// Frames from the board that came damaged, and requests that reached it so.
    pub(super) damaged: u64,
    /// Requests sent again.
    pub(super) resent: u64,
    /// Costs of all steps in the board's units, their sum and the greatest.
    pub(super) cost_sum: u64,
    pub(super) cost_worst: u32,
    /// Steps done.
    pub(super) steps: u32,
}

/// The host's end of one board's bus.
pub(super) struct BusClient<T> {
    transport: T,
    link: LinkKind,
    decoder: StreamDecoder,
    /// The radio of the board, put together from the parts of its answers.
    radio: StreamDecoder,
    step: u32,
    /// The present request, or the parts of the present step: frames one after the other, and where each ends.
    request: Vec<u8>,
    ends: Vec<usize>,
    /// Parts of the step that have been sent at least once.
    sent: usize,
    /// What was sent last.
    outgoing: Vec<u8>,
    /// Number of the last request for a step, and how many in a row came to nothing.
    attempt: u8,
    in_vain: u32,
    frame: StreamFrame,
    /// When the board said anything at all.
    last_word: Instant,
    head: Option<StepHead>,
    counters: BusCounters,
}

impl<T: Transport> BusClient<T> {
    pub(super) fn new(transport: T, link: LinkKind) -> Self {
        Self {
            transport,
            link,
            decoder: StreamDecoder::new(),
            radio: StreamDecoder::new(),
            step: 0,
            request: Vec::new(),
            ends: Vec::new(),
            sent: 0,
            outgoing: Vec::new(),
            attempt: 0,
            in_vain: 0,
            frame: StreamFrame::new(),
            last_word: Instant::now(),
            head: None,
            counters: BusCounters::default(),
        }
    }

    pub(super) const fn counters(&self) -> &BusCounters {
        &self.counters
    }

    /// Makes the board the drone of `config`, with this root key.
    pub(super) fn begin(&mut self, config: &AgentConfig, key: Option<Key>) -> Result<(), BoardFault> {
        let begin = Begin {
            bus_version: BUS_VERSION,
            schema_hash: SCHEMA_HASH,
            radio_part: self.link.radio_part,
            config: WireConfig::from(config),
            key,
        };
        self.clear();
        self.put(&ToBoard::Begin(begin));
        let doing = || "since it was started".to_owned();
        let answer = self.ask(doing, |_, message| match message {
            FromBoard::Ready { bus_version, schema_hash, id } => Some((bus_version, schema_hash, id)),
            _ => None,
        })?;
        match answer {
            (BUS_VERSION, SCHEMA_HASH, id) if id == config.id => Ok(()),
            (BUS_VERSION, SCHEMA_HASH, id) => {
                Err(BoardFault::Nonsense(format!("it says it is drone {}", id.0)))
            }
            (bus, schema, _) => Err(BoardFault::Version { bus, schema }),
        }
    }

    /// How the board fared.
    pub(super) fn report(&mut self) -> Result<Report, BoardFault> {
        self.clear();
        self.put(&ToBoard::Report);
        let report = self.ask(
            || "when asked how it fared".to_owned(),
            |_, message| match message {
                FromBoard::Report(report) => Some(report),
                _ => None,
            },
        )?;
        if report.steps != self.step {
            return Err(BoardFault::Nonsense(format!(
                "it has done {} steps of {}; it has been reset",
                report.steps, self.step
            )));
        }
        Ok(report)
    }

    /// Sends everything that a step needs.
    pub(super) fn begin_step(&mut self, now: TimePs, inputs: &Inputs) -> Result<(), BoardFault> {
        self.clear();
        self.step += 1;
        let mut index = 0;
        let mut part = |client: &mut Self, part: SensePart<'_>| {
            client.put(&ToBoard::Sense { step: client.step, index, part });
            index += 1;
        };
        let mut stream = StreamFrame::new();
        for frame in &inputs.frames {
            encode_stream(frame, &mut stream).expect("a link carries frames, and no empty ones");
            for bytes in stream.chunks(usize::from(self.link.radio_part)) {
                part(self, SensePart::Radio(bytes));
            }
        }
        for page in inputs.captures.chunks(MAX_CAPTURES_PART) {
            part(self, SensePart::Captures(page.iter().map(|c| (*c).into()).collect()));
        }
        for page in inputs.attached.chunks(MAX_ATTACHED_PART) {
            part(self, SensePart::Attached(page.iter().copied().collect()));
        }
        self.head = Some(StepHead {
            now,
            nav: inputs.nav.map(Into::into),
            in_air: inputs.in_air,
            timer_ticks: inputs.timer_ticks,
            pulse: inputs.pulse.map(Into::into),
            battery_permille: inputs.battery_permille,
        });
        self.send_step(0, 0)
    }

    /// Collects what the board wants done.
    pub(super) fn end_step(&mut self, outputs: &mut Outputs) -> Result<(), BoardFault> {
        let mut have: u16 = 0;
        let begun = Instant::now();
        self.last_word = begun;
        self.in_vain = 0;
        loop {
            let had = have;
            let heard = self.listen(self.patience(), &mut |client, message| {
                client.on_answer(message, &mut have, outputs)
            })?;
            let from = match heard {
                Heard::Done(()) => return Ok(()),
                _ if self.last_word.elapsed() >= SILENCE => return Err(self.silent_in_step()),
                _ if begun.elapsed() >= ANSWER_LIMIT => {
                    let (step, limit_s) = (self.step, ANSWER_LIMIT.as_secs());
                    return Err(BoardFault::Nonsense(format!("step {step} is not done after {limit_s} s")));
                }
                Heard::Nothing if self.link.resend_after.is_none() => return Err(self.silent_in_step()),
                Heard::Hole(_) | Heard::Damage if self.link.resend_after.is_none() => {
                    return Err(BoardFault::Damaged);
                }
                Heard::Hole(from) => usize::from(from),
                // The parts are there, or nobody knows: the step itself is enough to hear more.
                Heard::Nothing | Heard::Damage => self.ends.len(),
            };
            // A board that is slow must not be asked faster than it can answer.
            let progress = have > had || matches!(heard, Heard::Hole(_));
            self.in_vain = if progress { 0 } else { self.in_vain + 1 };
            // Going on where the window ended is no repetition.
            self.counters.resent += u64::from(from < self.sent || from == self.ends.len());
            self.send_step(from, have)?;
        }
    }

    /// How long an answer may take: what is on the way to the board takes its time.
    fn patience(&self) -> Duration {
        self.link.resend_after.map_or(SILENCE - SILENCE_AT_THE_END, |after| {
            (after + BYTE_TIME * self.outgoing.len() as u32) * self.backoff()
        })
    }

    /// Doubles with every request in a row that came to nothing, up to a limit: within [`SILENCE`] a step is asked for some thirty times.
    fn backoff(&self) -> u32 {
        1 << self.in_vain.min(3)
    }

    fn silent_in_step(&self) -> BoardFault {
        BoardFault::Silent { seconds: SILENCE.as_secs(), doing: format!("in step {}", self.step) }
    }

    /// Takes in a message of the answer to a step.
    fn on_answer(
        &mut self,
        message: FromBoard<'_>,
        have: &mut u16,
        outputs: &mut Outputs,
    ) -> Result<Option<Heard<()>>, BoardFault> {
        match message {
            FromBoard::Act { step, index, part } if step == self.step => {
                if index == *have {
                    *have += 1;
                    self.act(part, outputs)?;
                }
                Ok(None)
            }
            FromBoard::Done { step, parts, attempt, setpoint, cost } if step == self.step => {
                if parts > *have {
                    if attempt != self.attempt {
                        return Ok(None); // another answer is on its way
                    }
                    // Something in between was damaged.
                    return Ok(Some(Heard::Damage));
                }
                outputs.setpoint = setpoint.into();
                self.counters.steps += 1;
                self.counters.cost_sum += u64::from(cost);
                self.counters.cost_worst = self.counters.cost_worst.max(cost);
                Ok(Some(Heard::Done(())))
            }
            FromBoard::Missing { step, next, attempt } if step == self.step && attempt == self.attempt => {
                Ok(Some(Heard::Hole(next)))
            }
            FromBoard::Refused(Refusal::OutOfStep(done)) => Err(BoardFault::Nonsense(format!(
                "it is at step {done} when asked for step {}; it may have been reset",
                self.step
            ))),
            FromBoard::Refused(Refusal::NotBegun) => {
                Err(BoardFault::Nonsense("it has forgotten who it is; it has been reset".to_owned()))
            }
            FromBoard::Refused(refusal) => Err(BoardFault::Nonsense(format!("it refuses: {refusal:?}"))),
            // Answers to requests that were repeated may come twice.
            _ => Ok(None),
        }
    }

    fn act(&mut self, part: ActPart<'_>, outputs: &mut Outputs) -> Result<(), BoardFault> {
        let nonsense = |what: &str| Err(BoardFault::Nonsense(what.to_owned()));
        match part {
            ActPart::Radio(mut bytes) => {
                while !bytes.is_empty() {
                    let (taken, found) = self.radio.take(bytes);
                    bytes = &bytes[taken..];
                    let frame = match found {
                        None => continue,
                        Some(Err(error)) => return nonsense(&format!("a frame for the radio: {error}")),
                        Some(Ok(frame)) => Frame::from_slice(frame).expect("the decoder yields frames"),
                    };
                    let kept = match Header::read(&frame).map(|header| header.kind) {
                        Ok(Kind::Up) => outputs.uplink.push(frame),
                        Ok(Kind::Peer) => outputs.peer.push(frame),
                        _ => return nonsense("a frame for nobody on the radio"),
                    };
                    if kept.is_err() {
                        return nonsense("more frames for the radio than a step can have");
                    }
                }
            }
            ActPart::Gates(gates) => {
                for gate in gates {
                    if outputs.srs_gates.push(gate.into()).is_err() {
                        return nonsense("more SRS gates than a step can have");
                    }
                }
            }
        }
        Ok(())
    }

    /// Sends the request and waits for its answer.
    fn ask<A>(
        &mut self,
        doing: impl Fn() -> String,
        mut pick: impl FnMut(&mut Self, FromBoard<'_>) -> Option<A>,
    ) -> Result<A, BoardFault> {
        let (begun, mut backoff) = (Instant::now(), 1);
        self.last_word = begun;
        loop {
            self.outgoing.clear();
            self.outgoing.extend_from_slice(&self.request);
            self.send_outgoing()?;
            let timeout =
                self.link.resend_after.map_or(SILENCE - SILENCE_AT_THE_END, |after| after * backoff);
            backoff = (2 * backoff).min(MOST_BACKOFF);
            let heard = self.listen(timeout, &mut |client, message| {
                if let FromBoard::Refused(refusal) = message {
                    return Err(BoardFault::Nonsense(format!("it refuses: {refusal:?}")));
                }
                Ok(pick(client, message).map(Heard::Done))
            })?;
            match heard {
                Heard::Done(answer) => return Ok(answer),
                _ if self.link.resend_after.is_none() || self.last_word.elapsed() >= SILENCE => {
                    return Err(BoardFault::Silent { seconds: SILENCE.as_secs(), doing: doing() });
                }
                _ if begun.elapsed() >= ANSWER_LIMIT => {
                    let limit_s = ANSWER_LIMIT.as_secs();
                    return Err(BoardFault::Nonsense(format!("nothing of use for {limit_s} s {}", doing())));
                }
                _ => self.counters.resent += 1,
            }
        }
    }

    /// Sends what is to go out.
    fn send_outgoing(&mut self) -> Result<(), BoardFault> {
        if self.link.resend_after.is_some() {
            // Should the last delimiter come damaged, this one ends the frame.
            self.outgoing.push(0);
        }
        self.transport.send(&self.outgoing).map_err(fault)
    }

    /// Hears messages until `on_message` has heard enough, for at most `timeout` without any.
    fn listen<A>(
        &mut self,
        timeout: Duration,
        on_message: &mut OnMessage<'_, Self, A>,
    ) -> Result<Heard<A>, BoardFault> {
        // Lent out while its messages are looked at.
        let mut decoder = std::mem::take(&mut self.decoder);
        let heard = self.listen_with(&mut decoder, timeout, on_message);
        self.decoder = decoder;
        heard
    }

    fn listen_with<A>(
        &mut self,
        decoder: &mut StreamDecoder,
        mut timeout: Duration,
        on_message: &mut OnMessage<'_, Self, A>,
    ) -> Result<Heard<A>, BoardFault> {
        let lossless = self.link.resend_after.is_none();
        let mut ended = false;
        let mut bytes = [0; 4096];
        loop {
            let mut count = self.transport.receive(&mut bytes, timeout).map_err(fault)?;
            if count == 0 {
                if !lossless || ended {
                    return Ok(Heard::Nothing);
                }
                // Where a delimiter is what was damaged, the frame before it is still open, at either end: a
                // delimiter of our own ends it, and shows what silence would hide.
                self.transport.send(&[0]).map_err(fault)?;
                (bytes[0], count, ended, timeout) = (0, 1, true, SILENCE_AT_THE_END);
            }
            let mut heard = None;
            let mut rest = &bytes[..count];
            while !rest.is_empty() {
                let (taken, found) = decoder.take(rest);
                rest = &rest[taken..];
                let message = match found {
                    None => continue,
                    Some(Ok(payload)) => decode::<FromBoard<'_>>(payload),
                    Some(Err(error)) if lossless => return Err(BoardFault::Nonsense(error.to_string())),
                    Some(Err(_)) => None,
                };
                let verdict = match message {
                    Some(FromBoard::Damaged) if lossless => return Err(BoardFault::Damaged),
                    None if lossless => {
                        return Err(BoardFault::Nonsense("a frame that is no message of the bus".to_owned()));
                    }
                    // Damage shows as a hole in what follows, or as silence.
                    damaged @ (Some(FromBoard::Damaged) | None) => {
                        if damaged.is_some() {
                            self.last_word = Instant::now(); // it is there, and says what it heard
                        }
                        self.counters.damaged += 1;
                        timeout = timeout.min(SILENCE_AFTER_DAMAGE * self.backoff());
                        None
                    }
                    Some(message) => {
                        self.last_word = Instant::now();
                        on_message(self, message)?
                    }
                };
                // Bytes that follow are taken in as well: they may end the wait.
                if verdict.is_some() && !matches!(heard, Some(Heard::Done(_))) {
                    heard = verdict;
                }
            }
            if let Some(heard) = heard {
                return Ok(heard);
            }
        }
    }

    /// Sends parts from `from` on, as many as the window lets, and asks for the step.
    fn send_step(&mut self, from: usize, have: u16) -> Result<(), BoardFault> {
        let parts = self.ends.len();
        let until = parts.min(from.saturating_add(self.link.window));
        let end_of = |part: usize| part.checked_sub(1).map_or(0, |last| self.ends[last]);
        self.outgoing.clear();
        self.outgoing.extend_from_slice(&self.request[end_of(from.min(parts))..end_of(until)]);
        self.sent = self.sent.max(until);
        let head = self.head.expect("a step has been begun");
        self.attempt = self.attempt.wrapping_add(1);
        let attempt = self.attempt;
        let step = ToBoard::Step { step: self.step, parts: parts as u16, have, attempt, head };
        assert!(encode(&step, &mut self.frame), "every message fits a frame");
        self.outgoing.extend_from_slice(&self.frame);
        self.send_outgoing()
    }

    fn put(&mut self, message: &ToBoard<'_>) {
        assert!(encode(message, &mut self.frame), "every message fits a frame");
        self.request.extend_from_slice(&self.frame);
        self.ends.push(self.request.len());
    }

    fn clear(&mut self) {
        self.request.clear();
        self.ends.clear();
        self.sent = 0;
    }
}

/// Looks at a message, and says what it means for the wait.
type OnMessage<'a, C, A> = dyn FnMut(&mut C, FromBoard<'_>) -> Result<Option<Heard<A>>, BoardFault> + 'a;

/// What came of listening.
enum Heard<A> {
    /// What was waited for.
    Done(A),
    /// The answer has a hole.
    Damage,
    /// The board lacks parts of the request from this one on.
    Hole(u16),
    /// Nothing, for too long.
    Nothing,
}

fn fault(error: io::Error) -> BoardFault {
    match error.kind() {
        io::ErrorKind::BrokenPipe | io::ErrorKind::UnexpectedEof => {
            BoardFault::Ended("it closed its end of the bus".to_owned())
        }
        _ => BoardFault::Link(error),
    }
}

#[cfg(test)]
mod tests;
