//! What only the supervisor wants to know, gathered a little in every step.

use super::FlightAgent;
use crate::{
    STEP_S, STEP_US, Vec2, Vec3, ZERO,
    avoid::walls::Wall,
    guidance::limited,
    io::NavFix,
    scalar::lesser,
    supervisor::{FenceRoom, Health, ago_ms, low_ms},
};
use skyroost_protocol::{
    message::ClockState,
    units::{TimePs, mm_from_m},
};

/// Gusts pass and turns are over in less than this, seconds: what is lacking in the mean of it is lacking for good.
const SHORTFALL_TAU_S: f32 = 2.0;
/// Gates that none follows for this long are over, captured or not.
const GATES_WITHIN_MS: u32 = 5_000;
/// The clock is asked this often, milliseconds, a power of two: a board divides for it.
const CLOCK_EVERY_MS: u32 = 512;
/// Walls looked at in a step; all have been within half a second.
const WALLS_A_STEP: usize = 8;

/// What is gathered.
#[derive(Clone, Debug)]
pub(super) struct Vitals {
    /// What is lacking of the velocity wanted, east and north, in the mean; metres a second.
    lacking_mps: Vec2,
    /// Gates that captured nothing.
    unanswered: Option<Unanswered>,
    clock: ClockState,
    fence: FenceWatch,
}

impl Vitals {
    pub(super) const fn new() -> Self {
        Self {
            lacking_mps: Vec2::new(0.0, 0.0),
            unanswered: None,
            clock: ClockState::Free,
            fence: FenceWatch::new(),
        }
    }

    /// Takes in whether a step captured something and opened gates.
    pub(super) fn listened(&mut self, now: TimePs, captured: bool, opened: bool) {
        let now_ms = low_ms(now);
        let is_over = |gates: &Unanswered| now_ms.wrapping_sub(gates.last_ms) > GATES_WITHIN_MS;
        if captured || self.unanswered.as_ref().is_some_and(is_over) {
            self.unanswered = None;
        }
        if opened {
            self.unanswered.get_or_insert(Unanswered { since_ms: now_ms, last_ms: now_ms }).last_ms = now_ms;
        }
    }
}

/// Gates that captured nothing: when the first and the last of them were opened, in low milliseconds.
#[derive(Clone, Copy, Debug)]
struct Unanswered {
    since_ms: u32,
    last_ms: u32,
}

/// A look at all walls, some in every step, from the place where it began.
#[derive(Clone, Debug)]
struct FenceWatch {
    from_m: Vec3,
    /// The next wall to look at.
    next: u16,
    /// Of those looked at, the room before the nearest, and whether the way home leads through an odd number.
    nearest_m: f32,
    odd: bool,
    /// What the last whole look found: the room before the nearest wall, metres, and whether one is crossed; none
    /// without walls.
    found: Option<(f32, bool)>,
}

impl FenceWatch {
    const fn new() -> Self {
        Self { from_m: ZERO, next: 0, nearest_m: f32::INFINITY, odd: false, found: None }
    }

    /// Looks at some of `walls`, which begin with the next one.
    fn look(&mut self, at_m: &Vec3, home_m: &Vec3, mut walls: impl Iterator<Item = Wall>) {
        if self.next == 0 {
            *self = Self { from_m: *at_m, found: self.found, ..Self::new() };
        }
        for _ in 0..WALLS_A_STEP {
            let Some(wall) = walls.next() else {
                self.found = (self.next > 0).then_some((self.nearest_m, self.odd || self.nearest_m < 0.0));
                self.next = 0;
                return;
            };
            self.next = self.next.saturating_add(1);
            if self.from_m.z < wall.top_m {
                let at_m = self.from_m.xy();
                self.nearest_m = lesser(self.nearest_m, wall.room_m(at_m));
                self.odd ^= wall.is_east_of(at_m) != wall.is_east_of(home_m.xy());
            }
        }
    }
}

impl FlightAgent {
    /// Gathers what this step says.
    pub(super) fn watch(&mut self, now: TimePs, fix: Option<&NavFix>) {
        let vitals = &mut self.vitals;
        // The first step of each, whatever the steps' phase.
        if low_ms(now) % CLOCK_EVERY_MS < (STEP_US / 1_000) as u32 {
            vitals.clock = self.srs.clock_state();
        }
        if !self.flight.airborne() {
            (vitals.lacking_mps, vitals.fence) = (Vec2::zeros(), FenceWatch::new());
            return;
        }
        let Some(nav) = fix else { return };
        // Walls come with a mission.
        if let Some(mission) = &self.mission {
            let walls = self.lanes.walls_from(usize::from(vitals.fence.next));
            vitals.fence.look(&nav.pos_enu_m, &mission.home_m, walls);
        }
        // Whoever avoids does not fly as guidance wants.
        if self.flight.avoiding {
            vitals.lacking_mps = Vec2::zeros();
        } else {
            let commanded = limited(self.flight.last_wanted, self.config.limits.max_speed_mps);
            let lacking_mps = (commanded - nav.vel_enu_mps).xy();
            let mean_mps =
                vitals.lacking_mps + (lacking_mps - vitals.lacking_mps) * (STEP_S / SHORTFALL_TAU_S);
            // A velocity beyond all bounds would stay in the mean for ever.
            vitals.lacking_mps = if mean_mps.norm().is_finite() { mean_mps } else { Vec2::zeros() };
        }
    }

    /// How everything stands.
    pub(super) fn health(&self, now: TimePs) -> Health {
        let sweep = self.flight.sweeping_since();
        let Vitals { lacking_mps, unanswered, clock, fence, .. } = &self.vitals;
        let error_m = self.nav.map_or(0.0, |(_, nav)| nav.error_radius_m);
        Health {
            airborne: self.flight.airborne(),
            link_silent_ms: ago_ms(now, self.links.control_heard),
            mates_silent_ms: sweep.and_then(|start| Some(ago_ms(now, self.mates_heard(start)?))),
            clock: *clock,
            nav_silent_ms: self.nav.map_or_else(|| self.flight.searching_ms(now), |(at, _)| ago_ms(now, at)),
            nav_error_mm: millimetres(error_m),
            battery_permille: self.battery_permille,
            fence: fence
                .found
                .map(|(nearest_m, crossed)| FenceRoom { room_mm: millimetres(nearest_m - error_m), crossed }),
            shortfall_mmps: millimetres(lacking_mps.norm()),
            captures_silent_ms: sweep.and_then(|start| {
                let silent_ms = low_ms(now).wrapping_sub(unanswered.as_ref()?.since_ms);
                Some(silent_ms.min(ago_ms(now, start)))
            }),
            avoided_ago_ms: self.avoided.map(|at| ago_ms(now, at)),
        }
    }
}

/// [`mm_from_m`], once for all that is measured.
#[inline(never)]
fn millimetres(metres: f32) -> i32 {
    mm_from_m(metres)
}
