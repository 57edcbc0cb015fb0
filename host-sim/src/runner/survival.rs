//! The control center of a simulation that is killed, and made again of its journal alone.

use super::{RunError, input::JournalOptions, links::Center};
use crate::control::{
    journal::{Journal, JournalError},
    mission::{ControlCenter, MissionError, plan::MissionPlan},
};
use skyroost_protocol::units::{DroneId, TimePs};
use std::{
    collections::VecDeque,
    fs::{self, OpenOptions},
    io::Write,
    path::PathBuf,
    process,
    sync::atomic::{AtomicU64, Ordering},
};

/// When the control center dies, and for how long it is dead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kill {
    pub(super) at_s: f64,
    pub(super) for_s: f64,
}

/// What keeps a control center from being lost.
#[derive(Debug, Default)]
pub(super) struct Survival {
    journal: Option<Journal>,
    /// Where it is; none where nothing is journalled.
    path: Option<PathBuf>,
    /// Whether nobody asked for the file.
    is_temporary: bool,
    kills: VecDeque<Kill>,
    back_at_s: Option<f64>,
    /// The boot of a control center that goes on from a journal.
    boot_epoch: u16,
}

impl Survival {
    /// For a mission with this plan, whose control center dies at these times. Where it goes on from a journal, the plan's boot becomes the
    /// one that the journal begins with: the world comes to where the journal ends as it did then.
    pub(super) fn new(
        options: &JournalOptions,
        mut kills: Vec<Kill>,
        plan: &mut MissionPlan,
    ) -> Result<Self, RunError> {
        let boot_epoch = plan.keys.boot_epoch();
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let name =
            || format!("skyroost-{}-{}.journal", process::id(), NUMBER.fetch_add(1, Ordering::Relaxed));
        let path = match &options.path {
            Some(path) => Some(path.clone()),
            None if kills.is_empty() => None,
            None => Some(std::env::temp_dir().join(name())),
        };
        let Some(file) = &path else { return Ok(Self::default()) };
        let mut journal = None;
        if let Some(for_s) = options.resume_after_s {
            // The world has to come there again, with the control center that was; then only its file counts.
            let [first] = Journal::boots(file).map_err(failed)?[..] else {
                return Err(failed(JournalError::Resumed { path: file.clone() }));
            };
            plan.keys = plan.keys.at_boot(first);
            let (_, replayed) = Journal::resume(file, plan.clone()).map_err(failed)?;
            let at_s = replayed.until.map_or(0.0, |until| until.0 as f64 * 1e-12 + 1e-6);
            kills = vec![Kill { at_s, for_s }];
        } else {
            journal = Some(Journal::create(file, plan).map_err(failed)?);
        }
        kills.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        let is_temporary = options.path.is_none();
        Ok(Self { journal, path, is_temporary, kills: kills.into(), back_at_s: None, boot_epoch })
    }

    /// Whether there is a control center at `now`; it may die or come back then.
    pub(super) fn is_alive(
        &mut self,
        now: TimePs,
        control: &mut ControlCenter,
        plan: &MissionPlan,
    ) -> Result<bool, RunError> {
        let now_s = now.0 as f64 * 1e-12;
        if self.back_at_s.is_none()
            && let Some(kill) = self.kills.front().copied().filter(|kill| kill.at_s <= now_s)
        {
            self.kills.pop_front();
            self.back_at_s = Some(now_s + kill.for_s);
            if self.journal.take().is_some() {
                self.tear();
            }
        }
        let Some(back_at_s) = self.back_at_s else { return Ok(true) };
        if now_s < back_at_s {
            return Ok(false);
        }
        self.back_at_s = None;
        let Some(path) = &self.path else { return Ok(true) };
        let (mut journal, replayed) = Journal::resume(path, plan.clone()).map_err(failed)?;
        *control = replayed.control;
        // Of a file of keys a boot was spent for this start; in a simulation they are counted on.
        let epoch = self.boot_epoch.max(control.plan().keys.boot_epoch() + 1);
        journal.resumed(now, epoch).map_err(failed)?;
        control.resume(now, epoch);
        self.journal = Some(journal);
        Ok(true)
    }

    /// Whoever dies while writing leaves half a record.
    fn tear(&self) {
        if let Some(path) = &self.path
            && let Ok(mut file) = OpenOptions::new().append(true).open(path)
        {
            let _ = file.write_all(&[200, 0, 0, 0, 1]); // the next to read it finds it torn or, if this failed, whole
        }
    }

    /// The control center behind its journal.
    pub(super) fn journalled<'a>(&'a mut self, control: &'a mut ControlCenter) -> Journalled<'a> {
        Journalled { control, journal: self.journal.as_mut() }
    }
}

impl Drop for Survival {
    fn drop(&mut self) {
        if let Some(path) = self.path.as_ref().filter(|_| self.is_temporary) {
            let _ = fs::remove_file(path); // nobody knows of it
        }
    }
}

fn failed(error: JournalError) -> RunError {
    match error {
        JournalError::Mission(error) => error.into(),
        error => RunError::BadInput(super::InputError::Journal(error)),
    }
}

/// A control center that writes down what it is told before it says anything.
pub(super) struct Journalled<'a> {
    control: &'a mut ControlCenter,
    journal: Option<&'a mut Journal>,
}

impl Center for Journalled<'_> {
    fn receive(
        &mut self,
        now: TimePs,
        from: DroneId,
        bytes: &[u8],
        send: &mut impl FnMut(DroneId, &[u8]),
    ) -> Result<(), MissionError> {
        if let Some(journal) = &mut self.journal {
            journal.frame(from, bytes);
        }
        self.control.receive(now, from, bytes, send)
    }

    fn step(&mut self, now: TimePs, send: &mut impl FnMut(DroneId, &[u8])) -> Result<(), MissionError> {
        // What was answered to frames of this step waits for it as well: nothing is said before the step has ended.
        if let Some(journal) = &mut self.journal {
            journal.step(now).map_err(|error| MissionError::Journal(error.to_string()))?;
        }
        self.control.step(now, send)
    }
}
