//! The runs of a campaign, each by its number alone.
//!
//! Run numbers go through seeds slowest and densities fastest. So further seeds only append runs, and every block holds
//! some of each density and takes about as long as any other.

use std::ops::Range;

use rand_chacha::ChaCha8Rng;

use super::plan::{Method, Plan};
use crate::rng::{self, Stream};

/// One run: some users, and every method on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// Its number, from 0.
    pub run: u64,
    /// Which of the runs with the same numbers below, from 1.
    pub seed: u64,
    /// Mean number of users per square kilometre.
    pub density_per_km2: f64,
    /// Error of position that the proposed method assumes.
    pub r_e_m: f64,
    /// Number of drones.
    pub drones: u32,
    /// The seed that all chance of the campaign comes from.
    base_seed: u64,
}

/// What one method came to in one run: a row of the results.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The run.
    pub run: u64,
    /// Which of the runs alike, from 1.
    pub seed: u64,
    /// The method.
    pub method: Method,
    /// Mean number of users per square kilometre.
    pub density_per_km2: f64,
    /// Error of position that the proposed method assumes.
    pub r_e_m: f64,
    /// Number of drones.
    pub drones: u32,
    /// Users that there were.
    pub users: u64,
    /// Users whose whole error disk is covered; of random search, users within `R_C - r_e`.
    pub served_guaranteed: u64,
    /// Users whose true position is covered.
    pub served_actual: u64,
}

impl Run {
    /// The stream of chance of this run for a purpose: a function of campaign seed, run and purpose, whatever else is run
    /// before or beside it.
    #[must_use]
    pub fn stream(&self, purpose: Stream) -> ChaCha8Rng {
        rng::stream(self.base_seed, purpose, self.run)
    }

    /// A row of this run.
    #[must_use]
    pub fn row(&self, method: Method, users: usize, [served_guaranteed, served_actual]: [usize; 2]) -> Row {
        let Self { run, seed, density_per_km2, r_e_m, drones, base_seed: _ } = *self;
        Row {
            run,
            seed,
            method,
            density_per_km2,
            r_e_m,
            drones,
            users: users as u64,
            served_guaranteed: served_guaranteed as u64,
            served_actual: served_actual as u64,
        }
    }
}

impl Plan {
    /// The run of a number; none beyond the last.
    #[must_use]
    pub fn run(&self, run: u64) -> Option<Run> {
        let campaign = &self.campaign;
        let (seed, combination) = (run / self.combinations(), (run % self.combinations()) as usize);
        let (densities, errors) = (campaign.densities_per_km2.len(), campaign.r_e_m.len());
        (run < self.runs()).then(|| Run {
            run,
            seed: seed + 1,
            density_per_km2: campaign.densities_per_km2[combination % densities],
            r_e_m: campaign.r_e_m[combination / densities % errors],
            drones: campaign.drones[combination / densities / errors],
            base_seed: campaign.base_seed,
        })
    }

    /// Numbers of the runs of a block, from 0; none beyond the last block.
    #[must_use]
    pub fn block(&self, block: u64) -> Option<Range<u64>> {
        let size = u64::from(self.campaign.block_runs);
        (block < self.blocks()).then(|| block * size..((block + 1) * size).min(self.runs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::plan::PlanOverrides;
    use rand_core::Rng;
    use std::collections::BTreeSet;

    fn plan(seeds: u32, block_runs: u32) -> Plan {
        let text = format!(
            "[campaign]\nbase_seed = 9\nseeds = {seeds}\ndensities_per_km2 = [1, 5, 10]\nr_e_m = [30, 0]\n\
             drones = [3, 6]\nblock_runs = {block_runs}"
        );
        Plan::from_toml(&text, "plan.toml", PlanOverrides::default()).unwrap()
    }

    #[test]
    fn every_combination_comes_once_for_each_seed() {
        let plan = plan(4, 7);
        let key = |run: Run| (run.seed, run.density_per_km2 as u32, run.r_e_m as u32, run.drones);
        let all: Vec<_> = (0..plan.runs()).map(|run| key(plan.run(run).unwrap())).collect();
        assert_eq!((all.len(), all.iter().collect::<BTreeSet<_>>().len()), (48, 48));
        assert_eq!((all[0], all[1], all[47]), ((1, 1, 30, 3), (1, 5, 30, 3), (4, 10, 0, 6)));
        assert_eq!(plan.run(48), None);
    }

    #[test]
    fn blocks_part_the_runs() {
        let plan = plan(4, 7);
        let blocks: Vec<_> = (0..plan.blocks()).map(|block| plan.block(block).unwrap()).collect();
        assert_eq!((blocks.len(), &blocks[0], &blocks[6]), (7, &(0..7), &(42..48)));
        assert!(blocks.windows(2).all(|pair| pair[0].end == pair[1].start));
        assert_eq!(plan.block(7), None);
    }

    /// More seeds and other blocks leave runs as they were, and no two runs or purposes share their chance.
    #[test]
    fn chance_is_a_function_of_seed_run_and_purpose() {
        let (few, many) = (plan(4, 7), plan(40, 3));
        let mut drawn = BTreeSet::new();
        for run in 0..few.runs() {
            let [a, b] = [&few, &many].map(|plan| plan.run(run).unwrap());
            assert_eq!(a, b);
            for purpose in [Stream::Users, Stream::Search, Stream::Declared, Stream::Modelled] {
                assert_eq!(a.stream(purpose).next_u64(), b.stream(purpose).next_u64());
                drawn.insert(a.stream(purpose).next_u64());
            }
        }
        assert_eq!(drawn.len() as u64, 4 * few.runs());
    }
}
