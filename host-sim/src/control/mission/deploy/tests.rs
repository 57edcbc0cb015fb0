//! Drones on their way to their places.

use super::*;
use crate::control::mission::simple;
use skyroost_protocol::{
    codec::{Message, decode},
    message::{AckStatus, Down, Manner, SharedState, Telemetry},
    units::{MissionId, PosEnuMm, VelEnuMmps},
};

/// A control center whose drones are to serve at these places.
fn deploying(sites_m: &[V2]) -> ControlCenter {
    let mut control = simple::control(sites_m.len() as u16, |_| {});
    let targets = sites_m.iter().enumerate();
    control.targets = targets
        .map(|(drone, &pos_m)| Target { drone, station: Some(Station { site: drone, pos_m }) })
        .collect();
    control
}

/// After `s` seconds drones tell how they fly and where, and are sent off; they acknowledge what they are told. Who is sent where.
fn sent_off(control: &mut ControlCenter, s: i64, drones: &[(FlightPhase, [f64; 3])]) -> Vec<(usize, V2)> {
    let now = TimePs::from_ms(1_000 * s);
    for (link, &(phase, at_m)) in control.drones.iter_mut().zip(drones) {
        let pos = PosEnuMm(at_m.map(|m| (1e3 * m) as i32));
        link.connected = true;
        let (vel, error_radius_mm, manner) = (VelEnuMmps([0; 3]), 1_000, Manner::ALONE);
        link.state = Some(SharedState { time: now, pos, vel, error_radius_mm, manner });
        let mission = Some(MissionId(1));
        link.telemetry = Some(Telemetry { mission, ..simple::telemetry(now, phase) });
    }
    control.send_off(now);
    let mut sent = Vec::new();
    for (drone, link) in control.drones.iter_mut().enumerate() {
        let mut said = Vec::new();
        link.step(now, &mut |_, frame| said.push(decode(frame).unwrap().1)).unwrap();
        for message in said {
            if let Message::Down(Down::Command { id, command: Command::Place { target } }) = message {
                sent.push((drone, V2::new(f64::from(target.0[0]), f64::from(target.0[1])) * 1e-3));
                link.acknowledged(now, id, AckStatus::Accepted, &mut |_, _| {}).unwrap();
            }
        }
    }
    sent
}

/// It may never get to where it was sent before: where all of its fleet were to hold, say, when another plan was made.
#[test]
fn who_is_on_the_way_of_an_earlier_stage_is_sent_to_its_place_at_once() {
    let site_m = V2::new(300.0, 0.0);
    let mut control = deploying(&[site_m]);
    let flies = [(FlightPhase::GoTo, [0.0, 0.0, 100.0])];
    assert_eq!(sent_off(&mut control, 1, &flies), [(0, site_m)]);
    assert_eq!(sent_off(&mut control, 2, &flies), [], "it is on its way");
}

/// Two that want past each other and a third, above and below it, serve from where there is room for all three.
#[test]
fn who_does_not_get_to_its_place_serves_where_there_is_room() {
    let (east, west) = (V2::new(500.0, 0.0), V2::new(-500.0, 0.0));
    let at_m = [[0.0, 0.0, 90.0], [1.0, 0.0, 110.0], [8.0, 0.0, 100.0]];
    let mut control = deploying(&[east, west, V2::new(8.0, 0.0)]);
    let ready = [FlightPhase::Hold, FlightPhase::Hold, FlightPhase::Serve];
    let first = sent_off(&mut control, 1, &[0, 1, 2].map(|drone| (ready[drone], at_m[drone])));
    assert_eq!(first, [(0, east), (1, west), (2, V2::new(8.0, 0.0))]);

    let stuck = [FlightPhase::GoTo, FlightPhase::GoTo, FlightPhase::Serve];
    let flies = [0, 1, 2].map(|drone| (stuck[drone], at_m[drone]));
    let sent: Vec<(usize, V2)> = (2..80).flat_map(|s| sent_off(&mut control, s, &flies)).collect();
    assert_eq!(sent.iter().map(|(drone, _)| *drone).collect::<Vec<_>>(), [0, 1], "once: {sent:?}");
    for &(drone, place_m) in &sent {
        let serves_from_m = control.targets[drone].station.unwrap().pos_m;
        assert!(
            (serves_from_m - place_m).norm() < 2e-3,
            "{serves_from_m} {place_m}: commands are in millimetres"
        );
        assert!(place_m.norm() < 40.0, "{place_m} is near");
        for (other, there_m) in at_m.iter().enumerate().filter(|(other, _)| *other != drone) {
            assert!((place_m - V2::new(there_m[0], there_m[1])).norm() >= 14.99, "{place_m} and {other}");
        }
    }
    assert!((sent[0].1 - sent[1].1).norm() >= 14.99, "{sent:?}");
}
