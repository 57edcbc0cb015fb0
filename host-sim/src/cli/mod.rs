//! The `skyroost` command: one file per subcommand, and what they share.
//!
//! - `mission`: flies a whole mission,
//! - `sweep`: plans a sweep,
//! - `locate`: locates users from recorded captures,
//! - `place`: places drones for located users,
//! - `accuracy`: tells how well a formation locates,
//! - `encounter`: flies vehicles past each other,
//! - `campaign`: plans, runs, merges and plots many runs,
//! - `keys`: makes, shows and hands out the keys of links,
//! - `answer`: files, and JSON or text, of commands that answer a question,
//! - `inputs`: reads and checks everything before anything flies,
//! - `output`: result files that appear whole or not at all,
//! - `console`: results to stdout, logs and progress to stderr,
//! - `interrupt`: Ctrl-C and SIGTERM as a flag,
//! - `values`: values of options,
//! - `exit`: what went wrong and the exit status it has.

mod accuracy;
mod answer;
mod campaign;
mod console;
mod encounter;
mod exit;
mod inputs;
mod interrupt;
mod keys;
mod locate;
mod mission;
mod output;
mod place;
mod sweep;
mod values;

use clap::{Parser, Subcommand};
use console::Console;
use std::process::ExitCode;

/// What `--help` ends with.
const EXIT_STATUS_HELP: &str = "\
Exit status:
  0    done
  1    done, but an acceptance limit of the scenario failed
  2    wrong usage or bad input; nothing is written
  3    infeasible: valid input without a solution
  4    a link or a board failed
  5    part of a campaign is missing
  130  interrupted; nothing is left half-written";

/// Drone base stations after a disaster: sweep an area with fleets of three drones, locate the users by
/// UTDOA, and place the drones where they serve the most.
#[derive(Debug, Parser)]
#[command(name = "skyroost", version, max_term_width = 100, after_long_help = EXIT_STATUS_HELP)]
#[command(subcommand_required = true, arg_required_else_help = true, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Mission(Box<mission::MissionArgs>),
    Sweep(Box<sweep::SweepArgs>),
    Locate(locate::LocateArgs),
    Place(place::PlaceArgs),
    Accuracy(accuracy::AccuracyArgs),
    Encounter(encounter::EncounterArgs),
    Campaign(campaign::CampaignArgs),
    Keys(keys::KeysArgs),
}

/// Runs the command line of this process and returns its exit status.
#[must_use]
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(message) => {
            // Help and version go to stdout with status 0, mistakes to stderr with 2. A reader that
            // has gone away is none of our business.
            let _ = message.print();
            return u8::try_from(message.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from);
        }
    };
    let result = match &cli.command {
        Command::Mission(args) => mission::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Locate(args) => locate::run(args),
        Command::Place(args) => place::run(args),
        Command::Accuracy(args) => accuracy::run(args),
        Command::Encounter(args) => encounter::run(args),
        Command::Campaign(args) => campaign::run(args),
        Command::Keys(args) => keys::run(args),
    };
    let exit = result.unwrap_or_else(|failure| {
        Console::error(&failure);
        failure.exit()
    });
    ExitCode::from(exit.code())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
