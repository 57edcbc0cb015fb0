//! Drives the fuzz targets for as long as one likes, or one of them with a given input; `cargo xtask fuzz` runs it.
#![forbid(unsafe_code)]

use skyroost_tests::fuzz::{
    TARGETS, Target,
    drive::{Broken, Until, drive, replay, save, unhex},
    target,
};
use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    time::{Duration, SystemTime},
};

/// What the command line asks for.
#[derive(Default)]
struct Asked {
    target: Option<&'static Target>,
    seconds: Option<u64>,
    seed: Option<u64>,
    input: Option<Vec<u8>>,
    list: bool,
}

fn asked(mut args: impl Iterator<Item = String>) -> Result<Asked, String> {
    let mut asked = Asked::default();
    while let Some(word) = args.next() {
        if word == "--list" {
            asked.list = true;
            continue;
        }
        let value = args.next().ok_or_else(|| format!("`{word}` lacks its value"))?;
        let number = || value.parse::<u64>().map_err(|_| format!("{word}: `{value}` is no whole number"));
        match word.as_str() {
            "--target" => {
                let unknown = || format!("--target: no target `{value}`; --list names them");
                asked.target = Some(target(&value).ok_or_else(unknown)?);
            }
            "--seconds" => asked.seconds = Some(number()?),
            "--seed" => asked.seed = Some(number()?),
            "--hex" => {
                asked.input = Some(unhex(&value).ok_or("--hex: expected pairs of hexadecimal digits")?);
            }
            "--replay" => {
                let read = std::fs::read(PathBuf::from(&value));
                asked.input = Some(read.map_err(|error| format!("--replay: {value}: {error}"))?);
            }
            _ => return Err(format!("unknown option `{word}`")),
        }
    }
    if asked.input.is_some() && asked.target.is_none() {
        return Err("an input needs its --target".to_owned());
    }
    Ok(asked)
}

fn main() -> ExitCode {
    match asked(std::env::args().skip(1)) {
        Ok(asked) => fuzz(&asked),
        Err(told) => {
            eprintln!("fuzz: {told}");
            ExitCode::from(2)
        }
    }
}

fn fuzz(asked: &Asked) -> ExitCode {
    if asked.list {
        TARGETS.iter().for_each(|target| println!("{}", target.name));
        return ExitCode::SUCCESS;
    }
    if let (Some(target), Some(input)) = (asked.target, &asked.input) {
        return match replay(target, input) {
            Ok(outcome) => {
                println!("{}: {outcome:?}", target.name);
                ExitCode::SUCCESS
            }
            Err(broken) => failed(&broken),
        };
    }
    // Another one every time, and said: with it, the same inputs come again.
    let seed =
        asked.seed.unwrap_or_else(|| SystemTime::UNIX_EPOCH.elapsed().map_or(1, |elapsed| elapsed.as_secs()));
    let all: Vec<&'static Target> = match asked.target {
        Some(target) => vec![target],
        None => TARGETS.iter().filter_map(|each| target(each.name)).collect(),
    };
    // Shared out among the targets, a second for each at least.
    let each = (asked.seconds.unwrap_or(300) / all.len() as u64).max(1);
    println!("seed {seed}, {each} s each");
    for target in all {
        match drive(target, seed, Until::Time(Duration::from_secs(each))) {
            Ok(driven) => {
                println!("{:16} {:>10} inputs, {:>9} accepted", target.name, driven.rounds, driven.accepted);
            }
            Err(broken) => return failed(&broken),
        }
    }
    ExitCode::SUCCESS
}

fn failed(broken: &Broken) -> ExitCode {
    eprintln!("{broken}");
    match save(broken, Path::new("target/fuzz")) {
        Ok(path) => eprintln!("saved: {}", path.display()),
        Err(error) => eprintln!("not saved: {error}"),
    }
    ExitCode::FAILURE
}
