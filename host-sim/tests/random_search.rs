//! Random search as it is flown, beside the closed model of it.

use std::sync::atomic::AtomicBool;

use skyroost_host_sim::campaign::plan::Reading;
use skyroost_host_sim::campaign::search::{Ground, Track};
use skyroost_host_sim::geometry::V2;
use skyroost_host_sim::rng::{self, Stream};
use skyroost_host_sim::runner::{self, RunError};
use skyroost_host_sim::scenario::{LossTable, Scenario};

fn ground(side_m: f64) -> Ground {
    Ground { side_m: V2::repeat(side_m), radius_m: 500.0, speed_mps: 10.0 }
}

fn flown(scenario: &Scenario, side_m: f64, seconds: u32, seed: u64) -> Track {
    let rng = rng::stream(seed, Stream::Search, 0);
    let never = AtomicBool::new(false);
    let mut scenario = scenario.clone();
    scenario.seed = seed;
    let places = runner::random_search(&scenario, ground(side_m), seconds, rng, &never).unwrap();
    Track::of_places(scenario.fleet.drones as usize, &places)
}

fn closed(drones: usize, side_m: f64, seconds: u32, seed: u64) -> Track {
    Track::at_random(ground(side_m), drones, seconds, rng::stream(seed, Stream::Search, 0))
}

/// By how much disks overlap at most, and how far centres leave the ground at most, metres; negative where never.
fn trespass_m(track: &Track, side_m: f64) -> [f64; 2] {
    let (mut overlap_m, mut beyond_m) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    for places_m in track.seconds() {
        for (index, at) in places_m.iter().enumerate() {
            beyond_m = beyond_m.max(500.0 - at.min()).max(at.max() - (side_m - 500.0));
            let apart_m = places_m[..index].iter().map(|other| (at - other).norm());
            overlap_m = apart_m.fold(overlap_m, |most, apart_m| most.max(1000.0 - apart_m));
        }
    }
    [overlap_m, beyond_m]
}

/// Mean way of all drones between two turns, metres: a turn is where a drone's way bends, for as long as it does, once it has
/// got going.
fn leg_m(track: &Track) -> f64 {
    let seconds: Vec<&[V2]> = track.seconds().skip(10).collect();
    let (mut way_m, mut turns) = (0.0, 0);
    for drone in 0..seconds[0].len() {
        let mut bent = false;
        for three in seconds.windows(3) {
            let [a, b, c] = [0, 1, 2].map(|k| three[k][drone]);
            let bends = (a - 2.0 * b + c).norm() > 1.0;
            turns += u32::from(bends && !bent);
            bent = bends;
            way_m += (b - a).norm();
        }
    }
    way_m / f64::from(turns)
}

/// What docs/campaigns.md says of the flown motion: disks apart and within the area but for what turning makes of it,
/// legs about as long, and as many users found.
#[test]
fn truth_flown_search_moves_and_finds_as_the_closed_model() {
    const SIDE_M: f64 = 10_000.0;
    /// Users of each run: what one lot of them says differs by more than the two motions do.
    const DRAWS: u64 = 8;
    let scenario = Scenario::default();
    let mut served = [0, 0];
    let mut legs_m = [0.0, 0.0];
    for seed in 0..8 {
        let tracks = [flown(&scenario, SIDE_M, 1500, seed), closed(6, SIDE_M, 1500, seed)];
        let [overlap_m, beyond_m] = trespass_m(&tracks[0], SIDE_M);
        assert!(overlap_m < 15.0 && beyond_m < 3.0, "seed {seed}: {overlap_m} m, {beyond_m} m");
        for users in 0..DRAWS {
            let mut chance = rng::stream(seed, Stream::Users, users);
            let mut user = || V2::new(rng::unit(&mut chance), rng::unit(&mut chance)) * SIDE_M;
            let users_m: Vec<V2> = (0..5000).map(|_| user()).collect();
            for (served, track) in served.iter_mut().zip(&tracks) {
                *served += track.served(&users_m, 500.0, Reading::Simultaneous);
            }
        }
        (0..2).for_each(|k| legs_m[k] += leg_m(&tracks[k]) / 8.0);
    }
    let [flown, closed] = served.map(|all| all as f64 / (8 * DRAWS) as f64);
    assert!((flown / closed - 1.0).abs() < 0.02, "{flown} flown, {closed} closed");
    assert!((legs_m[0] / legs_m[1] - 1.0).abs() < 0.1, "{legs_m:?}");
}

/// Hardly any room, one frame in five lost, strong gusts, and still nobody is far from where it may be.
#[test]
fn truth_in_a_crowd_and_on_bad_links_disks_still_keep_apart() {
    let mut scenario = Scenario::default();
    scenario.link.loss_fraction = 0.2;
    scenario.wind.gust_sigma_mps = 2.0;
    for seed in 0..2 {
        let track = flown(&scenario, 4_000.0, 1500, seed);
        let [overlap_m, beyond_m] = trespass_m(&track, 4_000.0);
        assert!(overlap_m < 60.0 && beyond_m < 20.0, "seed {seed}: {overlap_m} m, {beyond_m} m");
    }
}

/// All disks over one another: no heading leads anywhere, and drones keep the distance that avoidance keeps.
#[test]
fn drones_without_room_for_their_disks_search_all_the_same() {
    let track = flown(&Scenario::default(), 1_300.0, 300, 3);
    for places_m in track.seconds() {
        assert_eq!(places_m.len(), 6);
        for (index, at) in places_m.iter().enumerate() {
            assert!(places_m[..index].iter().all(|other| (at - other).norm() > 10.0));
        }
    }
}

#[test]
fn starts_and_first_headings_are_those_of_the_closed_model() {
    let (flown, closed) = (flown(&Scenario::default(), 10_000.0, 20, 4), closed(6, 10_000.0, 20, 4));
    let apart_m = |second: usize| {
        let [a, b] = [&flown, &closed].map(|track| track.seconds().nth(second).unwrap().to_vec());
        a.iter().zip(&b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
    };
    // What the receivers are off; and then what it takes to get going.
    assert!(apart_m(0) < 3.0, "{} m", apart_m(0));
    assert!(apart_m(20) < 35.0, "{} m", apart_m(20));
}

#[test]
fn the_same_seed_flies_the_same_and_another_does_not() {
    let [a, b, other] = [1, 1, 2].map(|seed| flown(&Scenario::default(), 10_000.0, 60, seed));
    assert_eq!(a, b);
    assert_ne!(a, other);
}

/// A battery that is low brings its drone home, and a board that is dead ends its drone's search.
#[test]
fn drones_that_go_home_or_are_lost_count_no_more() {
    let mut scenario = Scenario::default();
    scenario.battery.endurance_s = 600.0;
    scenario.losses = vec![LossTable { drone: 2, at_s: 250.0 }];
    let track = flown(&scenario, 10_000.0, 500, 1);
    let up: Vec<usize> = track.seconds().map(<[V2]>::len).collect();
    assert_eq!((up[0], up[100], up[200], up[500]), (6, 6, 5, 0));
    assert!(up.windows(2).all(|pair| pair[1] <= pair[0]), "{up:?}");
    assert_eq!(track.served(&[], 500.0, Reading::Greedy), 0);
}

#[test]
fn a_search_can_be_interrupted() {
    let (scenario, cancelled) = (Scenario::default(), AtomicBool::new(true));
    let rng = rng::stream(1, Stream::Search, 0);
    let ended = runner::random_search(&scenario, ground(10_000.0), 6000, rng, &cancelled);
    assert!(matches!(ended, Err(RunError::Interrupted)));
}
