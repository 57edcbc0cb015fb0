//! Anything at all given as a file: an area or a fault, never a panic.

use proptest::prelude::*;
use proptest::sample::{Index, select};

use super::*;

const NAMES: [&str; 4] = ["a.geojson", "a.kml", "a.plan", "a.csv"];

/// What a number is replaced by.
const NUMBERS: [&str; 16] = [
    "NaN",
    "1e308",
    "-1e308",
    "1e999",
    "1e-320",
    "-0",
    "0",
    "90",
    "180",
    "-180",
    "13.7",
    "51.05",
    "null",
    "\"\"",
    "99999999999999999999999",
    "",
];

/// Something done to a file.
#[derive(Clone, Debug)]
enum Harm {
    Flip(Index, u8),
    Cut(Index, Index),
    Repeat(Index, Index, Index),
    Number(Index, &'static str),
    Nest(Index, usize),
}

fn harm() -> impl Strategy<Value = Harm> {
    let at = any::<Index>;
    prop_oneof![
        (at(), any::<u8>()).prop_map(|(i, bits)| Harm::Flip(i, bits)),
        (at(), at()).prop_map(|(a, b)| Harm::Cut(a, b)),
        (at(), at(), at()).prop_map(|(a, b, to)| Harm::Repeat(a, b, to)),
        (at(), select(&NUMBERS[..])).prop_map(|(i, by)| Harm::Number(i, by)),
        (at(), select(vec![1, 3, 120, 3_000])).prop_map(|(i, depth)| Harm::Nest(i, depth)),
    ]
}

impl Harm {
    fn on(&self, bytes: &mut Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        let n = bytes.len();
        // Short spans: a file that is cut in half tells little.
        let span = |a: &Index, b: &Index| a.index(n)..(a.index(n) + b.index(40)).min(n);
        match self {
            Self::Flip(i, bits) => bytes[i.index(n)] ^= bits,
            Self::Cut(a, b) => drop(bytes.drain(span(a, b))),
            Self::Repeat(a, b, to) => {
                let copy = bytes[span(a, b)].to_vec();
                bytes.splice(to.index(n)..to.index(n), copy);
            }
            Self::Number(i, by) => {
                let in_number = |i: usize| matches!(bytes[i], b'0'..=b'9' | b'.' | b'-');
                let starts: Vec<usize> =
                    (0..n).filter(|&i| in_number(i) && (i == 0 || !in_number(i - 1))).collect();
                if starts.is_empty() {
                    return;
                }
                let start = starts[i.index(starts.len())];
                let end = (start..n).find(|&i| !in_number(i)).unwrap_or(n);
                bytes.splice(start..end, by.bytes());
            }
            Self::Nest(i, depth) => {
                let (open, close) = if bytes.contains(&b'<') { ("<a>", "</a>") } else { ("[", "]") };
                let at = i.index(n);
                bytes.splice(at..at, (open.repeat(*depth) + &close.repeat(*depth)).bytes());
            }
        }
    }
}

/// A sound file of each format.
fn sound() -> Vec<(&'static str, String)> {
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},{LAKE}],[{EAST}]]}}"#);
    let parts =
        format!("<MultiGeometry>{}{}</MultiGeometry>", kml_polygon(RING, &[LAKE]), kml_polygon(EAST, &[]));
    let circles = [fence_circle(51.075, 13.75, 500.0, false)];
    vec![
        ("a.geojson", polygon(&format!("{RING},{LAKE}"))),
        ("a.geojson", collection(&[feature(&multi)])),
        ("a.kml", kml(&placemark(&parts))),
        ("a.plan", plan(&[survey(RING)], &[fence(LAKE, false)], &circles)),
        ("a.plan", plan(&[], &[fence(RING, true)], &circles)),
        ("a.csv", "x_m,y_m\n0,0\n1000,0\n1000,1000\n300,700\n0,900\n".to_owned()),
    ]
}

/// What holds of any area that is read.
fn check(name: &str, bytes: &[u8]) {
    let Ok(area) = Area::parse(Path::new(name), bytes) else { return };
    let area_m2 = area.region.area_m2();
    let [low, high] = area.region.bbox_m();
    assert!(area_m2 > 0.0 && area_m2 <= (high - low).product() * (1.0 + 1e-9), "{area_m2} m2");
    assert!((high - low).amax() <= MAX_EXTENT_M);
    if let Some(frame) = area.frame {
        let [lon_deg, lat_deg] = frame.origin_lon_lat_deg();
        assert!((-180.0..180.0).contains(&lon_deg) && lat_deg.abs() < 90.0);
    }
}

proptest! {
    #[test]
    fn random_bytes_are_no_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        for name in NAMES {
            check(name, &bytes);
        }
    }

    #[test]
    fn harmed_files_are_no_panic(file in select(sound()), harms in prop::collection::vec(harm(), 1..6)) {
        let mut bytes = file.1.into_bytes();
        for harm in harms {
            harm.on(&mut bytes);
        }
        check(file.0, &bytes);
    }

    /// Sound numbers in unsound order: borders that cross, touch and lie in each other.
    #[test]
    fn any_rings_are_no_panic(
        rings in prop::collection::vec(prop::collection::vec((0..6i32, 0..6i32), 3..7), 1..5),
        split in 1..4usize,
    ) {
        let ring = |ring: &Vec<(i32, i32)>| {
            let mut positions: Vec<[f64; 2]> = ring.iter().map(|&(i, j)| [f64::from(i), f64::from(j)]).collect();
            positions.push(positions[0]);
            serde_json::to_string(&positions.iter().map(|p| p.map(|x| 10.0 + x * 0.02)).collect::<Vec<_>>()).unwrap()
        };
        let rings: Vec<String> = rings.iter().map(ring).collect();
        let polygons: Vec<String> = rings.chunks(split).map(|rings| format!("[{}]", rings.join(","))).collect();
        check("a.geojson", format!(r#"{{"type":"MultiPolygon","coordinates":[{}]}}"#, polygons.join(",")).as_bytes());
        let fences: Vec<String> = rings.iter().enumerate().map(|(i, ring)| fence(ring, i == 0)).collect();
        check("a.plan", plan(&[], &fences, &[fence_circle(10.04, 10.04, 2_500.0, false)]).as_bytes());
    }
}
