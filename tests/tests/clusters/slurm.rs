//! A Slurm of two machines, both of them this one, in the folder of a test.

use std::{
    fs::{self, File, Permissions},
    io::Read,
    net::TcpListener,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::Stdio,
};

use rustix::process::Signal;
use skyroost_tests::processes;

use super::site::{Halted, Site};

/// What its two machines are called.
pub(crate) const MACHINES: [&str; 2] = ["machine1", "machine2"];

/// A controller and two machines, which take one task each at a time; they end with the folder they are in.
pub(crate) struct Slurm<'a> {
    site: &'a Site,
}

impl<'a> Slurm<'a> {
    /// Returns when both machines wait for work.
    #[track_caller]
    pub(crate) fn start(site: &'a Site) -> Self {
        let slurm = Self { site };
        slurm.configure();
        for dir in [&["state"], &MACHINES[..]].concat() {
            fs::create_dir(site.path(dir)).expect("a folder");
        }
        slurm.start_munge();
        slurm.daemon("slurmctld", &["-D"], None);
        for machine in MACHINES {
            slurm.daemon("slurmd", &["-D", "-N", machine], Some(machine));
        }
        site.wait_for("two idle machines", || {
            let told = site.command("sinfo").args(["--noheader", "--Node", "--format=%t"]).output();
            (told.expect("sinfo runs").stdout == b"idle\nidle\n").then_some(())
        });
        slurm
    }

    fn configure(&self) {
        let here = self.site.path("").display().to_string();
        let host = fs::read_to_string("/proc/sys/kernel/hostname").expect("a name of this machine");
        let host = host.trim().split('.').next().unwrap_or_default().to_owned();
        let user = self.site.shell("id --user --name");
        let [controller, first, second] = free_ports();
        let text = format!(
            "ClusterName=skyroost\n\
             SlurmctldHost={host}(127.0.0.1)\n\
             SlurmctldPort={controller}\n\
             CommunicationParameters=NoInAddrAny,NoCtldInAddrAny\n\
             SlurmUser={user}\n\
             SlurmdUser={user}\n\
             # Also how long a task waits that is queued again: by default two minutes.\n\
             AuthInfo=socket={here}munge.socket,cred_expire=5\n\
             SlurmctldPidFile={here}slurmctld.pid\n\
             SlurmdPidFile={here}%n/slurmd.pid\n\
             StateSaveLocation={here}state\n\
             SlurmdSpoolDir={here}%n\n\
             ProctrackType=proctrack/linuxproc\n\
             TaskPlugin=task/none\n\
             MailProg=/bin/true\n\
             ReturnToService=2\n\
             # How many seconds a machine may be silent, and take to answer, until it is lost.\n\
             SlurmdTimeout=5\n\
             MessageTimeout=5\n\
             # Tasks are given out at once and not, as when all else is busy, once a minute.\n\
             SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0\n\
             # What follows is so, whatever this machine is.\n\
             SlurmdParameters=config_overrides\n\
             NodeName={machine1} NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1 RealMemory=4096\n\
             NodeName={machine2} NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1 RealMemory=4096\n\
             PartitionName=all Nodes=ALL Default=YES State=UP\n",
            user = user.trim(),
            machine1 = MACHINES[0],
            machine2 = MACHINES[1],
        );
        fs::write(self.site.path("slurm.conf"), text).expect("a configuration");
    }

    /// Whom the daemons trust: who has the same key.
    #[track_caller]
    fn start_munge(&self) {
        let mut key = [0; 64];
        File::open("/dev/urandom").and_then(|mut random| random.read_exact(&mut key)).expect("random bytes");
        fs::write(self.site.path("munge.key"), key).expect("a key");
        fs::set_permissions(self.site.path("munge.key"), Permissions::from_mode(0o600)).expect("a secret");
        let option =
            |name: &str| format!("--{name}-file={}", self.site.path(&format!("munge.{name}")).display());
        let socket = self.site.path("munge.socket");
        let at = format!("--socket={}", socket.display());
        // By force: it would refuse a folder that not everybody may look into, or any above it.
        let options = ["--foreground", "--force", &at, &option("key"), &option("pid"), &option("seed")];
        self.daemon("munged", &options, None);
        self.site.wait_for("munge", || socket.exists().then_some(()));
    }

    /// Starts one that logs to a file of its name. That of a machine bears the machine's name, as tasks on it do.
    #[track_caller]
    fn daemon(&self, program: &str, options: &[&str], machine: Option<&str>) {
        let log =
            File::create(self.site.path(&format!("{}.log", machine.unwrap_or(program)))).expect("a log");
        let mut command = self.site.command(program);
        command.args(options).stdout(Stdio::null()).stderr(log);
        command.envs(machine.map(|name| ("SLURMD_NODENAME", name)));
        let started = command.spawn();
        drop(started.unwrap_or_else(|error| panic!("{program}: {error}; `cargo xtask setup` installs it")));
    }

    /// The lines that the template's own header tells to type, for the campaign of this test: plan, submit and merge.
    #[track_caller]
    pub(crate) fn told(&self, template: &Path) -> [String; 3] {
        let text = fs::read_to_string(template).expect("the template");
        let lines = text.lines().filter_map(|line| line.strip_prefix("#   ")).map(|line| {
            line.replace("figure6.toml", "plan.toml")
                .replace("/shared/figure6", &self.site.path("shared").display().to_string())
                .replace("campaign.sbatch", &template.display().to_string())
        });
        let lines: Vec<String> = lines.collect();
        lines.try_into().unwrap_or_else(|lines| panic!("three lines to type, found {lines:?}"))
    }

    /// Waits until no task is queued or runs.
    #[track_caller]
    pub(crate) fn wait_for_the_array(&self) {
        self.site.wait_for("the end of the array", || {
            let told = self.site.command("squeue").arg("--noheader").output().expect("squeue runs");
            (told.status.success() && told.stdout.is_empty()).then_some(())
        });
    }

    /// A power cut in the middle of a block: its machine's daemon, what looks after the task there and the task itself are
    /// gone at once.
    pub(crate) fn kill_machine(&self, machine: &str, at: &Halted) {
        let mut there = self.site.processes(Some(machine));
        there.push(at.parent);
        // First all stand still: whoever saw another die would report it.
        for signal in [Signal::STOP, Signal::KILL] {
            for process in &there {
                assert!(processes::try_signal(*process, signal), "{there:?} are on {machine} with {at:?}");
            }
        }
    }
}

/// Some that nobody listens on.
fn free_ports<const N: usize>() -> [u16; N] {
    // All at once, so that no two are the same.
    let listeners = [(); N].map(|()| TcpListener::bind(("127.0.0.1", 0)).expect("a free port"));
    listeners.map(|listener| listener.local_addr().expect("its address").port())
}
