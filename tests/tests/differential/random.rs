//! Random flights: a mission that is valid up to some phase, then anything that a board can be made to sense.

mod strategies;

pub(crate) use strategies::script;

use super::pair::{Pair, steps_long};
use skyroost_firmware::{
    Vec3,
    config::AgentConfig,
    counters::Counters,
    io::{Capture, Inputs, MAX_CAPTURES_PER_STEP, MAX_FRAMES_PER_STEP, NavFix, Pulse},
};
use skyroost_protocol::{
    codec::{Frame, Sender},
    message::{
        AttachedUser, CaptureEntry, ClockState, Command, Down, Heading, LanePiece, MAX_ATTACHED_PER_FRAME,
        MAX_CAPTURES_PER_FRAME, MAX_LANE_PIECE, MAX_PEERS_PER_FRAME, MAX_SRS_PER_REQUEST, Manner,
        MissionHeader, Peer, PeerState, SharedState, SrsRequest, SrsRequestEntry, Vertical, lanes_crc,
    },
    units::{
        CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId, VelEnuMmps,
    },
};

/// The drone under test and its mates.
const MATES: [DroneId; 3] = [DroneId(1), DroneId(2), DroneId(3)];
/// The only mission there is, but for wild ones.
const MISSION: MissionId = MissionId(7);
/// Occasions are few, so that captures meet them.
const OCCASIONS: u32 = 240;

/// A whole random flight.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    epoch: TimePs,
    /// Symbols of an SRS.
    srs_symbols: u8,
    /// Whether there is a pulse every second.
    pulses: bool,
    header: MissionHeader,
    waypoints_mm: Vec<[i32; 2]>,
    reach: Reach,
    stretches: Vec<Stretch>,
}

/// How far a mission goes as it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Reach {
    Nothing,
    Uploaded,
    Climbing,
    Aloft,
    Sweeping,
    Going,
    Serving,
    Returning,
    Landing,
    Landed,
}

/// A wild step, and calm ones after it.
#[derive(Clone, Debug)]
struct Stretch {
    gap: TimePs,
    nav: Nav,
    in_air: bool,
    ticks: u32,
    battery_permille: u16,
    pulse: Option<(u32, i32)>,
    /// Occasion, ticks, symbol, deviation.
    captures: Vec<(u32, u32, u8, u16)>,
    attached: Vec<(u32, u16)>,
    words: Vec<Word>,
    calm_steps: u16,
}

/// What the navigation solution says.
#[derive(Clone, Copy, Debug)]
enum Nav {
    /// That the drone does what it is told.
    Obeys,
    Gone,
    Wild([f32; 7]),
}

/// A frame; times are relative to the present.
#[derive(Clone, Debug)]
enum Word {
    Order(Order),
    Down(Down),
    Request {
        ahead: TimePs,
        spacing: TimePs,
        first: u32,
        users: Vec<(u32, u16)>,
    },
    Peers(Vec<Neighbour>),
    Captures(u16, Vec<(u32, TimePs, [i32; 3], u16, ClockState)>),
    Phase {
        sender: u16,
        ahead: TimePs,
        phase_um: i64,
        rate_mmps: u16,
        track_error_mm: u32,
    },
    /// The last frame once more.
    Again,
    /// The last frame with a bit turned.
    Bent(u16),
    Bytes(Vec<u8>),
    Stranger,
}

/// A command that makes sense.
#[derive(Clone, Copy, Debug)]
enum Order {
    TakeOff,
    Sweep,
    Place([i32; 3]),
    Hold,
    ReturnHome,
    Commit,
}

#[derive(Clone, Copy, Debug)]
struct Neighbour {
    drone: u16,
    ahead: TimePs,
    pos_mm: [i32; 3],
    vel_mmps: [i16; 3],
    error_radius_mm: u16,
    manner: Manner,
}

/// What brings a flight into its next phase.
type Deed<'a> = dyn Fn(&mut Flight) -> Result<(), String> + 'a;

/// Flies it on both.
pub(crate) struct Flight {
    pub(crate) pair: Pair,
    now: TimePs,
    pos_m: Vec3,
    inputs: Inputs,
    control: Sender,
    mates: [Sender; 2],
    last: Frame,
    command: u16,
    header: MissionHeader,
    pulses: bool,
}

impl Flight {
    pub(crate) fn new(epoch: TimePs, header: MissionHeader, srs_symbols: u8, pulses: bool) -> Self {
        let config = AgentConfig { srs_symbols, ..AgentConfig::new(MATES[0]) };
        let mut inputs = Inputs::new();
        inputs.battery_permille = 900;
        Self {
            pair: Pair::new(config, None),
            now: epoch,
            pos_m: Vec3::zeros(),
            inputs,
            control: Sender::new(DroneId::CONTROL, 1),
            mates: [Sender::new(MATES[1], 1), Sender::new(MATES[2], 1)],
            last: Frame::new(),
            command: 0,
            header,
            pulses,
        }
    }

    /// Both do a step; then time and drone move on.
    fn step(&mut self, gap: TimePs, nav: Nav) -> Result<(), String> {
        let told = self.pair.outputs().setpoint.vel_enu_mps;
        let vel_enu_mps = if told.iter().all(|v| v.is_finite()) { told } else { Vec3::zeros() };
        self.pos_m += vel_enu_mps * skyroost_firmware::STEP_S;
        self.inputs.nav = match nav {
            Nav::Obeys => Some(NavFix { pos_enu_m: self.pos_m, vel_enu_mps, error_radius_m: 2.0 }),
            Nav::Gone => None,
            Nav::Wild([px, py, pz, vx, vy, vz, error_radius_m]) => Some(NavFix {
                pos_enu_m: Vec3::new(px, py, pz),
                vel_enu_mps: Vec3::new(vx, vy, vz),
                error_radius_m,
            }),
        };
        let us = self.now.as_us();
        if self.pulses && us.rem_euclid(1_000_000) < 20_000 {
            let second = us.div_euclid(1_000_000) as i32;
            let jitter = second.wrapping_mul(7_919).rem_euclid(41) as u32;
            self.inputs
                .pulse
                .get_or_insert(Pulse { ticks: self.inputs.timer_ticks.wrapping_sub(jitter), second });
        }
        self.pair.step(self.now, &self.inputs)?;
        self.inputs.clear();
        self.inputs.timer_ticks = self.inputs.timer_ticks.wrapping_add(19_660_800);
        self.now = self.now.after(gap);
        Ok(())
    }

    pub(crate) fn calm(&mut self, steps: u16) -> Result<(), String> {
        (0..steps).try_for_each(|_| self.step(steps_long(1), Nav::Obeys))
    }

    /// Has a frame arrive with the next step; when that has no room, with one before.
    fn deliver(&mut self, frame: Frame) -> Result<(), String> {
        self.last.clone_from(&frame);
        if self.inputs.frames.is_full() {
            self.calm(1)?;
        }
        self.inputs.frames.push(frame).expect("there is room");
        Ok(())
    }

    fn say(&mut self, message: &Down) -> Result<(), String> {
        let frame = self.control.down(message).expect("a message fits a frame");
        self.deliver(frame)
    }

    fn command(&mut self, command: Command) -> Result<(), String> {
        self.command = self.command.wrapping_add(1);
        self.say(&Down::Command { id: CommandId(self.command), command })
    }

    fn upload(&mut self, waypoints_mm: &[[i32; 2]]) -> Result<(), String> {
        self.command(Command::UploadBegin(self.header))?;
        for (piece, points) in waypoints_mm.chunks(MAX_LANE_PIECE).enumerate() {
            self.say(&Down::LanePiece(LanePiece {
                mission: MISSION,
                first: (piece * MAX_LANE_PIECE) as u16,
                waypoints_mm: points.iter().copied().collect(),
            }))?;
        }
        self.command(Command::UploadCommit { mission: MISSION, lanes_crc: lanes_crc(waypoints_mm) })
    }

    fn order(&mut self, order: Order) -> Result<(), String> {
        self.command(match order {
            Order::TakeOff => Command::TakeOff,
            Order::Sweep => Command::StartSweep { at: self.now.after(steps_long(5)) },
            Order::Place(target_mm) => Command::Place { target: PosEnuMm(target_mm) },
            Order::Hold => Command::Hold,
            Order::ReturnHome => Command::ReturnHome,
            Order::Commit => Command::UploadCommit { mission: MISSION, lanes_crc: 0 },
        })
    }

    /// The mission as it should go, up to a phase; the drone jumps over long ways.
    fn reach(&mut self, reach: Reach, waypoints_mm: &[[i32; 2]]) -> Result<(), String> {
        let altitude_m = self.header.altitude_mm as f32 * 1e-3;
        let goal_m = Vec3::new(50.0, 20.0, altitude_m);
        let stages: [(Reach, &Deed<'_>); 9] = [
            (Reach::Uploaded, &|f| f.upload(waypoints_mm)),
            (Reach::Climbing, &|f| f.order(Order::TakeOff)),
            (Reach::Aloft, &|f| {
                f.pos_m.z = altitude_m;
                Ok(())
            }),
            (Reach::Sweeping, &|f| f.order(Order::Sweep)),
            (Reach::Going, &|f| f.order(Order::Place([50_000, 20_000, f.header.altitude_mm as i32]))),
            (Reach::Serving, &|f| {
                f.pos_m = goal_m;
                Ok(())
            }),
            (Reach::Returning, &|f| f.order(Order::ReturnHome)),
            (Reach::Landing, &|f| {
                f.pos_m = Vec3::from(f.header.home.0.map(|mm| mm as f32 * 1e-3));
                f.pos_m.z = altitude_m;
                // It has to come to rest before it lands.
                f.calm(400)
            }),
            (Reach::Landed, &|f| {
                f.pos_m.z = f.header.home.0[2] as f32 * 1e-3 + 0.1;
                Ok(())
            }),
        ];
        for (stage, do_it) in stages {
            if stage > reach {
                break;
            }
            do_it(self)?;
            self.calm(60)?;
        }
        Ok(())
    }

    fn word(&mut self, word: &Word) -> Result<(), String> {
        match word {
            Word::Order(order) => self.order(*order),
            Word::Down(message) => self.say(message),
            Word::Request { ahead, spacing, first, users } => {
                let entry = |&(user, serving): &(u32, u16)| SrsRequestEntry {
                    user: UserId(user),
                    serving: DroneId(serving),
                };
                self.say(&Down::SrsRequest(SrsRequest {
                    start: self.now.after(*ahead),
                    spacing: *spacing,
                    first_occasion: OccasionId(*first),
                    entries: users.iter().map(entry).collect(),
                }))
            }
            Word::Peers(neighbours) => {
                let now = self.now;
                let state = |n: &Neighbour| PeerState {
                    drone: DroneId(n.drone),
                    state: SharedState {
                        time: now.after(n.ahead),
                        pos: PosEnuMm(n.pos_mm),
                        vel: VelEnuMmps(n.vel_mmps),
                        error_radius_mm: n.error_radius_mm,
                        manner: n.manner,
                    },
                };
                self.say(&Down::Peers(neighbours.iter().map(state).collect()))
            }
            Word::Captures(mate, captures) => {
                let now = self.now;
                let entry =
                    |&(occasion, ahead, pos_mm, sigma, clock): &(u32, TimePs, [i32; 3], u16, ClockState)| {
                        CaptureEntry {
                            occasion: OccasionId(occasion),
                            toa: now.after(ahead),
                            pos: PosEnuMm(pos_mm),
                            sigma: ToaSigma(sigma),
                            clock,
                        }
                    };
                self.mate(*mate, &Peer::Captures(captures.iter().map(entry).collect()))
            }
            Word::Phase { sender, ahead, phase_um, rate_mmps, track_error_mm } => {
                let (time, phase_um) = (self.now.after(*ahead), *phase_um);
                let (rate_mmps, track_error_mm) = (*rate_mmps, *track_error_mm);
                self.mate(*sender, &Peer::SweepPhase { time, phase_um, rate_mmps, track_error_mm })
            }
            Word::Again if !self.last.is_empty() => self.deliver(self.last.clone()),
            Word::Bent(bit) if !self.last.is_empty() => {
                let mut frame = self.last.clone();
                let bit = usize::from(*bit) % (8 * frame.len());
                frame[bit / 8] ^= 1 << (bit % 8);
                self.deliver(frame)
            }
            Word::Bytes(bytes) => self.deliver(bytes.iter().copied().collect()),
            Word::Stranger => {
                let frame = Sender::new(DroneId(99), 1).peer(&Peer::Captures(heapless::Vec::new()));
                self.deliver(frame.expect("a message fits a frame"))
            }
            Word::Again | Word::Bent(_) => Ok(()),
        }
    }

    fn mate(&mut self, mate: u16, message: &Peer) -> Result<(), String> {
        let frame = self.mates[usize::from(mate) % 2].peer(message).expect("a message fits a frame");
        self.deliver(frame)
    }

    fn stretch(&mut self, stretch: &Stretch) -> Result<(), String> {
        for word in &stretch.words {
            self.word(word)?;
        }
        self.inputs.pulse = stretch.pulse.map(|(ticks, second)| Pulse { ticks, second });
        for &(occasion, ticks, symbol, sigma) in &stretch.captures {
            // Close to the counter as well, where captures really are.
            let ticks =
                if ticks % 2 == 0 { ticks } else { self.inputs.timer_ticks.wrapping_sub(ticks % 40_000_000) };
            let capture = Capture { occasion: OccasionId(occasion), ticks, symbol, sigma: ToaSigma(sigma) };
            self.inputs.captures.push(capture).expect("no more than there is room for");
        }
        for &(user, timing_advance) in &stretch.attached {
            let user = AttachedUser { user: UserId(user), timing_advance };
            self.inputs.attached.push(user).expect("no more than there is room for");
        }
        self.inputs.in_air = stretch.in_air;
        let calm = self.inputs.battery_permille;
        self.inputs.battery_permille = stretch.battery_permille;
        if stretch.ticks != 0 {
            self.inputs.timer_ticks = stretch.ticks;
        }
        self.step(stretch.gap, stretch.nav)?;
        self.inputs.battery_permille = calm;
        self.calm(stretch.calm_steps)
    }
}

impl Script {
    /// Flies it on both, and returns what both counted.
    pub(crate) fn fly(&self) -> Result<(Counters, Pair), String> {
        let mut flight = Flight::new(self.epoch, self.header, self.srs_symbols, self.pulses);
        flight.reach(self.reach, &self.waypoints_mm)?;
        for stretch in &self.stretches {
            flight.stretch(stretch)?;
        }
        let counters = flight.pair.end()?;
        Ok((counters, flight.pair))
    }
}

/// More than there is room for: of answers, of occasions, of neighbours and of captures.
pub(crate) fn flood() -> Result<Counters, String> {
    let lanes_mm = [[0, 0], [300_000, 0], [300_000, 200_000]];
    let mut flight = Flight::new(
        TimePs(0),
        MissionHeader {
            mission: MISSION,
            fleet: Some(FleetId(0)),
            mates: MATES,
            slot: 0,
            spacing_mm: 50_000,
            heading: Heading::AlongTrack,
            orientation_mrad: 0,
            speed_mmps: 10_000,
            altitude_mm: 30_000,
            home: PosEnuMm::default(),
            waypoints: lanes_mm.len() as u16,
            d_safe_mm: 10_000,
            walls: 0,
            vertical: Vertical::Preferred,
        },
        2,
        true,
    );
    flight.reach(Reach::Sweeping, &lanes_mm)?;
    let users: Vec<_> = (0..MAX_SRS_PER_REQUEST as u32).map(|user| (user, 1 + (user % 3) as u16)).collect();
    for first in (0..OCCASIONS).step_by(users.len()) {
        let (ahead, spacing) = (TimePs::from_ms(500), TimePs::from_ms(2));
        flight.word(&Word::Request { ahead, spacing, first, users: users.clone() })?;
    }
    // Every other capture that can be, twice, while gates open and close.
    for round in 0..60 {
        for place in 0..MAX_CAPTURES_PER_STEP as u32 {
            let occasion = OccasionId((round * 7 + place / 2) % OCCASIONS);
            let ticks = flight.inputs.timer_ticks.wrapping_sub(place);
            let capture = Capture { occasion, ticks, symbol: (place % 2) as u8, sigma: ToaSigma(600) };
            flight.inputs.captures.push(capture).expect("there is room");
        }
        let clock = ClockState::Locked { sigma_ns: 5 };
        let toa = |k| (round * 7 + k, TimePs::from_ms(-5), [0; 3], 600, clock);
        let toas = (0..MAX_CAPTURES_PER_FRAME as u32).map(toa);
        flight.word(&Word::Captures(round as u16, toas.collect()))?;
        flight.calm(1)?;
    }
    for first in (1..=40).step_by(MAX_PEERS_PER_FRAME) {
        let neighbour = |drone| Neighbour {
            drone,
            ahead: TimePs(-i64::from(drone)),
            pos_mm: [i32::from(drone) * 15_000, 5_000, 30_000],
            vel_mmps: [-3_000, 0, 0],
            error_radius_mm: 1_000,
            manner: Manner::ALONE,
        };
        let page = (first..first + MAX_PEERS_PER_FRAME as u16).map(neighbour);
        flight.word(&Word::Peers(page.collect()))?;
    }
    flight.calm(20)?;
    let users =
        (0..MAX_ATTACHED_PER_FRAME as u32).map(|user| AttachedUser { user: UserId(user), timing_advance: 7 });
    flight.inputs.attached.extend(users);
    for _ in 0..MAX_FRAMES_PER_STEP {
        flight.order(Order::Hold)?;
    }
    flight.step(TimePs::from_ms(61_000), Nav::Obeys)?;
    flight.calm(100)?;
    flight.pair.end()
}
