//! A drone whose uplink takes less than it has to say: what keeps drones apart is said as ever, and the rest waits its turn.
#![allow(missing_docs)]

mod common;

use common::{Bench, FLEET, ME};
use skyroost_firmware::{config::AgentConfig, io::Capture};
use skyroost_protocol::{
    budget::BURST,
    codec::{MAX_FRAME, Message, Sender, decode},
    message::{
        AckStatus, AttachedUser, CaptureEntry, ClockState, Command, Down, Peer, SrsRequest, SrsRequestEntry,
        Up,
    },
    stream::FRAMING,
    units::{MissionId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId},
};

const LANES_MM: [[i32; 2]; 2] = [[0, 0], [2_000_000, 0]];
/// States take half of it.
const TIGHT_BYTES_PER_S: u32 = 1_600;

/// What was said when, and how many bytes it took.
type Said = Vec<(TimePs, Up, usize)>;

struct Uplink {
    bench: Bench,
    mates: [Sender; 2],
    /// Occasions asked for so far.
    asked: u32,
    said: Said,
}

impl Uplink {
    /// In the air, holding.
    fn new(uplink_bytes_per_s: u32) -> Self {
        let mut bench = Bench::of(AgentConfig { uplink_bytes_per_s, ..AgentConfig::new(ME) });
        bench.tell(&Down::Welcome {
            version: skyroost_protocol::PROTOCOL_VERSION,
            schema_hash: skyroost_protocol::SCHEMA_HASH,
            resumes: false,
        });
        bench.fly();
        assert_eq!(bench.upload(MissionId(1), &LANES_MM), AckStatus::Accepted);
        bench.take_off();
        let mates = [FLEET[1], FLEET[2]].map(|mate| Sender::new(mate, 1));
        Self { bench, mates, asked: 0, said: Vec::new() }
    }

    /// Flies on for so many seconds; in each so many measurements are asked of all three drones, of users whom a page tells of.
    fn fly(&mut self, seconds: u32, asks: u16) {
        for step in 0..50 * seconds {
            if step % 50 == 0 {
                let asks: Vec<u32> = (0..asks.into()).collect();
                for batch in asks.chunks(10) {
                    let entries =
                        batch.iter().map(|user| SrsRequestEntry { user: UserId(*user % 24), serving: ME });
                    let start = self.bench.now().after(TimePs::from_ms(100 + 200 * i64::from(batch[0] / 10)));
                    let request = SrsRequest {
                        start,
                        spacing: TimePs::from_ms(20),
                        first_occasion: OccasionId(self.asked),
                        entries: entries.collect(),
                    };
                    self.bench.tell(&Down::SrsRequest(request));
                    self.asked += batch.len() as u32;
                }
            }
            let gates: Vec<OccasionId> =
                self.bench.outputs.srs_gates.iter().map(|gate| gate.occasion).collect();
            for occasion in &gates {
                let entry = CaptureEntry {
                    occasion: *occasion,
                    toa: TimePs(0),
                    pos: PosEnuMm([50_000, 0, 50_000]),
                    sigma: ToaSigma(100),
                    clock: ClockState::Free,
                };
                let captures = Peer::Captures([entry].into_iter().collect());
                let frames = self.mates.each_mut().map(|mate| mate.peer(&captures).expect("it fits"));
                frames.into_iter().for_each(|frame| self.bench.inputs.frames.push(frame).expect("room"));
            }
            self.bench.tell(&Down::Heartbeat);
            self.bench.fly_sensing(|inputs| {
                let sigma = ToaSigma(100);
                let capture = |occasion| Capture { occasion, ticks: 0, symbol: 0, sigma };
                inputs.captures.extend(gates.into_iter().map(capture));
                if step % 50 == 25 {
                    let heard = |user| AttachedUser { user: UserId(user), timing_advance: 3 };
                    inputs.attached.extend((0..u32::from(asks.min(24))).map(heard));
                }
            });
            let now = self.bench.now();
            for frame in &self.bench.outputs.uplink {
                let Ok((_, Message::Up(message))) = decode(frame) else { panic!("it says nothing else") };
                self.said.push((now, message, frame.len() + FRAMING));
            }
        }
    }

    fn times(&self, is: fn(&Up) -> bool) -> Vec<TimePs> {
        self.said.iter().filter(|(_, message, _)| is(message)).map(|(at, ..)| *at).collect()
    }

    fn reported(&self) -> usize {
        let entries =
            |said: &(TimePs, Up, usize)| if let Up::Tdoa(entries) = &said.1 { entries.len() } else { 0 };
        self.said.iter().map(entries).sum()
    }

    fn put_off(&self) -> u32 {
        self.bench.agent.counters().frames_put_off
    }
}

fn longest_gap(times: &[TimePs]) -> TimePs {
    times.windows(2).map(|pair| pair[1].since(pair[0])).max().expect("more than one")
}

const IS_STATE: fn(&Up) -> bool = |message| matches!(message, Up::SharedState(_));
const IS_TELEMETRY: fn(&Up) -> bool = |message| matches!(message, Up::Telemetry(_));
const IS_PAGE: fn(&Up) -> bool = |message| matches!(message, Up::Attached(_));

#[test]
fn an_ample_rate_is_as_good_as_none() {
    let [mut free, mut ample] = [0, 100_000].map(Uplink::new);
    [&mut free, &mut ample].into_iter().for_each(|uplink| uplink.fly(10, 20));
    assert_eq!(free.said, ample.said);
    assert_eq!((free.put_off(), ample.put_off(), ample.reported()), (0, 0, 200));
}

/// A rush is reported whole, as long as the table has room for what waits; states go on as if there were none.
#[test]
fn measurements_wait_for_states_and_are_not_lost() {
    let mut uplink = Uplink::new(TIGHT_BYTES_PER_S);
    uplink.fly(3, 0);
    assert_eq!(uplink.put_off(), 0, "without users there is room for all");
    uplink.fly(1, 36);
    let (put_off, reported) = (uplink.put_off(), uplink.reported());
    assert!(put_off > 0 && reported < 36, "it does not fit a second: {put_off} {reported}");
    uplink.fly(3, 0);
    assert_eq!((uplink.reported(), uplink.bench.agent.counters().dropped()), (36, 0));
    let states = uplink.times(IS_STATE);
    assert!((longest_gap(&states), states.len()) == (TimePs::from_ms(100), 70), "{}", states.len());
}

/// More than it can ever say: states are as many, telemetry and pages come, what is sent keeps to the rate, and what finds no room in the
/// table is counted.
#[test]
fn whoever_has_too_much_to_say_starves_nothing() {
    let mut uplink = Uplink::new(TIGHT_BYTES_PER_S);
    uplink.fly(60, 40);
    let states = uplink.times(IS_STATE);
    assert!((longest_gap(&states), states.len()) == (TimePs::from_ms(100), 600), "{}", states.len());
    let telemetry = uplink.times(IS_TELEMETRY);
    assert!(longest_gap(&telemetry) <= TimePs::from_ms(2_020), "{:?}", longest_gap(&telemetry));
    assert!(uplink.times(IS_PAGE).len() > 50, "{}", uplink.times(IS_PAGE).len());
    assert!(uplink.reported() > 300, "{} of {}", uplink.reported(), uplink.asked);
    let Some((_, Up::Telemetry(last), _)) = uplink.said.iter().rfind(|it| IS_TELEMETRY(&it.1)) else {
        panic!()
    };
    assert!(last.tdoa.evicted > 0 && last.dropped == 0, "{last:?}");
    // All of it together, over any window: no more than the rate, a burst, and what goes into debt for a moment.
    let debt = (f64::from(TIGHT_BYTES_PER_S) * 0.15) as usize + 3 * (MAX_FRAME + FRAMING);
    for first in (0..uplink.said.len()).step_by(7) {
        let mut bytes = 0;
        for (until, _, length) in &uplink.said[first..] {
            bytes += length;
            let window_s = (until.since(uplink.said[first].0).0 + BURST.0) as f64 * 1e-12;
            assert!(
                bytes <= (f64::from(TIGHT_BYTES_PER_S) * window_s) as usize + debt,
                "{bytes} in {window_s} s"
            );
        }
    }
}

/// Where states would take more than half of the link they are fewer, and within what others' avoidance reckons with.
#[test]
fn a_link_for_less_than_states_carries_fewer_of_them() {
    let mut uplink = Uplink::new(500);
    uplink.fly(60, 10);
    let states = uplink.times(IS_STATE);
    let gap = longest_gap(&states);
    assert!((TimePs::from_ms(200)..=TimePs::from_ms(500)).contains(&gap), "{gap:?}");
    assert!(longest_gap(&uplink.times(IS_TELEMETRY)) <= TimePs::from_ms(2_020));
    assert_eq!(uplink.bench.agent.counters().frames_overflowed, 0);
    let commanded = uplink.bench.command(Command::Hold);
    assert_eq!(commanded, AckStatus::Accepted, "answered in the same step, in debt or not");
}
