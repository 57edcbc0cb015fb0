use super::{
    table::{CONDITIONS, Level, Row, Watched},
    *,
};
use proptest::prelude::*;
use skyroost_protocol::message::ClockState;
use std::vec::Vec;

const USUAL: SupervisorConfig = SupervisorConfig::USUAL;

/// Nothing to complain of, everything there to be measured.
const WELL: Health = Health {
    airborne: true,
    link_silent_ms: 0,
    mates_silent_ms: Some(0),
    clock: ClockState::Locked { sigma_ns: 5 },
    nav_silent_ms: 0,
    nav_error_mm: 2_000,
    battery_permille: 1_000,
    fence: Some(FenceRoom { room_mm: 100_000, crossed: false }),
    shortfall_mmps: 0,
    captures_silent_ms: Some(0),
    avoided_ago_ms: None,
};

/// `health` with so much of what `condition` measures.
fn with(health: Health, condition: Condition, measure: i32) -> Health {
    use Condition as C;
    let FenceRoom { room_mm, crossed } = health.fence.unwrap();
    match condition {
        C::LinkQuiet | C::LinkLost | C::LinkGone => Health { link_silent_ms: measure as u32, ..health },
        C::MateLost | C::MateGone => Health { mates_silent_ms: Some(measure as u32), ..health },
        C::NavigationLost | C::NavigationGone => Health { nav_silent_ms: measure as u32, ..health },
        C::NavigationPoor => Health { nav_error_mm: measure, ..health },
        C::BatteryWaning | C::BatteryLow | C::BatteryCritical => {
            Health { battery_permille: -measure as u16, ..health }
        }
        C::Avoiding => Health { avoided_ago_ms: Some(-measure as u32), ..health },
        C::ClockHeld if measure > 0 => Health { clock: ClockState::Held { sigma_ns: 5 }, ..health },
        C::ClockHeld => Health { clock: ClockState::Locked { sigma_ns: 5 }, ..health },
        C::ClockUseless => Health { clock: ClockState::Held { sigma_ns: measure as u16 }, ..health },
        C::FenceNear => Health { fence: Some(FenceRoom { room_mm: -measure, crossed }), ..health },
        C::FenceCrossed => Health { fence: Some(FenceRoom { room_mm, crossed: measure > 0 }), ..health },
        C::WindStrong | C::WindBeyond => Health { shortfall_mmps: measure, ..health },
        C::CapturesMissed | C::CapturesGone => Health { captures_silent_ms: Some(measure as u32), ..health },
    }
}

/// `health` just beyond the limit of `condition`, unless it is farther already.
fn suffering(health: Health, condition: Condition) -> Health {
    let limit = condition.limit(&USUAL);
    if health.measure(condition) > limit.above {
        return health;
    }
    with(health, condition, limit.above + 1)
}

/// Steps of 20 ms from a boot long ago.
struct Flight {
    supervisor: Supervisor,
    ms: i64,
    told: Vec<(i64, Condition, bool)>,
}

impl Flight {
    fn new() -> Self {
        Self { supervisor: Supervisor::new(), ms: 0, told: Vec::new() }
    }

    fn step(&mut self, health: &Health) -> Action {
        let (ms, told) = (self.ms, &mut self.told);
        let now = TimePs::from_ms(ms + 1_000_000);
        let action =
            self.supervisor.step(now, health, &USUAL, |condition, on| told.push((ms, condition, on)));
        self.ms += 20;
        action
    }

    /// For so long that whatever comes up has come up.
    fn settle(&mut self, health: &Health) -> Action {
        (0..300).map(|_| self.step(health)).last().unwrap()
    }
}

/// Whether these were told, each when it should be and no later than two ticks.
#[track_caller]
fn assert_told(told: &[(i64, Condition, bool)], expected: &[(i64, Condition, bool)]) {
    let is_so = |(found, expected): (&(i64, Condition, bool), &(i64, Condition, bool))| {
        (expected.0..=expected.0 + 80).contains(&found.0) && (found.1, found.2) == (expected.1, expected.2)
    };
    let all = told.len() == expected.len() && told.iter().zip(expected).all(is_so);
    assert!(all, "found {told:?}, expected {expected:?}");
}

/// What every two conditions come to, worked out by hand: fly on (.), hold (H), return home (R), land (L). A row is a
/// condition by its number, with itself and all before it.
const PAIRS: [&str; CONDITIONS] = [
    ".",                    // link quiet
    "HH",                   // link lost
    "RRR",                  // link gone
    "HHHH",                 // navigation lost
    "RRRHR",                // battery low
    "LLLLLL",               // battery critical
    ".HRHRL.",              // mate lost
    ".HRHRL..",             // avoiding
    ".HRHRL...",            // clock held
    ".HRHRL....",           // clock useless
    ".HRHRL.....",          // navigation poor
    "LLLLLLLLLLLL",         // navigation gone
    ".HRHRL.....L.",        // fence near
    "HHRHRLHHHHHLHH",       // fence crossed
    ".HRHRL.....L.H.",      // wind strong
    "RRRHRLRRRRRLRRRR",     // wind beyond limits
    ".HRHRL.....L.H.R.",    // captures missed
    ".HRHRL.....L.H.R..",   // captures gone
    ".HRHRL.....L.H.R...",  // battery waning
    ".HRHRL.....L.H.R....", // mate gone
];

#[test]
fn every_pair_of_conditions_comes_to_what_is_expected() {
    for (later, expected) in TABLE.iter().zip(PAIRS) {
        assert_eq!(expected.len(), later.condition as usize + 1);
        for (earlier, expected) in TABLE.iter().zip(expected.chars()) {
            let pair = (earlier.condition, later.condition);
            let expected = match expected {
                '.' => Action::None,
                'H' => Action::Hold,
                'R' => Action::ReturnHome,
                _ => Action::Land,
            };
            assert_eq!(earlier.demands.and(later.demands).action(), expected, "{pair:?}");
            // And by what brings both about, in either order; what comes before a level is in force as well.
            for (first, second) in [pair, (pair.1, pair.0)] {
                let mut flight = Flight::new();
                flight.settle(&suffering(WELL, first));
                let found = flight.settle(&suffering(suffering(WELL, first), second));
                let are = flight.supervisor.is(first) && flight.supervisor.is(second);
                assert_eq!((are, found), (true, expected), "{first:?}, then {second:?}");
            }
        }
    }
}

#[test]
fn every_subject_is_warned_of_before_it_is_acted_upon() {
    use Watched as W;
    for watched in [
        W::GroundLink,
        W::PeerLink,
        W::TimeSync,
        W::Navigation,
        W::Battery,
        W::Geofence,
        W::Wind,
        W::Captures,
    ] {
        let of = |level| TABLE.iter().filter(move |row| row.watched == watched && row.level == level);
        assert!(of(Level::Warns).all(|row| row.demands == Demands::NONE), "{watched:?}");
        assert!(of(Level::Warns).count() >= 1 && of(Level::Acts).count() >= 1, "{watched:?}");
    }
    assert!((0..32).all(|n| Condition::numbered(n).map(|c| c as u32) == Some(n).filter(|n| *n < 20)));
}

#[test]
fn link_loss_warns_then_holds_then_returns_and_clears() {
    let mut flight = Flight::new();
    let mut actions = Vec::new();
    for ms in (0..64_000).step_by(20) {
        let silent_ms = if ms < 62_000 { ms } else { 0 };
        actions.push((ms, flight.step(&Health { link_silent_ms: silent_ms as u32, ..WELL })));
    }
    actions.dedup_by_key(|(_, action)| *action);
    use Action::{Hold, None, ReturnHome};
    let whats: Vec<Action> = actions.iter().map(|(_, action)| *action).collect();
    assert_eq!(whats, [None, Hold, ReturnHome, None]);
    use Condition::{LinkGone, LinkLost, LinkQuiet};
    let expected = [
        (2_020, LinkQuiet, true),
        (10_020, LinkLost, true),
        (60_020, LinkGone, true),
        (63_000, LinkQuiet, false),
        (63_000, LinkLost, false),
        (63_000, LinkGone, false),
    ];
    assert_told(&flight.told, &expected);
}

#[test]
fn a_silent_mate_and_a_manoeuvre_are_told_and_nothing_is_done() {
    let mut flight = Flight::new();
    for ms in (0..6_000_u32).step_by(20) {
        let mates_silent_ms = Some(if ms < 3_000 { ms.saturating_sub(500) } else { 0 });
        let avoided_ago_ms = (ms >= 1_000).then(|| ms.saturating_sub(1_500));
        assert_eq!(flight.step(&Health { mates_silent_ms, avoided_ago_ms, ..WELL }), Action::None);
    }
    use Condition::{Avoiding, MateLost};
    let expected = [
        (1_000, Avoiding, true),
        (2_120, MateLost, true),
        (3_500, Avoiding, false),
        (4_000, MateLost, false),
    ];
    assert_told(&flight.told, &expected);
}

#[test]
fn blind_for_long_it_lands_and_a_gust_is_no_wind() {
    let mut flight = Flight::new();
    let mut actions: Vec<_> = (0..11_000)
        .step_by(20)
        .map(|ms| (ms, flight.step(&Health { nav_silent_ms: ms as u32, ..WELL })))
        .collect();
    actions.dedup_by_key(|(_, action)| *action);
    assert_eq!(actions, [(0, Action::None), (520, Action::Hold), (10_020, Action::Land)]);

    let mut flight = Flight::new();
    let lacking_mmps = |s: i64| if (2..6).contains(&s) || s >= 20 { 4_100 } else { 0 };
    for _ in 0..30 * 50 {
        flight.step(&Health { shortfall_mmps: lacking_mmps(flight.ms / 1_000), ..WELL });
    }
    use Condition::{WindBeyond, WindStrong};
    let expected = [
        (5_000, WindStrong, true),
        (11_000, WindStrong, false),
        (23_000, WindStrong, true),
        (25_000, WindBeyond, true),
    ];
    assert_told(&flight.told, &expected);
}

#[test]
fn on_the_ground_everything_is_over_at_once() {
    let mut flight = Flight::new();
    let ill = Health { link_silent_ms: 70_000, battery_permille: 40, nav_silent_ms: 700, ..WELL };
    assert_eq!(flight.settle(&ill), Action::Land);
    assert_eq!(flight.step(&Health { airborne: false, ..ill }), Action::None);
    assert_eq!(flight.supervisor.conditions(), 0);
    assert_eq!(flight.told.iter().map(|(_, _, on)| if *on { 1 } else { -1 }).sum::<i32>(), 0);
}

#[test]
fn a_clock_without_any_pulses_is_no_fault() {
    let mut flight = Flight::new();
    assert_eq!(flight.settle(&Health { clock: ClockState::Free, ..WELL }), Action::None);
    assert_eq!(flight.supervisor.conditions(), 0);
    for (sigma_ns, useless) in [(900, false), (1_001, true), (u16::MAX, true)] {
        flight.settle(&Health { clock: ClockState::Held { sigma_ns }, ..WELL });
        let told =
            (flight.supervisor.is(Condition::ClockHeld), flight.supervisor.is(Condition::ClockUseless));
        assert_eq!(told, (true, useless), "{sigma_ns} ns");
    }
}

/// Nobody who cannot find home is sent there.
fn is_blind(row: &Row) -> bool {
    matches!(row.condition, Condition::NavigationLost | Condition::NavigationGone)
}

fn come_to(rows: &[Row]) -> Action {
    rows.iter().fold(Demands::NONE, |demands, row| demands.and(row.demands)).action()
}

proptest! {
    #[test]
    fn any_set_is_its_pairs_in_any_order(
        rows in prop::sample::subsequence(TABLE.to_vec(), 0..=CONDITIONS).prop_shuffle(),
        more in prop::sample::select(TABLE.to_vec()),
    ) {
        let action = come_to(&rows);
        // In pairs that overlap, backwards, and twice.
        let pairs = rows.windows(2).map(|pair| pair[0].demands.and(pair[1].demands));
        let alone = rows.first().map_or(Demands::NONE, |row| row.demands);
        prop_assert_eq!(pairs.rev().fold(alone, Demands::and).action(), action);
        prop_assert_eq!(come_to(&[rows.as_slice(), rows.as_slice()].concat()), action);
        // The strongest, or what is left of it for the blind.
        let strongest = rows.iter().map(|row| row.demands.action()).max().unwrap_or_default();
        let held_back = strongest == Action::ReturnHome && rows.iter().any(is_blind);
        prop_assert_eq!(action, if held_back { Action::Hold } else { strongest });
        // One more never weakens it, but blindness what only the seeing can do.
        let after = come_to(&[rows.as_slice(), &[more]].concat());
        prop_assert!(after >= action || (is_blind(&more) && (action, after) == (Action::ReturnHome, Action::Hold)));
    }

    /// A measure that goes to and fro about its limit is told once in the time that clearing takes, or, where that
    /// is none, once for as long as it stays within the band.
    #[test]
    fn chatter_is_not_passed_on(
        row in prop::sample::select(TABLE.to_vec()),
        beyond in prop::collection::vec(any::<bool>(), 1..1_500),
    ) {
        // What counts the time since avoidance cannot go to and fro.
        prop_assume!(row.condition != Condition::Avoiding);
        let (limit, mut flight) = (row.condition.limit(&USUAL), Flight::new());
        let less = if row.clears_after_ms == 0 { limit.band - 1 } else { limit.band };
        for beyond in beyond {
            flight.step(&with(WELL, row.condition, if beyond { limit.above + 1 } else { limit.above - less }));
        }
        let raised = flight.told.iter().filter(|(_, condition, on)| *condition == row.condition && *on);
        let at_ms: Vec<i64> = raised.map(|(ms, ..)| *ms).collect();
        let apart = if row.clears_after_ms == 0 { i64::MAX } else { row.clears_after_ms.into() };
        prop_assert!(at_ms.windows(2).all(|pair| pair[1] - pair[0] >= apart), "{:?}", at_ms);
    }

    /// Any health: what is done is what the limits say, and nothing on the ground.
    #[test]
    fn the_strongest_action_wins(link_s in 0u32..100, nav_ms in 0u32..12_000, battery in 0u16..=1000, airborne: bool) {
        let health = Health {
            link_silent_ms: link_s * 1000,
            nav_silent_ms: nav_ms,
            battery_permille: battery,
            airborne,
            ..WELL
        };
        let expected = if !airborne { Action::None }
            else if battery < 50 || nav_ms > 10_000 { Action::Land }
            else if (battery < 150 || link_s > 60) && nav_ms <= 500 { Action::ReturnHome }
            else if link_s > 10 || nav_ms > 500 { Action::Hold }
            else { Action::None };
        // Blind with a low battery, and nothing else: to stand is all that is left.
        prop_assert_eq!(Flight::new().step(&health), expected);
    }
}
