//! One area in every format: the same polygon, at the same place on Earth.

use std::f64::consts::TAU;
use std::fmt::Write;

use ::geojson::{Geometry, GeometryValue};
use proptest::prelude::*;

use super::*;
use crate::geometry::polygon::Polygon;

/// A star-shaped border with a smaller copy of it as hole.
#[derive(Clone, Debug)]
struct Star {
    frame: LocalFrame,
    outer_m: Vec<V2>,
    hole_m: Vec<V2>,
}

impl Star {
    fn positions(&self, ring_m: &[V2]) -> Vec<[f64; 2]> {
        ring_m.iter().map(|&p| self.frame.to_lon_lat_deg(p)).collect()
    }

    /// Both rings closed, longitude first.
    fn closed(&self) -> [Vec<[f64; 2]>; 2] {
        [&self.outer_m, &self.hole_m].map(|ring_m| {
            let mut ring = self.positions(ring_m);
            ring.push(ring[0]);
            ring
        })
    }

    /// By a writer that is not ours.
    fn geojson(&self) -> String {
        let ring = |ring: &Vec<[f64; 2]>| ring.iter().map(|&[lon, lat]| vec![lon, lat].into()).collect();
        let coordinates = self.closed().iter().map(ring).collect();
        Geometry::new(GeometryValue::Polygon { coordinates }).to_string()
    }

    fn kml(&self) -> String {
        let [outer, hole] = self.closed().map(|ring| serde_json::to_string(&ring).unwrap());
        kml(&placemark(&kml_polygon(&outer, &[&hole])))
    }

    fn plan(&self, by_survey: bool) -> String {
        let [outer, hole] = self.closed().map(|ring| serde_json::to_string(&ring).unwrap());
        if by_survey {
            plan(&[survey(&outer)], &[fence(&hole, false)], &[])
        } else {
            plan(&[], &[fence(&outer, true), fence(&hole, false)], &[])
        }
    }

    fn csv(&self) -> String {
        let mut rows = "x_m,y_m\n".to_owned();
        for p in &self.outer_m {
            writeln!(rows, "{},{}", p.x, p.y).unwrap();
        }
        rows
    }
}

/// Anywhere on Earth where an area of 20 km fits beside the poles, often near the date line.
fn star() -> impl Strategy<Value = Star> {
    let lon_deg = prop_oneof![-180.0..180.0f64, 179.9..180.0f64, -180.0..-179.9f64];
    let radii = prop::collection::vec(2_000.0..10_000.0f64, 3..12);
    (lon_deg, -88.0..88.0f64, radii, 0.0..TAU, any::<bool>()).prop_map(
        |(lon, lat, radii, turn, clockwise)| {
            let step = TAU / radii.len() as f64;
            let corner = |(i, r): (usize, &f64)| {
                let angle = turn + i as f64 * step;
                V2::new(r * angle.cos(), r * angle.sin())
            };
            let mut outer_m: Vec<V2> = radii.iter().enumerate().map(corner).collect();
            if clockwise {
                outer_m.reverse();
            }
            let hole_m = outer_m.iter().map(|p| p * 0.3).collect();
            Star { frame: LocalFrame::new(lon, lat), outer_m, hole_m }
        },
    )
}

/// Whether two borders have the same vertices to a centimetre, wherever they begin.
fn same(found: &[V2], expected: &[V2]) -> bool {
    let near = |a: &V2, b: &V2| (a - b).norm() < 0.01;
    found.len() == expected.len() && expected.iter().all(|e| found.iter().any(|f| near(f, e)))
}

proptest! {
    #[test]
    fn every_format_gives_the_same_region(star in star()) {
        let expected = |ring_m: &[V2]| Polygon::new(ring_m).unwrap().vertices_m().to_vec();
        let (outer_m, hole_m) = (expected(&star.outer_m), expected(&star.hole_m));
        for (name, content) in [
            ("a.geojson", star.geojson()),
            ("a.kml", star.kml()),
            ("a.plan", star.plan(true)),
            ("b.plan", star.plan(false)),
        ] {
            let area = read(name, &content).unwrap();
            let frame = area.frame.unwrap();
            // By way of degrees from the frame found to the one that the area was made in.
            let back = |polygon: &Polygon| -> Vec<V2> {
                let degrees = polygon.vertices_m().iter().map(|&p| frame.to_lon_lat_deg(p));
                degrees.map(|[lon_deg, lat_deg]| star.frame.to_local_m(lon_deg, lat_deg)).collect()
            };
            let [part] = area.region.parts() else { panic!("{} parts", area.region.parts().len()) };
            prop_assert!(same(&back(&part.outer), &outer_m), "{}: {:?}", name, back(&part.outer));
            prop_assert!(same(&back(&part.holes[0]), &hole_m), "{}", name);
            prop_assert!(same(&back(&area.region.no_fly()[0]), &hole_m), "{}", name);
        }
        let local = read("a.csv", &star.csv()).unwrap();
        prop_assert!(same(local.region.parts()[0].outer.vertices_m(), &outer_m));
    }
}
