//! The control center's journal: everything that it was told, in order, written before it says a word about it.
//!
//! [`ControlCenter`] reads no clock and draws no chance of its own: what it knows follows from its plan, the boot it runs in, and
//! what came in when. So that is all that is written, and a control center that was killed is made again by being told the same.
//! Users that were located stay located, commands keep their numbers, and a drone that was told something is not told it twice.
//!
//! The file is a line of eight bytes, then records of a length, a checksum (the low half of XXH3) and so many bytes; integers are
//! little-endian. A record that was cut off or damaged ends the journal: what had not been written had not been acted upon. Written is
//! what the operating system has: a control center that dies loses nothing, a machine that loses power what was not on disk.

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
    /// It is there already, and may be all that is known of a mission.
    #[error("{}: is there already, expected a new file, or --resume to go on from it", .path.display())]
    Exists {
        /// Which file.
        path: PathBuf,
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

/// One of the control centers that wrote a journal, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Life {
    /// Its boot.
    pub boot_epoch: u16,
    /// When it began.
    pub begun: TimePs,
    /// It acted on every step before this, and on none from here on.
    pub ended: TimePs,
}

/// What tells one mission from another: all of the plan but the keys.
#[must_use]
pub fn plan_hash(plan: &MissionPlan) -> u64 {
    let public = MissionPlan { keys: super::keys::LinkKeys::none(), ..plan.clone() };
    xxh3_64(format!("{public:?}").as_bytes())
}

impl Journal {
    /// Begins a journal in a new file.
    ///
    /// # Errors
    /// [`JournalError::Exists`] and [`JournalError::Io`].
    pub fn create(path: &Path, plan: &MissionPlan) -> Result<Self, JournalError> {
        let io = |source: io::Error| match source.kind() {
            io::ErrorKind::AlreadyExists => JournalError::Exists { path: path.to_owned() },
            _ => JournalError::Io { path: path.to_owned(), source },
        };
        let mut file = File::create_new(path).map_err(io)?;
        file.write_all(MAGIC).map_err(io)?;
        let mut journal = Self { path: path.to_owned(), file, step: Vec::new() };
        let mut record = vec![kind::PLAN];
        record.extend(plan_hash(plan).to_le_bytes());
        record.extend(plan.keys.boot_epoch().to_le_bytes());
        journal.append(&record)?;
        Ok(journal)
    }

    /// Takes a journal up where its last whole record ends, and makes the control center of `plan` again that wrote it, as it was then.
    ///
    /// # Errors
    /// [`JournalError`].
    pub fn resume(path: &Path, plan: MissionPlan) -> Result<(Self, ControlCenter), JournalError> {
        let io = |source| JournalError::Io { path: path.to_owned(), source };
        let bytes = fs::read(path).map_err(io)?;
        let records = bytes.strip_prefix(MAGIC).ok_or(JournalError::NoJournal { path: path.to_owned() })?;
        let (control, read) = replay(path, records, plan)?;
        let file = OpenOptions::new().append(true).open(path).map_err(io)?;
        file.set_len((MAGIC.len() + read) as u64).map_err(io)?;
        Ok((Self { path: path.to_owned(), file, step: Vec::new() }, control))
    }

    /// The control centers that wrote a journal, at least one.
    ///
    /// # Errors
    /// [`JournalError`], where there is no journal.
    pub fn lives(path: &Path) -> Result<Vec<Life>, JournalError> {
        let bytes = fs::read(path).map_err(|source| JournalError::Io { path: path.to_owned(), source })?;
        let mut rest = bytes.strip_prefix(MAGIC).ok_or(JournalError::NoJournal { path: path.to_owned() })?;
        let mut lives: Vec<Life> = Vec::new();
        while let Some(record) = next(&mut rest) {
            match (record, lives.last_mut()) {
                ([kind::PLAN, .., low, high], None) => {
                    let boot_epoch = u16::from_le_bytes([*low, *high]);
                    lives.push(Life { boot_epoch, begun: TimePs(0), ended: TimePs(0) });
                }
                ([kind::RESUME, body @ .., low, high], Some(_)) => {
                    let Some(begun) = time_of(body) else { break };
                    lives.push(Life { boot_epoch: u16::from_le_bytes([*low, *high]), begun, ended: begun });
                }
                ([kind::STEP, body @ ..], Some(life)) => {
                    let Some(now) = time_of(body) else { break };
                    life.ended = now.after(TimePs(1));
                }
                _ => break,
            }
        }
        if lives.is_empty() { Err(JournalError::NoJournal { path: path.to_owned() }) } else { Ok(lives) }
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
        let io = |source| JournalError::Io { path: self.path.clone(), source };
        self.file.write_all(&framed(record)).map_err(io)
    }
}

/// A record as it stands in the file.
fn framed(record: &[u8]) -> Vec<u8> {
    let mut whole = Vec::with_capacity(RECORD_HEAD + record.len());
    whole.extend((record.len() as u32).to_le_bytes());
    whole.extend(checksum(record).to_le_bytes());
    whole.extend(record);
    whole
}

/// Tells the control center of `plan` what the records say, as far as they are whole: how it stands then, and how many bytes that
/// were.
fn replay(
    path: &Path,
    records: &[u8],
    mut plan: MissionPlan,
) -> Result<(ControlCenter, usize), JournalError> {
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
    let mut control = ControlCenter::new(plan);
    let mut read = records.len() - rest.len();
    while let Some(record) = next(&mut rest) {
        if tell(&mut control, record)?.is_none() {
            break;
        }
        read = records.len() - rest.len();
    }
    Ok((control, read))
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

/// The time that a record's body begins with.
fn time_of(body: &[u8]) -> Option<TimePs> {
    body.first_chunk().map(|bytes| TimePs(i64::from_le_bytes(*bytes)))
}

/// Tells the control center what a record says; none where it says nothing.
fn tell(control: &mut ControlCenter, record: &[u8]) -> Result<Option<()>, MissionError> {
    let Some((&what, body)) = record.split_first() else { return Ok(None) };
    let (Some(now), Some((_, mut body))) = (time_of(body), body.split_at_checked(8)) else { return Ok(None) };
    let unheard = &mut |_: DroneId, _: &[u8]| {};
    match what {
        kind::STEP => {
            while !body.is_empty() {
                let Some((head, after)) = body.split_at_checked(4) else { return Ok(None) };
                let from = DroneId(u16::from_le_bytes([head[0], head[1]]));
                let length = usize::from(u16::from_le_bytes([head[2], head[3]]));
                let Some((frame, after)) = after.split_at_checked(length) else { return Ok(None) };
                control.receive(now, from, frame, unheard)?;
                body = after;
            }
            control.step(now, unheard)?;
        }
        kind::RESUME => {
            let Ok(epoch) = body.try_into() else { return Ok(None) };
            control.resume(now, u16::from_le_bytes(epoch));
        }
        _ => return Ok(None),
    }
    Ok(Some(()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(mut bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut records = Vec::new();
        while let Some(record) = next(&mut bytes) {
            records.push(record.to_vec());
        }
        records
    }

    proptest! {
        /// A journal that is cut off anywhere holds the records before the cut, and one with a damaged bit those before the damage.
        #[test]
        fn what_is_whole_is_read_up_to_what_is_not(
            records in prop::collection::vec(prop::collection::vec(any::<u8>(), 1..40), 1..8),
            at in any::<prop::sample::Index>(),
            bit in 0..8_u8,
        ) {
            let whole: Vec<u8> = records.iter().flat_map(|record| framed(record)).collect();
            prop_assert_eq!(&read(&whole), &records);
            let at = at.index(whole.len());
            let mut ends = records.iter().scan(0, |end, record| {
                *end += RECORD_HEAD + record.len();
                Some(*end)
            });
            let before = ends.position(|end| end > at).unwrap_or(records.len());
            prop_assert_eq!(&read(&whole[..at])[..], &records[..before]);
            let mut damaged = whole;
            damaged[at] ^= 1_u8 << bit;
            prop_assert_eq!(&read(&damaged)[..], &records[..before]);
        }
    }

    #[test]
    fn each_control_center_is_known_by_when_it_lived() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mission.journal");
        let at = |ms: i64| TimePs::from_ms(ms);
        let step = |ms: i64| [&[kind::STEP][..], &at(ms).0.to_le_bytes()].concat();
        let back =
            |ms: i64, boot: u16| [&[kind::RESUME][..], &at(ms).0.to_le_bytes(), &boot.to_le_bytes()].concat();
        let plan = [&[kind::PLAN][..], &[7; 8], &3_u16.to_le_bytes()].concat();
        let records = [plan, step(0), step(40), back(5_080, 4), back(10_080, 6), step(10_080)];
        let whole: Vec<u8> = records.iter().flat_map(|record| framed(record)).collect();
        let life = |boot_epoch, begun, ended| Life { boot_epoch, begun, ended };
        let after = |ms: i64| at(ms).after(TimePs(1));
        let lives = [
            life(3, at(0), after(40)),
            life(4, at(5_080), at(5_080)), // died before its first step
            life(6, at(10_080), after(10_080)),
        ];
        fs::write(&path, [&MAGIC[..], &whole, &[200, 0, 0, 0, 1]].concat()).unwrap();
        assert_eq!(Journal::lives(&path).unwrap(), lives, "half a record at the end counts for nothing");
    }

    #[test]
    fn a_file_that_is_none_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mission.journal");
        assert!(matches!(Journal::lives(&path), Err(JournalError::Io { .. })));
        for text in [&b""[..], b"SKYJRNL", b"SKYJRNL1", b"SKYJRNL2 and more"] {
            fs::write(&path, text).unwrap();
            let error = Journal::lives(&path).unwrap_err().to_string();
            assert!(error.contains("mission.journal: found no journal"), "{error}");
        }
    }
}
