//! The board's end of the bus: bytes in, what is asked of the board out; see [`bus`](super::bus).

use super::bus::{
    ActPart, BUS_VERSION, FromBoard, LinkCounters, MAX_GATES_PART, MAX_RADIO_PART, Refusal, Report,
    SensePart, ToBoard, decode, encode,
};
use crate::{
    config::AgentConfig,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{
    SCHEMA_HASH,
    codec::Frame,
    key::Key,
    stream::{StreamDecoder, StreamFrame, encode_stream},
    units::{DroneId, TimePs},
};

/// What the host asks of the board.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask<'a> {
    /// Be this drone, with this root key, then [`Lockstep::begun`] says what to answer.
    Begin(AgentConfig, Option<Key>),
    /// These bytes came over the radio.
    Radio(&'a [u8]),
    /// All inputs of a step are there: do it, call [`Lockstep::stepped`], and answer from this part on.
    Step {
        /// GNSS time since the mission's epoch.
        now: TimePs,
        /// Parts of the answer that the host has already.
        have: u16,
    },
    /// The step is done; answer once more, from this part on.
    Answer {
        /// Parts of the answer that the host has already.
        have: u16,
    },
    /// Nothing to do but to say this.
    Say(FromBoard<'a>),
    /// Say [`Lockstep::report`].
    Report,
}

/// Puts the host's messages together to steps.
#[derive(Clone, Debug)]
pub struct Lockstep {
    decoder: StreamDecoder,
    steps: Steps,
}

/// Where the board is in the flight.
#[derive(Clone, Debug)]
struct Steps {
    begun: Option<AgentConfig>,
    radio_part: usize,
    /// The last step done.
    done: u32,
    /// Parts of the step after it that have arrived.
    next: u16,
    /// Of the last request for a step.
    attempt: u8,
    link: LinkCounters,
    cost: u32,
    worst_cost: u32,
}

impl Default for Lockstep {
    fn default() -> Self {
        Self::new()
    }
}

impl Lockstep {
    /// A board that is nobody yet.
    #[must_use]
    pub const fn new() -> Self {
        let link = LinkCounters {
            bus_damaged: 0,
            bus_out_of_order: 0,
            bus_repeated: 0,
            radio_damaged: 0,
            inputs_overflowed: 0,
        };
        let (radio_part, done, next, attempt, cost, worst_cost) = (MAX_RADIO_PART, 0, 0, 0, 0, 0);
        let steps = Steps { begun: None, radio_part, done, next, attempt, link, cost, worst_cost };
        Self { decoder: StreamDecoder::new(), steps }
    }

    /// Takes bytes of the bus up to the end of the first message among them; returns how many it took. What
    /// the message brings goes into `inputs`, but for the radio's bytes.
    pub fn take(&mut self, bytes: &[u8], inputs: &mut Inputs) -> (usize, Option<Ask<'_>>) {
        let (taken, found) = self.decoder.take(bytes);
        let ask = found.and_then(|found| match found.ok().and_then(decode) {
            Some(message) => self.steps.on_message(message, inputs),
            None => {
                Counters::count(&mut self.steps.link.bus_damaged);
                Some(Ask::Say(FromBoard::Damaged))
            }
        });
        (taken, ask)
    }

    /// The answer to [`Ask::Begin`].
    #[must_use]
    pub fn begun(&self) -> Option<FromBoard<'static>> {
        Some(ready(self.steps.begun?.id))
    }

    /// The step asked for is done, at this cost.
    pub fn stepped(&mut self, cost: u32) {
        self.steps.cost = cost;
        self.steps.worst_cost = self.steps.worst_cost.max(cost);
    }

    /// The answer to the last step, from part `have` on, frame by frame.
    #[must_use]
    pub fn answer<'a>(&self, have: u16, outputs: &'a Outputs) -> Answer<'a> {
        Answer {
            step: self.steps.done,
            have,
            index: 0,
            attempt: self.steps.attempt,
            cost: self.steps.cost,
            radio_part: self.steps.radio_part,
            frame: 0,
            stream: StreamFrame::new(),
            sent: 0,
            gates: 0,
            done: false,
            outputs,
        }
    }

    /// How the board fared; the agent's own counts and the radio's come from outside.
    #[must_use]
    pub fn report(&self, counters: &Counters, radio: &RadioIntake, stack_used: u32) -> FromBoard<'static> {
        let mut link = self.steps.link;
        link.radio_damaged = radio.damaged;
        link.inputs_overflowed = link.inputs_overflowed.saturating_add(radio.overflowed);
        FromBoard::Report(Report {
            counters: counters.to_array(),
            link,
            steps: self.steps.done,
            worst_step_cost: self.steps.worst_cost,
            stack_used,
        })
    }
}

impl Steps {
    fn on_message<'a>(&mut self, message: ToBoard<'a>, inputs: &mut Inputs) -> Option<Ask<'a>> {
        let refuse = |refusal| Some(Ask::Say(FromBoard::Refused(refusal)));
        match message {
            ToBoard::Begin(begin) => {
                if begin.bus_version != BUS_VERSION || begin.schema_hash != SCHEMA_HASH {
                    return Some(Ask::Say(ready(NOBODY)));
                }
                let Some(config) = begin.config.agent_config() else { return refuse(Refusal::Config) };
                self.begun = Some(config);
                self.radio_part = usize::from(begin.radio_part).clamp(1, MAX_RADIO_PART);
                (self.done, self.next, self.cost, self.worst_cost) = (0, 0, 0, 0);
                inputs.clear();
                Some(Ask::Begin(config, begin.key))
            }
            ToBoard::Report => Some(Ask::Report),
            _ if self.begun.is_none() => refuse(Refusal::NotBegun),
            ToBoard::Sense { step, index, part } => {
                if Some(step) != self.done.checked_add(1) || index != self.next {
                    Counters::count(&mut self.link.bus_out_of_order);
                    return None;
                }
                self.next = self.next.saturating_add(1);
                self.sense(part, inputs)
            }
            ToBoard::Step { step, have, attempt, .. } if step == self.done && step > 0 => {
                self.attempt = attempt;
                Counters::count(&mut self.link.bus_repeated);
                Some(Ask::Answer { have })
            }
            ToBoard::Step { step, .. } if Some(step) != self.done.checked_add(1) => {
                refuse(Refusal::OutOfStep(self.done))
            }
            ToBoard::Step { step, parts, have, attempt, head } => {
                self.attempt = attempt;
                if parts != self.next {
                    Counters::count(&mut self.link.bus_repeated);
                    return Some(Ask::Say(FromBoard::Missing { step, next: self.next, attempt }));
                }
                (self.done, self.next) = (step, 0);
                inputs.nav = head.nav.map(Into::into);
                inputs.in_air = head.in_air;
                inputs.timer_ticks = head.timer_ticks;
                inputs.pulse = head.pulse.map(Into::into);
                inputs.battery_permille = head.battery_permille;
                Some(Ask::Step { now: head.now, have })
            }
        }
    }

    fn sense<'a>(&mut self, part: SensePart<'a>, inputs: &mut Inputs) -> Option<Ask<'a>> {
        let overflowed = &mut self.link.inputs_overflowed;
        match part {
            SensePart::Radio(bytes) => return Some(Ask::Radio(bytes)),
            SensePart::Captures(captures) => {
                for capture in captures {
                    if inputs.captures.push(capture.into()).is_err() {
                        Counters::count(overflowed);
                    }
                }
            }
            SensePart::Attached(users) => {
                for user in users {
                    if inputs.attached.push(user).is_err() {
                        Counters::count(overflowed);
                    }
                }
            }
        }
        None
    }
}

/// The id of a board that is no drone.
const NOBODY: DroneId = DroneId(0);

const fn ready(id: DroneId) -> FromBoard<'static> {
    FromBoard::Ready { bus_version: BUS_VERSION, schema_hash: SCHEMA_HASH, id }
}

/// The answer to a step as frames of the bus, made as they are needed: nothing but the outputs themselves
/// is kept for repeating it.
#[derive(Clone, Debug)]
pub struct Answer<'a> {
    step: u32,
    /// Parts before this one are not wanted.
    have: u16,
    index: u16,
    attempt: u8,
    cost: u32,
    radio_part: usize,
    /// The next frame of the radio: those for the control center first, then those for the mates.
    frame: usize,
    /// The present frame as it crosses the radio, and how much of it has gone.
    stream: StreamFrame,
    sent: usize,
    /// Gates that have gone.
    gates: usize,
    done: bool,
    outputs: &'a Outputs,
}

impl Answer<'_> {
    /// Replaces `frame` by the next frame of the answer; false after the last.
    pub fn next_frame(&mut self, frame: &mut StreamFrame) -> bool {
        let (step, have, attempt, cost) = (self.step, self.have, self.attempt, self.cost);
        while !self.done {
            let index = self.index;
            let outputs = self.outputs;
            let Some(part) = self.next_part() else {
                self.done = true;
                let setpoint = outputs.setpoint.into();
                return encode(&FromBoard::Done { step, parts: index, attempt, setpoint, cost }, frame);
            };
            let wanted = index >= have;
            if wanted {
                encode(&FromBoard::Act { step, index, part }, frame);
            }
            self.index = index.saturating_add(1);
            if wanted {
                return true;
            }
        }
        false
    }

    fn next_part(&mut self) -> Option<ActPart<'_>> {
        while self.sent == self.stream.len() {
            let Some(frame) = self.outputs.uplink.iter().chain(&self.outputs.peer).nth(self.frame) else {
                return self.next_gates();
            };
            self.frame += 1;
            self.sent = 0;
            // No frame of the flight code is empty or too long; such a one would leave nothing to send.
            let _ = encode_stream(frame, &mut self.stream);
        }
        let rest = self.stream.get(self.sent..).unwrap_or(&[]);
        let bytes = rest.get(..self.radio_part).unwrap_or(rest);
        self.sent += bytes.len();
        Some(ActPart::Radio(bytes))
    }

    fn next_gates(&mut self) -> Option<ActPart<'static>> {
        let rest = self.outputs.srs_gates.get(self.gates..).unwrap_or(&[]);
        let page = rest.chunks(MAX_GATES_PART).next()?;
        self.gates += page.len();
        Some(ActPart::Gates(page.iter().copied().map(Into::into).collect()))
    }
}

/// Finds the frames in the bytes of the radio.
#[derive(Clone, Debug, Default)]
pub struct RadioIntake {
    decoder: StreamDecoder,
    damaged: u32,
    overflowed: u32,
}

impl RadioIntake {
    /// At the start of a frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { decoder: StreamDecoder::new(), damaged: 0, overflowed: 0 }
    }

    /// Takes bytes; the frames that they complete go into `inputs`.
    pub fn take(&mut self, bytes: &[u8], inputs: &mut Inputs) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, found) = self.decoder.take(rest);
            match found {
                None => {}
                Some(Ok(bytes)) => {
                    let kept = Frame::from_slice(bytes).is_ok_and(|frame| inputs.frames.push(frame).is_ok());
                    if !kept {
                        Counters::count(&mut self.overflowed);
                    }
                }
                Some(Err(_)) => Counters::count(&mut self.damaged),
            }
            rest = rest.get(taken..).unwrap_or(&[]);
        }
    }

    /// Frames that came damaged.
    #[must_use]
    pub const fn damaged(&self) -> u32 {
        self.damaged
    }

    /// Frames that the inputs of a step had no room for.
    #[must_use]
    pub const fn overflowed(&self) -> u32 {
        self.overflowed
    }
}
