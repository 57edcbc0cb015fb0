//! `skyroost keys`: the keys that links are sealed with.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;
use skyroost_firmware::board::provision::Provision;
use skyroost_protocol::key::Key;
use skyroost_protocol::units::{DroneId, MAX_DRONES};
use thiserror::Error;
use zeroize::Zeroizing;

use super::console::Console;
use super::exit::{Exit, Failure};
use crate::control::keys::file::{Kept, KeyFile, KeyFileError, write_new};

const EXAMPLES: &str = "\
Examples:
  skyroost keys new --drones 6 --out fleet.keys
      Fresh keys for drones 1 to 6, in a file that only you can read.
  skyroost keys show fleet.keys
      Who has a key, by its fingerprint; keys themselves are never shown.
  skyroost keys export fleet.keys --drone 3 --out drone-3.bin
      What drone 3 is given, once, to be written to its last sector of flash:
      probe-rs download --chip STM32F405RGTx --binary-format bin --base-address 0x080e0000 drone-3.bin
  skyroost keys renew fleet.keys --drone 3
      Another key for drone 3, whose old one was lost, seen or erased. Export and flash it before it flies.
  skyroost mission --backend serial:/dev/ttyACM0,... --keys fleet.keys
      A mission whose links are sealed with these keys.

Files are made for you alone (mode 600), and one that others can read is refused.

Exit status: 0 done, 2 wrong usage or bad input (nothing is written).";

/// Make, show and hand out the keys that links are sealed with
///
/// Every drone shares one key with the control center. It is made here, given to the drone once on the ground, and never sent.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES, subcommand_required = true, arg_required_else_help = true)]
pub(super) struct KeysArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Make fresh keys
    New {
        /// Number of drones: they are numbered from 1
        #[arg(long, value_name = "M", value_parser = clap::value_parser!(u16).range(1..=i64::from(MAX_DRONES)))]
        drones: u16,
        /// File to make; one that is there is not touched
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Say who has a key, by its fingerprint, and whether it was exported
    Show {
        /// File of keys
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Print one JSON object
        #[arg(long)]
        json: bool,
    },
    /// Give a drone another key, or a first one
    Renew {
        /// File of keys
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// The drone
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=i64::from(MAX_DRONES)))]
        drone: u16,
    },
    /// Write what a drone's flash is given, each key once
    Export {
        /// File of keys
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// The drone
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=i64::from(MAX_DRONES)))]
        drone: u16,
        /// File to make; one that is there is not touched
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Give it an open link instead of its key: whoever can send can command it
        #[arg(long)]
        unauthenticated: bool,
    },
}

/// Why there are no keys.
#[derive(Debug, Error)]
pub(super) enum KeysFailure {
    /// A file cannot be used.
    #[error(transparent)]
    File(#[from] KeyFileError),
    /// A drone without a key.
    #[error("--drone: {}: has no key for drone {drone}; `skyroost keys renew` gives it one", .path.display())]
    NoKey {
        /// Which file.
        path: PathBuf,
        /// Which drone.
        drone: u16,
    },
}

/// Runs the subcommand.
pub(super) fn run(args: &KeysArgs) -> Result<Exit, Failure> {
    let text = match &args.action {
        Action::New { drones, out } => {
            KeyFile::fresh(out, *drones).and_then(|keys| keys.create()).map_err(KeysFailure::File)?;
            format!("{}: fresh keys for drones 1 to {drones}\n", out.display())
        }
        Action::Show { file, json } => {
            let keys = KeyFile::read(file).map_err(KeysFailure::File)?;
            if *json { as_json(&keys) } else { as_text(file, &keys) }
        }
        Action::Renew { file, drone } => {
            let mut keys = KeyFile::read(file).map_err(KeysFailure::File)?;
            keys.renew(DroneId(*drone)).and_then(|()| keys.replace()).map_err(KeysFailure::File)?;
            format!(
                "{}: drone {drone} has a fresh key; export and flash it before it flies\n",
                file.display()
            )
        }
        Action::Export { file, drone, out, unauthenticated } => {
            export(file, DroneId(*drone), out, *unauthenticated)?
        }
    };
    Console::print(&text)?;
    Ok(Exit::Ok)
}

fn export(file: &Path, drone: DroneId, out: &Path, unauthenticated: bool) -> Result<String, KeysFailure> {
    let mut keys = KeyFile::read(file)?;
    if keys.key(drone).is_none() {
        return Err(KeysFailure::NoKey { path: file.to_owned(), drone: drone.0 });
    }
    if unauthenticated {
        // Nothing is sealed: it may be given as often as one likes.
        write_new(out, &Provision { drone, key: None }.to_bytes())?;
    } else {
        keys.export(drone, out, |key| {
            Zeroizing::new(Provision { drone, key: Some(key.clone()) }.to_bytes().into())
        })?;
    }
    let (what, name) = (if unauthenticated { "an OPEN LINK" } else { "its key" }, out.display());
    Ok(format!("{name}: drone {} and {what}, for its last sector of flash (0x080e0000)\n", drone.0))
}

fn fingerprint(key: &Key) -> String {
    key.fingerprint().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn as_text(file: &Path, keys: &KeyFile) -> String {
    let row = |Kept { drone, key, exported }: &Kept| {
        let exported = if *exported { "  exported" } else { "" };
        format!("{:>5}  {}{exported}\n", drone.0, fingerprint(key))
    };
    let rows: String = keys.keys().map(row).collect();
    format!(
        "{}\ncontrol center started {} time(s)\ndrone  fingerprint\n{rows}",
        file.display(),
        keys.control_boots()
    )
}

fn as_json(keys: &KeyFile) -> String {
    let row = |Kept { drone, key, exported }: &Kept| json!({ "id": drone.0, "fingerprint": fingerprint(key), "exported": exported });
    let drones = keys.keys().map(row);
    let drones: Vec<_> = drones.collect();
    format!("{}\n", json!({ "control_boots": keys.control_boots(), "drones": drones }))
}
