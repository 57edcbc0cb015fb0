//! What a board sensed in a real mission, recorded on its bus: a program between `skyroost` and the emulator
//! keeps a copy of every byte.

use skyroost_firmware::{
    board::lockstep::{Ask, Lockstep, RadioIntake},
    config::AgentConfig,
    io::Inputs,
};
use skyroost_protocol::{key::Key, units::TimePs};
use skyroost_tests::boards::Site;
use std::fs;

/// Stands in the emulator's place, runs it in a folder below, and passes on what it says and hears.
const TAP: &str = r#"
mkdir inner && mkfifo inner/bus.in inner/bus.out || exit 1
copy="$RECORDS/${PWD##*-}"
(cd inner && PATH="${PATH#*:}" && exec qemu-system-arm "$@") &
tee "$copy" < bus.in > inner/bus.in &
exec cat inner/bus.out > bus.out
"#;

/// One drone's part of a mission.
pub(crate) struct Recording {
    pub(crate) config: AgentConfig,
    pub(crate) key: Option<Key>,
    pub(crate) steps: Vec<(TimePs, Inputs)>,
}

/// Flies a mission on emulated boards and returns what every drone sensed in it.
pub(crate) fn record(words: &[&str], drones: usize) -> Vec<Recording> {
    let site = Site::new();
    site.program("qemu-system-arm", TAP);
    let records = site.path("records");
    fs::create_dir(&records).expect("a folder");
    let ended = site.start_with(words, |command| {
        command.env("RECORDS", &records);
    });
    let ended = ended.end();
    assert!(matches!(ended.code, Some(0 | 1)), "{ended:?}");
    let read = |drone: usize| read(&fs::read(records.join(drone.to_string())).expect("a recording"));
    (0..drones).map(read).collect()
}

/// Puts the steps together as a board does.
fn read(bytes: &[u8]) -> Recording {
    let (mut lockstep, mut radio, mut inputs) = (Lockstep::new(), RadioIntake::new(), Inputs::new());
    let (mut begun, mut steps) = (None, Vec::new());
    let mut rest = bytes;
    while !rest.is_empty() {
        let (taken, ask) = lockstep.take(rest, &mut inputs);
        rest = &rest[taken..];
        match ask {
            Some(Ask::Begin(drone, key)) => begun = Some((drone, key)),
            Some(Ask::Radio(bytes)) => radio.take(bytes, &mut inputs),
            Some(Ask::Step { now, .. }) => {
                steps.push((now, inputs.clone()));
                inputs.clear();
            }
            None | Some(Ask::Report) => {}
            Some(other) => panic!("{other:?} in a recording"),
        }
    }
    let (config, key) = begun.expect("a recording begins with a drone");
    Recording { config, key, steps }
}
