//! What crosses the bus comes out as it went in.

use super::*;
use skyroost_protocol::stream::StreamDecoder;

/// What arrives where `message` was sent.
fn payload_of<T: Serialize>(message: &T) -> std::vec::Vec<u8> {
    let mut frame = StreamFrame::new();
    assert!(encode(message, &mut frame), "fits");
    let mut decoder = StreamDecoder::new();
    let (taken, found) = decoder.take(&frame);
    assert_eq!(taken, frame.len());
    found.expect("a frame").expect("undamaged").to_vec()
}

#[test]
fn the_longest_messages_fit_a_frame() {
    let longest = [
        SensePart::Radio(&[0xff; MAX_RADIO_PART]),
        SensePart::Captures(
            [WireCapture {
                occasion: OccasionId(u32::MAX),
                ticks: u32::MAX,
                symbol: u8::MAX,
                sigma: ToaSigma(u16::MAX),
            }; MAX_CAPTURES_PART]
                .into(),
        ),
        SensePart::Attached(
            [AttachedUser { user: UserId(u32::MAX), timing_advance: u16::MAX }; MAX_ATTACHED_PART].into(),
        ),
    ];
    for part in longest {
        let message = ToBoard::Sense { step: u32::MAX, index: u16::MAX, part };
        assert_eq!(decode(&payload_of(&message)), Some(message));
    }
    let gate = WireGate {
        occasion: OccasionId(u32::MAX),
        user: UserId(u32::MAX),
        at: TimePs(i64::MIN),
        grant: true,
    };
    for part in [ActPart::Radio(&[0; MAX_RADIO_PART]), ActPart::Gates([gate; MAX_GATES_PART].into())] {
        let message = FromBoard::Act { step: u32::MAX, index: u16::MAX, part };
        assert_eq!(decode(&payload_of(&message)), Some(message));
    }
    let link = LinkCounters {
        bus_damaged: u32::MAX,
        bus_out_of_order: u32::MAX,
        bus_repeated: u32::MAX,
        radio_damaged: u32::MAX,
        inputs_overflowed: u32::MAX,
    };
    let report = Report {
        counters: [u32::MAX; Counters::COUNT],
        link,
        steps: u32::MAX,
        worst_step_cost: u32::MAX,
        stack_used: u32::MAX,
    };
    assert_eq!(decode(&payload_of(&FromBoard::Report(report))), Some(FromBoard::Report(report)));
}

#[test]
fn every_bit_of_a_number_arrives() {
    for bits in [0x7f80_0001, 0xffc0_1234, 0x0000_0001, 0x8000_0000, 0x7f80_0000] {
        let odd = f32::from_bits(bits);
        let nav = WireNav { pos_enu_m: [odd; 3], vel_enu_mps: [odd; 3], error_radius_m: odd };
        let pulse = Some(WirePulse { ticks: u32::MAX, second: i32::MIN });
        let head = StepHead {
            now: TimePs(-1),
            nav: Some(nav),
            in_air: true,
            timer_ticks: 1,
            pulse,
            battery_permille: 2,
        };
        let payload = payload_of(&ToBoard::Step { step: 1, parts: 0, have: 0, attempt: 0, head });
        let Some(ToBoard::Step { head, .. }) = decode(&payload) else { panic!("another message") };
        let fix = NavFix::from(head.nav.expect("a fix"));
        assert!(fix.pos_enu_m.iter().chain(&fix.vel_enu_mps).all(|x| x.to_bits() == bits));
        assert_eq!(fix.error_radius_m.to_bits(), bits);
    }
}

#[test]
fn a_configuration_arrives_whole() {
    let mut config = AgentConfig::new(DroneId(7));
    config.oscillator.walk_ps = 77;
    config.srs_symbols = 4;
    config.uplink_bytes_per_s = 1_234;
    config.d_safe_m = 7.5;
    config.limits.max_speed_mps = 3.25;
    config.supervisor.nav_lost_ms = 77;
    config.supervisor.wind_act_mmps = 78;
    assert_eq!(WireConfig::from(&config).agent_config(), Some(config));
    let still = WireConfig { capture_ticks: 0, ..WireConfig::from(&config) };
    assert_eq!(still.agent_config(), None);
}

#[test]
fn bytes_after_a_message_are_no_message() {
    let mut payload = [0; 16];
    let len = postcard::to_slice(&ToBoard::Report, &mut payload).unwrap().len();
    assert_eq!(decode::<ToBoard>(&payload[..len]), Some(ToBoard::Report));
    assert_eq!(decode::<ToBoard>(&payload[..len + 1]), None);
}
