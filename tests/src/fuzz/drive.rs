//! Drives a target: seeds, changed at random, one after the other.
//!
//! Chance comes from ChaCha, keyed by the seed and the target, and nothing depends on time but when to stop; so the n-th input of a
//! seed is the same everywhere.

use super::{Outcome, Target};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::{
    cell::RefCell,
    fmt::Write as _,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
    sync::{
        Arc, Mutex, Once,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    time::{Duration, Instant},
};

/// No input is longer.
const MOST_BYTES: usize = 16 << 10;
/// Inputs that were accepted and are changed further.
const MOST_KEPT: usize = 512;
/// An input that takes longer hangs.
const HANGS_AFTER: Duration = Duration::from_secs(30);
/// Smaller inputs tried for one that fails.
const SHRINKS: usize = 4_000;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub enum Until {
    /// After so many inputs.
    Rounds(u64),
    /// After so long.
    Time(Duration),
}

/// What came of a drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Driven {
    /// Inputs tried.
    pub rounds: u64,
    /// Of them, those that the target accepted.
    pub accepted: u64,
}

/// An input that breaks what must hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// The target.
    pub target: &'static str,
    /// The input, as small as it was made.
    pub input: Vec<u8>,
    /// What the target said.
    pub told: String,
}

impl std::fmt::Display for Broken {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { target, input, told } = self;
        writeln!(f, "{target}: {told}")?;
        writeln!(f, "input of {} bytes: {}", input.len(), hex(input))?;
        if let Ok(text) = str::from_utf8(input) {
            writeln!(f, "as text: {text:?}")?;
        }
        write!(f, "replay: cargo xtask fuzz --target {target} --hex {}", hex(input))
    }
}

/// Bytes as hexadecimal digits.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // a String takes every write
        text
    })
}

/// Bytes of hexadecimal digits.
#[must_use]
pub fn unhex(text: &str) -> Option<Vec<u8>> {
    let pair = |at: usize| u8::from_str_radix(text.get(at..at + 2)?, 16).ok();
    text.len().is_multiple_of(2).then(|| (0..text.len()).step_by(2).map(pair).collect())?
}

/// Gives `target` its seeds, and then what becomes of them under `seed`.
///
/// # Errors
/// The first input that breaks something, made small.
pub fn drive(target: &'static Target, seed: u64, until: Until) -> Result<Driven, Broken> {
    let watch = Watch::over(target.name);
    let mut mutator = Mutator::new(target, seed);
    let begun = Instant::now();
    let mut driven = Driven::default();
    let mut next_seed = 0;
    loop {
        let over = match until {
            Until::Rounds(rounds) => driven.rounds >= rounds,
            Until::Time(time) => begun.elapsed() >= time,
        };
        if over && next_seed >= mutator.seeds {
            return Ok(driven);
        }
        let input = if next_seed < mutator.seeds { mutator.kept[next_seed].clone() } else { mutator.next() };
        next_seed += 1;
        driven.rounds += 1;
        match run(target, &input, &watch) {
            Ok(Outcome::Accepted) => {
                driven.accepted += 1;
                mutator.keep(input);
            }
            Ok(Outcome::Refused) => {}
            Err(told) => return Err(shrunk(target, input, told, &watch)),
        }
    }
}

/// Gives `target` this input alone.
///
/// # Errors
/// When it breaks something.
pub fn replay(target: &'static Target, input: &[u8]) -> Result<Outcome, Broken> {
    let watch = Watch::over(target.name);
    run(target, input, &watch).map_err(|told| Broken { target: target.name, input: input.to_vec(), told })
}

thread_local! {
    /// What the last panic of a target in this thread said; none outside of targets.
    static TOLD: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Runs a target; what it says when it panics is an error here, and nothing is printed.
fn run(target: &Target, input: &[u8], watch: &Watch) -> Result<Outcome, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            let ours =
                TOLD.with_borrow_mut(|told| told.as_mut().map(|told| *told = info.to_string()).is_some());
            if !ours {
                usual(info);
            }
        }));
    });
    TOLD.set(Some(String::new()));
    watch.begins(input);
    let outcome = catch_unwind(AssertUnwindSafe(|| (target.run)(input)));
    watch.ended();
    let told = TOLD.take().unwrap_or_default();
    outcome.map_err(|_| told)
}

/// The smallest input found that still breaks something, by leaving out ever shorter pieces.
fn shrunk(target: &Target, mut input: Vec<u8>, mut told: String, watch: &Watch) -> Broken {
    let (mut piece, mut tries) = (input.len().div_ceil(2), 0);
    while piece > 0 && tries < SHRINKS {
        let mut at = 0;
        while at < input.len() && tries < SHRINKS {
            let mut less = input.clone();
            less.drain(at..(at + piece).min(input.len()));
            tries += 1;
            match run(target, &less, watch) {
                Err(now) => (input, told) = (less, now),
                Ok(_) => at += piece,
            }
        }
        piece /= 2;
    }
    Broken { target: target.name, input, told }
}

/// Ends the program, with the input, where an input hangs: nothing else could.
struct Watch {
    state: Arc<Watched>,
}

struct Watched {
    /// The input that the target has now, and since when.
    input: Mutex<Option<(Instant, Vec<u8>)>>,
    goes_on: AtomicBool,
}

impl Watch {
    fn over(target: &'static str) -> Self {
        let state = Arc::new(Watched { input: Mutex::new(None), goes_on: AtomicBool::new(true) });
        let watched = Arc::clone(&state);
        std::thread::spawn(move || {
            while watched.goes_on.load(Relaxed) {
                std::thread::sleep(Duration::from_millis(200));
                let Ok(guard) = watched.input.lock() else { return };
                if let Some((begun, input)) = guard.as_ref()
                    && begun.elapsed() > HANGS_AFTER
                {
                    let told = format!("hangs: not done after {} s", HANGS_AFTER.as_secs());
                    eprintln!("{}", Broken { target, input: input.clone(), told });
                    std::process::exit(1);
                }
            }
        });
        Self { state }
    }

    fn begins(&self, input: &[u8]) {
        if let Ok(mut guard) = self.state.input.lock() {
            *guard = Some((Instant::now(), input.to_vec()));
        }
    }

    fn ended(&self) {
        if let Ok(mut guard) = self.state.input.lock() {
            *guard = None;
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.state.goes_on.store(false, Relaxed);
    }
}

/// What numbers in a text are replaced by.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "1",
    "-1",
    "0.1",
    "1e-320",
    "1e308",
    "-1e308",
    "1e999",
    "NaN",
    "inf",
    "180",
    "-180",
    "90",
    "255",
    "256",
    "65535",
    "65536",
    "2147483647",
    "4294967296",
    "9223372036854775807",
    "18446744073709551616",
    "99999999999999999999999999",
    "0.30000000000000004",
    "",
    ".",
    "1.",
    "00",
    "+1",
    "1_000",
];

/// Changes inputs.
struct Mutator {
    chance: ChaCha8Rng,
    words: &'static [&'static str],
    /// Seeds first, then what was accepted.
    kept: Vec<Vec<u8>>,
    seeds: usize,
}

impl Mutator {
    fn new(target: &Target, seed: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        // No name of a target is longer.
        key[8..].iter_mut().zip(target.name.bytes()).for_each(|(to, from)| *to = from);
        let kept = (target.seeds)();
        assert!(!kept.is_empty(), "{} has no seed", target.name);
        let seeds = kept.len();
        Self { chance: ChaCha8Rng::from_seed(key), words: target.words, kept, seeds }
    }

    /// A number below `bound`; 0 where there is none.
    fn below(&mut self, bound: usize) -> usize {
        if bound == 0 { 0 } else { (self.chance.next_u64() % bound as u64) as usize }
    }

    fn keep(&mut self, input: Vec<u8>) {
        if self.kept.len() < MOST_KEPT {
            self.kept.push(input);
        } else {
            let at = self.seeds + self.below(MOST_KEPT - self.seeds);
            self.kept[at] = input;
        }
    }

    fn next(&mut self) -> Vec<u8> {
        // Seeds stay as likely as all that came of them.
        let bound = if self.below(2) == 0 { self.seeds } else { self.kept.len() };
        let at = self.below(bound);
        let mut input = self.kept[at].clone();
        for _ in 0..=self.below(4) {
            let is_text = !self.words.is_empty() && self.below(4) != 0;
            if is_text { self.change_text(&mut input) } else { self.change_bytes(&mut input) }
        }
        input.truncate(MOST_BYTES);
        input
    }

    /// A range of places in `input`, mostly a short one.
    fn range(&mut self, input: &[u8]) -> std::ops::Range<usize> {
        let from = self.below(input.len() + 1);
        let most = if self.below(8) == 0 { input.len() } else { 12 };
        from..(from + self.below(most + 1)).min(input.len())
    }

    fn change_bytes(&mut self, input: &mut Vec<u8>) {
        let at = self.below(input.len());
        match self.below(8) {
            0 if !input.is_empty() => input[at] ^= 1 << self.below(8),
            1 if !input.is_empty() => input[at] = [0, 1, 0x7f, 0x80, 0xfe, 0xff][self.below(6)],
            2 if !input.is_empty() => input[at] = self.chance.next_u32() as u8,
            3 => {
                let count = 1 + self.below(8);
                let bytes: Vec<u8> = (0..count).map(|_| self.chance.next_u32() as u8).collect();
                let at = self.below(input.len() + 1);
                input.splice(at..at, bytes);
            }
            4 => {
                let range = self.range(input);
                input.drain(range);
            }
            5 => {
                let range = self.range(input);
                let copied = input[range].to_vec();
                let at = self.below(input.len() + 1);
                input.splice(at..at, copied);
            }
            6 => {
                // The beginning of this, the end of another.
                let other = self.below(self.kept.len());
                let other = self.kept[other].clone();
                let (from, to) = (self.below(input.len() + 1), self.below(other.len() + 1));
                input.truncate(from);
                input.extend_from_slice(&other[to..]);
            }
            _ => input.truncate(at),
        }
    }

    fn change_text(&mut self, input: &mut Vec<u8>) {
        match self.below(6) {
            // A number by another.
            0 | 1 => {
                let is_digit = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'e');
                let begins: Vec<usize> = (0..input.len())
                    .filter(|&at| input[at].is_ascii_digit() && (at == 0 || !is_digit(&input[at - 1])))
                    .collect();
                if begins.is_empty() {
                    return;
                }
                let from = begins[self.below(begins.len())];
                let length = input[from..].iter().take_while(|byte| is_digit(byte)).count();
                let number = NUMBERS[self.below(NUMBERS.len())];
                input.splice(from..from + length, number.bytes());
            }
            // A word more, or in the place of something.
            2 | 3 => {
                let word = self.words[self.below(self.words.len())];
                let range = if self.below(2) == 0 {
                    let at = self.below(input.len() + 1);
                    at..at
                } else {
                    self.range(input)
                };
                input.splice(range, word.bytes());
            }
            // A line twice, or none of it, or somewhere else.
            _ => {
                let mut lines: Vec<&[u8]> = input.split_inclusive(|byte| *byte == b'\n').collect();
                if lines.is_empty() {
                    return;
                }
                let (line, to) = (self.below(lines.len()), self.below(lines.len()));
                match self.below(3) {
                    0 => lines.insert(to, lines[line]),
                    1 => drop(lines.remove(line)),
                    _ => lines.swap(line, to),
                }
                *input = lines.concat();
            }
        }
    }
}

/// Puts a broken input into `directory`, and says where.
///
/// # Errors
/// When it cannot be written.
pub fn save(broken: &Broken, directory: &Path) -> std::io::Result<std::path::PathBuf> {
    std::fs::create_dir_all(directory)?;
    let sum = broken.input.iter().fold(0_u32, |sum, byte| sum.rotate_left(5) ^ u32::from(*byte));
    let path = directory.join(format!("{}-{sum:08x}.bin", broken.target));
    std::fs::write(&path, &broken.input)?;
    Ok(path)
}
