//! Results to stdout, logs and progress to stderr.

use super::exit::Failure;
use crate::campaign;
use crate::runner::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::sync::{Mutex, PoisonError};

/// Steps of the progress bar: a hundredth of a percent each.
const BAR_STEPS: u64 = 10_000;
const BAR_TEMPLATE: &str = "{msg:<14} {bar:30} {percent:>3} %  simulated {prefix}  ETA {eta}";

const CAMPAIGN_TEMPLATE: &str = "{msg:<20} {bar:30} {pos}/{len} runs  {elapsed} gone, ETA {eta}";

/// Where a run speaks to its user.
pub(super) struct Console {
    quiet: bool,
}

impl Console {
    /// `quiet` silences logs and progress, never errors or results.
    pub(super) const fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// An error, always.
    pub(super) fn error(error: &impl Display) {
        // Nothing is left to tell a user whose stderr is closed.
        let _ = writeln!(io::stderr(), "error: {error}");
    }

    /// A line of the log.
    pub(super) fn log(&self, line: &str) {
        if !self.quiet {
            let _ = writeln!(io::stderr(), "{line}");
        }
    }

    /// The results.
    ///
    /// A reader that has seen enough (`| head`) is no error; a full disk is.
    pub(super) fn print(text: &str) -> Result<(), Failure> {
        let mut stdout = io::stdout().lock();
        match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
            _ => Ok(()),
        }
    }

    /// Shows how many runs and blocks of a campaign are done: a bar on a terminal, a line for each block elsewhere.
    pub(super) fn campaign(&self) -> CampaignView<'_> {
        let bar = (!self.quiet && io::stderr().is_terminal()).then(|| {
            let style = ProgressStyle::with_template(CAMPAIGN_TEMPLATE)
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(0).with_style(style)
        });
        CampaignView { console: self, bar, blocks: Mutex::new(None) }
    }

    /// Shows how far a run is: a bar on a terminal, one line for each phase elsewhere.
    pub(super) fn progress(&self) -> ProgressView<'_> {
        let bar = (!self.quiet && io::stderr().is_terminal()).then(|| {
            let style =
                ProgressStyle::with_template(BAR_TEMPLATE).unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(BAR_STEPS).with_style(style)
        });
        ProgressView { console: self, bar, phase: Mutex::new("") }
    }
}

/// The progress of one run; the bar disappears with it.
pub(super) struct ProgressView<'a> {
    console: &'a Console,
    bar: Option<ProgressBar>,
    phase: Mutex<&'static str>,
}

impl ProgressView<'_> {
    /// Shows `progress`.
    pub(super) fn show(&self, progress: Progress) {
        let Progress { phase, simulated_s, fraction } = progress;
        if let Some(bar) = &self.bar {
            bar.set_message(phase);
            bar.set_prefix(format!("{simulated_s:.0} s"));
            bar.set_position((fraction.clamp(0.0, 1.0) * BAR_STEPS as f64) as u64);
        } else if std::mem::replace(&mut *self.phase.lock().unwrap_or_else(PoisonError::into_inner), phase)
            != phase
        {
            self.console.log(&format!("{phase} (simulated {simulated_s:.0} s)"));
        }
    }
}

impl Drop for ProgressView<'_> {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// The progress of a campaign; the bar disappears with it.
pub(super) struct CampaignView<'a> {
    console: &'a Console,
    bar: Option<ProgressBar>,
    /// Blocks done, as last shown.
    blocks: Mutex<Option<u64>>,
}

impl CampaignView<'_> {
    /// Shows `progress`; called from many threads, so that an older one may come after a newer.
    pub(super) fn show(&self, progress: campaign::Progress) {
        let campaign::Progress { blocks, of_blocks, runs, of_runs } = progress;
        let mut shown = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        if shown.is_some_and(|shown| shown > blocks) {
            return;
        }
        if let Some(bar) = &self.bar {
            bar.set_length(of_runs);
            bar.set_message(format!("{blocks} of {of_blocks} blocks"));
            bar.set_position(runs.max(bar.position()));
        } else if *shown != Some(blocks) {
            self.console.log(&format!("{blocks} of {of_blocks} blocks done"));
        }
        *shown = Some(blocks);
    }
}

impl Drop for CampaignView<'_> {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
