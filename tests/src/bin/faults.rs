//! What `cargo xtask faults` runs: random missions to which random things happen.

use serde_json::json;
use skyroost_tests::faults::{self, End, Flown};
use std::process::ExitCode;

/// What the command line says.
struct Args {
    missions: u64,
    seed: u64,
    replay: Option<u64>,
    json: bool,
}

fn args() -> Result<Args, String> {
    let mut args = Args { missions: 500, seed: 1, replay: None, json: false };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut number = || {
            let found = words.next().unwrap_or_default();
            found.parse::<u64>().map_err(|_| format!("{word}: found '{found}', expected a whole number"))
        };
        match word.as_str() {
            "--missions" => args.missions = number()?,
            "--seed" => args.seed = number()?,
            "--replay" => args.replay = Some(number()?),
            "--json" => args.json = true,
            other => return Err(format!("found '{other}', expected --missions, --seed, --replay or --json")),
        }
    }
    Ok(args)
}

fn main() -> ExitCode {
    let args = match args() {
        Ok(args) => args,
        Err(what) => {
            eprintln!("faults: {what}");
            return ExitCode::from(2);
        }
    };
    let flown = match args.replay {
        Some(seed) => {
            if args.json {
                vec![faults::fly(seed)]
            } else {
                println!("{:#?}", faults::scenario(seed));
                vec![faults::fly_and_tell(seed)]
            }
        }
        None => faults::campaign(args.missions, args.seed, &|ended, one| tell(ended, args.missions, one)),
    };
    let count = |what: fn(&End) -> bool| flown.iter().filter(|one| what(&one.end)).count();
    let completed = count(|end| *end == End::Completed);
    let ended_safe = count(|end| matches!(end, End::EndedSafe(_)));
    let failed: Vec<_> = flown
        .iter()
        .filter_map(|Flown { seed, end, .. }| match end {
            End::Failed { invariant, at_s } => {
                Some(json!({ "seed": seed, "invariant": invariant, "at_s": at_s }))
            }
            _ => None,
        })
        .collect();
    if args.json {
        let all = json!({
            "missions": flown.len(), "completed": completed, "ended_safe": ended_safe, "failed": failed
        });
        println!("{all}");
    } else {
        println!(
            "{} missions: {completed} completed, {ended_safe} ended safe, {} failed",
            flown.len(),
            failed.len()
        );
        for Flown { seed, end, .. } in &flown {
            match end {
                End::Completed => {}
                End::EndedSafe(why) => println!("  seed {seed} ended safe: {why}"),
                End::Failed { invariant, at_s } => {
                    println!(
                        "  seed {seed} failed at {at_s:.0} s: {invariant}\n    {}",
                        faults::replay(*seed)
                    );
                }
            }
        }
    }
    if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(1) }
}

/// Progress, and failures as they come.
fn tell(ended: usize, missions: u64, one: &Flown) {
    if let End::Failed { invariant, at_s } = &one.end {
        eprintln!("seed {}: at {at_s:.0} s: {invariant}\n  {}", one.seed, faults::replay(one.seed));
    }
    if ended.is_multiple_of(25) {
        eprintln!("{ended} of {missions} missions flown");
    }
}
