//! Missions on flight boards at serial ports: the boards' own image, emulated, its UART behind a pseudo
//! terminal, and a line in between that damages bytes, is cut, or loses its board.
//!
//! A flight takes as long as in reality. Seeds and figures are printed: `cargo test -- --nocapture`.

use serde_json::Value;
use skyroost_tests::{flight_board::FlightBoard, line::Line, mission::binary};
use std::{
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};
use tempfile::TempDir;

/// A whole mission of 68 s in real time: an area so small, and flown so low, that little is left but the mission itself.
const SHORT: &str = r#"
name = "short"
area.width_m = 150
area.height_m = 60
fleet.drones = 3
fleet.radius_m = 60
fleet.altitude_m = 15
fleet.spacing_m = 25
users.density_per_km2 = 400
"#;

/// One byte in so many is damaged where the line is bad.
const BAD: u32 = 100;
/// No byte is damaged.
const GOOD: u32 = 0;
/// A board that fails is named within this time.
const PATIENCE: Duration = Duration::from_secs(5);
/// Bytes on a line after which a flight is well under way: some 4 s.
const UNDER_WAY: u64 = 20_000;

/// Boards, each at its line; one such bench at a time, as boards answer in real time and share the machine's processors.
struct Bench {
    boards: Vec<FlightBoard>,
    lines: Vec<Line>,
    _alone: MutexGuard<'static, ()>,
}

impl Bench {
    fn new(seed: u64, damage_one_in: u32) -> Self {
        static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
        let alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let lines: Vec<Line> = (0..3).map(|drone| Line::new(seed + drone, damage_one_in)).collect();
        let boards: Vec<_> = lines.iter().map(|line| FlightBoard::start(line.board_end())).collect();
        boards.iter().for_each(FlightBoard::wait_until_up);
        Self { boards, lines, _alone: alone }
    }

    fn ports(&self) -> Vec<&Path> {
        self.lines.iter().map(Line::port).collect()
    }

    /// Waits until a flight is well under way.
    fn wait_until_under_way(&self) {
        let begun = Instant::now();
        while self.lines.iter().any(|line| line.carried() < UNDER_WAY) {
            assert!(begun.elapsed() < 12 * PATIENCE, "the flight does not get under way");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// A run of `skyroost mission`; ends with this value.
struct Flight {
    process: Option<Child>,
    dir: TempDir,
}

impl Flight {
    /// Flies the short mission on boards at `ports`; in this process where there are none.
    fn start(ports: &[&Path], words: &[&str]) -> Self {
        let dir = TempDir::new().expect("a temporary directory");
        let scenario = dir.path().join("short.toml");
        fs::write(&scenario, SHORT).expect("a scenario file");
        let mut command = Command::new(binary());
        command.arg("mission").arg(scenario).args(words).arg("--out").arg(dir.path().join("out"));
        if !ports.is_empty() {
            let ports: Vec<String> = ports.iter().map(|port| port.display().to_string()).collect();
            command.arg("--backend").arg(format!("serial:{}", ports.join(",")));
        }
        let process = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        Self { process: Some(process.expect("skyroost starts")), dir }
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    fn interrupt(&self) {
        let process = self.process.as_ref().expect("it runs");
        let pid = rustix::process::Pid::from_child(process);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("it runs");
    }

    fn end(&mut self) -> Output {
        self.process.take().expect("it runs").wait_with_output().expect("it ends")
    }

    /// Waits for the failure of the mission, of which nothing must be left but the message, and returns that.
    fn fail(mut self, code: i32) -> String {
        let begun = Instant::now();
        let output = self.end();
        let took = begun.elapsed();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{message}");
        assert!(took < PATIENCE, "took {took:?}: {message}");
        assert!(!self.out().exists(), "nothing is written");
        assert!(output.stdout.is_empty(), "nothing is printed");
        message
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        if let Some(process) = &mut self.process {
            let _ = process.kill(); // it may have ended already
            let _ = process.wait();
        }
    }
}

/// Asserts that a flight on boards has the results of a flight in this process but for how the boards fared;
/// returns that.
fn assert_same_flight(flight: &mut Flight, words: &[&str]) -> Vec<Value> {
    let read = |flight: &mut Flight| {
        let output = flight.end();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{}: {errors}", output.status);
        let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
        (output.status.code(), json)
    };
    let mut reference = Flight::start(&[], words);
    let (expected_code, mut expected) = read(&mut reference);
    let (code, mut found) = read(flight);
    assert_eq!(found["digest"], expected["digest"]);
    assert_eq!(code, expected_code);
    assert_eq!(found["backend"], "serial");
    let boards = found["boards"].as_array().expect("boards").clone();
    let steps = expected["timing"]["simulated_s"].as_f64().expect("a time") * 50.0;
    for board in &boards {
        assert_eq!(board["steps"].as_f64(), Some(steps.round()), "every step is done once");
        assert_eq!(board["radio_damaged"], 0);
        assert_eq!(board["inputs_overflowed"], 0);
    }
    for key in ["backend", "boards", "timing"] {
        found[key] = Value::Null;
        expected[key] = Value::Null;
    }
    assert_eq!(found, expected);
    for table in ["users.csv", "trajectory.csv"] {
        let read = |flight: &Flight| fs::read(flight.out().join(table)).expect("a result file");
        assert_eq!(read(flight), read(&reference), "{table}");
    }
    boards
}

fn count(board: &Value, name: &str) -> u64 {
    board["punctuality"][name].as_u64().unwrap_or_else(|| panic!("no {name} in {board}"))
}

fn print_figures(boards: &[Value], lines: &[Line]) {
    for (board, line) in boards.iter().zip(lines) {
        let (carried, damaged) = (line.carried(), line.damaged());
        let steps = &board["steps"];
        let late = &board["punctuality"];
        eprintln!("{damaged} of {carried} bytes damaged; {steps} steps, {late}");
    }
}

/// Flies over bad lines and asserts that nothing is lost but time.
fn fly_over_bad_lines(words: &[&str]) {
    let seed = 20_240_501;
    eprintln!("damage by seed {seed}");
    let bench = Bench::new(seed, BAD);
    let mut flight = Flight::start(&bench.ports(), words);
    let boards = assert_same_flight(&mut flight, words);
    print_figures(&boards, &bench.lines);
    assert_eq!(boards.len(), 3);
    for (board, line) in boards.iter().zip(&bench.lines) {
        let share = line.damaged() as f64 / line.carried() as f64;
        assert!((share - 0.01).abs() < 0.002, "{share} of the bytes are damaged");
        assert!(count(board, "damaged") > 100 && count(board, "resent") > 100, "{board}");
        assert!(board["bus_damaged"].as_u64() > Some(100), "{board}");
        assert!(count(board, "missed_deadlines") <= board["steps"].as_u64().expect("steps"));
    }
}

#[test]
fn one_damaged_byte_in_a_hundred_costs_nothing_but_time() {
    // Take-off and the first lane: the whole takes minutes where emulators share two cores.
    fly_over_bad_lines(&["--json", "--quiet", "--duration-s", "12"]);
}

/// `cargo test --package skyroost-tests --test serial_boards -- --ignored --nocapture`
#[test]
#[ignore = "takes five minutes"]
fn a_whole_mission_over_lines_that_damage_one_byte_in_a_hundred() {
    fly_over_bad_lines(&["--json", "--quiet"]);
}

#[test]
fn good_lines_need_no_second_word() {
    let words = ["--json", "--quiet", "--duration-s", "12"];
    let bench = Bench::new(1, GOOD);
    let mut flight = Flight::start(&bench.ports(), &words);
    let boards = assert_same_flight(&mut flight, &words);
    print_figures(&boards, &bench.lines);
    for board in &boards {
        assert_eq!((count(board, "damaged"), &board["bus_damaged"]), (0, &Value::from(0)));
    }
}

/// Flies until `fate` meets the second board, and returns the message that must name it.
fn fail_under_way(fate: impl FnOnce(&mut Bench)) -> String {
    let mut bench = Bench::new(2, GOOD);
    let flight = Flight::start(&bench.ports(), &["--quiet"]);
    let port = bench.lines[1].port().display().to_string();
    bench.wait_until_under_way();
    fate(&mut bench);
    let message = flight.fail(4);
    assert!(message.contains(&format!("board of drone 2 at {port}: ")), "{message}");
    assert_eq!(message.lines().count(), 1, "one message: {message}");
    message
}

#[test]
fn a_board_that_is_unplugged_under_way_is_named() {
    let message = fail_under_way(|bench| bench.lines[1].unplug());
    assert!(message.contains("has it been unplugged?"), "{message}");
}

#[test]
fn a_wire_that_breaks_under_way_is_named() {
    let message = fail_under_way(|bench| bench.lines[1].cut());
    assert!(message.contains("has not answered for 3 s in step "), "{message}");
}

#[test]
fn a_board_that_dies_under_way_is_named() {
    let message = fail_under_way(|bench| drop(bench.boards.remove(1)));
    assert!(message.contains("has not answered for 3 s in step "), "{message}");
}

#[test]
fn a_board_that_is_reset_under_way_is_found_out() {
    let message = fail_under_way(|bench| bench.boards[1].reset());
    assert!(message.contains("it has been reset"), "{message}");
}

#[test]
fn a_port_with_nobody_behind_it_is_named() {
    let lines = [3, 4, 5].map(|seed| Line::new(seed, GOOD));
    let ports = lines.each_ref().map(Line::port);
    let message = Flight::start(&ports, &["--quiet"]).fail(4);
    let port = ports[0].display();
    let expected = format!("board of drone 1 at {port}: has not answered for 3 s since it was started");
    assert!(message.contains(&expected), "{message}");
}

#[test]
fn ports_that_are_none_are_named() {
    for (port, why) in [("/dev/no-such-port", "No such file or directory"), ("/dev/null", "ioctl")] {
        let message = Flight::start(&[Path::new(port), Path::new("b"), Path::new("c")], &["--quiet"]).fail(4);
        let expected = format!("board of drone 1 at {port}: cannot be started: ");
        assert!(message.contains(&expected) && message.contains(why), "{message}");
    }
}

#[test]
fn every_drone_has_a_port_of_its_own() {
    let fail = |ports: &[&str]| {
        let ports: Vec<&Path> = ports.iter().map(Path::new).collect();
        Flight::start(&ports, &["--quiet"]).fail(2)
    };
    for (ports, count) in [(&["a", "b"][..], 2), (&["a", "b", "c", "d"], 4)] {
        let message = fail(ports);
        assert!(message.contains(&format!("found {count} serial port(s) for 3 drones")), "{message}");
    }
    let message = fail(&["/dev/a", "/dev/b", "/dev/a"]);
    assert!(message.contains("--backend: found the port /dev/a twice"), "{message}");
}

#[test]
fn an_interrupt_under_way_ends_the_flight() {
    let bench = Bench::new(6, GOOD);
    let flight = Flight::start(&bench.ports(), &[]);
    bench.wait_until_under_way();
    flight.interrupt();
    let message = flight.fail(130);
    assert!(message.contains("take off") && message.contains("interrupted"), "{message}");
}

#[test]
fn people_see_how_boards_fared() {
    let bench = Bench::new(7, BAD);
    let mut flight = Flight::start(&bench.ports(), &["--duration-s", "2", "--quiet"]);
    let output = flight.end();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.stderr.is_empty(), "quiet: {}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("(serial)"), "{text}");
    let of_boards = |words: &str| text.lines().filter(|line| line.contains(words)).count();
    assert_eq!(of_boards(" of 100 deadlines missed, answers within "), 3, "{text}");
    assert_eq!(of_boards(" frames damaged on the bus, "), 3, "{text}");
}
