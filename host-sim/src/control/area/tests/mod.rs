//! What is read from each format, and what is refused.

mod alike;
mod garbage;
mod truth;

use std::path::Path;

use super::*;
use crate::geometry::V2;

/// Reads a file of that name and content; of a fault, what users see.
fn read(name: &str, content: &str) -> Result<Area, String> {
    Area::parse(Path::new(name), content.as_bytes()).map_err(|e| e.to_string())
}

/// Holds a fault against what it has to say.
fn refused(name: &str, content: &str, parts: &[&str]) {
    let found = read(name, content).map(|area| area.region.area_m2()).unwrap_err();
    for part in [&[name], parts].concat() {
        assert!(found.contains(part), "{found:?} lacks {part:?}");
    }
}

const RING: &str = "[[13.70,51.05],[13.80,51.05],[13.80,51.10],[13.70,51.10],[13.70,51.05]]";
const LAKE: &str = "[[13.74,51.06],[13.74,51.07],[13.76,51.07],[13.76,51.06],[13.74,51.06]]";
const EAST: &str = "[[13.81,51.05],[13.83,51.05],[13.82,51.08],[13.81,51.05]]";

fn polygon(rings: &str) -> String {
    format!(r#"{{"type":"Polygon","coordinates":[{rings}]}}"#)
}

fn feature(geometry: &str) -> String {
    format!(r#"{{"type":"Feature","properties":{{"name":"Town"}},"geometry":{geometry}}}"#)
}

fn collection(features: &[String]) -> String {
    format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, features.join(","))
}

/// A KML file with some placemarks in a folder.
fn kml(placemarks: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n\
         <Document><Folder>\n{placemarks}\n</Folder></Document></kml>\n"
    )
}

/// A ring of GeoJSON as that of KML, with heights.
fn linear_ring(ring: &str) -> String {
    let positions: Vec<[f64; 2]> = serde_json::from_str(ring).unwrap();
    let tuples: Vec<String> = positions.iter().map(|[lon, lat]| format!("{lon},{lat},120")).collect();
    format!("<LinearRing><coordinates>\n {}\n</coordinates></LinearRing>", tuples.join("\n "))
}

fn kml_polygon(outer: &str, holes: &[&str]) -> String {
    let hole = |it: &&str| format!("<innerBoundaryIs>{}</innerBoundaryIs>", linear_ring(it));
    format!(
        "<Polygon><outerBoundaryIs>{}</outerBoundaryIs>{}</Polygon>",
        linear_ring(outer),
        holes.iter().map(hole).collect::<String>()
    )
}

fn placemark(geometry: &str) -> String {
    format!("<Placemark><name>Town</name>{geometry}</Placemark>")
}

/// A ring of GeoJSON as one of a plan: turned around, not closed.
fn plan_ring(ring: &str) -> String {
    let mut positions: Vec<[f64; 2]> = serde_json::from_str(ring).unwrap();
    positions.pop();
    let turned: Vec<String> = positions.iter().map(|[lon, lat]| format!("[{lat},{lon}]")).collect();
    format!("[{}]", turned.join(","))
}

fn survey(ring: &str) -> String {
    format!(r#"{{"type":"ComplexItem","complexItemType":"survey","polygon":{}}}"#, plan_ring(ring))
}

fn fence(ring: &str, inclusion: bool) -> String {
    format!(r#"{{"inclusion":{inclusion},"polygon":{},"version":1}}"#, plan_ring(ring))
}

fn fence_circle(lat_deg: f64, lon_deg: f64, radius_m: f64, inclusion: bool) -> String {
    format!(
        r#"{{"circle":{{"center":[{lat_deg},{lon_deg}],"radius":{radius_m}}},"inclusion":{inclusion},"version":1}}"#
    )
}

fn plan(items: &[String], polygons: &[String], circles: &[String]) -> String {
    format!(
        r#"{{"fileType":"Plan","version":1,"groundStation":"QGroundControl",
            "geoFence":{{"circles":[{}],"polygons":[{}],"version":2}},
            "mission":{{"items":[{{"type":"SimpleItem","command":22,"params":[0,null]}}{}],"version":2}},
            "rallyPoints":{{"points":[],"version":2}}}}"#,
        circles.join(","),
        polygons.join(","),
        items.iter().map(|it| format!(",{it}")).collect::<String>()
    )
}

#[test]
fn one_area_reads_the_same_however_it_is_wrapped() {
    let area = read("a.geojson", &polygon(RING)).unwrap();
    assert_eq!(area.region.parts().len(), 1);
    assert_eq!(area.region.as_convex().unwrap().vertices_m().len(), 4);
    let [lon_deg, lat_deg] = area.frame.unwrap().origin_lon_lat_deg();
    assert!((lon_deg - 13.75).abs() < 1e-9 && (lat_deg - 51.075).abs() < 1e-9);
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING}]]}}"#);
    let placemark = placemark(&kml_polygon(RING, &[]));
    for (name, content) in [
        ("b.GeoJSON", feature(&polygon(RING))),
        ("c.json", collection(&[feature(&polygon(RING))])),
        ("d.geojson", format!("\u{feff}{}", feature(&multi))),
        ("e.kml", kml(&placemark)),
        ("f.KML", format!("<kml>{placemark}</kml>")),
        (
            "g.kml",
            format!("<k:kml xmlns:k=\"http://earth.google.com/kml/2.1\">{}</k:kml>", prefixed(&placemark)),
        ),
        ("h.plan", plan(&[survey(RING)], &[], &[])),
        ("i.plan", plan(&[], &[fence(RING, true)], &[])),
    ] {
        assert_eq!(read(name, &content).as_ref(), Ok(&area), "{name}");
    }
}

/// The same elements in a namespace of their own.
fn prefixed(xml: &str) -> String {
    xml.replace("</", "<\u{1}").replace('<', "<k:").replace("<k:\u{1}", "</k:")
}

#[test]
fn holes_and_exclusions_are_no_fly_zones() {
    let area = read("a.geojson", &polygon(&format!("{RING},{LAKE}"))).unwrap();
    let whole_m2 = read("a.geojson", &polygon(RING)).unwrap().region.area_m2();
    let [zone] = area.region.no_fly() else { panic!("{} zones", area.region.no_fly().len()) };
    assert!((area.region.area_m2() - (whole_m2 - zone.area_m2())).abs() < 1e-3);
    assert_eq!(area.region.parts()[0].holes.len(), 1);
    for (name, content) in [
        ("a.kml", kml(&placemark(&kml_polygon(RING, &[LAKE])))),
        ("a.plan", plan(&[survey(RING)], &[fence(LAKE, false)], &[])),
        ("b.plan", plan(&[], &[fence(LAKE, false), fence(RING, true)], &[])),
    ] {
        assert_eq!(read(name, &content).as_ref(), Ok(&area), "{name}");
    }
}

#[test]
fn parts_of_one_area_are_kept_together() {
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},{LAKE}],[{EAST}]]}}"#);
    let area = read("a.geojson", &multi).unwrap();
    assert_eq!((area.region.parts().len(), area.region.no_fly().len()), (2, 1));
    let nested = format!(
        "<MultiGeometry>{}<MultiGeometry>{}</MultiGeometry></MultiGeometry>",
        kml_polygon(RING, &[LAKE]),
        kml_polygon(EAST, &[])
    );
    assert_eq!(read("a.kml", &kml(&placemark(&nested))).as_ref(), Ok(&area));
}

#[test]
fn what_is_no_area_is_left_out_and_named() {
    let point = feature(r#"{"type":"Point","coordinates":[13.7,51.0]}"#);
    let nowhere = r#"{"type":"Feature","properties":null,"geometry":null}"#.to_owned();
    let area = read("a.geojson", &collection(&[point.clone(), feature(&polygon(RING)), nowhere])).unwrap();
    assert_eq!(area.left_out, ["feature 1 \"Town\" (a Point)", "feature 3 (no geometry)"]);
    let base = "<Placemark><name>Base</name><Point><coordinates>13,51</coordinates></Point></Placemark>";
    let area = read("a.kml", &kml(&format!("{base}{}{base}", placemark(&kml_polygon(RING, &[]))))).unwrap();
    assert_eq!(area.left_out, ["2 of Point"]);
    let area = read("a.plan", &plan(&[survey(LAKE)], &[fence(RING, true)], &[])).unwrap();
    assert_eq!(area.left_out, ["geofence polygon 1 (an inclusion fence beside a survey)"]);
    assert!(area.region.area_m2() < 2e6, "the survey is the area, not the fence");
}

#[test]
fn circles_are_never_entered_and_never_left() {
    let (lat_deg, lon_deg) = (51.075, 13.75);
    for radius_m in [30.0, 900.0, 20_000.0] {
        let whole =
            read("a.plan", &plan(&[], &[], &[fence_circle(lat_deg, lon_deg, radius_m, true)])).unwrap();
        let [south_west_m, north_east_m] = whole.region.bbox_m();
        assert!((north_east_m - south_west_m - V2::repeat(2.0 * radius_m)).amax() < 0.6);
        let outer = &whole.region.parts()[0].outer;
        assert!(outer.vertices_m().iter().all(|v| v.norm() <= radius_m + 1e-6));
        assert!(outer.edges_m().all(|(a, b)| ((a + b) / 2.0).norm() > radius_m - 0.3));
    }
    let exclusion = fence_circle(lat_deg, lon_deg, 900.0, false);
    let area = read("a.plan", &plan(&[survey(RING)], &[], &[exclusion])).unwrap();
    let zone = &area.region.no_fly()[0];
    assert!(zone.edges_m().all(|(a, b)| ((a + b) / 2.0).norm() >= 900.0 - 1e-6));
    assert!(zone.vertices_m().iter().all(|v| v.norm() < 900.3));
}

#[test]
fn local_rows_are_taken_as_they_are() {
    let area = read("a.csv", "\u{feff}x_m,y_m\n0,0\n1000, 0\r\n1000,2000\n\n0,2000\n").unwrap();
    assert_eq!(area.region.bbox_m(), [V2::new(0.0, 0.0), V2::new(1000.0, 2000.0)]);
    assert!(area.frame.is_none() && area.region.no_fly().is_empty());
}

#[test]
fn untidy_rings_are_cleaned() {
    let tidy = read("a.plan", &plan(&[survey(RING)], &[], &[])).unwrap();
    // Clockwise, closed, with vertices twice and on the line between others.
    let untidy = "[[13.70,51.05],[13.70,51.05],[13.70,51.10],[13.70,51.10],[13.80,51.10],[13.80,51.08],\
                  [13.80,51.05],[13.80,51.05],[13.70,51.05]]";
    let area = read("a.geojson", &polygon(untidy)).unwrap();
    let (tidy, area) = (&tidy.region.parts()[0].outer, &area.region.parts()[0].outer);
    assert!((tidy.area_m2() - area.area_m2()).abs() < 20.0, "{} {}", tidy.area_m2(), area.area_m2());
    // The meridian is not quite straight in the frame: its vertex stays, the others go.
    assert_eq!(area.vertices_m().len(), 5);
    let rows = read("a.csv", "x_m,y_m\n0,0\n0,50\n0,90\n0,90\n90,90\n90,0\n0,0\n").unwrap();
    assert_eq!(rows.region.as_convex().unwrap().vertices_m().len(), 4);
}

#[test]
fn names_that_tell_no_area_are_refused() {
    refused("a.shp", "", &["\"shp\"", ".geojson", ".kml", ".plan", ".csv"]);
    refused("a", "", &["\"\"", "expected .geojson"]);
    refused("a.kmz", "PK", &["a zipped KML", "unzip"]);
    for name in ["a.geojson", "a.kml", "a.plan", "a.csv"] {
        refused(name, " \n", &["nothing", "an area"]);
    }
    let error = Area::read(Path::new("/no/such/file.csv")).unwrap_err().to_string();
    assert!(error.contains("/no/such/file.csv"));
    let found = Area::parse(Path::new("a.kml"), b"<kml>\n\xff</kml>").unwrap_err().to_string();
    assert!(found.contains("line 2") && found.contains("UTF-8"), "{found}");
}

#[test]
fn faults_of_local_files_name_the_line() {
    let far = "x_m,y_m\n0,0\n9e5,0\n0,9e5\n";
    refused("a.csv", "x,y\n0,0\n", &["line 1", "\"x,y\"", "\"x_m,y_m\""]);
    refused("a.csv", "y_m,x_m\n0,0\n", &["line 1", "\"y_m,x_m\""]);
    refused("a.csv", "x_m,y_m\n0,0\n1,nan\n", &["line 3, y_m", "\"nan\"", "finite"]);
    refused("a.csv", "x_m,y_m\n0,0\n1,2,3\n", &["line 3", "3 fields", "2 fields"]);
    refused("a.csv", "x_m,y_m\n0,0\n1,2\n", &["found 2 different vertices"]);
    refused("a.csv", far, &["900 km", "at most 200 km"]);
}

#[test]
fn faults_of_geojson_name_the_feature_and_the_vertex() {
    let refused = |content: &str, parts: &[&str]| refused("a.geojson", content, parts);
    let ring = |ring: &str, parts: &[&str]| refused(&polygon(ring), parts);
    refused("{\"type\":\n}", &["line 2", "GeoJSON"]);
    refused("[]", &["the file", "an array of 0", "\"type\""]);
    refused(r#"{"type":"Topology"}"#, &["\"Topology\"", "RFC 7946"]);
    refused(r#"{"type":"Feature","properties":null,"geometry":null}"#, &["the feature", "no geometry"]);
    refused(&collection(&[]), &["no feature", "exactly one"]);
    refused(&collection(&[polygon(RING)]), &["feature 1", "\"Polygon\"", "\"Feature\""]);
    let areas = [feature(&polygon(RING)), feature(r#"{"type":"Point"}"#), feature(&polygon(EAST))];
    refused(&collection(&areas), &["2 areas", "feature 1 \"Town\"", "feature 3 \"Town\""]);
    refused(
        &feature(r#"{"type":"LineString","coordinates":[]}"#),
        &["only the feature \"Town\" (a LineString)"],
    );
    let nested = r#"{"type":"GeometryCollection","geometries":[]}"#;
    refused(nested, &["a GeometryCollection", "a Polygon"]);
    refused(&collection(&[areas[1].clone(), feature(nested)]), &["feature 2", "a GeometryCollection"]);
    refused(r#"{"type":"MultiPolygon","coordinates":[]}"#, &["without a polygon"]);
    refused(r#"{"type":"Polygon","coordinates":[]}"#, &["without a ring"]);
    refused(
        r#"{"type":"Polygon","coordinates":7}"#,
        &["the geometry, \"coordinates\"", "found 7", "an array"],
    );
    refused(r#"{"type":"Polygon"}"#, &["no \"coordinates\""]);
    let crs = r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25833"}}"#;
    refused(&polygon(RING).replacen('{', &format!("{{{crs},"), 1), &["\"crs\"", "EPSG::25833", "WGS84"]);
    ring("[]", &["without a vertex"]);
    ring("[[0,0],[1,95],[1,0],[0,0]]", &["vertex 2", "latitude 95", "within +-90"]);
    ring("[[0,0],[181,1],[1,0],[0,0]]", &["vertex 2", "longitude 181"]);
    ring("[[0,0],[1e999,1],[1,0],[0,0]]", &["1e", "999"]);
    ring("[[0,0],[0.1,\"x\"],[0.1,0],[0,0]]", &["vertex 2", "\"x\"", "finite"]);
    ring("[[0,0],[0.1],[0.1,0],[0,0]]", &["vertex 2", "1 numbers", "longitude and latitude"]);
    ring("[[0,0],[0.1,0],[0.1,0.1]]", &["vertex 3", "unclosed", "(0.1, 0.1)", "repeat the first"]);
    ring("[[0,0],[0.1,0],[0,0]]", &["found 2 different vertices"]);
    ring("[[0,0],[0.1,0],[0.2,0],[0,0]]", &["on the line through vertices 1 and 3"]);
    ring("[[0,0],[0.1,0.1],[0.1,0],[0,0.1],[0,0]]", &["the edge from vertex 1", "vertex 3"]);
    ring("[[0,0],[9,0],[9,9],[0,0]]", &["vertex 1", "km from the middle", "at most 100 km"]);
    let hole = |hole: &str, parts: &[&str]| ring(&format!("{RING},{LAKE},{hole}"), parts);
    hole("[[13.74,51.08],[13.75,51.08],[13.74,51.09]]", &["hole 2, vertex 3", "unclosed"]);
    hole(
        "[[13.7,51.06],[13.8,51.07],[13.8,51.06],[13.7,51.07],[13.7,51.06]]",
        &["hole 2: the edge from vertex 1"],
    );
    hole(EAST, &["hole 2", "outside of its polygon"]);
    let island = "[[13.745,51.062],[13.755,51.062],[13.75,51.068],[13.745,51.062]]";
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},{LAKE}],[{island}]]}}"#);
    refused(&multi, &["polygon 2", "reaches into the geometry, polygon 1, hole 1", "no drone may enter"]);
    ring(&format!("{RING},{RING}"), &["no-fly zones over all of the area"]);
}

#[test]
fn a_named_wgs84_and_a_shared_border_are_no_faults() {
    for name in ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326"] {
        let crs = format!(r#"{{"crs":{{"type":"name","properties":{{"name":"{name}"}}}},"#);
        read("a.geojson", &polygon(RING).replacen('{', &crs, 1)).unwrap();
    }
    // The second polygon fills the western half of the first one's hole's neighbourhood up to its border.
    let beside = "[[13.72,51.06],[13.74,51.06],[13.74,51.07],[13.72,51.07],[13.72,51.06]]";
    let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{RING},{LAKE}],[{beside}]]}}"#);
    assert_eq!(read("a.geojson", &multi).unwrap().region.parts().len(), 1);
}

#[test]
fn faults_of_kml_name_the_placemark_and_the_line() {
    let refused = |content: &str, parts: &[&str]| refused("a.kml", content, parts);
    let one = placemark(&kml_polygon(RING, &[LAKE]));
    refused("<kml>\n<Placemark></kml>", &["line 2, column 12", "expected 'Placemark' tag", "KML"]);
    refused("<gpx/>", &["line 1", "\"gpx\"", "\"kml\""]);
    refused(&kml(""), &["no polygon", "exactly one placemark"]);
    refused(&kml(&format!("{one}\n{one}")), &["2 placemarks", "\"Town\" (line 4)"]);
    refused(&kml(&placemark("<Polygon/>")), &["\"Town\" (line 4), line 4", "0 outer boundaries"]);
    refused(&kml(&one.replacen("13.7,51.05,120", "13.7, 51.05", 1)), &["vertex 1", "\"13.7,\"", "no space"]);
    refused(&kml(&one.replacen("13.8,51.05,120", "nan,51.05,120", 1)), &["vertex 2", "longitude NaN"]);
    refused(&kml(&one.replacen("13.76,51.07,120", "1;2", 1)), &["hole 1, line 10, vertex 3", "\"1;2\""]);
    let open = one.replacen("13.7,51.05,120\n<", "<", 1);
    refused(&kml(&open), &["line 4, vertex 4", "unclosed", "(13.7, 51.1)"]);
    let entities = "<!DOCTYPE kml [<!ENTITY a \"b\">]><kml>&a;</kml>";
    refused(entities, &["line 1", "DTD"]);
    let deep = "<a>".repeat(600_000);
    refused(&format!("<kml>{deep}"), &["nodes limit"]);
}

#[test]
fn faults_of_plans_name_the_item_and_the_fence() {
    let refused = |content: &str, parts: &[&str]| refused("a.plan", content, parts);
    refused("{\n", &["line 2", "a plan file of QGroundControl"]);
    refused(r#"{"fileType":"Mission"}"#, &["\"fileType\"", "\"Mission\"", "\"Plan\""]);
    refused(&plan(&[], &[], &[]), &["neither a survey nor an inclusion fence"]);
    refused(&plan(&[], &[fence(RING, false)], &[]), &["neither"]);
    let surveys = plan(&[survey(RING), survey(EAST)], &[], &[]);
    refused(&surveys, &["2 areas", "the survey (mission item 2)", "the survey (mission item 3)"]);
    let fences = plan(&[], &[fence(RING, true)], &[fence_circle(51.0, 13.0, 100.0, true)]);
    refused(&fences, &["geofence polygon 1", "geofence circle 1"]);
    let open = survey(RING);
    refused(
        &plan(&[open.replacen("51.05", "null", 1)], &[], &[]),
        &["mission item 2), vertex 1", "null", "latitude"],
    );
    refused(&plan(&[open.replacen("51.05", "113.7", 1)], &[], &[]), &["vertex 1", "latitude 113.7"]);
    refused(&plan(&[r#"{"complexItemType":"survey"}"#.into()], &[], &[]), &["no \"polygon\""]);
    let circle = |lat_deg: f64, radius_m: f64| plan(&[], &[], &[fence_circle(lat_deg, 13.0, radius_m, true)]);
    refused(&circle(51.0, 0.0), &["geofence circle 1, radius", "more than 0"]);
    refused(&circle(51.0, 3e5), &["radius", "300000", "at most 100000"]);
    refused(&circle(89.999, 3e3), &["a circle around a pole"]);
    let unsure = plan(&[survey(RING)], &[fence(LAKE, true).replace("true", "1")], &[]);
    refused(&unsure, &["geofence polygon 1, \"inclusion\"", "found 1", "true or false"]);
    let old = r#"{"fileType":"Plan","geoFence":{"polygon":[],"version":1},"mission":{"items":[]}}"#;
    refused(old, &["a geofence of version 1", "QGroundControl"]);
    refused(&plan(&[survey(LAKE)], &[fence(RING, false)], &[]), &["no-fly zones over all"]);
    let far = "[[20,51],[21,51],[21,52],[20,51]]";
    refused(
        &plan(&[survey(RING)], &[fence(far, false)], &[]),
        &["geofence polygon 1, vertex 1", "at most 200 km"],
    );
}

#[test]
fn absurd_sizes_are_refused() {
    let rows: String = (0..10_001).map(|i| format!("{i},{}\n", i * i)).collect();
    refused("a.csv", &format!("x_m,y_m\n{rows}"), &["10001 vertices", "at most 10000", "simplify"]);
    let positions = vec!["[1,2]"; 10_001].join(",");
    refused("a.geojson", &polygon(&format!("[{positions}]")), &["10001 vertices"]);
    refused("a.geojson", &polygon(&vec!["[]"; 1_001].join(",")), &["1001 rings", "at most 1000"]);
    refused("a.kml", &kml(&placemark(&"<Polygon/>".repeat(1_001))), &["1001 rings"]);
    refused("a.plan", &plan(&[], &vec!["0".to_owned(); 1_001], &[]), &["1001 rings"]);
    refused("a.csv", &"x".repeat(5 << 20), &["more than 4194304 bytes", "at most 4 MiB"]);
    refused("a.json", &"[".repeat(1 << 20), &["line 1, column 128", "recursion limit"]);
}

#[test]
fn combs_across_each_other_are_refused_soon() {
    let comb = |turned: bool| {
        let mut teeth: Vec<[f64; 2]> = Vec::new();
        for i in 0..2_000 {
            teeth.extend([[f64::from(i) * 5e-5, 0.0], [f64::from(i) * 5e-5 + 1e-5, 0.1]]);
        }
        teeth.extend([[0.1, -0.001], [0.0, -0.001], [0.0, 0.0]]);
        teeth.iter_mut().filter(|_| turned).for_each(|position| position.swap(0, 1));
        serde_json::to_string(&teeth).unwrap()
    };
    let rings = polygon(&[comb(false), comb(true)].join(","));
    refused("a.geojson", &rings, &["cross each other", "simplify"]);
}

#[cfg(unix)]
#[test]
fn a_file_without_an_end_is_not_read_to_it() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("endless.kml");
    std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
    assert!(Area::read(&file).unwrap_err().to_string().contains("more than"));
}
