//! What the flight code costs on the board: instructions and stack, counted by the emulator.
//!
//! A search for the worst step flies one board through steps that are as full as they can be and keeps what
//! costs the most; a mission says what is usual. Both are the same in every run, as the counts are. Prints a
//! line `key value` for each figure, which `cargo xtask bench board` holds against `firmware/budgets.toml`.
//!
//! `--quick` searches less. The image is the one in `SKYROOST_BOARD_IMAGE`, or the workspace's own.

use rand_chacha::ChaCha8Rng;
use rand_core::Rng;
use skyroost_firmware::{
    STEP_US, Vec3,
    config::AgentConfig,
    io::{Capture, Inputs, MAX_CAPTURES_PER_STEP, MAX_FRAMES_PER_STEP, NavFix, Outputs, Pulse},
    peers::MAX_PEERS,
};
use skyroost_host_sim::{
    fleet::{
        Backend, Board, BoardFigures, BoardReport,
        qemu::{Emulator, Launcher, QemuOptions},
    },
    rng::{Stream, stream},
    runner::{MissionInput, RunOptions, fly},
    scenario::LoadedScenario,
};
use skyroost_protocol::{
    Frame,
    codec::{Message, Sender, decode},
    message::{
        AckStatus, AttachedUser, CaptureEntry, ClockState, Command, Down, Heading, LanePiece,
        MAX_ATTACHED_PER_FRAME, MAX_CAPTURES_PER_FRAME, MAX_LANE_PIECE, MAX_PEERS_PER_FRAME,
        MAX_SRS_PER_REQUEST, MAX_WAYPOINTS, Manner, MissionHeader, Peer, PeerState, SharedState, SrsRequest,
        SrsRequestEntry, Up, Vertical, lanes_crc,
    },
    units::{
        CommandId, DroneId, FleetId, MissionId, OccasionId, PosEnuMm, TimePs, ToaSigma, UserId, VelEnuMmps,
        mm_from_m,
    },
};
use std::{sync::atomic::AtomicBool, time::Instant};

const ME: DroneId = DroneId(1);
const MATES: [DroneId; 2] = [DroneId(2), DroneId(3)];
const MISSION: MissionId = MissionId(1);
const ALTITUDE_M: f32 = 50.0;
/// Ticks of the capture timer in a step.
const TICKS_PER_STEP: u32 = 19_660_800;
/// Occasions that a drone can know, and those of them that it can wait for captures of.
const OCCASIONS: u32 = 192;
const PAIRINGS: u32 = 32;
const SIGMA: ToaSigma = ToaSigma(600);

fn main() {
    let quick = std::env::args().any(|arg| arg == "--quick");
    let options =
        QemuOptions { image: std::env::var_os("SKYROOST_BOARD_IMAGE").map(Into::into), log_dir: None };
    let launcher = Launcher::new(&options).expect("there is an image");
    let begun = Instant::now();

    let mut sky = Sky::new(launcher.start(AgentConfig::new(ME), None).expect("the board starts"));
    let commit = sky.enter();
    let (worst, searched) = search(&mut sky, if quick { 60 } else { 500 });
    let figures = sky.figures();
    let mut stack = figures.stack_used.expect("the board measures its stack");
    let sum = figures.step_instructions_sum.expect("the emulator counts");
    let seconds = begun.elapsed().as_secs_f64();

    let boards = mission(options, if quick { 150.0 } else { 600.0 });
    let all = || boards.iter().filter_map(|report| report.board.as_ref());
    let steps: u64 = all().map(|board| u64::from(board.steps)).sum();
    let instructions: u64 = all().filter_map(|board| board.step_instructions_sum).sum();
    stack = all().filter_map(|board| board.stack_used).fold(stack, u32::max);

    println!("step_instructions_worst {worst}");
    println!("step_instructions_typical {}", instructions.div_ceil(steps));
    println!("upload_instructions_worst {commit}");
    println!("stack_bytes {stack}");
    println!(
        "worst_step_of_a_mission {}",
        all().filter_map(|b| b.step_instructions_worst).max().unwrap_or(0)
    );
    println!("steps_tried {searched}");
    println!("steps_of_missions {steps}");
    println!("steps_a_second_of_one_board {:.0}", f64::from(figures.steps) / seconds);
    println!("instructions_a_second {:.0}", sum as f64 / seconds);
}

/// The default mission on emulated boards, up to `duration_s`.
fn mission(options: QemuOptions, duration_s: f64) -> Vec<BoardReport> {
    let mut scenario = LoadedScenario::paper().scenario;
    scenario.mission.duration_s = Some(duration_s);
    let input = MissionInput::of_rectangle(scenario).expect("a square has an area");
    let cancel = AtomicBool::new(false);
    let backend = Backend::Qemu(options);
    let options = RunOptions::new(2, backend, &cancel, &|_| {});
    fly(&input, &options).expect("the default mission flies").boards
}

/// Tries steps, changes the costliest a little, and so on; the cost of the worst and how many were tried.
fn search(sky: &mut Sky, tries: u32) -> (u64, u32) {
    let mut chance = stream(1, Stream::Search, 0);
    let mut best = (0, Rush::all(Word::Strangers));
    let mut tried = 0;
    let mut attempt = |rush: Rush, best: &mut (u64, Rush)| {
        let cost = sky.cost_of(&rush);
        tried += 1;
        if cost > best.0 {
            *best = (cost, rush);
        }
    };
    // Of each kind of frame as many as there can be, then what chance finds.
    for word in WORDS {
        for waited in [Waited::Mates, Waited::Own] {
            attempt(Rush { waited, ..Rush::all(word) }, &mut best);
        }
    }
    for _ in 0..tries {
        let rush = if chance.next_u32().is_multiple_of(4) {
            Rush::any(&mut chance)
        } else {
            best.1.varied(&mut chance)
        };
        attempt(rush, &mut best);
    }
    println!("# the worst of them: {:?}", best.1);
    (best.0, tried)
}

/// What a frame says.
#[derive(Clone, Copy, Debug)]
enum Word {
    /// States of neighbours that are known.
    Neighbours,
    /// States of others, for whom known ones must go.
    Strangers,
    /// Occasions for which there is no room.
    Requests,
    /// Occasions that are known.
    KnownRequests,
    /// A mate's captures of occasions that nobody captured yet.
    Captures,
    /// A mate's captures of those that others captured.
    KnownCaptures,
    /// A piece of the lanes.
    Piece,
    /// A command that was executed before.
    Repeated,
    /// A new command.
    Command,
    /// Where a mate stands on the lanes.
    Phase,
    /// Bytes.
    Noise,
}

const WORDS: [Word; 11] = [
    Word::Neighbours,
    Word::Strangers,
    Word::Requests,
    Word::KnownRequests,
    Word::Captures,
    Word::KnownCaptures,
    Word::Piece,
    Word::Repeated,
    Word::Command,
    Word::Phase,
    Word::Noise,
];

/// Whose captures the drone has before the step, of as many occasions as it can wait for.
#[derive(Clone, Copy, Debug)]
enum Waited {
    Nobodys,
    Mates,
    Own,
}

/// Whose occasions the drone itself captures in the step.
#[derive(Clone, Copy, Debug)]
enum Captured {
    /// Its own, and nobody captured them yet.
    New,
    /// Its own, and mates captured them.
    Waited,
    /// A mate's.
    Mates,
}

/// A step as full as it can be.
#[derive(Clone, Copy, Debug)]
struct Rush {
    words: [Word; MAX_FRAMES_PER_STEP],
    waited: Waited,
    captured: Captured,
    /// Steps since then; after 25 they are waited for no longer.
    waited_steps: i64,
    /// When the gates of most occasions are due, milliseconds after the step.
    gates_ms: i64,
    /// Distance of the nearest and the farthest neighbour, metres.
    near_m: f32,
    far_m: f32,
    /// How fast they come nearer, metres a second.
    closing_mps: f32,
    /// Of the places of the neighbours.
    seed: u64,
}

fn pick<T: Copy>(chance: &mut ChaCha8Rng, among: &[T]) -> T {
    among[chance.next_u32() as usize % among.len()]
}

fn between(chance: &mut ChaCha8Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * (chance.next_u32() as f32 / u32::MAX as f32)
}

impl Rush {
    /// Frames of one kind, and of everything else the most.
    const fn all(word: Word) -> Self {
        Self {
            words: [word; MAX_FRAMES_PER_STEP],
            waited: Waited::Mates,
            captured: Captured::New,
            waited_steps: 25,
            gates_ms: 30,
            near_m: 20.0,
            far_m: 60.0,
            closing_mps: 6.0,
            seed: 0,
        }
    }

    fn any(chance: &mut ChaCha8Rng) -> Self {
        let mut rush = Self::all(Word::Noise);
        for _ in 0..40 {
            rush = rush.varied(chance);
        }
        rush
    }

    /// Something of it otherwise.
    fn varied(mut self, chance: &mut ChaCha8Rng) -> Self {
        match chance.next_u32() % 8 {
            0 => self.waited = pick(chance, &[Waited::Nobodys, Waited::Mates, Waited::Own]),
            1 => self.captured = pick(chance, &[Captured::New, Captured::Waited, Captured::Mates]),
            2 => self.waited_steps = pick(chance, &[2, 10, 24, 25]),
            3 => self.gates_ms = pick(chance, &[-20, 20, 30, 200]),
            4 => {
                self.near_m = between(chance, 0.0, 60.0);
                self.far_m = self.near_m + between(chance, 0.0, 200.0);
            }
            5 => (self.closing_mps, self.seed) = (between(chance, 0.5, 12.0), chance.next_u64()),
            _ => {
                for _ in 0..=chance.next_u32() % 4 {
                    self.words[chance.next_u32() as usize % MAX_FRAMES_PER_STEP] = pick(chance, &WORDS);
                }
            }
        }
        self
    }
}

/// One board and all that it hears.
struct Sky {
    board: Emulator,
    inputs: Inputs,
    outputs: Outputs,
    step: i64,
    control: Sender,
    mates: [Sender; 2],
    command: CommandId,
    /// The next number that no occasion and no drone has had.
    unused: u32,
}

impl Sky {
    fn new(board: Emulator) -> Self {
        Self {
            board,
            inputs: Inputs::new(),
            outputs: Outputs::new(),
            step: 0,
            control: Sender::new(DroneId::CONTROL, 1),
            mates: MATES.map(|mate| Sender::new(mate, 1)),
            command: CommandId(0),
            unused: 100,
        }
    }

    fn figures(&mut self) -> BoardFigures {
        self.board.report().expect("the board reports").board.expect("it is a board")
    }

    /// One step; a drone that stands where it is.
    fn step(&mut self) {
        self.inputs.battery_permille = 900;
        self.inputs.timer_ticks = TICKS_PER_STEP.wrapping_mul(self.step as u32);
        // Once a second, when all that is sent once a second is sent.
        self.inputs.pulse = (self.step % 50 == 0)
            .then_some(Pulse { ticks: self.inputs.timer_ticks, second: (self.step / 50) as i32 });
        self.inputs.nav = Some(NavFix {
            pos_enu_m: Vec3::new(0.0, 0.0, ALTITUDE_M),
            vel_enu_mps: Vec3::new(6.0, 1.0, 0.3),
            error_radius_m: 1.0,
        });
        self.outputs.clear();
        let now = self.after_ms(0);
        self.board.begin_step(now, &self.inputs, &mut self.outputs).expect("the board steps");
        self.board.end_step(&mut self.outputs).expect("the board steps");
        self.inputs.clear();
        self.step += 1;
    }

    /// One step and its instructions.
    fn cost(&mut self) -> u64 {
        let sum = |figures: BoardFigures| figures.step_instructions_sum.expect("the emulator counts");
        let before = sum(self.figures());
        self.step();
        sum(self.figures()) - before
    }

    /// So many milliseconds after the step to come.
    fn after_ms(&self, ms: i64) -> TimePs {
        TimePs::from_us(self.step * STEP_US + 1000 * ms)
    }

    fn hear(&mut self, frame: Frame) {
        self.inputs.frames.push(frame).expect("a step has room for its frames");
    }

    fn tell(&mut self, message: &Down) {
        let frame = self.control.down(message).expect("a frame holds every message");
        self.hear(frame);
    }

    fn put_command(&mut self, command: Command) {
        self.command.0 += 1;
        self.tell(&Down::Command { id: self.command, command });
    }

    /// Whether the last command was accepted in the last step.
    fn accepted(&self) -> bool {
        self.outputs.uplink.iter().any(|frame| {
            let Ok((_, Message::Up(Up::CommandAck { command, status }))) = decode(frame) else {
                return false;
            };
            command == self.command && status == AckStatus::Accepted
        })
    }

    /// Has a command done in a step and returns its instructions.
    fn command(&mut self, command: Command) -> u64 {
        self.put_command(command);
        let cost = self.cost();
        assert!(self.accepted(), "the drone obeys");
        cost
    }

    /// Into the air and, among neighbours, onto the longest lanes there can be. Returns what it costs to make
    /// those ready.
    fn enter(&mut self) -> u64 {
        let short = [[0, 0], [90_000, 0]];
        self.upload(MISSION, &short);
        self.command(Command::TakeOff);
        self.step();
        // Corners all the way, none like the other.
        let corner = |k: usize| [40_000 * k as i32, (k * k * 7_919 % 90_000) as i32];
        let longest: Vec<[i32; 2]> = (0..MAX_WAYPOINTS).map(corner).collect();
        self.put_crowd(&Rush::all(Word::Neighbours));
        self.step();
        let cost = self.upload(MissionId(MISSION.0 + 1), &longest);
        self.command(Command::StartSweep { at: self.after_ms(0) });
        cost
    }

    /// Uploads lanes; returns what the commit costs.
    fn upload(&mut self, mission: MissionId, lanes_mm: &[[i32; 2]]) -> u64 {
        self.command(Command::UploadBegin(header(mission, lanes_mm.len())));
        for (index, waypoints_mm) in lanes_mm.chunks(MAX_LANE_PIECE).enumerate() {
            if self.inputs.frames.is_full() {
                self.step();
            }
            self.tell(&piece(mission, index * MAX_LANE_PIECE, waypoints_mm));
        }
        self.step();
        self.command(Command::UploadCommit { mission, lanes_crc: lanes_crc(lanes_mm) })
    }

    /// The instructions of a step that begins with full tables, with everything due that is sent at times.
    fn cost_of(&mut self, rush: &Rush) -> u64 {
        // Telemetry is sent at the second, so it is due then; so is all that is sent more often.
        let at = (self.step + 40 + 49) / 50 * 50;
        self.idle_until(at - 38);
        // Those of the first request are over in the step, and forgotten.
        let first = self.take_unused(OCCASIONS);
        for request in 0..OCCASIONS / MAX_SRS_PER_REQUEST as u32 {
            let ms = if request == 0 { 38 * 20 - 601 } else { 38 * 20 + rush.gates_ms };
            self.put_request(OccasionId(first + request * MAX_SRS_PER_REQUEST as u32), ms);
        }
        self.idle_until(at - rush.waited_steps);
        // The middle of the table are those waited for, and its end those that come new.
        let waited = first + 32;
        match rush.waited {
            Waited::Nobodys => {}
            Waited::Mates => {
                for page in 0..7 {
                    self.put_captures(page as usize % 2, waited + page * MAX_CAPTURES_PER_FRAME as u32);
                }
            }
            Waited::Own => {
                self.put_own_captures(waited);
                self.step();
                self.put_own_captures(waited + MAX_CAPTURES_PER_STEP as u32);
            }
        }
        self.step();
        self.idle_until(at - 1);
        self.put_crowd(rush);
        self.step();

        let mut new = waited + PAIRINGS + 8;
        for (index, word) in rush.words.into_iter().enumerate() {
            match word {
                Word::Neighbours => self.put_page(rush, index % 7, 0),
                Word::Strangers => {
                    let id = self.take_unused(MAX_PEERS_PER_FRAME as u32);
                    self.put_page(rush, index % 7, (id % 3_000) as u16);
                }
                Word::Requests => {
                    let occasion = self.take_unused(MAX_SRS_PER_REQUEST as u32);
                    self.put_request(OccasionId(occasion), 40);
                }
                Word::KnownRequests => self.put_request(OccasionId(first + 180), 40),
                Word::Captures => {
                    self.put_captures(index % 2, new);
                    new += MAX_CAPTURES_PER_FRAME as u32;
                }
                Word::KnownCaptures => {
                    self.put_captures(index % 2, waited + (index as u32 * 5) % (PAIRINGS - 5));
                }
                Word::Piece => {
                    let waypoints_mm = [[123_456, -654_321]; MAX_LANE_PIECE];
                    let mission = MissionId(MISSION.0 + 1);
                    self.tell(&piece(mission, index * MAX_LANE_PIECE, &waypoints_mm));
                }
                Word::Repeated => {
                    let command = Command::UploadBegin(header(MISSION, MAX_WAYPOINTS));
                    self.tell(&Down::Command { id: self.command, command });
                }
                Word::Command => {
                    // Refused, so that the sweep goes on.
                    self.put_command(Command::UploadCommit { mission: MISSION, lanes_crc: u32::MAX });
                }
                Word::Phase => {
                    let time = self.after_ms(-30);
                    let message =
                        Peer::SweepPhase { time, phase_um: 900_000, rate_mmps: 4_000, track_error_mm: 1_000 };
                    let frame = self.mates[index % 2].peer(&message).expect("a frame holds every message");
                    self.hear(frame);
                }
                Word::Noise => self.hear(Frame::from_slice(&[0x53; 200]).expect("short enough")),
            }
        }
        self.put_own_captures(match rush.captured {
            Captured::New => new,
            Captured::Waited => waited,
            Captured::Mates => first + 12,
        });
        let user = |k| AttachedUser { user: UserId(u32::MAX - k), timing_advance: u16::MAX - k as u16 };
        self.inputs.attached = (0..MAX_ATTACHED_PER_FRAME as u32).map(user).collect();
        self.cost()
    }

    fn idle_until(&mut self, step: i64) {
        while self.step < step {
            if self.step % 25 == 0 {
                self.tell(&Down::Heartbeat);
            }
            self.step();
        }
    }

    fn take_unused(&mut self, count: u32) -> u32 {
        self.unused += count;
        self.unused - count
    }

    /// Announces a request's worth of occasions. A mate serves the second dozen, this drone all others.
    fn put_request(&mut self, first: OccasionId, ms: i64) {
        let mates_turn = self.inputs.frames.len() == 1;
        let serving = if mates_turn { MATES[0] } else { ME };
        let entry = |k| SrsRequestEntry { user: UserId(u32::MAX - k), serving };
        self.tell(&Down::SrsRequest(SrsRequest {
            start: self.after_ms(ms),
            spacing: TimePs(0),
            first_occasion: first,
            entries: (0..MAX_SRS_PER_REQUEST as u32).map(entry).collect(),
        }));
    }

    fn put_captures(&mut self, mate: usize, first: u32) {
        let toa = self.after_ms(-10);
        let entry = |k| CaptureEntry {
            occasion: OccasionId(first + k),
            toa,
            pos: PosEnuMm([1_234_567, -2_345_678, 345_678]),
            sigma: SIGMA,
            clock: ClockState::Locked { sigma_ns: 300 },
        };
        let entries = (0..MAX_CAPTURES_PER_FRAME as u32).map(entry).collect();
        let frame = self.mates[mate].peer(&Peer::Captures(entries)).expect("a frame holds every message");
        self.hear(frame);
    }

    fn put_own_captures(&mut self, first: u32) {
        let ticks = TICKS_PER_STEP.wrapping_mul(self.step as u32).wrapping_sub(1_234_567);
        let capture = |k| Capture { occasion: OccasionId(first + k), ticks, symbol: 0, sigma: SIGMA };
        self.inputs.captures = (0..MAX_CAPTURES_PER_STEP as u32).map(capture).collect();
    }

    /// As many neighbours as are kept, where `rush` has them.
    fn put_crowd(&mut self, rush: &Rush) {
        for page in 0..MAX_PEERS.div_ceil(MAX_PEERS_PER_FRAME) {
            self.put_page(rush, page, 0);
        }
    }

    /// A page of neighbours, or of others in their places, all on their way here.
    fn put_page(&mut self, rush: &Rush, page: usize, strangers: u16) {
        let ids = page * MAX_PEERS_PER_FRAME..((page + 1) * MAX_PEERS_PER_FRAME).min(MAX_PEERS);
        let states = ids.map(|id| {
            let mut chance = stream(rush.seed, Stream::Search, 1 + id as u64);
            let towards =
                Vec3::from_fn(|row, _| between(&mut chance, -1.0, 1.0) * if row == 2 { 0.3 } else { 1.0 });
            let towards = towards / towards.norm().max(0.1);
            let aside = Vec3::new(-towards.y, towards.x, 0.0) * between(&mut chance, -1.0, 1.0);
            let from_m = towards * between(&mut chance, rush.near_m, rush.far_m);
            let state = SharedState {
                time: self.after_ms(-30),
                pos: PosEnuMm((from_m + Vec3::new(0.0, 0.0, ALTITUDE_M)).map(mm_from_m).into()),
                vel: VelEnuMmps::from_mps((aside - towards * rush.closing_mps).into()),
                error_radius_mm: 1_500,
                // Some crowds are fleets in formation, which take looking for their mates.
                manner: if rush.seed.is_multiple_of(3) {
                    Manner::formation(FleetId(id as u16 / 3))
                } else {
                    Manner::ALONE
                },
            };
            PeerState { drone: DroneId(10 + strangers + id as u16), state }
        });
        let message = Down::Peers(states.collect());
        self.tell(&message);
    }
}

fn header(mission: MissionId, waypoints: usize) -> MissionHeader {
    MissionHeader {
        mission,
        fleet: Some(FleetId(0)),
        mates: [ME, MATES[0], MATES[1]],
        slot: 0,
        spacing_mm: 50_000,
        heading: Heading::AlongTrack,
        orientation_mrad: 1_000,
        speed_mmps: 10_000,
        altitude_mm: (ALTITUDE_M * 1e3) as u32,
        home: PosEnuMm([0, 0, 0]),
        waypoints: waypoints as u16,
        d_safe_mm: 10_000,
        walls: 0,
        vertical: Vertical::Preferred,
    }
}

fn piece(mission: MissionId, first: usize, waypoints_mm: &[[i32; 2]]) -> Down {
    let waypoints_mm = waypoints_mm.iter().copied().collect();
    Down::LanePiece(LanePiece { mission, first: first as u16, waypoints_mm })
}
