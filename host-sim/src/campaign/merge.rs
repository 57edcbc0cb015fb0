//! All blocks together: one table of results, and one of times.

use std::fs;

use super::CampaignError;
use super::block::{HEADER, push_row};
use super::files::{failed, remove_partial, write_whole};
use super::manifest::hash;
use super::parquet;
use super::runs::Row;
use super::store::{BLOCKS, Campaign, TIMES, TIMES_HEADER};

/// All rows, as text.
pub const RESULTS_CSV: &str = "results.csv";
/// All rows, as Parquet.
pub const RESULTS_PARQUET: &str = "results.parquet";
/// How long the methods took.
pub const TIMES_CSV: &str = "times.csv";

/// What was merged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Merged {
    /// Runs.
    pub runs: u64,
    /// Rows: runs times methods.
    pub rows: u64,
    /// Hash over the bytes of the CSV.
    pub csv_hash: String,
    /// Hash over the bytes of the Parquet file.
    pub parquet_hash: String,
}

impl Campaign {
    /// All rows, by run and then by method as the plan lists them.
    ///
    /// # Errors
    /// [`CampaignError::Partial`] where blocks are missing or damaged.
    pub fn rows(&self) -> Result<Vec<Row>, CampaignError> {
        let (rows, left) = self.rows_and_left()?;
        if left.missing.is_empty() { Ok(rows) } else { Err(CampaignError::Partial { left }) }
    }

    /// Writes `results.csv`, `results.parquet` and `times.csv` into the directory. Only the times depend on how the blocks
    /// were run.
    ///
    /// # Errors
    /// As [`Campaign::rows`], and where a file cannot be written; nothing is written where blocks are missing.
    pub fn merge(&self) -> Result<Merged, CampaignError> {
        // Blocks follow each other as their runs do, and were held against the plan.
        let rows = self.rows()?;
        let mut csv = format!("{HEADER}\n");
        rows.iter().for_each(|row| push_row(&mut csv, row));
        let path = self.dir().join(RESULTS_PARQUET);
        let columns = parquet::encode(&rows).map_err(failed(&path, "encoded"))?;
        write_whole(&path, &columns)?;
        write_whole(&self.dir().join(RESULTS_CSV), csv.as_bytes())?;
        write_whole(&self.dir().join(TIMES_CSV), self.times().as_bytes())?;
        for dir in [BLOCKS, TIMES] {
            remove_partial(&self.dir().join(dir));
        }
        Ok(Merged {
            runs: self.plan_of().runs(),
            rows: rows.len() as u64,
            csv_hash: hash(csv.as_bytes()),
            parquet_hash: hash(&columns),
        })
    }

    /// How long the methods took, as far as is known: nothing hangs on it.
    fn times(&self) -> String {
        let mut all = format!("{TIMES_HEADER}\n");
        for block in 0..self.plan_of().blocks() {
            let text = fs::read_to_string(self.file(TIMES, block)).unwrap_or_default();
            all.extend(text.lines().skip(1).flat_map(|line| [line, "\n"]));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use ::parquet::record::RowAccessor;
    use std::fs::File;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn both_tables_hold_every_row_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let toml = "[campaign]\nseeds = 3\ndensities_per_km2 = [0.3, 20]\nr_e_m = [30, 0]\nblock_runs = 5\n\
                    [mission]\ntime_s = 60\n";
        fs::write(dir.path().join("plan.toml"), toml).unwrap();
        let campaign =
            Campaign::plan(&dir.path().join("plan.toml"), dir.path(), PlanOverrides::default()).unwrap();
        let nothing = campaign.merge().unwrap_err();
        assert!(
            matches!(nothing, CampaignError::Partial { ref left } if left.missing == [0, 1, 2]),
            "{nothing}"
        );
        assert!(!dir.path().join(RESULTS_CSV).exists());
        campaign.run(None, &AtomicBool::new(false), &|_| {}).unwrap();
        fs::write(dir.path().join("blocks/.00001.csv.9-0-0.partial"), "half").unwrap();
        let merged = campaign.merge().unwrap();
        assert_eq!((merged.runs, merged.rows), (12, 36));
        assert_eq!(fs::read_dir(dir.path().join("blocks")).unwrap().count(), 3);

        let csv = fs::read_to_string(dir.path().join(RESULTS_CSV)).unwrap();
        let mut lines = csv.lines();
        assert_eq!(lines.next(), Some(HEADER));
        let file = File::open(dir.path().join(RESULTS_PARQUET)).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let mut rows = 0;
        for (line, row) in lines.zip(reader.get_row_iter(None).unwrap()) {
            let row = row.unwrap();
            let whole = |column: usize| row.get_long(column).unwrap();
            let as_text = format!(
                "{},{},{},{},{},{},{},{},{}",
                whole(0),
                whole(1),
                row.get_string(2).unwrap(),
                row.get_double(3).unwrap(),
                row.get_double(4).unwrap(),
                whole(5),
                whole(6),
                whole(7),
                whole(8)
            );
            assert_eq!(as_text, line);
            assert_eq!(whole(0), rows / 3);
            rows += 1;
        }
        assert_eq!((rows, reader.metadata().file_metadata().num_rows()), (36, 36));
        let times = fs::read_to_string(dir.path().join(TIMES_CSV)).unwrap();
        assert_eq!((times.lines().next(), times.lines().count()), (Some(TIMES_HEADER), 37));
        assert_eq!(campaign.merge().unwrap(), merged);
    }
}
