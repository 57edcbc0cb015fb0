//! The control center's journal: everything that it was told, in order, on disk before it says a word about it.
//!
//! [`ControlCenter`] reads no clock and draws no chance of its own: what it knows follows from its plan, the boot it runs in, and
//! what came in when. So that is all that is written, and a control center that was killed is made again by being told the same.
//! Users that were located stay located, commands keep their numbers, and a drone that was told something is not told it twice.
//!
//! The file is a line of eight bytes, then records of a length, a checksum (the low half of XXH3) and so many bytes; integers are little-endian. A record
//! that was cut off or damaged ends the journal: what had not been written had not been acted upon.

use super::mission::{ControlCenter, MissionError, plan::MissionPlan};
use skyroost_protocol::units::{DroneId, TimePs};
use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write},
    path::{Path, PathBuf},
};
use thiserror::Error;
use xxhash_rust::xxh3::xxh3_64;

/// What a journal begins with.
const MAGIC: &[u8; 8] = b"SKYJRNL1";
/// Bytes of a record before its own.
const RECORD_HEAD: usize = 8;
/// No record is longer: a step takes in some hundred bytes of each drone.
const MOST_BYTES: usize = 1 << 26;

/// First byte of each kind of record.
mod kind {
    pub(super) const PLAN: u8 = 0;
    pub(super) const STEP: u8 = 1;
    pub(super) const RESUME: u8 = 2;
}

/// Why there is no journal.
#[derive(Debug, Error)]
pub enum JournalError {
    /// The file cannot be read or written.
    #[error("{}: {source}", .path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is no journal, or holds not even a plan.
    #[error("{}: found no journal of a control center, expected one that `skyroost mission --journal` wrote", .path.display())]
    NoJournal {
        /// Which file.
        path: PathBuf,
    },
    /// It is the journal of another mission.
    #[error("{}: found the journal of another mission, expected that of this scenario, seed and input", .path.display())]
    AnotherMission {
        /// Which file.
        path: PathBuf,
    },
    /// It went on before: the world of a simulation is flown there again as if nobody had been killed, and somebody was.
    #[error("{}: found the journal of a mission that went on from it already, expected one that was killed once", .path.display())]
    Resumed {
        /// Which file.
        path: PathBuf,
    },
    /// What it tells ends a mission.
    #[error(transparent)]
    Mission(#[from] MissionError),
}

/// A journal that is being written.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// The record of the step under way.
    step: Vec<u8>,
}

/// A control center made again of its journal.
#[derive(Debug)]
pub struct Replayed {
    /// As it was when the journal ended.
    pub control: ControlCenter,
    /// The last step in it.
    pub until: Option<TimePs>,
}

/// What tells one mission from another: all of the plan but the keys.
#[must_use]
pub fn plan_hash(plan: &MissionPlan) -> u64 {
    let public = MissionPlan { keys: super::keys::LinkKeys::none(), ..plan.clone() };
    xxh3_64(format!("{public:?}").as_bytes())
}

impl Journal {
    /// Begins a journal, in the place of one that is there.
    ///
    /// # Errors
    /// [`JournalError::Io`].
    pub fn create(path: &Path, plan: &MissionPlan) -> Result<Self, JournalError> {
        let io = |source| JournalError::Io { path: path.to_owned(), source };
        let mut file = File::create(path).map_err(io)?;
        file.write_all(MAGIC).map_err(io)?;
        let mut journal = Self { path: path.to_owned(), file, step: Vec::new() };
        let mut record = vec![kind::PLAN];
        record.extend(plan_hash(plan).to_le_bytes());
        record.extend(plan.keys.boot_epoch().to_le_bytes());
        journal.append(&record)?;
        Ok(journal)
    }

    /// Takes a journal up where its last whole record ends, and makes the control center of `plan` again that wrote it.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn resume(path: &Path, plan: MissionPlan) -> Result<(Self, Replayed), JournalError> {
        let io = |source| JournalError::Io { path: path.to_owned(), source };
        let bytes = fs::read(path).map_err(io)?;
        let records = bytes.strip_prefix(MAGIC).ok_or(JournalError::NoJournal { path: path.to_owned() })?;
        let (replayed, read) = replay(path, records, plan)?;
        let file = OpenOptions::new().append(true).open(path).map_err(io)?;
        file.set_len((MAGIC.len() + read) as u64).map_err(io)?;
        Ok((Self { path: path.to_owned(), file, step: Vec::new() }, replayed))
    }

    /// The boots of the control centers that wrote a journal, in their order.
    ///
    /// # Errors
    /// [`JournalError`], where there is no journal.
    pub fn boots(path: &Path) -> Result<Vec<u16>, JournalError> {
        let bytes = fs::read(path).map_err(|source| JournalError::Io { path: path.to_owned(), source })?;
        let mut rest = bytes.strip_prefix(MAGIC).ok_or(JournalError::NoJournal { path: path.to_owned() })?;
        let mut boots = Vec::new();
        while let Some(record) = next(&mut rest) {
            if let [kind::PLAN | kind::RESUME, .., low, high] = *record {
                boots.push(u16::from_le_bytes([low, high]));
            }
        }
        if boots.is_empty() { Err(JournalError::NoJournal { path: path.to_owned() }) } else { Ok(boots) }
    }

    /// A frame came in, of the step under way.
    pub fn frame(&mut self, from: DroneId, bytes: &[u8]) {
        if self.step.is_empty() {
            self.begin_step();
        }
        self.step.extend(from.0.to_le_bytes());
        self.step.extend((bytes.len() as u16).to_le_bytes());
        self.step.extend(bytes);
    }

    /// The step under way is that at `now`; when this returns it is written.
    ///
    /// # Errors
    /// [`JournalError::Io`].
    pub fn step(&mut self, now: TimePs) -> Result<(), JournalError> {
        if self.step.is_empty() {
            self.begin_step();
        }
        let mut record = std::mem::take(&mut self.step);
        record[1..9].copy_from_slice(&now.0.to_le_bytes());
        let written = self.append(&record);
        record.clear();
        self.step = record;
        written
    }

    /// The control center goes on at `now` in a new boot.
    ///
    /// # Errors
    /// [`JournalError::Io`].
    pub fn resumed(&mut self, now: TimePs, boot_epoch: u16) -> Result<(), JournalError> {
        let mut record = vec![kind::RESUME];
        record.extend(now.0.to_le_bytes());
        record.extend(boot_epoch.to_le_bytes());
        self.append(&record)
    }

    fn begin_step(&mut self) {
        self.step.push(kind::STEP);
        self.step.extend([0; 8]);
    }

    fn append(&mut self, record: &[u8]) -> Result<(), JournalError> {
        let mut whole = Vec::with_capacity(RECORD_HEAD + record.len());
        whole.extend((record.len() as u32).to_le_bytes());
        whole.extend(checksum(record).to_le_bytes());
        whole.extend(record);
        let io = |source| JournalError::Io { path: self.path.clone(), source };
        self.file.write_all(&whole).map_err(io)
    }
}

/// Tells the control center of `plan` what the records say, as far as they are whole: how it stands then, and how many bytes that
/// were.
fn replay(path: &Path, records: &[u8], mut plan: MissionPlan) -> Result<(Replayed, usize), JournalError> {
    let mut rest = records;
    let first = next(&mut rest).and_then(|record| match record {
        [kind::PLAN, body @ ..] => {
            let (hash, epoch) = body.split_at_checked(8)?;
            Some((u64::from_le_bytes(hash.try_into().ok()?), u16::from_le_bytes(epoch.try_into().ok()?)))
        }
        _ => None,
    });
    let (hash, boot_epoch) = first.ok_or(JournalError::NoJournal { path: path.to_owned() })?;
    if hash != plan_hash(&plan) {
        return Err(JournalError::AnotherMission { path: path.to_owned() });
    }
    plan.keys = plan.keys.at_boot(boot_epoch);
    let mut replayed = Replayed { control: ControlCenter::new(plan), until: None };
    let mut read = records.len() - rest.len();
    while let Some(record) = next(&mut rest) {
        if tell(&mut replayed, record)?.is_none() {
            break;
        }
        read = records.len() - rest.len();
    }
    Ok((replayed, read))
}

fn checksum(record: &[u8]) -> u32 {
    xxh3_64(record) as u32
}

/// Takes the next record off, if it is whole.
fn next<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (head, after) = rest.split_at_checked(RECORD_HEAD)?;
    let length = u32::from_le_bytes(head[..4].try_into().ok()?) as usize;
    let written = u32::from_le_bytes(head[4..].try_into().ok()?);
    if length > MOST_BYTES {
        return None;
    }
    let (record, after) = after.split_at_checked(length)?;
    if checksum(record) != written {
        return None;
    }
    *rest = after;
    Some(record)
}

/// Tells the control center what a record says; none where it says nothing.
fn tell(replayed: &mut Replayed, record: &[u8]) -> Result<Option<()>, MissionError> {
    let Some((&what, body)) = record.split_first() else { return Ok(None) };
    let Some((time, mut body)) = body.split_at_checked(8) else { return Ok(None) };
    let now = TimePs(i64::from_le_bytes(time.try_into().expect("eight bytes")));
    let unheard = &mut |_: DroneId, _: &[u8]| {};
    match what {
        kind::STEP => {
            while !body.is_empty() {
                let Some((head, after)) = body.split_at_checked(4) else { return Ok(None) };
                let from = DroneId(u16::from_le_bytes([head[0], head[1]]));
                let length = usize::from(u16::from_le_bytes([head[2], head[3]]));
                let Some((frame, after)) = after.split_at_checked(length) else { return Ok(None) };
                replayed.control.receive(now, from, frame, unheard)?;
                body = after;
            }
            replayed.control.step(now, unheard)?;
        }
        kind::RESUME => {
            let Ok(epoch) = body.try_into() else { return Ok(None) };
            replayed.control.resume(now, u16::from_le_bytes(epoch));
        }
        _ => return Ok(None),
    }
    replayed.until = Some(now);
    Ok(Some(()))
}
