//! Whole missions on emulated boards: the results are those of the same code in process, to the bit; and
//! whatever happens to a board is told at once and leaves nothing behind.

use rustix::process::Signal;
use serde_json::Value;
use skyroost_firmware::board::bus::{BUS_VERSION, FromBoard, encode};
use skyroost_protocol::{stream::StreamFrame, units::DroneId};
use skyroost_tests::{
    boards::{Ended, Site, image, open_as, signal, workspace},
    mission::{Flown, fly},
};
use std::{
    fs::{self, File, OpenOptions},
    io::{Read, Write},
    path::Path,
    time::Duration,
};

/// Flies on emulated boards to the end.
fn fly_on_boards(words: &[&str]) -> Flown {
    let image = image().to_str().expect("a path in UTF-8");
    fly(&[&["--backend", "qemu", "--board-image", image], words].concat())
}

/// What must be the same wherever the flight code ran: everything but where it ran, how long that took, and
/// how the boards fared.
fn flight(flown: &Flown) -> Value {
    let mut json = flown.json.clone();
    let table = json.as_object_mut().expect("one JSON object");
    for of_the_backend in ["backend", "timing", "boards"] {
        table.remove(of_the_backend);
    }
    json
}

#[track_caller]
fn assert_same_flight(inproc: &Flown, qemu: &Flown) {
    assert_eq!(inproc.json["digest"], qemu.json["digest"], "replay: {}\nand: {}", inproc.replay, qemu.replay);
    assert_eq!(flight(inproc), flight(qemu), "replay: {}\nand: {}", inproc.replay, qemu.replay);
    for name in ["users.csv", "trajectory.csv"] {
        let read = |flown: &Flown| fs::read(flown.out.path().join("out").join(name)).expect("a result file");
        assert!(read(inproc) == read(qemu), "{name} differs; replay: {}", qemu.replay);
    }
    assert_eq!((&inproc.json["backend"], &qemu.json["backend"]), (&"inproc".into(), &"qemu".into()));
}

#[test]
fn ten_minutes_of_the_paper_scenario_are_the_same_to_the_bit() {
    let _turn = Site::new();
    let words = ["--duration-s", "600"];
    assert_same_flight(&fly(&words), &fly_on_boards(&words));
}

/// An area that three drones sweep in minutes.
fn small_area(dir: &Path) -> String {
    let path = dir.join("area.csv");
    fs::write(&path, "x_m,y_m\n0,0\n1200,0\n1200,1000\n0,1000\n").expect("an input file");
    path.to_str().expect("a path in UTF-8").to_owned()
}

#[test]
fn a_whole_mission_with_losses_is_the_same_to_the_bit_and_to_the_instruction() {
    let site = Site::new();
    let area = small_area(&site.path("tmp"));
    // With pulses and bursts, which a mission by default has none of.
    let scenario = site.path("tmp").join("pulses.toml");
    let pulses = "[clock]\ndrift_ns_per_s = 20_000\npps_sigma_ns = 20\npps_loss_fraction = 0.1\n";
    fs::write(&scenario, format!("{pulses}[srs]\nsymbols = 2\n")).expect("an input file");
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let lossy = ["--loss-fraction", "0.1", "--density-per-km2", "20"];
    let words = [&[scenario, "--area", &area, "--drones", "3"][..], &lossy].concat();
    let (inproc, first, second) = (fly(&words), fly_on_boards(&words), fly_on_boards(&words));
    assert!(inproc.number("/placement/served_guaranteed") > 0.0, "drones were placed");
    assert_same_flight(&inproc, &first);
    assert_same_flight(&inproc, &second);
    // -icount: the boards did the same instructions, not only the same flight.
    let boards = &first.json["boards"];
    assert_eq!(boards.as_array().map(Vec::len), Some(3), "{boards}");
    for board in boards.as_array().into_iter().flatten() {
        for figure in ["step_instructions_sum", "step_instructions_worst", "stack_used_bytes"] {
            assert!(board[figure].as_f64().is_some_and(|count| count > 0.0), "{figure} of {board}");
        }
    }
    assert_eq!(boards, &second.json["boards"]);
}

/// A mission that would take minutes, for three drones.
const LONG: [&str; 2] = ["--drones", "3"];

#[test]
fn a_board_that_is_killed_is_named() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    let victim = mission.wait_for_boards(3)[1].clone();
    signal(victim.process, Signal::KILL);
    let ended =
        mission.fails(&["board of drone 2: ended", "signal: 9", "last words in its log:", "drone 2 begins"]);
    assert!(!ended.stderr.contains("drone 1 ") && !ended.stderr.contains("drone 3"), "{}", ended.stderr);
}

#[test]
fn a_board_of_many_that_is_killed_is_named() {
    let site = Site::new();
    let mut mission = site.start(&["--drones", "7", "--threads", "1"]);
    signal(mission.wait_for_boards(7)[6].process, Signal::KILL);
    mission.fails(&["board of drone 7: ended", "signal: 9"]);
}

#[test]
fn a_board_that_hangs_is_named() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    signal(mission.wait_for_boards(3)[2].process, Signal::STOP);
    mission.fails(&["board of drone 3: has not answered for 3 s in step", "last words in its log:"]);
}

/// Bytes that are no frame, closed by a zero.
const GARBAGE: &[u8] = b"this is no frame of the bus, whoever reads it\0";

/// Writes into a FIFO that both ends have open already.
fn write_into(fifo: &Path, bytes: &[u8]) {
    let mut fifo = OpenOptions::new().write(true).open(fifo).expect("a FIFO");
    fifo.write_all(bytes).expect("a FIFO with a reader");
}

#[test]
fn garbage_for_a_board_is_noticed() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    write_into(&mission.wait_for_boards(3)[0].folder.join("bus.in"), GARBAGE);
    mission.fails(&["board of drone 1: received damaged bytes"]);
}

#[test]
fn a_board_that_answers_garbage_is_named() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    write_into(&mission.wait_for_boards(3)[1].folder.join("bus.out"), GARBAGE);
    mission.fails(&["board of drone 2: answered nonsense"]);
}

#[test]
fn garbage_through_the_emulators_own_files_is_noticed() {
    for (name, told) in [("bus.in", "received damaged bytes"), ("bus.out", "answered nonsense")] {
        let site = Site::new();
        let mut mission = site.start(&LONG);
        let board = mission.wait_for_boards(3)[2].clone();
        let open = open_as(board.process, &board.folder.join(name)).expect("an open FIFO");
        write_into(&open, &[0x55; 4096]);
        write_into(&open, &[0]);
        mission.fails(&["board of drone 3: ", told]);
    }
}

#[test]
fn half_a_frame_for_a_board_spoils_the_next_one() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    write_into(&mission.wait_for_boards(3)[0].folder.join("bus.in"), &GARBAGE[..7]);
    mission.fails(&["board of drone 1: received damaged bytes"]);
}

#[test]
fn bytes_that_are_taken_away_are_noticed() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    let answers = mission.wait_for_boards(3)[1].folder.join("bus.out");
    let thief = std::thread::spawn(move || {
        let Ok(mut fifo) = File::open(answers) else { return };
        let mut stolen = [0; 64];
        // Until the board is ended, as its answers no longer arrive.
        while matches!(fifo.read(&mut stolen), Ok(count) if count > 0) {}
    });
    mission.fails(&["board of drone 2: "]);
    thief.join().expect("the thief ends");
}

/// Starts a mission with an image that cannot be flown.
fn with_image(site: &Site, image: &Path) -> Ended {
    site.start(&["--board-image", image.to_str().expect("a path in UTF-8"), "--drones", "3"])
        .fails(&[&image.display().to_string()])
}

#[test]
fn images_that_are_none_are_refused() {
    let site = Site::new();
    let put = |name: &str, bytes: &[u8]| {
        let path = site.path(name);
        fs::write(&path, bytes).expect("an image");
        path
    };
    let elf = fs::read(image()).expect("the image");
    let own = fs::read(std::env::current_exe().expect("a path")).expect("an ELF file");
    for (name, bytes, told) in [
        ("text", b"an image, honestly\n".as_slice(), "not an ELF file"),
        ("empty", b"", "not an ELF file"),
        ("pc", &own[..], "an ELF file for another processor"),
        ("header", &elf[..52], "cut short"),
        ("half", &elf[..elf.len() / 2], "cut short"),
        ("short", &elf[..elf.len() - 1], "cut short"),
    ] {
        let ended = with_image(&site, &put(name, bytes));
        assert!(ended.stderr.contains(told), "{}", ended.stderr);
    }
}

#[test]
fn the_image_of_another_board_is_refused() {
    let site = Site::new();
    let flight_board = workspace().join("target/cross/thumbv7em-none-eabihf/release/stm32f405");
    if !flight_board.exists() {
        eprintln!("{} is not built: nothing to try", flight_board.display());
        return;
    }
    let ended = with_image(&site, &flight_board);
    assert!(ended.stderr.contains("is it the image of an emulated board?"), "{}", ended.stderr);
}

#[test]
fn an_emulator_that_is_missing_is_named() {
    let site = Site::new();
    site.start_with(&LONG, |command| {
        command.env("PATH", site.path("bin"));
    })
    .fails(&[
        "board of drone 1: cannot be started",
        "qemu-system-arm is not installed",
        "cargo xtask setup",
    ]);
}

#[test]
fn an_emulator_that_does_not_start_is_quoted() {
    let site = Site::new();
    site.program("qemu-system-arm", "echo 'qemu-system-arm: no such machine' >&2\nexit 1");
    site.start(&LONG).fails(&["board of drone 1: cannot be started", "exit status: 1", "no such machine"]);
}

/// A program in the emulator's place that opens the bus, takes in what comes, and then does this.
fn impostor(site: &Site, deed: &str) {
    site.program("qemu-system-arm", &format!("exec 3<bus.in 4>bus.out\n{deed}"));
}

#[test]
fn an_emulator_that_never_opens_its_bus_is_not_waited_for() {
    let site = Site::new();
    site.program("qemu-system-arm", "exec sleep 60");
    site.start(&LONG).fails(&["board of drone 1: cannot be started", "has not opened its bus within 3 s"]);
}

#[test]
fn an_emulator_that_opens_half_of_its_bus_is_not_waited_for() {
    let site = Site::new();
    site.program("qemu-system-arm", "exec 3<bus.in\nexec sleep 60");
    site.start(&LONG).fails(&["board of drone 1: has not answered for 3 s since it was started"]);
}

#[test]
fn an_emulator_that_answers_nothing_is_not_waited_for() {
    let site = Site::new();
    impostor(&site, "exec sleep 60");
    site.start(&LONG).fails(&["board of drone 1: has not answered for 3 s since it was started"]);
}

#[test]
fn an_emulator_that_answers_nonsense_is_named() {
    let site = Site::new();
    impostor(&site, "printf 'who are you?\\0' >&4\nexec sleep 60");
    site.start(&LONG).fails(&["board of drone 1: answered nonsense"]);
}

#[test]
fn an_emulator_that_talks_without_end_is_named() {
    let site = Site::new();
    impostor(&site, "exec yes 'and so on' >&4");
    site.start(&LONG).fails(&["board of drone 1: "]);
}

#[test]
fn an_emulator_that_hangs_up_is_named() {
    let site = Site::new();
    impostor(&site, "exec 4>&-\nexec sleep 60");
    site.start(&LONG).fails(&["board of drone 1: ended: it closed its end of the bus"]);
}

#[test]
fn boards_of_another_version_and_boards_that_are_somebody_else_are_told_apart() {
    let ready = |bus_version, schema_hash, id| FromBoard::Ready { bus_version, schema_hash, id: DroneId(id) };
    let schema = skyroost_protocol::SCHEMA_HASH;
    for (answer, told) in [
        (ready(BUS_VERSION + 1, schema, 0), format!("another version (bus {}", BUS_VERSION + 1)),
        (ready(BUS_VERSION, 0xdead_beef, 0), "messages 0xdeadbeef".to_owned()),
        (ready(BUS_VERSION, schema, 2), "it says it is drone 2".to_owned()),
    ] {
        let site = Site::new();
        let mut frame = StreamFrame::new();
        assert!(encode(&answer, &mut frame), "a message fits a frame");
        fs::write(site.path("answer"), &frame).expect("a file");
        impostor(&site, &format!("cat {} >&4\nexec sleep 60", site.path("answer").display()));
        site.start(&LONG).fails(&["board of drone 1: ", &told]);
    }
}

#[test]
fn an_interrupt_ends_all_emulators() {
    for which in [Signal::INT, Signal::TERM] {
        let site = Site::new();
        let mut mission = site.start(&LONG);
        let _ = mission.wait_for_boards(3);
        mission.signal(which);
        let ended = mission.end();
        assert_eq!((ended.code, ended.stdout.as_str()), (Some(130), ""), "{}", ended.stderr);
        assert!(ended.took < Duration::from_secs(5), "{:?}", ended.took);
        assert!(!site.path("out").exists());
        site.assert_clean();
    }
}

#[test]
fn emulators_do_not_outlive_a_mission_that_is_killed() {
    let site = Site::new();
    let mut mission = site.start(&LONG);
    let _ = mission.wait_for_boards(3);
    mission.signal(Signal::KILL);
    assert_eq!(mission.end().code, None);
    let begun = std::time::Instant::now();
    while !site.processes().is_empty() {
        assert!(begun.elapsed() < Duration::from_secs(5), "left: {:?}", site.processes());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// The logs of so many drones, each of which must tell of its own start.
fn logs(site: &Site, drones: usize) {
    for drone in 1..=drones {
        let log = fs::read_to_string(site.path(&format!("logs/of/today/drone-{drone}.log"))).expect("a log");
        assert!(log.contains(&format!("INFO  drone {drone} begins")), "{log}");
        assert!(log.contains("on the emulated board"), "{log}");
        assert!(!log.contains("damaged line"), "{log}");
    }
}

#[test]
fn logs_are_kept_after_a_good_run_and_after_a_bad_one() {
    let site = Site::new();
    let folder = site.path("logs/of/today");
    let with_logs = ["--drones", "3", "--board-log", folder.to_str().expect("a path in UTF-8")];
    let ended = site.start(&[&with_logs[..], &["--duration-s", "21"]].concat()).end();
    assert!(matches!(ended.code, Some(0 | 1)), "{ended:?}");
    logs(&site, 3);
    let telemetry = fs::read_to_string(folder.join("drone-2.log")).expect("a log");
    assert_eq!(telemetry.matches("flight code: 0 dropped").count(), 2, "every 10 s: {telemetry}");
    site.assert_clean();

    fs::remove_dir_all(site.path("logs")).expect("the logs");
    fs::remove_dir_all(site.path("out")).expect("the results");
    let mut mission = site.start(&with_logs);
    signal(mission.wait_for_boards(3)[0].process, Signal::KILL);
    mission.fails(&["board of drone 1: ended"]);
    logs(&site, 3);
}
