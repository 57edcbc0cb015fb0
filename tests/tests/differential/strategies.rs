//! What random flights are made of.

use super::{MATES, MISSION, Nav, Neighbour, OCCASIONS, Order, Reach, Script, Stretch, Word};
use crate::pair::steps_long;
use proptest::{collection::vec, prelude::*, sample::select};
use skyroost_firmware::io::{MAX_CAPTURES_PER_STEP, MAX_FRAMES_PER_STEP};
use skyroost_protocol::{
    codec::MAX_FRAME,
    message::{
        ClockState, Command, Down, Heading, LanePiece, MAX_ATTACHED_PER_FRAME, MAX_CAPTURES_PER_FRAME,
        MAX_LANE_PIECE, MAX_PEERS_PER_FRAME, MAX_SRS_PER_REQUEST, Manner, MissionHeader, Vertical,
    },
    units::{CommandId, DroneId, FleetId, MissionId, PosEnuMm, TimePs},
};

/// Every kind of float there is.
fn float() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -2000.0_f32..2000.0,
        1 => any::<u32>().prop_map(f32::from_bits),
        1 => (0x7f80_0001_u32..=0x7fff_ffff, any::<bool>()).prop_map(|(bits, minus)| f32::from_bits(bits | u32::from(minus) << 31)),
        1 => (1_u32..0x0080_0000, any::<bool>()).prop_map(|(bits, minus)| f32::from_bits(bits | u32::from(minus) << 31)),
        2 => select(vec![0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1e-30, 2_147_483.6, -2_147_483.8, 1e19, -3e38]),
    ]
}

/// Times of all sizes, both ways.
fn time() -> impl Strategy<Value = TimePs> {
    prop_oneof![
        6 => (-1_500_i64..1_500).prop_map(TimePs::from_ms),
        2 => (-2_000_000_000_i64..2_000_000_000).prop_map(TimePs),
        1 => any::<i64>().prop_map(TimePs),
        1 => select(vec![0, 1, -1, i64::MAX, i64::MIN, i64::MAX - 1, i64::MIN + 1]).prop_map(TimePs),
    ]
}

fn position_mm() -> impl Strategy<Value = [i32; 3]> {
    let near = || -120_000_i32..120_000;
    prop_oneof![
        5 => (near(), near(), 0..60_000_i32).prop_map(|(x, y, z)| [x, y, z]),
        1 => any::<[i32; 3]>(),
        1 => Just([0, 0, 30_000]),
    ]
}

fn neighbour() -> impl Strategy<Value = Neighbour> {
    let vel = prop_oneof![[-12_000_i16..12_000, -12_000_i16..12_000, -3_000_i16..3_000], any::<[i16; 3]>()];
    let drone = prop_oneof![5 => 1_u16..60, 1 => any::<u16>()];
    let manner =
        prop_oneof![2 => Just(Manner(0)), 2 => (1_u8..4).prop_map(Manner), 1 => any::<u8>().prop_map(Manner)];
    (drone, time(), position_mm(), vel, prop_oneof![0_u16..5_000, any::<u16>()], manner).prop_map(
        |(drone, ahead, pos_mm, vel_mmps, error_radius_mm, manner)| Neighbour {
            drone,
            ahead,
            pos_mm,
            vel_mmps,
            error_radius_mm,
            manner,
        },
    )
}

fn heading() -> impl Strategy<Value = Heading> {
    select(vec![Heading::Fixed, Heading::AlongTrack])
}

fn vertical() -> impl Strategy<Value = Vertical> {
    select(vec![Vertical::Level, Vertical::Free, Vertical::Preferred])
}

fn wild_header() -> impl Strategy<Value = MissionHeader> {
    (
        (any::<u16>(), any::<Option<u16>>(), any::<[u16; 3]>(), any::<u8>(), any::<u32>(), heading()),
        (any::<i16>(), any::<u16>(), any::<u32>(), any::<[i32; 3]>(), any::<u16>(), any::<[u16; 2]>()),
        vertical(),
    )
        .prop_map(|((mission, fleet, mates, slot, spacing_mm, heading), rest, vertical)| {
            let (orientation_mrad, speed_mmps, altitude_mm, home_mm, waypoints, [d_safe_mm, walls]) = rest;
            MissionHeader {
                mission: MissionId(mission),
                fleet: fleet.map(FleetId),
                mates: mates.map(DroneId),
                slot,
                spacing_mm,
                heading,
                orientation_mrad,
                speed_mmps,
                altitude_mm,
                home: PosEnuMm(home_mm),
                waypoints,
                d_safe_mm,
                walls,
                vertical,
            }
        })
}

/// A mission that the drone can fly.
fn header(waypoints: u16) -> impl Strategy<Value = MissionHeader> {
    let home = [-3_000_i32..3_000, -3_000_i32..3_000, 0_i32..500];
    let shape = (20_000_u32..90_000, heading(), any::<i16>(), 1_000_u16..11_000, vertical());
    (shape, 5_000_u32..80_000, home, 0_u16..20_000, proptest::bool::weighted(0.85)).prop_map(
        move |(
            (spacing_mm, heading, orientation_mrad, speed_mmps, vertical),
            altitude_mm,
            home,
            d_safe_mm,
            fleet,
        )| {
            MissionHeader {
                mission: MISSION,
                fleet: fleet.then_some(FleetId(0)),
                mates: MATES,
                slot: 0,
                spacing_mm,
                heading,
                orientation_mrad,
                speed_mmps,
                altitude_mm,
                home: PosEnuMm(home),
                waypoints,
                d_safe_mm,
                // The last waypoints stand for walls of any radius and top.
                walls: waypoints / 16,
                vertical,
            }
        },
    )
}

/// Lanes from the pad on: mostly long legs, some short or doubled points.
fn lanes() -> impl Strategy<Value = Vec<[i32; 2]>> {
    let leg = prop_oneof![
        8 => [-300_000_i32..300_000, -300_000_i32..300_000],
        1 => [-2_000_i32..2_000, -2_000_i32..2_000],
        1 => Just([0, 0]),
    ];
    let count = prop_oneof![8 => 2_usize..20, 1 => 20_usize..512];
    count.prop_flat_map(move |count| vec(leg.clone(), count)).prop_map(|legs| {
        let mut at = [0_i32; 2];
        legs.iter()
            .map(|leg| {
                at = [at[0].saturating_add(leg[0]), at[1].saturating_add(leg[1])];
                at
            })
            .collect()
    })
}

fn wild_down() -> impl Strategy<Value = Down> {
    let command = prop_oneof![
        wild_header().prop_map(Command::UploadBegin),
        (any::<u16>(), any::<u32>()).prop_map(|(mission, lanes_crc)| Command::UploadCommit {
            mission: MissionId(mission),
            lanes_crc
        }),
        time().prop_map(|at| Command::StartSweep { at }),
        any::<[i32; 3]>().prop_map(|target| Command::Place { target: PosEnuMm(target) }),
    ];
    let piece =
        (prop_oneof![Just(MISSION.0), any::<u16>()], 0_u16..600, vec(any::<[i32; 2]>(), 0..=MAX_LANE_PIECE));
    prop_oneof![
        (any::<u8>(), any::<u32>(), any::<bool>())
            .prop_map(|(version, schema_hash, resumes)| Down::Welcome { version, schema_hash, resumes }),
        Just(Down::Heartbeat),
        (any::<u16>(), command).prop_map(|(id, command)| Down::Command { id: CommandId(id), command }),
        piece.prop_map(|(mission, first, points)| Down::LanePiece(LanePiece {
            mission: MissionId(mission),
            first,
            waypoints_mm: points.into_iter().collect(),
        })),
    ]
}

fn word() -> impl Strategy<Value = Word> {
    let order = prop_oneof![
        select(vec![Order::TakeOff, Order::Sweep, Order::Hold, Order::ReturnHome, Order::Commit]),
        position_mm().prop_map(Order::Place),
    ];
    let spacing = prop_oneof![4 => (0_i64..30).prop_map(TimePs::from_ms), 1 => time()];
    let users = vec((0_u32..50, 1_u16..5), 0..=MAX_SRS_PER_REQUEST);
    let clock = prop_oneof![
        Just(ClockState::Free),
        any::<u16>().prop_map(|sigma_ns| ClockState::Held { sigma_ns }),
        (0..100_u16).prop_map(|sigma_ns| ClockState::Locked { sigma_ns }),
    ];
    let toa = (0..OCCASIONS, time(), position_mm(), any::<u16>(), clock);
    prop_oneof![
        2 => order.prop_map(Word::Order),
        2 => wild_down().prop_map(Word::Down),
        4 => (time(), spacing, 0..OCCASIONS, users)
            .prop_map(|(ahead, spacing, first, users)| Word::Request { ahead, spacing, first, users }),
        4 => vec(neighbour(), 0..=MAX_PEERS_PER_FRAME).prop_map(Word::Peers),
        4 => (any::<u16>(), vec(toa, 0..=MAX_CAPTURES_PER_FRAME))
            .prop_map(|(mate, captures)| Word::Captures(mate, captures)),
        2 => (any::<u16>(), time(), any::<i64>(), any::<u16>(), any::<u32>()).prop_map(
            |(sender, ahead, phase_um, rate_mmps, track_error_mm)| {
                Word::Phase { sender, ahead, phase_um, rate_mmps, track_error_mm }
            }
        ),
        1 => Just(Word::Again),
        1 => any::<u16>().prop_map(Word::Bent),
        1 => vec(any::<u8>(), 1..=MAX_FRAME).prop_map(Word::Bytes),
        1 => Just(Word::Stranger),
    ]
}

fn stretch() -> impl Strategy<Value = Stretch> {
    let gap = prop_oneof![
        12 => Just(steps_long(1)),
        2 => (0_i64..2_000_000).prop_map(TimePs::from_us),
        1 => (0_i64..200_000).prop_map(TimePs::from_ms),
        1 => (0_i64..=i64::MAX).prop_map(TimePs),
    ];
    let nav = prop_oneof![4 => Just(Nav::Obeys), 1 => Just(Nav::Gone), 5 => proptest::array::uniform7(float()).prop_map(Nav::Wild)];
    // Mostly a few, sometimes as many as there is room for.
    let words = prop_oneof![6 => vec(word(), 0..4), 1 => vec(word(), MAX_FRAMES_PER_STEP)];
    let captures = prop_oneof![3 => 0..3_usize, 1 => Just(MAX_CAPTURES_PER_STEP)]
        .prop_flat_map(|count| vec((0..OCCASIONS, any::<u32>(), 0..5_u8, any::<u16>()), count));
    let pulse = prop_oneof![9 => Just(None), 1 => any::<(u32, i32)>().prop_map(Some)];
    let attached =
        prop_oneof![4 => Just(0), 1 => 1..MAX_ATTACHED_PER_FRAME, 1 => Just(MAX_ATTACHED_PER_FRAME)]
            .prop_flat_map(|count| vec((any::<u32>(), any::<u16>()), count));
    let battery = prop_oneof![8 => 151_u16..=1_000, 1 => 0_u16..200, 1 => any::<u16>()];
    let ticks = prop_oneof![4 => Just(0_u32), 1 => any::<u32>()];
    let calm = prop_oneof![4 => 0_u16..3, 1 => 3_u16..120];
    (gap, nav, any::<bool>(), ticks, battery, pulse, captures, attached, words, calm).prop_map(
        |(gap, nav, in_air, ticks, battery_permille, pulse, captures, attached, words, calm_steps)| Stretch {
            gap,
            nav,
            in_air,
            ticks,
            battery_permille,
            pulse,
            captures,
            attached,
            words,
            calm_steps,
        },
    )
}

/// Random flights.
pub(crate) fn script() -> impl Strategy<Value = Script> {
    let epoch = prop_oneof![
        6 => Just(0_i64),
        2 => 0_i64..1_000_000_000_000_000,
        1 => i64::MAX - 3_000_000_000_000..=i64::MAX,
        1 => i64::MIN..=i64::MIN + 3_000_000_000_000,
    ];
    let reach = select(vec![
        Reach::Nothing,
        Reach::Uploaded,
        Reach::Climbing,
        Reach::Aloft,
        Reach::Sweeping,
        Reach::Sweeping,
        Reach::Going,
        Reach::Serving,
        Reach::Returning,
        Reach::Landing,
        Reach::Landed,
    ]);
    lanes()
        .prop_flat_map(|lanes| (header(lanes.len() as u16), Just(lanes)))
        .prop_flat_map(move |(header, lanes)| {
            let srs = (0..=4_u8, any::<bool>());
            (epoch.clone(), srs, Just(header), Just(lanes), reach.clone(), vec(stretch(), 0..40))
        })
        .prop_map(|(epoch, (srs_symbols, pulses), header, waypoints_mm, reach, stretches)| Script {
            epoch: TimePs(epoch),
            srs_symbols,
            pulses,
            header,
            waypoints_mm,
            reach,
            stretches,
        })
}
