//! What targets of links begin with: every message there is, framed as it crosses each link.

use super::links::{ME, STAMP, autopilot_payload, bus_payload, genuine, talk};
use skyroost_firmware::{
    board::{
        autopilot::{self, FROM_AUTOPILOT, FromAutopilot, TO_AUTOPILOT, ToAutopilot},
        bus::{self, Begin, FromBoard, SensePart, StepHead, ToBoard},
        provision::Provision,
    },
    config::AgentConfig,
    io::{NavFix, Outputs},
};
use skyroost_protocol::{
    Frame, HEADER_LEN, Key, MAX_FRAME, PROTOCOL_VERSION, SCHEMA_HASH, Sender, StreamFrame, encode_stream,
    key::KEY_LEN,
    manage::{self, Identity, Management},
    message::{
        AckStatus, Attached, AttachedUser, CaptureEntry, ClockState, Command, Down, EventCode, FlightPhase,
        Heading, LanePiece, Manner, MateTdoa, MissionHeader, Peer, PeerState, SharedState, SrsRequest,
        SrsRequestEntry, TdoaCounts, TdoaEntry, TdoaFlags, Telemetry, Up, Vertical, lanes_crc,
    },
    units::{
        CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TdoaPs, TimePs, ToaSigma, UserId,
        VelEnuMmps,
    },
};

fn state() -> SharedState {
    SharedState {
        time: TimePs::from_ms(61_000),
        pos: PosEnuMm([100_000, -50_000, 60_000]),
        vel: VelEnuMmps([1_000, -2_000, 0]),
        error_radius_mm: 2_000,
        manner: Manner::ALONE,
    }
}

pub(super) fn ups() -> Vec<Up> {
    let mate = MateTdoa {
        drone: DroneId(2),
        tdoa: TdoaPs(-77_000),
        pos: PosEnuMm([1, 2, 3]),
        sigma: ToaSigma(600),
        flags: TdoaFlags(0),
    };
    let entry = TdoaEntry {
        occasion: OccasionId(12),
        user: UserId(34),
        time: TimePs::from_ms(5),
        pos: PosEnuMm([4, 5, 6]),
        sigma: ToaSigma(600),
        mates: [mate, mate].into_iter().collect(),
    };
    let users = (0..5).map(|user| AttachedUser { user: UserId(user), timing_advance: 9 });
    vec![
        Up::Hello {
            version_min: PROTOCOL_VERSION,
            version_max: PROTOCOL_VERSION,
            schema_hash: SCHEMA_HASH,
            capture_ticks: 983_040_000,
            capture_ps: 1_000_000_000_000,
        },
        Up::CommandAck { command: CommandId(300), status: AckStatus::Incomplete { first_missing: 4 } },
        Up::Heartbeat,
        Up::SharedState(state()),
        Up::Telemetry(Telemetry {
            time: TimePs::from_ms(61_000),
            phase: FlightPhase::Sweep,
            mission: Some(MissionId(1)),
            sweep_phase_mm: 123_456,
            track_error_mm: 70,
            battery_permille: 900,
            conditions: 5,
            frames_lost: 1,
            frames_rejected: 2,
            dropped: 3,
            clock: ClockState::Held { sigma_ns: 40 },
            tdoa: TdoaCounts::NONE,
        }),
        Up::Attached(Attached { time: TimePs::from_ms(7), users: users.collect() }),
        Up::Tdoa([entry].into_iter().collect()),
        Up::Event { code: EventCode::PhaseEntered, time: TimePs::from_ms(9), value: 3 },
    ]
}

const LANES_MM: [[i32; 2]; 3] = [[0, 0], [400_000, 0], [400_000, 90_000]];

fn commands() -> Vec<Command> {
    let mission = MissionId(1);
    let header = MissionHeader {
        mission,
        fleet: Some(FleetId(0)),
        mates: [ME, DroneId(2), DroneId(3)],
        slot: 0,
        spacing_mm: 50_000,
        heading: Heading::Fixed,
        orientation_mrad: 0,
        speed_mmps: 10_000,
        altitude_mm: 50_000,
        home: PosEnuMm([0, 0, 0]),
        waypoints: LANES_MM.len() as u16,
        d_safe_mm: 10_000,
        walls: 0,
        vertical: Vertical::Preferred,
    };
    vec![
        Command::UploadBegin(header),
        Command::UploadCommit { mission, lanes_crc: lanes_crc(&LANES_MM) },
        Command::TakeOff,
        Command::StartSweep { at: TimePs::from_ms(1_000) },
        Command::Place { target: PosEnuMm([100_000, 0, 50_000]) },
        Command::Hold,
        Command::ReturnHome,
        Command::Rekey(Key::new([1; KEY_LEN])),
        Command::PeerKey(Key::new([2; KEY_LEN])),
    ]
}

fn lane_piece() -> Down {
    Down::LanePiece(LanePiece {
        mission: MissionId(1),
        first: 0,
        waypoints_mm: LANES_MM.into_iter().collect(),
    })
}

pub(super) fn downs() -> Vec<Down> {
    let entries = (0..3).map(|user| SrsRequestEntry { user: UserId(user), serving: ME });
    let request = SrsRequest {
        start: TimePs::from_ms(200),
        spacing: TimePs::from_ms(10),
        first_occasion: OccasionId(5),
        entries: entries.collect(),
    };
    let neighbours = (2..5).map(|drone| PeerState { drone: DroneId(drone), state: state() });
    let mut all = vec![
        Down::Welcome { version: PROTOCOL_VERSION, schema_hash: SCHEMA_HASH, resumes: false },
        Down::Heartbeat,
        lane_piece(),
        Down::SrsRequest(request),
        Down::Peers(neighbours.collect()),
    ];
    all.extend((1..).zip(commands()).map(|(id, command)| Down::Command { id: CommandId(id), command }));
    all
}

fn peers() -> Vec<Peer> {
    let capture = CaptureEntry {
        occasion: OccasionId(5),
        toa: TimePs::from_ms(3),
        pos: PosEnuMm([7, 8, 9]),
        sigma: ToaSigma(600),
        clock: ClockState::Locked { sigma_ns: 3 },
    };
    vec![
        Peer::Captures([capture].into_iter().collect()),
        Peer::SweepPhase { time: TimePs::from_ms(5), phase_um: 9, rate_mmps: 10_000, track_error_mm: 50 },
    ]
}

pub(super) fn frames() -> Vec<Vec<u8>> {
    let mut sender = Sender::new(ME, 3);
    let mut all: Vec<Frame> = ups().iter().map(|up| sender.up(up).expect("it fits")).collect();
    all.extend(downs().iter().map(|down| sender.down(down).expect("it fits")));
    all.extend(peers().iter().map(|peer| sender.peer(peer).expect("it fits")));
    all.iter().map(|frame| frame.to_vec()).collect()
}

pub(super) fn bodies() -> Vec<Vec<u8>> {
    let body = |frame: &Vec<u8>| [&[frame[3] - 1], &frame[HEADER_LEN..]].concat();
    frames().iter().map(body).collect()
}

pub(super) fn sealed_frames() -> Vec<Vec<u8>> {
    genuine().iter().map(|frame| frame.to_vec()).collect()
}

pub(super) fn management_frames() -> Vec<Vec<u8>> {
    let of = |message: Management, key: Option<&Key>| {
        let mut frame = [0; MAX_FRAME];
        let length = manage::encode_into(&STAMP, &message, key, &mut frame).expect("it fits");
        frame[..length].to_vec()
    };
    let other = Key::new([8; KEY_LEN]);
    vec![
        of(Management::Identify, None),
        of(Management::Identity(Identity::OWN), None),
        of(Management::Identity(Identity::OWN), Some(&other)),
    ]
}

pub(super) fn streams() -> Vec<Vec<u8>> {
    let coded = |frame: &Vec<u8>| {
        let mut coded = StreamFrame::new();
        encode_stream(frame, &mut coded).expect("it fits");
        coded.to_vec()
    };
    frames().chunks(3).map(|frames| frames.iter().flat_map(coded).collect()).collect()
}

fn to_board() -> Vec<Vec<u8>> {
    let config = AgentConfig::new(ME);
    let nav = NavFix {
        pos_enu_m: skyroost_firmware::Vec3::new(1.0, 2.0, 3.0),
        vel_enu_mps: skyroost_firmware::Vec3::new(0.0, f32::NAN, 0.0),
        error_radius_m: 2.0,
    };
    let begin = Begin {
        bus_version: bus::BUS_VERSION,
        schema_hash: SCHEMA_HASH,
        radio_part: 200,
        config: (&config).into(),
        key: Some(Key::new([3; KEY_LEN])),
    };
    let head = StepHead {
        now: TimePs::from_ms(20),
        nav: Some(nav.into()),
        in_air: true,
        timer_ticks: 5,
        pulse: None,
        battery_permille: 900,
    };
    let attached = [AttachedUser { user: UserId(4), timing_advance: 5 }];
    let parts = [SensePart::Radio(&[0, 1, 2, 0]), SensePart::Attached(attached.into_iter().collect())];
    let mut all = vec![bus_payload(&ToBoard::Begin(begin))];
    all.extend((0..).zip(parts).map(|(index, part)| bus_payload(&ToBoard::Sense { step: 1, index, part })));
    all.push(bus_payload(&ToBoard::Step { step: 1, parts: 2, have: 0, attempt: 0, head }));
    all.push(bus_payload(&ToBoard::Step { step: 2, parts: 0, have: 0, attempt: 0, head }));
    all.push(bus_payload(&ToBoard::Report));
    all
}

pub(super) fn bus_messages() -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = to_board().iter().map(|message| [&[0], &message[..]].concat()).collect();
    let setpoint = Outputs::new().setpoint.into();
    for message in [
        FromBoard::Ready { bus_version: bus::BUS_VERSION, schema_hash: SCHEMA_HASH, id: ME },
        FromBoard::Damaged,
        FromBoard::Missing { step: 3, next: 4, attempt: 5 },
        FromBoard::Act { step: 3, index: 0, part: bus::ActPart::Radio(&[1, 2, 3]) },
        FromBoard::Done { step: 3, parts: 4, attempt: 5, setpoint, cost: 6 },
    ] {
        all.push([&[1], &bus_payload(&message)[..]].concat());
    }
    all
}

pub(super) fn lockstep_talks() -> Vec<Vec<u8>> {
    vec![talk(&to_board())]
}

fn from_autopilot() -> Vec<Vec<u8>> {
    let fix = NavFix {
        pos_enu_m: skyroost_firmware::Vec3::new(1.0, 2.0, 3.0),
        vel_enu_mps: skyroost_firmware::Vec3::zeros(),
        error_radius_m: 2.0,
    };
    let users = [AttachedUser { user: UserId(4), timing_advance: 5 }];
    [
        FromAutopilot::Configure { drone: ME, epoch_gps_s: 1_400_000_000 },
        FromAutopilot::Nav { nav: Some(fix.into()), in_air: true, battery_permille: 900 },
        FromAutopilot::Nav { nav: None, in_air: false, battery_permille: 900 },
        FromAutopilot::Second { gps_s: 1_400_000_007 },
        FromAutopilot::Attached(users.into_iter().collect()),
    ]
    .iter()
    .map(|message| autopilot_payload(FROM_AUTOPILOT, message))
    .collect()
}

pub(super) fn autopilot_messages() -> Vec<Vec<u8>> {
    let mut all = from_autopilot();
    let setpoint = Outputs::new().setpoint.into();
    for message in [
        ToAutopilot::Started(autopilot::Start::default()),
        ToAutopilot::Setpoint { now: TimePs::from_ms(20), setpoint },
        ToAutopilot::Status(autopilot::Status::default()),
    ] {
        all.push(autopilot_payload(TO_AUTOPILOT, &message));
    }
    all
}

pub(super) fn autopilot_talks() -> Vec<Vec<u8>> {
    // Ten seconds of pulses and their numbers, 50 steps of the counter apart.
    let mut long = from_autopilot();
    for second in 0..10 {
        long.push(vec![0]);
        let said = FromAutopilot::Second { gps_s: 1_400_000_000 + second };
        long.push(autopilot_payload(FROM_AUTOPILOT, &said));
        long.extend((0..48).map(|_| vec![2]));
    }
    vec![talk(&from_autopilot()), talk(&long)]
}

pub(super) fn provisions() -> Vec<Vec<u8>> {
    let of = |key| Provision { drone: ME, key }.to_bytes().to_vec();
    vec![of(None), of(Some(Key::new([4; KEY_LEN])))]
}

pub(super) fn agent_talks() -> Vec<Vec<u8>> {
    let mut sender = Sender::new(DroneId::CONTROL, 3);
    let mut said: Vec<Down> = Vec::new();
    let upload = commands();
    let mut id = 0;
    let mut command = |command: &Command| {
        id += 1;
        Down::Command { id: CommandId(id), command: command.clone() }
    };
    said.push(command(&upload[0]));
    said.push(lane_piece());
    said.extend(upload[1..7].iter().map(&mut command));
    said.extend(downs());
    let frames: Vec<Vec<u8>> = said.iter().map(|down| sender.down(down).expect("it fits").to_vec()).collect();
    vec![talk(&frames)]
}
