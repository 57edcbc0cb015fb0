//! Random bytes, and good files with random damage: read, or refused with a line that exists.

use proptest::prelude::*;

use super::*;

/// A good file of some users, epochs and drones.
fn good_file() -> impl Strategy<Value = Vec<u8>> {
    let row = (0..4u8, 0..5u8, 0..5u8, -1e3..1e3f64, any::<i32>(), 0.1..9.9f64);
    prop::collection::vec(row, 1..25).prop_map(|rows| {
        let mut text = HEADER.to_owned();
        for (i, (user, epoch, drone, x_m, toa_ns, sigma_ns)) in rows.into_iter().enumerate() {
            // Each row an epoch of its own in every fourth place keeps contradictions rare.
            let epoch = if i % 4 == 0 { i + 10 } else { usize::from(epoch) };
            text += &format!("u{user},{epoch}.5,{drone},{x_m},-7e1,300,{toa_ns},{sigma_ns}\n");
        }
        text.into_bytes()
    })
}

/// Some damage: where, as a fraction of the file, and what.
#[derive(Clone, Debug)]
enum Damage {
    Put(u8),
    Insert(Vec<u8>),
    Remove(usize),
    Repeat(usize),
}

fn damage() -> impl Strategy<Value = (f64, Damage)> {
    let piece = prop::sample::select(vec![
        ",",
        "\"",
        "\n",
        "\r\n",
        "\r",
        "nan",
        "-inf",
        "1e400",
        "-",
        ".",
        "e",
        " ",
        "\t",
        "\0",
        "\u{feff}",
        "ä",
        "0",
        "9999999999999999999999",
        "user",
    ]);
    let damage = prop_oneof![
        any::<u8>().prop_map(Damage::Put),
        piece.prop_map(|piece| Damage::Insert(piece.as_bytes().to_vec())),
        (1..40usize).prop_map(Damage::Remove),
        (1..120usize).prop_map(Damage::Repeat),
    ];
    (0.0..1.0f64, damage)
}

fn damaged(mut text: Vec<u8>, damages: &[(f64, Damage)]) -> Vec<u8> {
    for (place, damage) in damages {
        let at = (place * text.len() as f64) as usize;
        let to = |length: usize| at..(at + length).min(text.len());
        match damage {
            Damage::Put(byte) => text.iter_mut().skip(at).take(1).for_each(|b| *b = *byte),
            Damage::Insert(piece) => drop(text.splice(at..at, piece.iter().copied())),
            Damage::Remove(length) => drop(text.drain(to(*length))),
            Damage::Repeat(length) => {
                let piece = text[to(*length)].to_vec();
                drop(text.splice(at..at, piece));
            }
        }
    }
    text
}

/// Reads, and holds what comes out against what a file can hold.
fn check(text: &[u8]) -> Result<(), TestCaseError> {
    let lines = text.iter().filter(|&&b| b == b'\n').count() + 1;
    match Captures::parse(Path::new("c.csv"), text) {
        Ok(found) => {
            let rows = found.count() + found.repeated.map_or(0, |(count, _)| count);
            prop_assert!(rows > 0 && rows < lines);
            prop_assert!(found.repeated.is_none_or(|(_, line)| (line as usize) <= lines));
            for clocks_differ in [false, true] {
                let prepared = found.prepare(clocks_differ);
                let kept: usize = prepared.occasions.iter().map(|o| o.captures.len()).sum();
                prop_assert_eq!(kept, found.count());
                for occasion in &prepared.occasions {
                    prop_assert!(occasion.time_s >= 0.0 && occasion.time_s <= 1e12);
                    for c in &occasion.captures {
                        let finite = c.toa_ns.is_finite() && c.pos_enu_m.iter().all(|p| p.is_finite());
                        prop_assert!(finite && c.sigma_ns.is_some_and(|s| s > 0.0), "{:?}", c);
                    }
                }
            }
        }
        Err(RowsError::Content { fault, .. }) => {
            prop_assert!(fault.line >= 1 && fault.line as usize <= lines, "{} of {}", fault, lines);
            prop_assert!(!fault.to_string().contains(char::is_control), "{:?}", fault.to_string());
        }
        Err(error @ RowsError::Read { .. }) => prop_assert!(false, "{}", error),
    }
    Ok(())
}

proptest! {
    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        check(&bytes)?;
        check(&[HEADER.as_bytes(), &bytes].concat())?;
    }

    #[test]
    fn anything_like_rows_is_read_or_refused(
        rows in "([ab]?,[-0-9.e]{0,4},[12],[-0-9.]{0,5},0,300,[-0-9naif]{0,9},[0-9e.-]{0,5}\r?\n){0,9}"
    ) {
        check(&[HEADER.as_bytes(), rows.as_bytes()].concat())?;
    }

    #[test]
    fn a_damaged_file_is_read_or_refused(
        text in good_file(), damages in prop::collection::vec(damage(), 0..4)
    ) {
        check(&damaged(text, &damages))?;
    }
}
