//! Which SRS occasion a trigger of the baseband belongs to.
//!
//! The baseband raises a line when it hears a sounding reference signal; the timer captures the edge, and
//! nothing on that line says whose signal it was. The gates do: each opens when its user transmits, and
//! stays open for as long as the signal may be under way; once more for every symbol that it is repeated over.

use crate::counters::Counters;
use crate::io::{Capture, SrsGate};
use crate::srs::{
    burst::{MAX_SYMBOLS, symbol_time},
    discipline::Reading,
};
use heapless::Vec;
use skyroost_protocol::units::{TimePs, ToaSigma};

/// Most gates that are waited on at a time: 40 ms of lead, and as much of stay, at 100 occasions a second
/// are eight.
pub const MAX_OPEN_GATES: usize = 32;

/// When a trigger may come, after its user's time of transmission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TriggerWindow {
    /// The user's timing is wrong by this much at most, either way: its timing advance is a multiple of
    /// 16·64·T_c/2^µ (TS 38.213, 4.2), 0.52 µs at 15 kHz, and its own error about as large.
    pub user_error_ns: u32,
    /// The longest way: 2 km at the speed of light.
    pub flight_ns: u32,
    /// From the signal at the antenna to the edge on the pin, at least.
    pub least_latency_ns: u32,
    /// And at most.
    pub most_latency_ns: u32,
    /// How well an edge stands for its signal, the timer's tick left aside.
    pub sigma: ToaSigma,
    /// Symbols of a signal, each with an edge of its own.
    pub symbols: u8,
}

impl Default for TriggerWindow {
    fn default() -> Self {
        Self {
            user_error_ns: 1_000,
            flight_ns: 6_671,
            least_latency_ns: 0,
            most_latency_ns: 2_000,
            // What missions are simulated with; no baseband has been measured yet.
            sigma: ToaSigma::from_ps(5_000),
            symbols: 1,
        }
    }
}

/// What became of triggers and gates. Every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TriggerCounters {
    /// Edges that made a capture.
    pub captured: u32,
    /// Edges in no gate.
    pub outside: u32,
    /// Edges of a symbol that had had its edge.
    pub repeated: u32,
    /// Edges in more than one gate or symbol: the clock is too uncertain to say which.
    pub ambiguous: u32,
    /// Edges while nobody knew the time.
    pub untimed: u32,
    /// Gates that closed without an edge.
    pub silent: u32,
    /// Gates that there was no room for.
    pub overflowed: u32,
}

/// A gate that a trigger may yet belong to.
#[derive(Clone, Copy, Debug)]
struct OpenGate {
    gate: SrsGate,
    /// A bit for each symbol.
    heard: u8,
}

/// Gates in, triggers in, captures out.
#[derive(Clone, Debug)]
pub struct Triggers {
    window: TriggerWindow,
    open: Vec<OpenGate, MAX_OPEN_GATES>,
    counters: TriggerCounters,
}

/// Gates are kept this long after they closed, for edges that are handled late.
const KEPT: TimePs = TimePs::from_ms(40);

impl Triggers {
    /// No gate yet.
    #[must_use]
    pub fn new(window: TriggerWindow) -> Self {
        Self { window, open: Vec::new(), counters: TriggerCounters::default() }
    }

    /// What became of triggers and gates so far.
    #[must_use]
    pub const fn counters(&self) -> &TriggerCounters {
        &self.counters
    }

    /// The flight code asks for a gate.
    pub fn open(&mut self, gate: SrsGate) {
        if self.open.push(OpenGate { gate, heard: 0 }).is_err() {
            Counters::count(&mut self.counters.overflowed);
        }
    }

    /// An edge on the baseband's line: `ticks` as captured, and when that was, as far as it is known. A
    /// capture if it was the first of one symbol in one gate and of no other.
    pub fn edge(&mut self, ticks: u32, at: Option<Reading>) -> Option<Capture> {
        let counters = &mut self.counters;
        let Some(at) = at else {
            Counters::count(&mut counters.untimed);
            return None;
        };
        let window = &self.window;
        let mut found = None;
        for open in &mut self.open {
            let fits = |symbol: &u8| window.holds(open.gate.at.after(symbol_time(*symbol)), &at);
            let mut symbols = (0..window.symbols.min(MAX_SYMBOLS)).filter(fits);
            let Some(symbol) = symbols.next() else { continue };
            if symbols.next().is_some() || found.is_some() {
                Counters::count(&mut counters.ambiguous);
                return None;
            }
            found = Some((open, symbol));
        }
        let Some((open, symbol)) = found else {
            Counters::count(&mut counters.outside);
            return None;
        };
        let bit = 1_u8.checked_shl(symbol.into()).unwrap_or(0);
        if open.heard & bit != 0 {
            Counters::count(&mut counters.repeated);
            return None;
        }
        open.heard |= bit;
        Counters::count(&mut counters.captured);
        Some(Capture { occasion: open.gate.occasion, ticks, symbol, sigma: window.sigma })
    }

    /// It is `now`: forgets gates that are over.
    pub fn close(&mut self, now: TimePs) {
        let counters = &mut self.counters;
        self.open.retain(|open| {
            let over = now.since(open.gate.at) > KEPT;
            if over && open.heard == 0 {
                Counters::count(&mut counters.silent);
            }
            !over
        });
    }
}

impl TriggerWindow {
    /// Whether a trigger at `edge` may be the signal that a user sent at `sent`.
    fn holds(&self, sent: TimePs, edge: &Reading) -> bool {
        let late_ns = |ns: u32| i64::from(ns);
        let slack_ns = late_ns(self.user_error_ns) + late_ns(edge.bound_ns());
        let first_ns = late_ns(self.least_latency_ns) - slack_ns;
        let last_ns = late_ns(self.flight_ns) + late_ns(self.most_latency_ns) + slack_ns;
        let since_ps = edge.time.since(sent).0;
        (first_ns * 1000..=last_ns * 1000).contains(&since_ps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::{collection::vec, prelude::*};
    use skyroost_protocol::units::{OccasionId, UserId};

    fn gate(occasion: u32, at_us: i64) -> SrsGate {
        SrsGate { occasion: OccasionId(occasion), user: UserId(1), at: TimePs::from_us(at_us), grant: false }
    }

    fn at(ns: i64, bound_ns: u32) -> Option<Reading> {
        Some(Reading { time: TimePs(ns * 1000), sigma_ps: bound_ns * 200 })
    }

    fn first_symbol(occasion: u32, ticks: u32) -> Capture {
        Capture { occasion: OccasionId(occasion), ticks, symbol: 0, sigma: TriggerWindow::default().sigma }
    }

    fn two_gates() -> Triggers {
        let mut triggers = Triggers::new(TriggerWindow::default());
        triggers.open(gate(7, 10_000));
        triggers.open(gate(8, 20_000));
        triggers
    }

    #[test]
    fn an_edge_finds_its_gate() {
        let mut triggers = two_gates();
        let capture = triggers.edge(42, at(20_001_700, 400)); // 500 m away
        assert_eq!(capture, Some(first_symbol(8, 42)));
        let capture = triggers.edge(43, at(10_006_700, 400)); // 2 km away, handled late
        assert_eq!(capture, Some(first_symbol(7, 43)));
        assert_eq!(triggers.counters().captured, 2);
    }

    #[test]
    fn a_second_edge_of_a_gate_is_an_echo() {
        let mut triggers = two_gates();
        assert!(triggers.edge(42, at(10_001_700, 400)).is_some());
        assert!(triggers.edge(43, at(10_002_900, 400)).is_none());
        assert_eq!(triggers.counters().repeated, 1);
    }

    #[test]
    fn every_symbol_has_an_edge() {
        let mut triggers = Triggers::new(TriggerWindow { symbols: 4, ..TriggerWindow::default() });
        triggers.open(gate(7, 10_000));
        // A kilometre away, the third symbol unheard.
        for (symbol, at_ns) in [(0, 10_003_300), (1, 10_038_977), (3, 10_110_331)] {
            let expected = Capture { symbol, ..first_symbol(7, u32::from(symbol)) };
            assert_eq!(triggers.edge(symbol.into(), at(at_ns, 400)), Some(expected));
        }
        assert_eq!(triggers.edge(9, at(10_110_400, 400)), None, "an echo");
        assert_eq!(triggers.edge(9, at(10_145_000, 400)), None, "a fifth symbol");
        assert_eq!(
            triggers.edge(9, at(10_074_000, 30_000)),
            None,
            "too uncertain to tell the second from the third"
        );
        let counters = triggers.counters();
        assert_eq!(
            (counters.captured, counters.repeated, counters.outside, counters.ambiguous),
            (3, 1, 1, 1)
        );
    }

    #[test]
    fn edges_outside_and_gates_without_an_edge_are_counted() {
        let mut triggers = two_gates();
        assert!(triggers.edge(1, at(9_998_000, 400)).is_none());
        assert!(triggers.edge(2, at(15_000_000, 400)).is_none());
        assert!(triggers.edge(3, None).is_none());
        triggers.close(TimePs::from_us(50_001));
        triggers.close(TimePs::from_us(60_001));
        let expected = TriggerCounters { outside: 2, untimed: 1, silent: 2, ..TriggerCounters::default() };
        assert_eq!(*triggers.counters(), expected);
    }

    #[test]
    fn a_clock_too_uncertain_to_tell_two_gates_apart_captures_nothing() {
        let mut triggers = two_gates();
        assert!(triggers.edge(1, at(15_000_000, 6_000_000)).is_none());
        assert_eq!(triggers.counters().ambiguous, 1);
    }

    #[test]
    fn gates_beyond_the_room_are_counted() {
        let mut triggers = Triggers::new(TriggerWindow::default());
        (0..40).for_each(|occasion| triggers.open(gate(occasion, 0)));
        assert_eq!(triggers.counters().overflowed as usize, 40 - MAX_OPEN_GATES);
    }

    proptest! {
        /// Whatever the way and the errors within their bounds, the edge is its gate's; and every gate
        /// and every edge ends in exactly one count.
        #[test]
        fn truth_no_edge_goes_astray(
            ways in vec(
                (0..6_671_i64, -1_000..=1_000_i64, 0..=2_000_i64, 0..50_000_u32, -1.0..1.0_f64, any::<bool>()),
                1..MAX_OPEN_GATES,
            ),
        ) {
            let mut triggers = Triggers::new(TriggerWindow::default());
            for index in 0..ways.len() {
                triggers.open(gate(index as u32, index as i64 * 1_000));
            }
            let mut edges = 0;
            for (index, (flight, user, latency, uncertainty_ns, share, heard)) in ways.iter().enumerate() {
                let error = (f64::from(*uncertainty_ns) * share) as i64;
                let ns = index as i64 * 1_000_000 + flight + user + latency + error;
                if *heard {
                    edges += 1;
                    let capture = triggers.edge(index as u32, at(ns, *uncertainty_ns));
                    prop_assert_eq!(capture.map(|c| c.occasion.0), Some(index as u32));
                }
            }
            triggers.close(TimePs::from_ms(1_000));
            let counters = triggers.counters();
            prop_assert_eq!(counters.captured, edges);
            prop_assert_eq!(counters.captured + counters.silent, ways.len() as u32);
        }
    }
}
