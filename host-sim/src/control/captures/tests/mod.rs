//! The reader against files as people have them, and against files that nobody should have.

mod garbage;

use super::*;

const HEADER: &str = "user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\n";

fn parse(text: impl AsRef<[u8]>) -> Result<Captures, String> {
    Captures::parse(Path::new("c.csv"), text.as_ref()).map_err(|error| error.to_string())
}

fn rows(rows: &str) -> Result<Captures, String> {
    parse(format!("{HEADER}{rows}"))
}

/// The fault of `rows` below a header, without the file's name.
#[track_caller]
fn refused(text: &str) -> String {
    rows(text).unwrap_err().strip_prefix("c.csv: ").unwrap().to_owned()
}

/// Drones and what their clocks said.
type Arrivals = Vec<(u16, f64)>;

/// Names of users with times and arrivals of their captures.
fn heard(captures: &Captures) -> Vec<(String, f64, Arrivals)> {
    let prepared = captures.prepare(false);
    let of = |o: &crate::control::localize::Occasion| {
        let arrivals = o.captures.iter().map(|c| (c.drone.0, c.toa_ns)).collect();
        (captures.users[o.user.0 as usize].id.clone(), o.time_s, arrivals)
    };
    prepared.occasions.iter().map(of).collect()
}

#[test]
fn reads_what_the_header_says() {
    let found = rows("u1,10,1,1.5,-2,300,1000,5\nu1,10,2,50,-2e0,300.25,1012.5,6\n").unwrap();
    assert_eq!(found.users, [HeardUser { id: "u1".into(), occasions: 1, captures: 2 }]);
    assert_eq!((found.count(), found.epochs_s, found.repeated), (2, [10.0, 10.0], None));
    let occasion = &found.prepare(false).occasions[0];
    assert_eq!((occasion.time_s, occasion.clock_group), (0.0, 0));
    let [a, b] = &occasion.captures[..] else { panic!("{occasion:?}") };
    assert_eq!((a.pos_enu_m, a.toa_ns, a.sigma_ns), ([1.5, -2.0, 300.0], 0.0, Some(5.0)));
    assert_eq!((b.pos_enu_m, b.toa_ns, b.sigma_ns), ([50.0, -2.0, 300.25], 12.5, Some(6.0)));
}

#[test]
fn columns_are_known_by_name_and_files_come_from_anywhere() {
    let plain = rows("u1,10,1,1,2,300,1000,5\nu1,10,2,50,3,300,1012.5,5\n").unwrap();
    let shuffled = "\u{feff}toa_ns, sigma_ns ,x_m,\"y_m\",z_m,drone,user,epoch_s\r\n\r\n\
                    1012.5,5.0,50,3,3e2,2,\"u1\", 10.0 \r\n \t\r\n1000,5,1,2,300,1,u1,1e1\r\n\n";
    let mut shuffled = parse(shuffled).unwrap();
    assert_eq!(shuffled.rows.iter().map(|row| row.line).collect::<Vec<_>>(), [5, 3]);
    shuffled.rows.iter_mut().zip(&plain.rows).for_each(|(row, plain)| row.line = plain.line);
    assert_eq!(shuffled, plain);
}

#[test]
fn names_are_names() {
    let found =
        rows("\"a, \"\"b\"\"\",1,07,0,0,300,0,5\nu10,1,7,0,0,300,0,5\nu2,1,N,0,0,300,0,5\nπ,1,7,0,0,300,0,5")
            .unwrap();
    let users: Vec<_> = found.users.iter().map(|user| user.id.as_str()).collect();
    assert_eq!(users, ["a, \"b\"", "u2", "u10", "π"]);
    assert_eq!(found.drones.len(), 3);
}

#[test]
fn every_bad_row_is_named() {
    let good = "u1,10,1,0,0,300,0,5\n";
    for (bad, told) in [
        ("u1,10,2,nan,0,300,0,5", "line 3, x_m: found \"nan\", expected a number of metres within ±1e7"),
        ("u1,10,2,0,inf,300,0,5", "line 3, y_m: found \"inf\", expected a number of metres within ±1e7"),
        ("u1,10,2,0,0,1e6,0,5", "line 3, z_m: found \"1e6\", expected a number of metres within ±1e5"),
        (
            "u1,10,2,0,0,300,NaN,5",
            "line 3, toa_ns: found \"NaN\", expected a number of nanoseconds within ±1e21",
        ),
        (
            "u1,10,2,0,0,300,-1e22,5",
            "line 3, toa_ns: found \"-1e22\", expected a number of nanoseconds within ±1e21",
        ),
        (
            "u1,soon,2,0,0,300,0,5",
            "line 3, epoch_s: found \"soon\", expected a number of seconds within ±5e11",
        ),
        (
            "u1,1e999,2,0,0,300,0,5",
            "line 3, epoch_s: found \"1e999\", expected a number of seconds within ±5e11",
        ),
        (
            "u1,10,2,0,0,300,0,0",
            "line 3, sigma_ns: found \"0\", expected a number of nanoseconds above 0, from 1e-6 to 1e6",
        ),
        ("u1,10,2,0,0,300,0,-5", "line 3, sigma_ns: found \"-5\", expected a number"),
        ("u1,10,2,0,0,300,0,NaN", "line 3, sigma_ns: found \"NaN\", expected a number"),
        ("u1,10,2,0,0,300,0,1e300", "line 3, sigma_ns: found \"1e300\", expected a number"),
        ("u1,10,2,0,0,300,0,", "line 3, sigma_ns: found \"\", expected a number"),
        ("u1,10,2,0,0,300,0", "line 3: found 7 fields, expected the 8 of the header"),
        ("u1,10,2,0,0,300,0,5,", "line 3: found 9 fields, expected the 8 of the header"),
        ("u1", "line 3: found 1 field, expected the 8 of the header"),
        (",10,2,0,0,300,0,5", "line 3, user: found \"\", expected a name"),
        ("u1,10,\" \",0,0,300,0,5", "line 3, drone: found \" \", expected a name"),
        (
            "u\u{1b}[2J,10,2,0,0,300,0,5",
            "line 3, user: found \"u\\u{1b}[2J\", expected a name without control characters",
        ),
        (
            "u1,10,\"2,0,0,300,0,5",
            "line 3: found \"\\\"2,0,0,300,0,5\", expected a quote that is closed on the same line",
        ),
        ("u1,10,2,0 0,0,300,0,5", "line 3, x_m: found \"0 0\""),
        ("u1;10;2;0;0;300;0;5", "line 3: found 1 field"),
    ] {
        for bad in [bad.to_owned(), format!("{bad}\r\n{good}")] {
            let found = refused(&format!("{good}{bad}"));
            assert!(found.starts_with(told), "{found}");
        }
    }
    let long = format!("{good}{},10,2,0,0,300,0,5", "u".repeat(201));
    assert!(refused(&long).ends_with("expected a name of at most 200 bytes"));
    assert!(
        refused(&format!("{good}{}", "u".repeat(9000)))
            .starts_with("line 3: found a line of more than 4096 bytes")
    );
    let no_text =
        parse([HEADER.as_bytes(), good.as_bytes(), b"\xff\xfe,10,2,0,0,300,0,5\n"].concat()).unwrap_err();
    assert_eq!(no_text, "c.csv: line 3, user: found bytes that are no UTF-8, expected text in UTF-8");
}

#[test]
fn every_bad_header_is_named() {
    let header = "expected the header \"user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\"";
    for (text, told) in [
        ("", "line 1: found nothing"),
        ("\n \n", "line 2: found nothing"),
        ("u1,10,1,0,0,300,0,5\n", "line 1, the header: found \"u1\""),
        ("user,epoch_s,drone,x_m,y_m,z_m,toa_ns\n", "line 1: found no column sigma_ns"),
        ("user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma\n", "line 1, the header: found \"sigma\""),
        ("user,epoch_s,drone,x_m,y_m,z_m,toa_ns,x_m\n", "line 1: found x_m twice"),
        ("user,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns,\n", "line 1: found 9 columns"),
        ("User,epoch_s,drone,x_m,y_m,z_m,toa_ns,sigma_ns\n", "line 1, the header: found \"User\""),
        ("user;epoch_s;drone;x_m;y_m;z_m;toa_ns;sigma_ns\n", "line 1, the header: found \"user;epoch_s"),
    ] {
        let found = parse(text).unwrap_err();
        assert!(found.starts_with(&format!("c.csv: {told}")) && found.ends_with(header), "{found}");
    }
    assert_eq!(
        parse(HEADER).unwrap_err(),
        "c.csv: line 1: found nothing after the header, expected a row for each capture"
    );
    assert_eq!(
        parse(format!("{HEADER}\n\n")).unwrap_err(),
        "c.csv: line 3: found nothing after the header, expected a row for each capture"
    );
    // What spreadsheets call Unicode text.
    let wide: Vec<u8> = "\u{feff}user".encode_utf16().flat_map(u16::to_le_bytes).collect();
    assert!(parse(wide).unwrap_err().starts_with("c.csv: line 1, the header: found "));
}

#[test]
fn repetitions_count_once_and_contradictions_are_refused() {
    let found =
        rows("u1,10,1,0,0,300,0,5\nu1,10,2,0,0,300,7,5\nu1,10.0,1,-0,0,3e2,0.0,5\nu1,10,1,0,0,300,0,5\n")
            .unwrap();
    assert_eq!((found.repeated, found.count()), (Some((2, 4)), 2));
    for (other, column) in [
        ("u1,10,1,1,0,300,0,5", "x_m"),
        ("u1,10,1,0,1,300,0,5", "y_m"),
        ("u1,10,1,0,0,301,0,5", "z_m"),
        ("u1,10,1,0,0,300,0.000000001,5", "toa_ns"),
        ("u1,10,1,0,0,300,0,6", "sigma_ns"),
    ] {
        assert_eq!(
            refused(&format!("u1,10,1,0,0,300,0,5\nu1,10,2,0,0,300,7,5\n{other}\n{other}\n")),
            format!(
                "line 4, {column}: found another value than in line 2 for the same user \"u1\", epoch and drone \
                 \"1\", expected one capture of each drone at each occasion"
            )
        );
    }
    // A nanosecond later, or another name, is another occasion.
    let apart =
        rows("u1,1700000000.000000001,1,0,0,300,0,5\nu1,1.7e9,1,1,0,300,0,5\nu1,1.7e9,01,1,0,300,0,5\n");
    assert_eq!(apart.map(|found| found.count()), Ok(3));
}

#[test]
fn the_order_of_rows_does_not_matter() {
    let mut text: Vec<String> = (0..60)
        .map(|i| format!("u{},{},{},{i},0,300,{},5\n", i % 7, 1e3 + f64::from(i % 5), i % 4, i * i))
        .collect();
    let straight = rows(&text.concat()).unwrap();
    text.reverse();
    text.rotate_left(17);
    let turned = rows(&text.concat()).unwrap();
    for clocks_differ in [false, true] {
        assert_eq!(straight.prepare(clocks_differ), turned.prepare(clocks_differ));
    }
    assert_eq!((straight.users, straight.drones), (turned.users, turned.drones));
}

#[test]
fn nanoseconds_since_1970_lose_nothing() {
    let found = rows(
        "u1,1700000000.25,1,0,0,300,1700000000250000123.4375,5\n\
         u1,1700000000.25,2,0,0,300,1700000000250000000.0000000005,5\n\
         u1,1700000001.2500005,1,0,0,300,1.7000000012500001e18,5\n\
         u1,1700000001.2500005,2,0,0,300,1700000001250000099.9,5\n",
    )
    .unwrap();
    assert_eq!(
        heard(&found),
        [
            ("u1".into(), 0.0, vec![(1, 0.0), (2, -123.437_499_999)]),
            ("u1".into(), 1.000_000_5, vec![(1, 0.0), (2, -0.1)]),
        ]
    );
}

#[test]
fn clocks_that_count_from_anywhere_are_brought_together() {
    // Drone 2 counts from 1970 and drone 3 from its start; they never hear anyone together with 1 and 3, 1 and 2.
    let found = rows(
        "a,0,1,0,0,300,1000,5\na,0,2,0,0,300,1700000000000000400.5,5\n\
         b,1,2,0,0,300,1700000001000000000,5\nb,1,3,0,0,300,98765,5\n\
         c,2,3,0,0,300,1000098765,5\nc,2,1,0,0,300,900,5\n",
    )
    .unwrap();
    let prepared = found.prepare(true);
    assert!(prepared.taken_out_ns[0].abs() < 1e-300);
    // c closes the circle: 98765 - 1700000001000000000 + 1700000000000000400.5 - 1000 + 900 - 1000098765 = ...
    let [.., last] = &prepared.occasions[..] else { panic!() };
    assert_eq!(last.captures.iter().map(|c| c.toa_ns).collect::<Vec<_>>(), [0.0, 0.0]);
    let offsets = &prepared.taken_out_ns;
    assert!(
        (offsets[1] - 1.699_999_999_999_999_4e18).abs() < 1e3 && (offsets[2] - 1_000_097_865.0).abs() < 1e-6
    );
    assert!(found.drones.iter().all(|drone| drone.tied));
}

#[test]
fn ties_are_followed_both_ways() {
    // From 1 to 3, and back from 3 to 2.
    let text = "a,0,1,0,0,300,100,5\na,0,3,0,0,300,350,5\nb,0,2,0,0,300,-1000,5\nb,0,3,0,0,300,0,5\n";
    let offsets = rows(text).unwrap().prepare(true).taken_out_ns;
    for (offset, expected) in offsets.iter().zip([0.0, -750.0, 250.0]) {
        assert!((offset - expected).abs() < 1e-6, "{offsets:?}");
    }
}

#[test]
fn drones_without_ties_come_last() {
    let text = "a,0,1,0,0,300,0,5\na,0,2,0,0,300,0,5\n\
                b,0,3,0,0,300,0,5\nb,0,4,0,0,300,0,5\nb,1,4,0,0,300,0,5\nb,1,5,0,0,300,0,5\n\
                c,0,0,0,0,300,0,5\n";
    let found = rows(text).unwrap();
    let drones: Vec<_> = found.drones.iter().map(|drone| (drone.id.as_str(), drone.tied)).collect();
    assert_eq!(drones, [("3", true), ("4", true), ("5", true), ("0", false), ("1", false), ("2", false)]);
    let prepared = found.prepare(true);
    assert_eq!((prepared.heard_together, prepared.heard_alone), (3, 1));
    assert_eq!(prepared.occasions[0].captures[0].drone.0, 5);
}

#[test]
fn occasions_of_many_drones_are_divided_and_counted() {
    let text: String = (0..3)
        .flat_map(|epoch| (0..5).map(move |d| format!("a,{epoch},{d},{d},0,300,{},5\n", 10 * d)))
        .collect();
    let prepared = rows(&text).unwrap().prepare(false);
    assert_eq!((prepared.heard_together, prepared.divided, prepared.differences_lost), (3, 3, 3));
    let drones: Vec<Vec<u16>> =
        prepared.occasions.iter().map(|o| o.captures.iter().map(|c| c.drone.0).collect()).collect();
    let expected: [&[u16]; 6] = [&[1, 2], &[3, 4, 5], &[2, 3], &[4, 5, 1], &[3, 4], &[5, 1, 2]];
    assert_eq!(drones, expected);
}

#[test]
fn differences_that_no_way_explains_are_counted() {
    // 50 m are 166.8 ns; six standard deviations of two captures of 5 ns are 42.4 ns.
    for (toa_ns, implausible) in [(209, 0), (-209, 0), (210, 1), (-210, 1)] {
        let text = format!("a,0,1,0,0,300,0,5\na,0,2,30,40,300,{toa_ns},5\n");
        assert_eq!(rows(&text).unwrap().prepare(false).implausible, implausible, "{toa_ns}");
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let missing = Captures::read(Path::new("no/such.csv")).unwrap_err().to_string();
    assert!(missing.starts_with("no/such.csv: No such file"), "{missing}");
    let folder = Captures::read(Path::new("/")).unwrap_err().to_string();
    assert!(folder.starts_with("/: ") && folder.contains("directory"), "{folder}");
}
