//! Nothing allocates in the stepping loop of the agents: counted by the allocator itself, from the hello on
//! the ground through upload, take-off and sweep.
#![allow(unsafe_code)] // a global allocator cannot be written without

use skyroost_firmware::{
    STEP_US,
    agent::FlightAgent,
    config::AgentConfig,
    io::{Capture, Inputs, NavFix, Outputs, Pulse},
};
use skyroost_protocol::{
    codec::Sender,
    message::{
        AttachedUser, Command, Down, FlightPhase, Heading, LanePiece, Manner, MissionHeader, PeerState,
        SharedState, SrsRequest, SrsRequestEntry, Vertical, lanes_crc,
    },
    units::{
        CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId, VelEnuMmps,
    },
};
use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

struct Counting;

thread_local! {
    /// Allocations of this thread: the test runner's own do not count.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system's allocator unchanged; counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller keeps the contract of `alloc`, which is that of `System`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System` by `alloc` above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const LANES_MM: [[i32; 2]; 3] = [[0, 0], [300_000, 0], [300_000, 200_000]];

/// What the control center says at certain steps of this short flight.
fn said(step: i64) -> Option<Down> {
    let command = |id, command| Some(Down::Command { id: CommandId(id), command });
    let mission = MissionId(1);
    let header = MissionHeader {
        mission,
        fleet: Some(FleetId(0)),
        mates: [DroneId(1), DroneId(2), DroneId(3)],
        slot: 0,
        spacing_mm: 50_000,
        heading: Heading::Fixed,
        orientation_mrad: 0,
        speed_mmps: 10_000,
        altitude_mm: 30_000,
        home: PosEnuMm::default(),
        waypoints: LANES_MM.len() as u16,
        d_safe_mm: 10_000,
        walls: 0,
        vertical: Vertical::Preferred,
    };
    match step {
        10 => command(1, Command::UploadBegin(header)),
        20 => Some(Down::LanePiece(LanePiece {
            mission,
            first: 0,
            waypoints_mm: heapless::Vec::from_slice(&LANES_MM).unwrap(),
        })),
        30 => command(2, Command::UploadCommit { mission, lanes_crc: lanes_crc(&LANES_MM) }),
        40 => command(3, Command::TakeOff),
        1_500 => command(4, Command::StartSweep { at: TimePs::from_us(1_600 * STEP_US) }),
        _ if step > 1_600 && step % 50 == 0 => Some(Down::SrsRequest(SrsRequest {
            start: TimePs::from_us((step + 10) * STEP_US),
            spacing: TimePs::from_ms(100),
            first_occasion: OccasionId(step as u32 * 10),
            entries: (0..8).map(|u| SrsRequestEntry { user: UserId(u), serving: DroneId(1) }).collect(),
        })),
        _ if step % 5 == 0 => {
            let state = SharedState {
                time: TimePs::from_us((step - 5) * STEP_US),
                pos: PosEnuMm([28_868 + step as i32 * 100, 40_000, 30_000]),
                vel: VelEnuMmps([-5_000, 0, 0]),
                error_radius_mm: 2_000,
                manner: Manner::ALONE,
            };
            let states = (2..6).map(|drone| PeerState { drone: DroneId(drone), state });
            Some(Down::Peers(states.collect()))
        }
        _ => None,
    }
}

#[test]
fn from_hello_to_sweep() {
    let mut agent = FlightAgent::new(AgentConfig::new(DroneId(1)), None);
    let mut control = Sender::new(DroneId::CONTROL, 1);
    let (mut inputs, mut outputs) = (Inputs::default(), Outputs::default());
    let mut pos = skyroost_firmware::Vec3::zeros();
    let mut counted = 0;
    for step in 0..4_000 {
        let vel = outputs.setpoint.vel_enu_mps; // a vehicle that does what it is told
        pos += vel * skyroost_firmware::STEP_S;
        inputs.clear();
        inputs.nav = Some(NavFix { pos_enu_m: pos, vel_enu_mps: vel, error_radius_m: 2.0 });
        inputs.battery_permille = 900;
        inputs.timer_ticks = (step as u32).wrapping_mul(19_660_800);
        if let Some(message) = said(step) {
            inputs.frames.push(control.down(&message).unwrap()).unwrap();
        }
        if step % 50 == 0 {
            inputs.pulse = Some(Pulse { ticks: inputs.timer_ticks, second: (step / 50) as i32 });
        }
        if step % 50 == 7 {
            inputs.attached.extend((0..8).map(|u| AttachedUser { user: UserId(u), timing_advance: 7 }));
        }
        for gate in &outputs.srs_gates {
            let capture = Capture {
                occasion: gate.occasion,
                ticks: inputs.timer_ticks,
                symbol: 0,
                sigma: ToaSigma(600),
            };
            inputs.captures.push(capture).unwrap();
        }
        outputs.clear();
        let before = ALLOCATIONS.get();
        agent.step(TimePs::from_us(step * STEP_US), &inputs, &mut outputs);
        counted += ALLOCATIONS.get() - before;
    }
    assert_eq!(agent.phase(), FlightPhase::Sweep, "the flight got as far as it should");
    assert_eq!(counted, 0, "allocations while stepping");
}
