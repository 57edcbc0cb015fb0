//! The standard deviation that is stated is that of the errors, and the line is a Kalman filter's.

use super::super::line::Line;
use super::*;

/// Chance for a test: SplitMix64 (Steele, Lea and Flood, 2014).
struct Chance(u64);

impl Chance {
    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal, by Box and Muller.
    fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }
}

/// An oscillator with white frequency noise, and pulses that jitter, fail and stray.
struct World {
    rate: TickRate,
    drift: f64,
    offset_ps: i64,
    walk_ps: f64,
    wandered_ps: f64,
    chance: Chance,
}

impl World {
    /// What the timer has counted `ps` into the present second; the walk is straight within it.
    fn ticks(&self, second: i64, ps: i64, step_ps: f64) -> i64 {
        let true_ps = second * PS_PER_S + ps;
        let walked = self.wandered_ps + step_ps * ps as f64 / PS_PER_S as f64;
        // Whole seconds and the rest apart: a float has the digits for either.
        let drifted = self.drift * (second * PS_PER_S) as f64 + self.drift * ps as f64;
        let local = i128::from(true_ps + self.offset_ps) + libm::round(walked + drifted) as i128;
        let (ticks, per_ps) = self.rate.ratio();
        (local * i128::from(ticks)).div_euclid(i128::from(per_ps)) as i64
    }
}

/// Errors over stated deviations, half a second after every pulse from the `from`-th on, of many clocks.
fn errors(rate: TickRate, jitter_ns: f64, lost: f64, strays: f64, from: i64) -> Vec<f64> {
    const SECONDS: i64 = 400;
    let stated = Oscillator {
        rate,
        tolerance_ppb: 25_000,
        walk_ps: 100,
        wander_fs_per_s2: 100,
        pulse_ps: (1e3 * jitter_ns) as u32,
    };
    let mut errors = Vec::new();
    for clock in 0..250 {
        let mut chance = Chance(clock << 32 ^ jitter_ns.to_bits());
        let drift = 2e-5 * (2.0 * chance.unit() - 1.0);
        let offset_ps = (1e12 * chance.unit()) as i64;
        let mut world = World { rate, drift, offset_ps, walk_ps: 100.0, wandered_ps: 0.0, chance };
        let mut clock = GnssClock::new(stated);
        for second in 1..SECONDS {
            let chance = &mut world.chance;
            let (is_lost, is_stray) = (chance.unit() < lost, chance.unit() < strays);
            let mut jitter_ps = (1e3 * jitter_ns * chance.normal()) as i64;
            if is_stray {
                jitter_ps += (1e6 + 1e9 * chance.unit()) as i64;
            }
            let step_ps = world.walk_ps * chance.normal();
            if !is_lost || second < 8 {
                clock.pulse(world.ticks(second, jitter_ps, step_ps), second);
            }
            let half = PS_PER_S / 2;
            if second >= from
                && let Some(now) = clock.held_at(world.ticks(second, half, step_ps))
            {
                let error_ps = now.time.0 - second * PS_PER_S - half;
                errors.push(error_ps as f64 / f64::from(now.sigma_ps));
            }
            world.wandered_ps += step_ps;
        }
        assert!(clock.counters().replaced == 0, "{:?}", clock.counters());
    }
    errors
}

/// For every timer and receiver, from the first reading on and with losses and strays: errors are within twice
/// the stated deviation 95 times in 100 at least, and not much smaller than it.
#[test]
fn truth_the_stated_deviation_is_that_of_the_errors() {
    let rates = [TickRate::new(84_000_000), TickRate::new(168_000_000), TickRate::of_period(184)];
    let mut total = (0, 0);
    for rate in rates.map(|rate| rate.expect("in range")) {
        for (jitter_ns, lost, strays) in [(5.0, 0.0, 0.0), (20.0, 0.2, 0.02), (50.0, 0.1, 0.05)] {
            let errors = errors(rate, jitter_ns, lost, strays, 8);
            assert!(errors.len() > 90_000, "{}", errors.len());
            let within = errors.iter().filter(|e| e.abs() <= 2.0).count();
            let share = within as f64 / errors.len() as f64;
            let rms = libm::sqrt(errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64);
            let case = format!("{rate:?}, {jitter_ns} ns: {share:.4} within twice, rms {rms:.3}");
            // Neighbouring errors are much alike: some hundred of them are worth one.
            assert!(share >= 0.94, "{case}");
            assert!((0.75..=1.04).contains(&rms), "{case}");
            total = (total.0 + within, total.1 + errors.len());
        }
    }
    let share = f64::from(total.0 as u32) / f64::from(total.1 as u32);
    assert!(share >= 0.95, "{share}");
}

/// Two states in floats, by the book.
struct Textbook {
    time: f64,
    slope: f64,
    cov: [f64; 3],
}

impl Textbook {
    /// Time and its deviation so many (nominal) seconds on; and what the filter then is.
    fn after(&self, s: f64, o: &Oscillator) -> Self {
        let (walk, wander) = (f64::from(o.walk_ps), 1e-3 * f64::from(o.wander_fs_per_s2));
        let [p, c, v] = self.cov;
        let bent = wander * s * s / 2.0;
        Self {
            time: self.time + self.slope * s,
            slope: self.slope,
            cov: [
                p + 2.0 * s * c + s * s * v + walk * walk * s + bent * bent,
                c + s * v + bent * wander * s,
                v + wander * wander * s * s,
            ],
        }
    }

    fn join(&self, residual: f64, r: f64) -> Self {
        let [p, c, v] = self.cov;
        let (kp, kv) = (p / (p + r), c / (p + r));
        Self {
            time: self.time + kp * residual,
            slope: self.slope + kv * residual,
            cov: [p - kp * p, c - kp * c, v - kv * c],
        }
    }
}

proptest! {
    /// Integers lose nothing that matters: offsets and deviations are those of the filter in floats, to a few
    /// picoseconds and percent, over any noise stated, gaps included.
    #[test]
    fn truth_is_the_textbook_s_filter(
        ppb in -20_000..20_000_i64,
        pulse_ps in 3_000..100_000_u32, walk_ps in 0..5_000_u32, wander_fs_per_s2 in 0..10_000_000_u32,
        pulses in vec((prop_oneof![9 => Just(1_i64), 1 => 2..60_i64], -1.0..1.0_f64), 2..200),
    ) {
        let rate = TickRate::of_period(184).expect("in range");
        let oscillator = Oscillator { rate, tolerance_ppb: 50_000, walk_ps, wander_fs_per_s2, pulse_ps };
        let r = f64::from(pulse_ps) * f64::from(pulse_ps) + 184.0 * 184.0 / 12.0;
        // A slope of 12.5 ppm, in ps a second; time in ps ahead of nominal.
        let mut book = Textbook { time: 0.0, slope: 0.0, cov: [r, 0.0, 12.5e6 * 12.5e6] };
        let mut line = Line::through(TimePs(0), &oscillator);
        let (mut second, mut last_local) = (0, 0_i64);
        for (gap_s, jitter) in pulses {
            second += gap_s;
            let local = second * PS_PER_S - second * ppb * 1000 + (jitter * f64::from(pulse_ps)) as i64;
            let since_s = (local - last_local) as f64 * 1e-12;
            let predicted = book.after(since_s, &oscillator);
            let residual = (second * PS_PER_S - local) as f64 - predicted.time;
            let sigma = libm::sqrt(predicted.cov[0] + r);
            let joined = line.join(TimePs(local), &oscillator).is_some();
            if (residual.abs() / sigma - 5.0).abs() > 0.01 {
                prop_assert_eq!(joined, residual.abs() < 5.0 * sigma, "{} of {}", residual, sigma);
            }
            if joined {
                (book, last_local) = (predicted.join(residual, r), local);
            }
            for after_s in [0, 1, 100] {
                let at = TimePs(last_local + after_s * PS_PER_S);
                let expected = book.after(after_s as f64, &oscillator);
                let found = (line.time_at(at).0 - at.0) as f64;
                let sigma = libm::sqrt(expected.cov[0] + 184.0 * 184.0 / 12.0);
                let sigma_ps = f64::from(line.sigma_ps(at, &oscillator));
                prop_assert!((found - expected.time).abs() < 3.0 + 0.01 * sigma, "{found} {}", expected.time);
                prop_assert!((sigma_ps / sigma - 1.0).abs() < 0.02, "{sigma_ps} ps, {sigma}");
                prop_assert!((line.local_at(line.time_at(at)).0 - at.0).abs() <= 1);
            }
        }
    }
}
