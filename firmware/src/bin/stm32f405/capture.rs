//! TIM2, the board's clock: 32 bits at 84 MHz, two edges captured, one gate driven.
//!
//! Channel 1 (PA0) captures the receiver's pulse per second, channel 2 (PA1) the trigger of the baseband.
//! Channel 3 (PB10) drives the baseband's gate by comparison: to the tick, whatever else the board does.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::NVIC;
use embassy_stm32::gpio::{AfType, Flex, OutputType, Pull, Speed};
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, CcmrOutputCcs, FilterValue, Ocm};
use embassy_stm32::peripherals::{PA0, PA1, PB10};
use embassy_stm32::{Peri, interrupt, pac};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex as Raw;
use embassy_sync::channel::Channel;
use skyroost_firmware::board::inflight::Edge;

/// Rate of the timer with the clock tree of this board.
pub(crate) const RATE_HZ: u64 = 84_000_000;

/// All three pins are channels of TIM2 as alternate function 1 (data sheet DS8626, table 9).
const TIM2_PINS: u8 = 1;

/// Channels of the timer, counted from 0.
const PULSE: usize = 0;
const TRIGGER: usize = 1;
/// The third, and its place in the second register for two channels each.
const GATE: usize = 2;
const GATE_IN_PAIR: usize = GATE - 2;

/// A window is loaded no later than this before it opens: what loading takes, amply.
const LEAD_TICKS: i32 = 2 * (RATE_HZ / 1_000_000) as i32;

/// Captured edges on their way to guidance.
pub(crate) static EDGES: Channel<Raw, Edge, 32> = Channel::new();
/// Captures that the next one overwrote in the timer, or that found [`EDGES`] full.
static LOST: AtomicU32 = AtomicU32::new(0);
/// Windows on their way to the gate.
static WINDOWS: Channel<Raw, Window, 16> = Channel::new();
/// Windows that came too late or found [`WINDOWS`] full.
static WINDOWS_LOST: AtomicU32 = AtomicU32::new(0);

/// When the gate is open, in values of the timer.
#[derive(Clone, Copy)]
pub(crate) struct Window {
    pub(crate) open: u32,
    pub(crate) close: u32,
}

/// What the comparison waits for.
#[derive(Clone, Copy)]
enum Phase {
    Idle,
    Opening { close: u32 },
    Closing,
}

static PHASE: Mutex<Raw, Cell<Phase>> = Mutex::new(Cell::new(Phase::Idle));

/// Value of the timer.
pub(crate) fn now() -> u32 {
    pac::TIM2.cnt().read()
}

/// Captures and windows lost so far.
pub(crate) fn lost() -> u32 {
    LOST.load(Ordering::Relaxed).saturating_add(WINDOWS_LOST.load(Ordering::Relaxed))
}

fn count(counter: &AtomicU32) {
    // The only writers are on this core and do not wait for each other; saturation matters to nobody here.
    counter.fetch_add(1, Ordering::Relaxed);
}

/// Has the gate open in this window.
pub(crate) fn open_gate(window: Window) {
    if WINDOWS.try_send(window).is_err() {
        count(&WINDOWS_LOST);
    }
    NVIC::pend(pac::Interrupt::TIM2);
}

/// Starts the timer.
pub(crate) fn start(pulse: Peri<'static, PA0>, trigger: Peri<'static, PA1>, gate: Peri<'static, PB10>) {
    for mut pin in [Flex::new(pulse), Flex::new(trigger)] {
        // Pulled down: a wire that is off captures nothing.
        pin.set_as_af_unchecked(TIM2_PINS, AfType::input(Pull::Down));
        core::mem::forget(pin); // dropped, it would no longer be the timer's
    }
    pac::RCC.apb1enr().modify(|w| w.set_tim2en(true));
    let _ = pac::RCC.apb1enr().read(); // see `safe::outputs`
    let timer = pac::TIM2;
    timer.arr().write_value(u32::MAX);
    timer.psc().write_value(0);
    timer.ccmr_input(0).modify(|w| {
        for channel in [PULSE, TRIGGER] {
            w.set_ccs(channel, CcmrInputCcs::TI4); // each channel its own input
            // Eight samples alike: what is shorter than 95 ns is no edge. Both wait equally long.
            w.set_icf(channel, FilterValue::FCK_INT_N8);
        }
    });
    timer.ccmr_output(1).modify(|w| {
        w.set_ccs(GATE_IN_PAIR, CcmrOutputCcs::OUTPUT);
        w.set_ocm(GATE_IN_PAIR, Ocm::FORCE_INACTIVE);
    });
    timer.ccer().modify(|w| [PULSE, TRIGGER, GATE].into_iter().for_each(|channel| w.set_cce(channel, true)));
    let mut gate = Flex::new(gate);
    gate.set_as_af_unchecked(TIM2_PINS, AfType::output(OutputType::PushPull, Speed::Medium));
    core::mem::forget(gate);
    timer.dier().modify(|w| [PULSE, TRIGGER].into_iter().for_each(|channel| w.set_ccie(channel, true)));
    timer.cr1().modify(|w| w.set_cen(true));
    // SAFETY: the handler below needs nothing but what is set up now.
    unsafe { interrupt::TIM2.enable() };
}

#[interrupt]
unsafe fn TIM2() {
    let timer = pac::TIM2;
    let flags = timer.sr().read();
    for (channel, edge) in [(PULSE, Edge::Pulse as fn(u32) -> Edge), (TRIGGER, Edge::Trigger)] {
        if flags.ccif(channel) {
            // Reading the value clears the flag, not that of an overrun (RM0090, 18.4.5).
            let value = timer.ccr(channel).read();
            if EDGES.try_send(edge(value)).is_err() {
                count(&LOST);
            }
        }
        if flags.ccof(channel) {
            // Flags are cleared by zeros; ones leave them alone.
            timer.sr().write(|w| {
                w.0 = u32::MAX;
                w.set_ccof(channel, false);
            });
            count(&LOST);
        }
    }
    PHASE.lock(|phase| phase.set(drive_gate(phase.get(), flags.ccif(GATE))));
}

/// The next phase of the gate, `matched` if the comparison has come true.
fn drive_gate(phase: Phase, matched: bool) -> Phase {
    match phase {
        Phase::Opening { close } if matched => {
            if ahead(close) > LEAD_TICKS {
                compare(close, Ocm::INACTIVE_ON_MATCH);
                return Phase::Closing;
            }
            next_window()
        }
        Phase::Closing if matched => next_window(),
        Phase::Idle => next_window(),
        waiting => waiting,
    }
}

fn next_window() -> Phase {
    pac::TIM2.dier().modify(|w| w.set_ccie(GATE, false));
    pac::TIM2.ccmr_output(1).modify(|w| w.set_ocm(GATE_IN_PAIR, Ocm::FORCE_INACTIVE));
    while let Ok(window) = WINDOWS.try_receive() {
        if ahead(window.open) > LEAD_TICKS {
            compare(window.open, Ocm::ACTIVE_ON_MATCH);
            return Phase::Opening { close: window.close };
        }
        count(&WINDOWS_LOST);
    }
    Phase::Idle
}

/// How far ahead of the timer a value is.
fn ahead(value: u32) -> i32 {
    value.wrapping_sub(now()) as i32
}

/// Has the channel do `what` at `value`, and then interrupt.
fn compare(value: u32, what: Ocm) {
    let timer = pac::TIM2;
    timer.ccr(GATE).write_value(value);
    timer.sr().write(|w| {
        w.0 = u32::MAX;
        w.set_ccif(GATE, false);
    });
    timer.ccmr_output(1).modify(|w| w.set_ocm(GATE_IN_PAIR, what));
    timer.dier().modify(|w| w.set_ccie(GATE, true));
}
