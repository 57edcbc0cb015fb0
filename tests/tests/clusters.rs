//! Campaigns on clusters, by the templates of `host-sim/cluster/` as they are shipped. Whatever dies in mid-run, the
//! merged files are to the byte those of one process that nothing happened to.

#[path = "clusters/site.rs"]
mod site;
#[path = "clusters/slurm.rs"]
mod slurm;

use std::{fs::File, process::Command};

use rustix::process::Signal;
use site::Site;
use skyroost_tests::{boards::workspace, processes};
use slurm::{MACHINES, Slurm};

/// One machine loses power, on the other a block is killed. Slurm sees to the first by itself; the second is left for
/// whoever submits what is missing.
#[test]
fn slurm_with_a_machine_and_a_task_killed() {
    let site = Site::of("slurm_with_a_machine_and_a_task_killed");
    let slurm = Slurm::start(&site);
    let [plan, submit, merge] = slurm.told(&workspace().join("host-sim/cluster/slurm/campaign.sbatch"));
    site.shell(&plan);
    site.shell(&submit);

    let lost = site.halt_a_block(Some(MACHINES[1]), 2);
    slurm.kill_machine(MACHINES[1], &lost);
    let killed = site.halt_a_block(Some(MACHINES[0]), 4);
    assert!(processes::try_signal(killed.process, Signal::KILL), "{killed:?} is gone");
    slurm.wait_for_the_array();
    assert_eq!(
        site.missing(),
        [killed.block],
        "Slurm repeats {lost:?} and not {killed:?}\nreplay: {}",
        site.replay()
    );

    site.shell(&submit);
    slurm.wait_for_the_array();
    assert_eq!(site.missing(), [0; 0], "replay: {}", site.replay());
    site.shell(&merge);
    site.assert_same_results();
}

/// A worker dies with the block that it was at; Dask gives that to another.
#[test]
fn dask_with_a_worker_killed() {
    let site = Site::of("dask_with_a_worker_killed");
    site.shell("skyroost campaign plan plan.toml --out shared");
    let log = File::create(site.path("dask.log")).expect("a log");
    let mut campaign = site
        .command(python_of_dask())
        .arg(workspace().join("host-sim/cluster/dask_campaign.py"))
        .args(["--dir", "shared", "--workers", "2"])
        .stdout(log.try_clone().expect("a log"))
        .stderr(log)
        .spawn()
        .expect("python3 runs");

    let lost = site.halt_a_block(None, 3);
    assert_ne!(lost.parent, campaign.id(), "blocks are run by workers, which are processes of their own");
    for process in [lost.parent, lost.process] {
        assert!(processes::try_signal(process, Signal::KILL), "{lost:?} is gone");
    }
    let status = campaign.wait().expect("its end");
    assert!(status.success(), "{status}\nreplay: {}", site.replay());
    site.assert_same_results();
}

/// The first Python that has Dask: the one that is found first may have packages of its own, and Debian's is elsewhere.
fn python_of_dask() -> &'static str {
    let has_dask = |python: &&str| {
        let asked = Command::new(python).args(["-c", "import distributed"]).output();
        asked.is_ok_and(|ran| ran.status.success())
    };
    ["python3", "/usr/bin/python3"].into_iter().find(has_dask).expect(
        "no python3 has Dask; `cargo xtask setup` or `apt-get install python3-distributed` installs it",
    )
}

/// Every cell of the Parquet file, as polars reads it, against the CSV. Debian has neither polars nor duckdb, and the crate of
/// duckdb compiles all of that; polars' reader of Parquet alone, not optimised, takes three minutes of processor time.
#[test]
fn truth_polars_reads_what_the_csv_says() {
    let site = Site::of("truth_polars_reads_what_the_csv_says");
    let csv = std::fs::read_to_string(site.path("alone/results.csv")).expect("the CSV");
    assert_eq!(csv.lines().count(), 1 + 2 * 48, "a header, and two methods on 48 runs");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let read = Command::new(cargo)
        .args(["run", "--quiet", "--locked", "--manifest-path"])
        .arg(workspace().join("tests/polars/Cargo.toml"))
        .arg("--target-dir")
        .arg(workspace().join("target/polars"))
        .arg("--")
        .arg(site.path("alone/results.parquet"))
        .output()
        .expect("cargo runs");
    let failed = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "polars does not read it: {failed}\nreplay: {}", site.replay());
    let told = String::from_utf8(read.stdout).expect("text");
    let differs = told.lines().zip(csv.lines()).find(|(told, csv)| told != csv);
    assert!(told == csv, "polars and the CSV differ, first in {differs:?}\nreplay: {}", site.replay());
}
