//! Whole missions.

use super::sim::World;
use super::*;

/// What a mission scored.
#[derive(Debug)]
struct Score {
    users: usize,
    ok: f64,
    in_r95: f64,
    r95_median_m: f64,
    rmse_m: f64,
    crlb_ratio: f64,
}

fn fly_and_score(world: &World) -> Score {
    let flown = world.fly();
    let cfg = LocalizeConfig::default();
    let t = std::time::Instant::now();
    let found = localize(&flown.occasions, &cfg).unwrap();
    let t1 = t.elapsed();
    let bound = crlb(&flown.occasions, &flown.late, &flown.truth, &cfg).unwrap();
    eprintln!(
        "{} occ, localize {:?} total {:?} its {} {:?}",
        flown.occasions.len(),
        t1,
        t.elapsed(),
        found.iterations,
        found.warnings
    );
    let mut r95_m: Vec<f64> = found.users.iter().map(|fix| fix.r95_m).collect();
    r95_m.sort_unstable_by(f64::total_cmp);
    let ok: Vec<_> = found.users.iter().filter(|fix| fix.status == FixStatus::Ok).collect();
    let error = |fix: &UserFix| {
        let p = flown.truth[&fix.user];
        (fix.pos_m[0] - p[0]).hypot(fix.pos_m[1] - p[1])
    };
    for f in found.users.iter().filter(|f| f.status != FixStatus::Ok || error(f) > 3.0 * f.r95_m) {
        eprintln!("{f:?} error {}", error(f));
    }
    Score {
        users: found.users.len(),
        ok: ok.len() as f64 / found.users.len() as f64,
        in_r95: ok.iter().filter(|fix| error(fix) <= fix.r95_m).count() as f64 / ok.len() as f64,
        r95_median_m: r95_m[r95_m.len() / 2],
        rmse_m: (ok.iter().map(|fix| error(fix).powi(2)).sum::<f64>() / ok.len() as f64).sqrt(),
        crlb_ratio: crlb_ratio(&found.users, &flown.truth, &bound).unwrap(),
    }
}

#[test]
fn missions() {
    for users_per_km2 in [1.0, 5.0] {
        for seed in 1..4 {
            let world = World { users_per_km2, seed, ..World::default() };
            eprintln!("{users_per_km2} {seed} {:?}", fly_and_score(&world));
        }
    }
}
