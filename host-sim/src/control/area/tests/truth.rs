//! Areas against PROJ: high in the north, across the date line and along it.

use super::*;

/// What `truth_area.py` prints of an area.
struct Truth<const N: usize> {
    middle_deg: [f64; 2],
    /// Longitude, latitude, east, north, length of the geodesic to the next vertex.
    vertices: [[f64; 5]; N],
    area_m2: f64,
}

const ELBE: Truth<4> = Truth {
    middle_deg: [13.775000, 51.080000],
    vertices: [
        [13.70, 51.05, -5259.164947, -3334.808722, 7100.665591],
        [13.80, 51.04, 1753.432554, -4449.679566, 6574.648480],
        [13.85, 51.09, 5254.633582, 1115.175159, 7758.461998],
        [13.75, 51.12, -1750.411214, 4450.304923, 8539.281200],
    ],
    area_m2: 54582345.923,
};

const ARCTIC: Truth<5> = Truth {
    middle_deg: [20.850000, 85.005000],
    vertices: [
        [20.00, 84.95, -8356.568249, -6080.946288, 16894.422862],
        [21.70, 84.93, 8389.575618, -8314.408242, 14649.287600],
        [21.50, 85.06, 6251.571484, 6178.032834, 6688.040780],
        [20.90, 85.03, 483.813210, 2792.346879, 9513.420548],
        [20.10, 85.08, -7184.170937, 8423.263792, 14551.505513],
    ],
    area_m2: 188492659.161,
};

const DATE_LINE: Truth<4> = Truth {
    middle_deg: [-180.000000, -16.480000],
    vertices: [
        [179.93, -16.55, -7471.569612, -7747.784316, 15308.616519],
        [-179.93, -16.52, 7472.723971, -4427.854072, 12358.912599],
        [-179.95, -16.41, 5340.670286, 7745.774152, 11184.596824],
        [179.95, -16.44, -5339.851087, 4425.879769, 12358.890110],
    ],
    area_m2: 155974266.249,
};

const AT_180: Truth<4> = Truth {
    middle_deg: [179.930000, 65.035000],
    vertices: [
        [179.86, 65.00, -3302.286646, -3900.422344, 6604.572999],
        [180.00, 65.00, 3302.286646, -3900.422344, 7804.519610],
        [180.00, 65.07, 3293.642524, 3904.093518, 4836.354838],
        [179.90, 65.06, -1412.090630, 2787.668343, 6950.064108],
    ],
    area_m2: 40453803.988,
};

impl<const N: usize> Truth<N> {
    fn ring(&self) -> String {
        let positions: Vec<String> = self
            .vertices
            .iter()
            .chain(&self.vertices[..1])
            .map(|[lon, lat, ..]| format!("[{lon},{lat}]"))
            .collect();
        format!("[{}]", positions.join(","))
    }

    fn check(&self, ring: &str) {
        let area = read("a.geojson", &polygon(ring)).unwrap();
        let frame = area.frame.unwrap();
        let [lon_deg, lat_deg] = frame.origin_lon_lat_deg();
        assert!((lon_deg - self.middle_deg[0]).abs() < 1e-9 && (lat_deg - self.middle_deg[1]).abs() < 1e-9);
        let outer = &area.region.parts()[0].outer;
        assert_eq!(outer.vertices_m().len(), N);
        for ([.., x_m, y_m, length_m], (a, b)) in self.vertices.iter().zip(outer.edges_m()) {
            let off_m = (a - V2::new(*x_m, *y_m)).norm();
            assert!(off_m < 2e-6, "{off_m} m beside PROJ");
            // What the frame promises 10 km east or west of its middle; nearer it is less.
            let error = (a - b).norm() / length_m - 1.0;
            assert!(error.abs() < 1.3e-6, "an edge is longer than the geodesic by {error}");
        }
        let error = area.region.area_m2() / self.area_m2 - 1.0;
        assert!(error.abs() < 2e-6, "the area is off by {error}");
    }
}

#[test]
fn truth_areas_agree_with_proj() {
    ELBE.check(&ELBE.ring());
    ARCTIC.check(&ARCTIC.ring());
    DATE_LINE.check(&DATE_LINE.ring());
    AT_180.check(&AT_180.ring());
    // The meridian has two names.
    AT_180.check(&AT_180.ring().replace("[180,", "[-180,"));
}

#[test]
fn truth_the_fixture_has_the_area_that_proj_gives_it() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/dresden-elbe.geojson");
    let region = Area::read(&file).unwrap().region;
    // pyproj.Geod(ellps="WGS84").polygon_area_perimeter over the ring.
    let truth_m2 = 32_746_441.3;
    assert!((region.area_m2() / truth_m2 - 1.0).abs() < 1e-6, "{} m2", region.area_m2());
    assert!(region.as_convex().is_some());
}

#[test]
fn an_area_cut_at_the_date_line_grows_together() {
    let west = "[[179.93,-16.55],[180,-16.53],[180.0,-16.43],[179.93,-16.45],[179.93,-16.55]]";
    let east = "[[-180,-16.53],[-179.93,-16.51],[-179.93,-16.41],[-180.0,-16.43],[-180,-16.53]]";
    for parts in [[west, east], [east, west]] {
        let [a, b] = parts;
        let multi = format!(r#"{{"type":"MultiPolygon","coordinates":[[{a}],[{b}]]}}"#);
        let area = read("a.geojson", &multi).unwrap();
        assert_eq!(area.region.parts().len(), 1);
        let [lon_deg, _] = area.frame.unwrap().origin_lon_lat_deg();
        assert!((lon_deg.abs() - 180.0).abs() < 1e-9);
        let halves = parts.map(|part| read("a.geojson", &polygon(part)).unwrap().region.area_m2());
        assert!((area.region.area_m2() / halves.iter().sum::<f64>() - 1.0).abs() < 1e-6);
    }
}

#[test]
fn areas_with_a_pole_are_refused() {
    let refused = |ring: &str, parts: &[&str]| refused("a.geojson", &polygon(ring), parts);
    refused("[[0,89.9],[120,89.9],[-120,89.9],[0,89.9]]", &["a ring around the north pole"]);
    refused("[[0,-89.9],[-120,-89.9],[120,-89.9],[0,-89.9]]", &["a ring around the south pole"]);
    refused("[[0,89.9],[90,89.9],[180,89.9],[0,89.9]]", &["vertex 4", "half of all longitudes", "no pole"]);
    refused("[[0,89.9],[90,89.9],[0,90],[0,89.9]]", &["vertex 3", "latitude 90", "touch a pole"]);
    let open = plan(&[survey("[[0,89.9],[90,89.9],[180,89.9],[0,89.9]]")], &[], &[]);
    super::refused("a.plan", &open, &["vertex 1", "half of all longitudes"]);
    // Around the pole by more than half, but not all of the way.
    let c = "[[-100,89.9],[0,89.9],[100,89.9],[100,89.8],[0,89.8],[-100,89.8],[-100,89.9]]";
    let area = read("a.geojson", &polygon(c)).unwrap();
    assert!(area.region.parts()[0].outer.first_reflex_m().is_some());
}
