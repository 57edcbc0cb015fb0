//! The tasks of a board around its flight agent, for any executor: what the images spawn.
//!
//! ```text
//!  bytes of the bus --> bus ----(parts of a step)----> inputs \
//!                        |  \--(bytes of the radio)--> radio ---> inputs --> guidance --> outputs
//!                        \------------- tick ---------------------------------^              |
//!  bytes of the bus <-- bus <---------------- answer, part by part -------------------------/
//! ```
//!
//! Guidance runs on an executor of its own above all links, so that a busy link never delays a step. Agent,
//! inputs and outputs exist once, behind a lock that is asynchronous: who holds it can be interrupted, and
//! the links hold it only to put something in.

use super::{
    bus::{FromBoard, encode},
    lockstep::{Ask, Lockstep, RadioIntake},
};
use crate::{
    agent::FlightAgent,
    config::AgentConfig,
    io::{Inputs, Outputs},
};
use core::{
    mem::MaybeUninit,
    sync::atomic::{AtomicU32, Ordering},
};
use embassy_futures::yield_now;
use embassy_sync::{
    blocking_mutex::raw::CriticalSectionRawMutex as Raw, mutex::Mutex, pipe::Pipe, signal::Signal,
};
use skyroost_protocol::{
    key::Key,
    stream::StreamFrame,
    units::{DroneId, TimePs},
};
use static_cell::{ConstStaticCell, StaticCell};

/// Bytes of a bus that may wait for their task.
pub const BUS_PIPE: usize = 512;
/// Bytes of the radio that may wait for their task.
const RADIO_PIPE: usize = 256;

/// What the tasks of a board share.
pub struct Shell {
    pub(super) core: Mutex<Raw, Core>,
    /// Bytes from the host.
    pub bus_in: Pipe<Raw, BUS_PIPE>,
    /// Bytes for the host.
    pub bus_out: Pipe<Raw, BUS_PIPE>,
    /// Bytes that came over the radio.
    pub radio_in: Pipe<Raw, RADIO_PIPE>,
    /// Bytes of the radio that its task has dealt with, modulo 2^32.
    radio_taken: AtomicU32,
    tick: Signal<Raw, TimePs>,
    stepped: Signal<Raw, u32>,
}

/// Counts what a step costs.
pub trait Stopwatch {
    /// The count.
    fn read(&self) -> u32;
    /// The count since an earlier one.
    fn since(&self, earlier: u32) -> u32;
}

/// The flight code and what goes in and out of it.
pub(super) struct Core {
    pub(super) agent: &'static mut FlightAgent,
    pub(super) inputs: &'static mut Inputs,
    pub(super) outputs: &'static mut Outputs,
    radio: RadioIntake,
}

/// An agent, its inputs and its outputs, each in a static of its own, so that nothing is ever made on the stack. The agent
/// is made in its place when the board starts: most of it is zeros, and its image would take 16 KiB of flash.
static AGENT: StaticCell<FlightAgent> = StaticCell::new();
static INPUTS: ConstStaticCell<Inputs> = ConstStaticCell::new(Inputs::new());
static OUTPUTS: ConstStaticCell<Outputs> = ConstStaticCell::new(Outputs::new());

/// Makes the agent that is nobody yet.
#[inline(never)] // so that what this takes of the stack is given back
fn nobody(place: &'static mut MaybeUninit<FlightAgent>) -> &'static mut FlightAgent {
    place.write(FlightAgent::new(AgentConfig::new(DroneId(1)), None))
}

impl Shell {
    /// The board's only shell, which is nobody yet; none when there is one already.
    #[must_use]
    pub fn the_only() -> Option<&'static Self> {
        static SHELL: StaticCell<Shell> = StaticCell::new();
        let (agent, inputs, outputs) = (AGENT.try_uninit()?, INPUTS.try_take()?, OUTPUTS.try_take()?);
        let agent = nobody(agent);
        let core = Core { agent, inputs, outputs, radio: RadioIntake::new() };
        Some(SHELL.try_uninit()?.write(Self::new(core)))
    }

    fn new(core: Core) -> Self {
        Self {
            core: Mutex::new(core),
            bus_in: Pipe::new(),
            bus_out: Pipe::new(),
            radio_in: Pipe::new(),
            radio_taken: AtomicU32::new(0),
            tick: Signal::new(),
            stepped: Signal::new(),
        }
    }

    /// The bus: takes the host's messages apart, has steps done, answers. `advance` is told the time of
    /// each step before it is done; `stack_used` says how much stack was ever in use, in bytes.
    pub async fn bus(&self, advance: impl Fn(TimePs), stack_used: impl Fn() -> u32) -> ! {
        let mut lockstep = Lockstep::new();
        let mut frame = StreamFrame::new();
        let mut radio_sent: u32 = 0;
        let mut bytes = [0; 128];
        loop {
            let count = self.bus_in.read(&mut bytes).await;
            let mut rest = bytes.get(..count).unwrap_or(&[]);
            while !rest.is_empty() {
                let (taken, ask) = lockstep.take(rest, self.core.lock().await.inputs);
                rest = rest.get(taken..).unwrap_or(&[]);
                let Some(ask) = ask else { continue };
                match ask {
                    Ask::Begin(config, key) => {
                        self.core.lock().await.begin(config, key);
                        defmt::info!("drone {=u16} begins", config.id.0);
                        self.say(lockstep.begun(), &mut frame).await;
                    }
                    Ask::Radio(bytes) => {
                        radio_sent = radio_sent.wrapping_add(bytes.len() as u32);
                        self.radio_in.write_all(bytes).await;
                    }
                    Ask::Step { now, have } => {
                        while self.radio_taken.load(Ordering::Relaxed) != radio_sent {
                            yield_now().await;
                        }
                        advance(now);
                        self.tick.signal(now);
                        lockstep.stepped(self.stepped.wait().await);
                        self.answer(&lockstep, have, &mut frame).await;
                    }
                    Ask::Answer { have } => self.answer(&lockstep, have, &mut frame).await,
                    Ask::Say(message) => self.say(Some(message), &mut frame).await,
                    Ask::Report => {
                        let core = self.core.lock().await;
                        let report = lockstep.report(core.agent.counters(), &core.radio, stack_used());
                        drop(core);
                        self.say(Some(report), &mut frame).await;
                    }
                }
            }
        }
    }

    async fn answer(&self, lockstep: &Lockstep, have: u16, frame: &mut StreamFrame) {
        let core = self.core.lock().await;
        let mut answer = lockstep.answer(have, core.outputs);
        while answer.next_frame(frame) {
            self.bus_out.write_all(frame).await;
        }
    }

    async fn say(&self, message: Option<FromBoard<'_>>, frame: &mut StreamFrame) {
        if message.is_some_and(|message| encode(&message, frame)) {
            self.bus_out.write_all(frame).await;
        }
    }

    /// The radio: finds frames in its bytes.
    pub async fn radio(&self) -> ! {
        let mut bytes = [0; 64];
        loop {
            let count = self.radio_in.read(&mut bytes).await;
            let mut core = self.core.lock().await;
            let Core { inputs, radio, .. } = &mut *core;
            radio.take(bytes.get(..count).unwrap_or(&[]), inputs);
            drop(core);
            self.radio_taken.fetch_add(count as u32, Ordering::Relaxed);
        }
    }

    /// Guidance: a step of the flight code at every tick.
    pub async fn guidance(&self, stopwatch: impl Stopwatch) -> ! {
        loop {
            let now = self.tick.wait().await;
            let cost = self.core.lock().await.step(now, &stopwatch);
            self.stepped.signal(cost);
        }
    }

    /// Frames of the radio that came damaged or did not fit, and whatever the agent dropped.
    pub async fn dropped(&self) -> (u32, u32, u32) {
        let core = self.core.lock().await;
        let agent = core.agent.counters();
        (core.radio.damaged(), core.radio.overflowed(), agent.unreadable().saturating_add(agent.dropped()))
    }
}

impl Core {
    pub(super) fn begin(&mut self, config: AgentConfig, key: Option<Key>) {
        self.agent.restart(config, key);
        self.inputs.clear();
        self.outputs.clear();
        self.radio = RadioIntake::new();
    }

    pub(super) fn step(&mut self, now: TimePs, stopwatch: &impl Stopwatch) -> u32 {
        self.outputs.clear();
        let begun = stopwatch.read();
        self.agent.step(now, self.inputs, self.outputs);
        let cost = stopwatch.since(begun);
        self.inputs.clear();
        cost
    }
}
