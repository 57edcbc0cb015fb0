//! The control center of a simulation that is killed, and made again of its journal alone.

use super::{RunError, input::JournalOptions, links::Center};
use crate::control::{
    journal::{Journal, JournalError, Life},
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

/// When the control center dies, and when it is back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kill {
    at: TimePs,
    back: Back,
}

/// How a control center is back that was killed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Back {
    /// After so long, made again of its journal.
    After(TimePs),
    /// As another was whose journal tells of it: then, in this boot.
    As(Life),
}

impl Kill {
    /// At a time and for one, seconds.
    pub(super) fn new(at_s: f64, for_s: f64) -> Self {
        Self { at: ps(at_s), back: Back::After(ps(for_s)) }
    }
}

fn ps(seconds: f64) -> TimePs {
    TimePs((seconds * 1e12).round() as i64)
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
    /// While it is dead: when it is back, and in which boot if that is known.
    dead: Option<(TimePs, Option<u16>)>,
    /// The boot of a control center that goes on from a journal.
    boot_epoch: u16,
}

impl Survival {
    /// For a mission with this plan, whose control center dies at these times. Where it goes on from a journal, the plan's boot becomes the
    /// one that the journal begins with, and it dies and is back as the journal tells: so the world comes to where the journal ends as it
    /// did then. From there on only the file counts.
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
        kills.sort_by_key(|kill| kill.at);
        if let Some(for_s) = options.resume_after_s {
            let lives = Journal::lives(file).map_err(failed)?;
            plan.keys = plan.keys.at_boot(lives[0].boot_epoch);
            Journal::resume(file, plan.clone()).map_err(failed)?; // refuses what is not this mission's
            let ends = lives.iter().map(|life| life.ended);
            let backs = lives[1..].iter().map(|life| Back::As(*life)).chain([Back::After(ps(for_s))]);
            let told = ends.zip(backs).map(|(at, back)| Kill { at, back });
            let back = lives[lives.len() - 1].ended.after(ps(for_s));
            kills = told.chain(kills.into_iter().filter(|kill| kill.at > back)).collect();
        } else {
            journal = Some(Journal::create(file, plan).map_err(failed)?);
        }
        let is_temporary = options.path.is_none();
        Ok(Self { journal, path, is_temporary, kills: kills.into(), dead: None, boot_epoch })
    }

    /// Whether there is a control center at `now`; it may die or come back then.
    pub(super) fn is_alive(
        &mut self,
        now: TimePs,
        control: &mut ControlCenter,
        plan: &MissionPlan,
    ) -> Result<bool, RunError> {
        loop {
            if let Some((back, boot_epoch)) = self.dead {
                if now < back {
                    return Ok(false);
                }
                self.dead = None;
                self.bring_back(now, boot_epoch, control, plan)?;
            }
            // One that was killed before its first step is dead at once.
            let Some(kill) = self.kills.pop_front_if(|kill| kill.at <= now) else { return Ok(true) };
            self.dead = Some(match kill.back {
                Back::After(pause) => (now.after(pause), None),
                Back::As(life) => (life.begun, Some(life.boot_epoch)),
            });
            if self.journal.take().is_some() {
                self.tear();
            }
        }
    }

    /// Makes the control center again of its journal; where another's life is told, in its boot, it still is what it was.
    fn bring_back(
        &mut self,
        now: TimePs,
        boot_epoch: Option<u16>,
        control: &mut ControlCenter,
        plan: &MissionPlan,
    ) -> Result<(), RunError> {
        if let Some(boot_epoch) = boot_epoch {
            control.resume(now, boot_epoch);
            return Ok(());
        }
        let Some(path) = &self.path else { return Ok(()) };
        let (mut journal, replayed) = Journal::resume(path, plan.clone()).map_err(failed)?;
        *control = replayed;
        // Of a file of keys a boot was spent for this start; in a simulation they are counted on.
        let epoch = self.boot_epoch.max(control.plan().keys.boot_epoch() + 1);
        journal.resumed(now, epoch).map_err(failed)?;
        control.resume(now, epoch);
        self.journal = Some(journal);
        Ok(())
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
    fn refused(&self) -> u64 {
        self.control.refused()
    }

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
