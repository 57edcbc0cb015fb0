//! The text of a block: what it is part of, its rows as CSV, and a checksum over all that.

use std::fmt::Write as _;

use super::manifest::{Manifest, hash};
use super::plan::{Method, Plan};
use super::runs::Row;

/// Columns of blocks and results.
pub(super) const HEADER: &str =
    "run,seed,method,density_per_km2,r_e_m,drones,users,served_guaranteed,served_actual";
/// What the last line begins with.
const CHECKSUM: &str = "# xxh3 ";

/// A block's rows as its file holds them.
#[must_use]
pub fn encode(manifest: &Manifest, block: u64, rows: &[Row]) -> String {
    let mut text = format!("{}\n{HEADER}\n", stamp(manifest, block));
    rows.iter().for_each(|row| push_row(&mut text, row));
    let checksum = hash(text.as_bytes());
    let _ = writeln!(text, "{CHECKSUM}{checksum}");
    text
}

/// The rows of a block's file.
///
/// # Errors
/// What is wrong with it: it is then to be run again.
pub fn decode(manifest: &Manifest, plan: &Plan, block: u64, bytes: &[u8]) -> Result<Vec<Row>, String> {
    let text = std::str::from_utf8(bytes).map_err(|_| "it is no text".to_owned())?;
    let end = text.rfind(CHECKSUM).ok_or("it ends without its checksum")?;
    let (body, last) = text.split_at(end);
    if last.strip_prefix(CHECKSUM).and_then(|told| told.strip_suffix('\n')) != Some(&hash(body.as_bytes())) {
        return Err("its checksum does not hold".to_owned());
    }
    let mut lines = body.lines();
    let expected = stamp(manifest, block);
    if lines.next() != Some(&expected) {
        return Err("it is of another campaign, program or number".to_owned());
    }
    if lines.next() != Some(HEADER) {
        return Err("its columns are others".to_owned());
    }
    let rows: Vec<Row> =
        lines.map(|line| row(line).ok_or_else(|| format!("`{line}` is no row"))).collect::<Result<_, _>>()?;
    let runs = plan.block(block).into_iter().flatten().filter_map(|run| plan.run(run));
    let planned = runs.flat_map(|run| plan.campaign.methods.iter().map(move |&method| (run, method)));
    let as_planned =
        planned.map(Some).chain(std::iter::repeat(None)).zip(rows.iter().map(Some).chain([None]));
    for (planned, found) in as_planned {
        let same = match (planned, found) {
            (Some((run, method)), Some(found)) => {
                let served = [found.served_guaranteed as usize, found.served_actual as usize];
                run.row(method, found.users as usize, served) == *found
            }
            (None, None) => true,
            _ => false,
        };
        if !same {
            return Err("its rows are not those planned".to_owned());
        }
    }
    Ok(rows)
}

/// A row as results and blocks hold it: numbers in as few digits as read back the same.
pub(super) fn push_row(text: &mut String, row: &Row) {
    let Row { run, seed, method, density_per_km2, r_e_m, drones, users, served_guaranteed, served_actual } =
        row;
    let method = method.name();
    let _ = writeln!(
        text,
        "{run},{seed},{method},{density_per_km2},{r_e_m},{drones},{users},{served_guaranteed},{served_actual}"
    );
}

fn row(line: &str) -> Option<Row> {
    let mut fields = line.split(',');
    let mut field = || fields.next();
    let row = Row {
        run: field()?.parse().ok()?,
        seed: field()?.parse().ok()?,
        method: Method::of_name(field()?)?,
        density_per_km2: field()?.parse().ok()?,
        r_e_m: field()?.parse().ok()?,
        drones: field()?.parse().ok()?,
        users: field()?.parse().ok()?,
        served_guaranteed: field()?.parse().ok()?,
        served_actual: field()?.parse().ok()?,
    };
    fields.next().is_none().then_some(row)
}

/// What a block belongs to.
fn stamp(manifest: &Manifest, block: u64) -> String {
    let Manifest { format, scenario_hash, program_hash, base_seed, .. } = manifest;
    format!(
        "# skyroost campaign block {block}, format {format}, base seed {base_seed}, scenario {scenario_hash}, \
         program {program_hash}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;
    use proptest::prelude::*;

    fn campaign(seeds: u32) -> (Manifest, Plan) {
        let text = format!(
            "[campaign]\nseeds = {seeds}\ndensities_per_km2 = [0.1, 5]\nr_e_m = [30.3]\nblock_runs = 3\n"
        );
        let plan = Plan::from_toml(&text, "plan.toml", PlanOverrides::default()).unwrap();
        (Manifest::of(&plan, text).unwrap(), plan)
    }

    fn rows(plan: &Plan, block: u64) -> Vec<Row> {
        let runs = plan.block(block).unwrap().map(|run| plan.run(run).unwrap());
        let row = |(k, (run, &method)): (usize, (crate::campaign::Run, &Method))| {
            run.row(method, 100 + k, [k, 2 * k])
        };
        runs.flat_map(|run| plan.campaign.methods.iter().map(move |method| (run, method)))
            .enumerate()
            .map(row)
            .collect()
    }

    #[test]
    fn what_is_written_is_read_and_nothing_else() {
        let (manifest, plan) = campaign(4);
        let text = encode(&manifest, 1, &rows(&plan, 1));
        let read = |manifest: &Manifest, block, text: &str| decode(manifest, &plan, block, text.as_bytes());
        assert_eq!(read(&manifest, 1, &text), Ok(rows(&plan, 1)));
        assert_eq!(read(&manifest, 0, &text), Err("it is of another campaign, program or number".into()));
        let other = Manifest { program_hash: "0".into(), ..manifest.clone() };
        assert!(read(&other, 1, &text).is_err());
        assert_eq!(read(&manifest, 1, ""), Err("it ends without its checksum".into()));
        let (fewer, more) = (&rows(&plan, 1)[1..], [rows(&plan, 1), rows(&plan, 0)].concat());
        for rows in [fewer, &more, &rows(&plan, 0)] {
            let planned = read(&manifest, 1, &encode(&manifest, 1, rows));
            assert_eq!(planned, Err("its rows are not those planned".into()));
        }
    }

    proptest! {
        /// A block of which any byte was changed, lost or added is no block.
        #[test]
        fn damage_is_seen(at in any::<prop::sample::Index>(), byte in any::<u8>(), kind in 0..3_u8) {
            let (manifest, plan) = campaign(4);
            let mut bytes = encode(&manifest, 1, &rows(&plan, 1)).into_bytes();
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = if bytes[at] == byte { byte ^ 1 } else { byte },
                1 => bytes.truncate(at),
                _ => bytes.insert(at, byte),
            }
            prop_assume!(bytes != encode(&manifest, 1, &rows(&plan, 1)).into_bytes());
            prop_assert!(decode(&manifest, &plan, 1, &bytes).is_err());
        }

        #[test]
        fn rows_are_read_to_the_bit(density_per_km2 in 0.0..1e4_f64, r_e_m in 0.0..500.0_f64, users in any::<u64>()) {
            let (_, plan) = campaign(1);
            let row = Row { density_per_km2, r_e_m, users, ..rows(&plan, 0)[0] };
            let mut text = String::new();
            push_row(&mut text, &row);
            prop_assert_eq!(super::row(text.trim_end()), Some(row));
        }

        #[test]
        fn garbage_is_no_row(line in "[0-9a-z,.-]{0,60}") {
            let _ = row(&line);
        }
    }
}
