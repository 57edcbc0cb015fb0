use super::*;
use proptest::{collection::vec, prelude::*};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use skyroost_firmware::{
    Vec3,
    agent::FlightAgent,
    board::lockstep::{Ask, Lockstep, RadioIntake},
    io::{Capture, NavFix, Pulse},
};
use skyroost_protocol::{
    codec::Sender,
    message::{AttachedUser, Command, Down},
    units::{CommandId, DroneId, OccasionId, PosEnuMm, ToaSigma, UserId},
};
use std::collections::VecDeque;

/// A board in this process at the other end of a link that damages bytes.
struct Loopback {
    lockstep: Lockstep,
    agent: FlightAgent,
    inputs: Inputs,
    outputs: Outputs,
    radio: RadioIntake,
    to_host: VecDeque<u8>,
    chance: ChaCha8Rng,
    /// One byte in so many is damaged, in each direction; none for 0.
    damage_one_in: u32,
    steps: u32,
}

impl Loopback {
    fn new(seed: u64, damage_one_in: u32) -> Self {
        Self {
            lockstep: Lockstep::new(),
            agent: FlightAgent::new(AgentConfig::new(DroneId(9)), None),
            inputs: Inputs::default(),
            outputs: Outputs::default(),
            radio: RadioIntake::new(),
            to_host: VecDeque::new(),
            chance: ChaCha8Rng::seed_from_u64(seed),
            damage_one_in,
            steps: 0,
        }
    }

    fn damaged(&mut self, byte: u8) -> u8 {
        if self.damage_one_in > 0 && self.chance.next_u32().is_multiple_of(self.damage_one_in) {
            byte ^ (1 << (self.chance.next_u32() % 8))
        } else {
            byte
        }
    }

    fn say(&mut self, message: &FromBoard<'_>) {
        let mut frame = StreamFrame::new();
        assert!(encode(message, &mut frame));
        self.put(&frame);
    }

    fn put(&mut self, frame: &StreamFrame) {
        for byte in frame {
            let byte = self.damaged(*byte);
            self.to_host.push_back(byte);
        }
    }

    /// Takes bytes up to the end of the first message among them, and says how many.
    fn hear(&mut self, bytes: &[u8]) -> usize {
        let mut lockstep = std::mem::take(&mut self.lockstep);
        let (taken, ask) = lockstep.take(bytes, &mut self.inputs);
        match ask {
            None => {}
            Some(Ask::Begin(config, _)) => {
                self.agent = FlightAgent::new(config, None);
                self.say(&lockstep.begun().expect("it has begun"));
            }
            Some(Ask::Radio(bytes)) => self.radio.take(bytes, &mut self.inputs),
            Some(Ask::Step { now, have }) => {
                self.outputs.clear();
                self.agent.step(now, &self.inputs, &mut self.outputs);
                self.inputs.clear();
                self.steps += 1;
                lockstep.stepped(self.steps);
                self.answer(&lockstep, have);
            }
            Some(Ask::Answer { have }) => self.answer(&lockstep, have),
            Some(Ask::Say(message)) => self.say(&message),
            Some(Ask::Report) => {
                let report = lockstep.report(self.agent.counters(), &self.radio, 0);
                self.say(&report);
            }
        }
        self.lockstep = lockstep;
        taken
    }

    fn answer(&mut self, lockstep: &Lockstep, have: u16) {
        let outputs = self.outputs.clone();
        let mut answer = lockstep.answer(have, &outputs);
        let mut frame = StreamFrame::new();
        while answer.next_frame(&mut frame) {
            self.put(&frame);
        }
    }
}

impl Transport for Loopback {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let bytes: Vec<u8> = bytes.iter().map(|byte| self.damaged(*byte)).collect();
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            rest = &rest[self.hear(rest)..];
        }
        Ok(())
    }

    fn receive(&mut self, bytes: &mut [u8], _: Duration) -> io::Result<usize> {
        let count = bytes.len().min(self.to_host.len());
        for (to, from) in bytes.iter_mut().zip(self.to_host.drain(..count)) {
            *to = from;
        }
        Ok(count)
    }
}

/// Any inputs at all, buffers full or empty.
fn inputs() -> impl Strategy<Value = Inputs> {
    let number = prop_oneof![any::<f32>(), -1e4_f32..1e4, any::<u32>().prop_map(f32::from_bits)];
    let nav = prop::option::of((vec(number, 7),).prop_map(|(n,)| NavFix {
        pos_enu_m: Vec3::new(n[0], n[1], n[2]),
        vel_enu_mps: Vec3::new(n[3], n[4], n[5]),
        error_radius_m: n[6],
    }));
    let pulse =
        prop::option::of((any::<u32>(), any::<i32>()).prop_map(|(ticks, second)| Pulse { ticks, second }));
    let captures = vec((any::<u32>(), any::<u32>(), any::<u8>(), any::<u16>()), 0..=16);
    let attached = vec((any::<u32>(), any::<u16>()), 0..=24);
    let commands = prop_oneof![
        Just(Command::TakeOff),
        Just(Command::Hold),
        Just(Command::ReturnHome),
        any::<[i32; 3]>().prop_map(|mm| Command::Place { target: PosEnuMm(mm) }),
    ];
    let frames = vec(
        prop_oneof![
            vec(any::<u8>(), 1..200).prop_map(|bytes| Frame::from_slice(&bytes).unwrap()),
            (commands, any::<u16>(), any::<u32>()).prop_map(|(command, id, _)| {
                let down = Down::Command { id: CommandId(id), command };
                Sender::new(DroneId::CONTROL, id).down(&down).unwrap()
            }),
        ],
        0..=16,
    );
    (nav, any::<bool>(), pulse, captures, attached, frames, any::<u32>(), any::<u16>()).prop_map(
        |(nav, in_air, pulse, captures, attached, frames, timer_ticks, battery_permille)| Inputs {
            nav,
            in_air,
            timer_ticks,
            pulse,
            captures: captures
                .into_iter()
                .map(|(occasion, ticks, symbol, sigma)| Capture {
                    occasion: OccasionId(occasion),
                    ticks,
                    symbol,
                    sigma: ToaSigma(sigma),
                })
                .collect(),
            attached: attached
                .into_iter()
                .map(|(user, timing_advance)| AttachedUser { user: UserId(user), timing_advance })
                .collect(),
            frames: frames.into_iter().collect(),
            battery_permille,
        },
    )
}

/// Runs `steps` directly and over a bus, and compares every output.
fn same_over_the_bus(seed: u64, damage_one_in: u32, steps: &[Inputs]) -> BusCounters {
    let config = AgentConfig::new(DroneId(3));
    let mut direct = FlightAgent::new(config, None);
    let link = match damage_one_in {
        0 => LinkKind::LOSSLESS,
        _ => LinkKind { resend_after: Some(Duration::ZERO), radio_part: 48, window: 6 },
    };
    let mut bus = BusClient::new(Loopback::new(seed, damage_one_in), link);
    bus.begin(&config, None).unwrap();
    for (index, inputs) in steps.iter().enumerate() {
        let now = TimePs::from_ms(20 * index as i64);
        let (mut expected, mut found) = (Outputs::default(), Outputs::default());
        direct.step(now, inputs, &mut expected);
        bus.begin_step(now, inputs).unwrap();
        bus.end_step(&mut found).unwrap();
        // As text, since the NaN of a setpoint equals no other.
        assert_eq!(format!("{found:?}"), format!("{expected:?}"), "step {index}, seed {seed}");
    }
    assert_eq!(bus.transport.steps as usize, steps.len(), "each step is done once");
    let report = bus.report().unwrap();
    assert_eq!(report.counters, direct.counters().to_array());
    assert_eq!((report.link.radio_damaged, report.link.inputs_overflowed), (0, 0));
    *bus.counters()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_step_over_the_bus_is_the_step_itself(steps in vec(inputs(), 1..20)) {
        let counters = same_over_the_bus(0, 0, &steps);
        prop_assert_eq!((counters.damaged, counters.resent), (0, 0));
        prop_assert_eq!(counters.steps as usize, steps.len());
    }

    /// One byte in a hundred is damaged, either way: nothing is lost, nothing is done twice.
    #[test]
    fn a_damaged_link_loses_nothing(steps in vec(inputs(), 1..20), seed: u64) {
        same_over_the_bus(seed, 100, &steps);
    }
}

#[test]
fn damage_is_seen_and_mended() {
    let steps = vec![Inputs::default(); 500];
    let counters = same_over_the_bus(7, 100, &steps);
    assert!(counters.damaged > 100 && counters.resent > 100, "{counters:?}");
}

#[test]
fn damage_where_there_should_be_none_is_a_fault() {
    let config = AgentConfig::new(DroneId(3));
    let faults: Vec<BoardFault> = (0..20)
        .filter_map(|seed| {
            let mut bus = BusClient::new(Loopback::new(seed, 40), LinkKind::LOSSLESS);
            let mut run = || {
                bus.begin(&config, None)?;
                for step in 0..100 {
                    bus.begin_step(TimePs::from_ms(20 * step), &Inputs::default())?;
                    bus.end_step(&mut Outputs::default())?;
                }
                Ok(())
            };
            run().err()
        })
        .collect();
    assert_eq!(faults.len(), 20, "none goes unnoticed");
    let named = |fault: &BoardFault| matches!(fault, BoardFault::Damaged | BoardFault::Nonsense(_));
    assert!(faults.iter().all(named), "{faults:?}");
}

#[test]
fn a_board_that_says_nothing_is_given_up() {
    struct Deaf;
    impl Transport for Deaf {
        fn send(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }
        fn receive(&mut self, _: &mut [u8], timeout: Duration) -> io::Result<usize> {
            std::thread::sleep(timeout);
            Ok(0)
        }
    }
    for resend_after in [None, Some(Duration::from_millis(200))] {
        let mut bus = BusClient::new(Deaf, LinkKind { resend_after, ..LinkKind::LOSSLESS });
        let begun = Instant::now();
        let fault = bus.begin(&AgentConfig::new(DroneId(3)), None).unwrap_err();
        assert!(matches!(fault, BoardFault::Silent { .. }), "{fault}");
        assert!(begun.elapsed() < Duration::from_secs(5));
    }
}

/// A board that hears nothing but damage for longer than a silent one is waited for, and says so each time, is there.
#[test]
fn a_board_that_complains_is_not_silent() {
    struct Noisy {
        board: Loopback,
        until: Option<Instant>,
    }
    impl Transport for Noisy {
        fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
            if self.until.is_some_and(|until| Instant::now() < until) {
                self.board.say(&FromBoard::Damaged);
                return Ok(());
            }
            self.board.send(bytes)
        }
        fn receive(&mut self, bytes: &mut [u8], timeout: Duration) -> io::Result<usize> {
            let count = self.board.receive(bytes, timeout)?;
            if count == 0 {
                std::thread::sleep(timeout);
            }
            Ok(count)
        }
    }
    let link = LinkKind { resend_after: Some(Duration::from_millis(10)), ..LinkKind::LOSSLESS };
    let past_silence = || Some(Instant::now() + SILENCE + Duration::from_millis(500));
    let mut bus = BusClient::new(Noisy { board: Loopback::new(1, 0), until: past_silence() }, link);
    bus.begin(&AgentConfig::new(DroneId(9)), None).unwrap();
    bus.transport.until = past_silence();
    bus.begin_step(TimePs(0), &Inputs::default()).unwrap();
    bus.end_step(&mut Outputs::default()).unwrap();
    assert_eq!(bus.counters().steps, 1);
}
