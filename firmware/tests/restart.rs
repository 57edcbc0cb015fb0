//! An agent that is restarted in its place is the agent that it would be anew.
#![allow(missing_docs)]

mod common;

use common::{Bench, FLEET, ME};
use proptest::prelude::*;
use skyroost_firmware::{
    STEP_US,
    agent::FlightAgent,
    config::AgentConfig,
    io::{Capture, Inputs, Outputs, Pulse},
    srs::{clock::TickRate, discipline::Oscillator},
};
use skyroost_protocol::{
    Frame,
    codec::Sender,
    message::{
        CaptureEntry, ClockState, Command, Down, Manner, Peer, PeerState, SharedState, SrsRequest,
        SrsRequestEntry,
    },
    units::{DroneId, MissionId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId, VelEnuMmps},
};
use std::sync::Mutex;

/// One thing that happens to the drone.
#[derive(Clone, Debug)]
enum Happening {
    Command(Command),
    Upload(u16, Vec<[i32; 2]>),
    Neighbour(u16, [i32; 3]),
    Asked(u32, i64),
    /// Occasion, ticks, symbol.
    Captured(u32, u32, u8),
    /// So many seconds of pulses.
    Pulses(u8),
    MateCaptured(u32, i64),
    /// A whole occasion that the drone serves: asked, captured by a mate, captured by itself.
    Served(u32),
    Noise(Vec<u8>),
    Silence(u16),
}

fn happening() -> impl Strategy<Value = Happening> {
    let waypoint = prop::array::uniform2(-500_000..500_000_i32);
    let position = prop::array::uniform3(-100_000..100_000_i32);
    prop_oneof![
        Just(Happening::Command(Command::TakeOff)),
        Just(Happening::Command(Command::StartSweep { at: TimePs(0) })),
        Just(Happening::Command(Command::Hold)),
        Just(Happening::Command(Command::ReturnHome)),
        position.clone().prop_map(|p| Happening::Command(Command::Place { target: PosEnuMm(p) })),
        (0..3_u16, prop::collection::vec(waypoint, 2..40)).prop_map(|(m, w)| Happening::Upload(m, w)),
        (2..60_u16, position).prop_map(|(drone, p)| Happening::Neighbour(drone, p)),
        (0..20_u32, 0..400_i64).prop_map(|(first, ms)| Happening::Asked(first, ms)),
        (0..6_u32).prop_map(Happening::Served),
        (0..30_u32, any::<u32>(), 0..3_u8)
            .prop_map(|(occasion, ticks, symbol)| Happening::Captured(occasion, ticks, symbol)),
        (1..12_u8).prop_map(Happening::Pulses),
        (0..30_u32, any::<i64>()).prop_map(|(occasion, ps)| Happening::MateCaptured(occasion, ps)),
        prop::collection::vec(any::<u8>(), 0..60).prop_map(Happening::Noise),
        (1..400_u16).prop_map(Happening::Silence),
    ]
}

/// A mission first: without one the drone hears no mates.
fn lifetime() -> impl Strategy<Value = Vec<Happening>> {
    prop::collection::vec(happening(), 0..40).prop_map(|mut all| {
        all.insert(0, Happening::Upload(1, vec![[0, 0], [90_000, 0]]));
        all
    })
}

const SIGMA: ToaSigma = ToaSigma(600);

fn mates_capture(occasion: OccasionId, ps: i64) -> CaptureEntry {
    let clock = ClockState::Locked { sigma_ns: 3 };
    CaptureEntry { occasion, toa: TimePs(ps), pos: PosEnuMm([7, 8, 9]), sigma: SIGMA, clock }
}

fn live(bench: &mut Bench, mate: &mut Sender, happening: &Happening) {
    match happening {
        Happening::Command(command) => _ = bench.command(command.clone()),
        Happening::Upload(mission, lanes_mm) => {
            let mission = MissionId(*mission);
            let header = common::header(mission, lanes_mm);
            _ = bench.command(Command::UploadBegin(header));
            bench.send_lanes(mission, lanes_mm);
            let lanes_crc = skyroost_protocol::message::lanes_crc(lanes_mm);
            _ = bench.command(Command::UploadCommit { mission, lanes_crc });
        }
        Happening::Neighbour(drone, pos) => {
            let state = SharedState {
                time: bench.now(),
                pos: PosEnuMm(*pos),
                vel: VelEnuMmps([1000, -2000, 0]),
                error_radius_mm: 1500,
                manner: Manner::ALONE,
            };
            let states = [PeerState { drone: DroneId(*drone), state }];
            bench.tell(&Down::Peers(states.into_iter().collect()));
        }
        Happening::Asked(first, ms) => {
            let entries = (0..6).map(|k| SrsRequestEntry { user: UserId(k), serving: FLEET[k as usize % 2] });
            bench.tell(&Down::SrsRequest(SrsRequest {
                start: bench.now().after(TimePs::from_ms(*ms)),
                spacing: TimePs::from_ms(10),
                first_occasion: OccasionId(*first),
                entries: entries.collect(),
            }));
        }
        Happening::Captured(occasion, ticks, symbol) => {
            let capture =
                Capture { occasion: OccasionId(*occasion), ticks: *ticks, symbol: *symbol, sigma: SIGMA };
            bench.inputs.captures.push(capture).expect("there is room");
        }
        Happening::MateCaptured(occasion, ps) => {
            let entry = mates_capture(OccasionId(*occasion), *ps);
            let message = Peer::Captures([entry].into_iter().collect());
            let frame = mate.peer(&message).expect("a frame holds every message");
            bench.inputs.frames.push(frame).expect("there is room");
        }
        Happening::Served(occasion) => {
            let (occasion, user) = (OccasionId(*occasion), UserId(9));
            bench.tell(&Down::SrsRequest(SrsRequest {
                start: bench.now(),
                spacing: TimePs(0),
                first_occasion: occasion,
                entries: [SrsRequestEntry { user, serving: ME }].into_iter().collect(),
            }));
            bench.fly();
            let entry = mates_capture(occasion, 5);
            let frame = mate.peer(&Peer::Captures([entry].into_iter().collect())).expect("it fits");
            bench.inputs.frames.push(frame).expect("there is room");
            bench
                .inputs
                .captures
                .push(Capture { occasion, ticks: 77, symbol: 0, sigma: SIGMA })
                .expect("there is room");
        }
        Happening::Noise(bytes) => {
            let frame = Frame::from_slice(bytes).expect("short");
            bench.inputs.frames.push(frame).expect("there is room");
        }
        Happening::Pulses(seconds) => {
            for _ in 0..*seconds {
                let second = bench.now().as_us().div_euclid(1_000_000) as i32;
                bench.inputs.pulse = Some(Pulse { ticks: bench.inputs.timer_ticks, second });
                for _ in 0..50 {
                    bench.fly();
                    bench.inputs.timer_ticks = bench.inputs.timer_ticks.wrapping_add(19_660_800);
                }
            }
        }
        Happening::Silence(steps) => (0..*steps).for_each(|_| bench.fly()),
    }
    bench.inputs.timer_ticks = bench.inputs.timer_ticks.wrapping_add(19_660_800);
    bench.fly();
}

/// Everything that a bench with this agent sees of it.
fn life(agent: FlightAgent, happenings: &[Happening]) -> (Bench, Vec<String>) {
    let mut bench = Bench::new();
    bench.agent = agent;
    let mut mate = Sender::new(FLEET[1], 1);
    let seen = |happening| {
        live(&mut bench, &mut mate, happening);
        format!("{:?} {:?} {}", bench.outputs, bench.agent.counters(), bench.agent.sweep_phase_um())
    };
    let seen = happenings.iter().map(seen).collect();
    (bench, seen)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn is_like_new_whatever_it_has_lived_through(
        past in lifetime(),
        future in lifetime(),
        hz in prop_oneof![Just(983_040_000_u64), Just(84_000_000)],
        srs_symbols in 1..=2_u8,
    ) {
        let mut config = AgentConfig::new(ME);
        let rate = TickRate::new(hz).expect("in range");
        (config.boot_epoch, config.srs_symbols) = (7, srs_symbols);
        config.oscillator = Oscillator { rate, ..config.oscillator };
        let (Bench { mut agent, .. }, _) = life(FlightAgent::new(AgentConfig::new(ME), None), &past);
        agent.restart(config, None);
        let (_, found) = life(agent, &future);
        let (_, expected) = life(FlightAgent::new(config, None), &future);
        prop_assert_eq!(found, expected);
    }
}

/// An agent and its buffers can be what the image starts with: no board needs them on its stack.
#[test]
fn statics_hold_all_of_it() {
    static ALL: Mutex<(FlightAgent, Inputs, Outputs)> =
        Mutex::new((FlightAgent::new(AgentConfig::new(ME), None), Inputs::new(), Outputs::new()));
    let (agent, inputs, outputs) = &mut *ALL.lock().expect("nobody else has it");
    agent.step(TimePs(STEP_US), inputs, outputs);
    assert_eq!(outputs.uplink.len(), 1, "it says hello");
}
