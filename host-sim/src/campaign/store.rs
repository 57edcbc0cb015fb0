//! The directory of a campaign: which blocks are done, which are not, and doing them.
//!
//! `manifest.json` says what there is to do, `blocks/00007.csv` is a block that is done, `times/00007.csv` how long its
//! runs took. Nothing else is kept, so nothing can be out of step: a block is done when its file says so and its
//! checksum holds.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;

use super::block;
use super::closed::Closed;
use super::files::{failed, write_whole};
use super::flown::Flown;
use super::manifest::{self, Manifest, ManifestError};
use super::plan::{Fidelity, Plan, PlanOverrides};
use super::runs::Row;
use super::{CampaignError, FileError, RunFailure, Timed};

/// Directories of blocks, and of how long they took.
pub(super) const BLOCKS: &str = "blocks";
pub(super) const TIMES: &str = "times";
/// Columns of the times.
pub(super) const TIMES_HEADER: &str = "run,method,wall_s";
/// Most blocks named in a message.
const NAMED: usize = 20;

/// A campaign and its directory.
#[derive(Clone, Debug)]
pub struct Campaign {
    dir: PathBuf,
    plan: Plan,
    manifest: Manifest,
}

/// How far a campaign is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Blocks that are done, those of earlier commands as well.
    pub blocks: u64,
    /// Blocks in all.
    pub of_blocks: u64,
    /// Runs that this command has done.
    pub runs: u64,
    /// Runs that this command has to do.
    pub of_runs: u64,
}

/// Blocks still to be done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Left {
    /// Blocks in all.
    pub blocks: u64,
    /// Numbers of those to be done, ascending, damaged ones among them.
    pub missing: Vec<u64>,
    /// Those that are there and damaged, and what is wrong with each.
    pub corrupted: Vec<(u64, String)>,
}

impl fmt::Display for Left {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { blocks, missing, corrupted } = self;
        let named: Vec<String> = missing.iter().take(NAMED).map(u64::to_string).collect();
        let more = if missing.len() > NAMED { ", ..." } else { "" };
        write!(f, "{} of {blocks} blocks are missing: {}{more}", missing.len(), named.join(", "))?;
        if let Some((block, what)) = corrupted.first() {
            write!(f, "; {} of them damaged, first block {block}: {what}", corrupted.len())?;
        }
        write!(f, "; `skyroost campaign run` does them")
    }
}

impl Campaign {
    /// Plans a campaign: writes its manifest, or finds the same one there.
    ///
    /// # Errors
    /// Where the plan is wrong, the directory holds another campaign, or cannot be written to.
    pub fn plan(file: &Path, dir: &Path, overrides: PlanOverrides) -> Result<Self, CampaignError> {
        let (plan, text) = Plan::read(file, overrides)?;
        let name = file.display().to_string();
        Model::new(&plan).map_err(|source| CampaignError::Formation { file: name, source })?;
        let manifest = Manifest::of(&plan, text)?;
        let path = dir.join(manifest::FILE);
        match fs::read_to_string(&path) {
            Ok(found) if found == manifest.to_json() => {}
            Ok(_) => {
                let found = "a campaign of another plan or program".to_owned();
                let expected = "a directory without a campaign, or with this one".to_owned();
                return Err(ManifestError::Field { path, field: "--out", found, expected }.into());
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                for made in [dir.join(BLOCKS), dir.join(TIMES)] {
                    fs::create_dir_all(&made).map_err(failed(&made, "made"))?;
                }
                write_whole(&path, manifest.to_json().as_bytes())?;
            }
            Err(error) => return Err(failed(&path, "read")(error).into()),
        }
        Ok(Self { dir: dir.to_owned(), plan, manifest })
    }

    /// Opens a campaign that was planned.
    ///
    /// # Errors
    /// Where there is none, or its manifest does not hold together.
    pub fn open(dir: &Path) -> Result<Self, CampaignError> {
        let (manifest, plan) = Manifest::read(dir)?;
        Ok(Self { dir: dir.to_owned(), plan, manifest })
    }

    /// What is to be done.
    #[must_use]
    pub const fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// What is varied and what is not.
    #[must_use]
    pub const fn plan_of(&self) -> &Plan {
        &self.plan
    }

    /// Where it lies.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// What is still to be done.
    ///
    /// # Errors
    /// Where a block is there and cannot be read.
    pub fn left(&self) -> Result<Left, CampaignError> {
        Ok(self.rows_and_left()?.1)
    }

    /// All rows that there are, by block, and what is still to be done.
    pub(super) fn rows_and_left(&self) -> Result<(Vec<Row>, Left), CampaignError> {
        let blocks = self.plan.blocks();
        let states: Vec<State> =
            (0..blocks).into_par_iter().map(|block| self.state(block)).collect::<Result<_, _>>()?;
        let (mut rows, mut left) = (Vec::new(), Left { blocks, ..Left::default() });
        for (block, state) in (0..).zip(states) {
            match state {
                State::Done(own) => rows.extend(own),
                State::Missing => left.missing.push(block),
                State::Corrupted(what) => {
                    left.missing.push(block);
                    left.corrupted.push((block, what));
                }
            }
        }
        Ok((rows, left))
    }

    fn state(&self, block: u64) -> Result<State, FileError> {
        let path = self.file(BLOCKS, block);
        match fs::read(&path) {
            Ok(bytes) => Ok(match block::decode(&self.manifest, &self.plan, block, &bytes) {
                Ok(rows) => State::Done(rows),
                Err(what) => State::Corrupted(what),
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(State::Missing),
            Err(error) => Err(failed(&path, "read")(error)),
        }
    }

    /// Does what is left, or of it only one block. Says what was done, by number.
    ///
    /// # Errors
    /// Where this is not the program that planned it, there is no such block, a run fails, a block cannot be written, or
    /// `cancel` was set: blocks that are done by then stay.
    pub fn run(
        &self,
        only: Option<u64>,
        cancel: &AtomicBool,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Left, CampaignError> {
        self.manifest.check_program(&self.dir)?;
        let last = self.plan.blocks() - 1;
        if let Some(found) = only.filter(|&block| block > last) {
            return Err(CampaignError::NoBlock { found, last });
        }
        let mut left = match only {
            // One block of many is not worth reading all.
            Some(block) => self.one(block)?,
            None => self.left()?,
        };
        left.blocks = self.plan.blocks();
        let sizes = left.missing.iter().filter_map(|&block| self.plan.block(block));
        let of_runs: u64 = sizes.map(|runs| runs.end - runs.start).sum();
        let before = if only.is_some() { 0 } else { left.blocks - left.missing.len() as u64 };
        let of_blocks = if only.is_some() { left.missing.len() as u64 } else { left.blocks };
        let (blocks, runs) = (AtomicU64::new(before), AtomicU64::new(0));
        let tell = || {
            progress(Progress {
                blocks: blocks.load(Ordering::Relaxed),
                of_blocks,
                runs: runs.load(Ordering::Relaxed),
                of_runs,
            });
        };
        tell();
        let model = Model::new(&self.plan).map_err(|source| CampaignError::Formation {
            file: self.dir.join(manifest::FILE).display().to_string(),
            source,
        })?;
        // Few blocks are shared out by their runs, so that no core idles.
        let share_runs = left.missing.len() < rayon::current_num_threads();
        let run = |number: u64| {
            if cancel.load(Ordering::Relaxed) {
                return Err(CampaignError::Interrupted);
            }
            let timed = self.timed(&model, number, cancel)?;
            runs.fetch_add(1, Ordering::Relaxed);
            tell();
            Ok(timed)
        };
        left.missing.par_iter().try_for_each(|&block| {
            let numbers = self.plan.block(block).unwrap_or(0..0);
            let timed: Vec<Vec<Timed>> = if share_runs {
                numbers.into_par_iter().map(run).collect::<Result<_, _>>()?
            } else {
                numbers.map(run).collect::<Result<_, _>>()?
            };
            self.write(block, &timed.concat())?;
            blocks.fetch_add(1, Ordering::Relaxed);
            tell();
            Ok::<(), CampaignError>(())
        })?;
        Ok(left)
    }

    /// What is left of one block.
    fn one(&self, block: u64) -> Result<Left, CampaignError> {
        let (missing, corrupted) = match self.state(block)? {
            State::Done(_) => (Vec::new(), Vec::new()),
            State::Missing => (vec![block], Vec::new()),
            State::Corrupted(what) => (vec![block], vec![(block, what)]),
        };
        Ok(Left { blocks: 1, missing, corrupted })
    }

    fn timed(&self, model: &Model, number: u64, cancel: &AtomicBool) -> Result<Vec<Timed>, CampaignError> {
        let Some(run) = self.plan.run(number) else { return Ok(Vec::new()) };
        let rows = match model {
            Model::Closed(closed) => closed.rows(&run),
            Model::Flown(flown) => flown.rows(&run, cancel),
        };
        rows.map_err(|source| match source {
            RunFailure::Mission(crate::runner::RunError::Interrupted) => CampaignError::Interrupted,
            source => CampaignError::Run { run: number, source },
        })
    }

    /// Writes a block that is done; its times first, so that whoever sees the block sees them too.
    fn write(&self, block: u64, timed: &[Timed]) -> Result<(), FileError> {
        let mut times = format!("{TIMES_HEADER}\n");
        for Timed { row, wall_s } in timed {
            times += &format!("{},{},{wall_s:.6}\n", row.run, row.method.name());
        }
        write_whole(&self.file(TIMES, block), times.as_bytes())?;
        let rows: Vec<Row> = timed.iter().map(|timed| timed.row).collect();
        let text = block::encode(&self.manifest, block, &rows);
        write_whole(&self.file(BLOCKS, block), text.as_bytes())
    }

    /// The file of a block.
    pub(super) fn file(&self, dir: &str, block: u64) -> PathBuf {
        self.dir.join(dir).join(format!("{block:05}.csv"))
    }
}

/// What there is of a block.
enum State {
    Done(Vec<Row>),
    Missing,
    Corrupted(String),
}

/// What does the runs.
enum Model {
    Closed(Closed),
    Flown(Box<Flown>),
}

impl Model {
    fn new(plan: &Plan) -> Result<Self, crate::control::accuracy::AccuracyError> {
        Ok(match plan.campaign.fidelity {
            Fidelity::Paper => Self::Closed(Closed::new(plan)?),
            Fidelity::Flight => Self::Flown(Box::new(Flown::new(plan))),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOML: &str = "[campaign]\nseeds = 4\ndensities_per_km2 = [1, 20]\nr_e_m = [30]\nblock_runs = 3\n\
                        [mission]\ntime_s = 60\n";

    fn planned(text: &str) -> (tempfile::TempDir, Campaign) {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("plan.toml"), text).unwrap();
        let campaign =
            Campaign::plan(&dir.path().join("plan.toml"), &dir.path().join("out"), PlanOverrides::default())
                .unwrap();
        (dir, campaign)
    }

    fn run(campaign: &Campaign, only: Option<u64>) -> Vec<u64> {
        campaign.run(only, &AtomicBool::new(false), &|_| {}).unwrap().missing
    }

    fn bytes(campaign: &Campaign) -> Vec<Vec<u8>> {
        (0..3).map(|block| fs::read(campaign.file(BLOCKS, block)).unwrap()).collect()
    }

    #[test]
    fn blocks_are_the_same_whoever_runs_them_and_damage_is_mended() {
        let (_dir, campaign) = planned(TOML);
        assert_eq!(campaign.left().unwrap().missing, [0, 1, 2]);
        assert_eq!(run(&campaign, None), [0, 1, 2]);
        let all = bytes(&campaign);
        assert_eq!((run(&campaign, None), run(&campaign, Some(1))), (vec![], vec![]));
        // Block by block, backwards, elsewhere.
        let (_other_dir, other) = planned(TOML);
        for block in [2, 1, 0] {
            assert_eq!(run(&other, Some(block)), [block]);
        }
        assert_eq!(bytes(&other), all);
        // Damaged, lost and half-written.
        let path = campaign.file(BLOCKS, 1);
        let damaged = String::from_utf8(all[1].clone()).unwrap().replacen(",proposed,1,", ",proposed,2,", 1);
        assert_ne!(damaged.as_bytes(), all[1]);
        fs::write(&path, damaged).unwrap();
        fs::remove_file(campaign.file(BLOCKS, 2)).unwrap();
        fs::write(campaign.dir().join("blocks/.00002.csv.9-0-0.partial"), "half").unwrap();
        let left = campaign.left().unwrap();
        assert_eq!((left.missing, left.corrupted[0].0), (vec![1, 2], 1));
        assert_eq!(run(&campaign, None), [1, 2]);
        assert_eq!(bytes(&campaign), all);
    }

    #[test]
    fn an_interrupted_campaign_keeps_its_blocks() {
        let (_dir, campaign) = planned(TOML);
        run(&campaign, Some(0));
        let cancelled = campaign.run(None, &AtomicBool::new(true), &|_| {});
        assert!(matches!(cancelled, Err(CampaignError::Interrupted)));
        assert_eq!(campaign.left().unwrap().missing, [1, 2]);
        let beyond = campaign.run(Some(3), &AtomicBool::new(false), &|_| {}).unwrap_err();
        assert_eq!(beyond.to_string(), "--block: found 3, expected 0 to 2");
    }

    #[test]
    fn a_directory_has_one_campaign() {
        let (dir, campaign) = planned(TOML);
        let (file, out) = (dir.path().join("plan.toml"), dir.path().join("out"));
        assert_eq!(
            Campaign::plan(&file, &out, PlanOverrides::default()).unwrap().manifest(),
            campaign.manifest()
        );
        fs::write(&file, TOML.replace("seeds = 4", "seeds = 5")).unwrap();
        let error = Campaign::plan(&file, &out, PlanOverrides::default()).unwrap_err().to_string();
        assert!(error.contains("--out: found a campaign of another plan"), "{error}");
        assert_eq!(Campaign::open(&out).unwrap().plan_of(), campaign.plan_of());
    }

    #[test]
    fn progress_goes_up_to_all_blocks() {
        let (_dir, campaign) = planned(TOML);
        run(&campaign, Some(1));
        let last = std::sync::Mutex::new(Vec::new());
        campaign.run(None, &AtomicBool::new(false), &|now| last.lock().unwrap().push(now)).unwrap();
        let told = last.into_inner().unwrap();
        assert_eq!(told[0], Progress { blocks: 1, of_blocks: 3, runs: 0, of_runs: 5 });
        assert!(told.contains(&Progress { blocks: 3, of_blocks: 3, runs: 5, of_runs: 5 }), "{told:?}");
    }
}
