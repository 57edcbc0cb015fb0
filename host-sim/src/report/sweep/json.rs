//! A sweep for scripts: lengths in metres in the local frame (east, north), angles in radians from east.

use serde::Serialize;

use super::{ModeTried, SweepReport, name};
use crate::control::air_to_ground::Environment;
use crate::control::sweep::SubArea;
use crate::geometry::V2;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::{Part, Region};

type Point = [f64; 2];
type Ring = Vec<Point>;

#[derive(Serialize)]
struct Sweep<'a> {
    /// Where the local frame's zero lies on Earth; none for an area in local metres.
    origin: Option<Origin>,
    split: &'static str,
    sweep_direction_rad: f64,
    width_m: f64,
    swath_m: f64,
    sub_areas: Vec<Fleet>,
    covered_fraction: f64,
    residue_m: Vec<Ring>,
    separation_m: Option<f64>,
    duration_s: f64,
    length_m: f64,
    mission_time_s: f64,
    meets_mission_time: bool,
    modes: Vec<Mode<'a>>,
    area_m2: f64,
    no_fly_m: Vec<Ring>,
    radius_m: f64,
    spacing_m: f64,
    margin_m: f64,
    speed_mps: f64,
    altitude_m: f64,
    link: Option<Link>,
    left_out: &'a [String],
}

#[derive(Serialize)]
struct Origin {
    lon_deg: f64,
    lat_deg: f64,
}

#[derive(Serialize)]
struct Fleet {
    fleet: usize,
    proportion: f64,
    area_m2: f64,
    /// None where there is no sub-area, or where it is not one ring.
    polygon_m: Option<Ring>,
    /// The sub-area where it is not one ring: polygons, each its outer ring and its holes.
    #[serde(skip_serializing_if = "Option::is_none")]
    polygons_m: Option<Vec<Vec<Ring>>>,
    path_m: Ring,
    lane_direction_rad: f64,
    length_m: f64,
    turns: usize,
    duration_s: f64,
    covered_fraction: f64,
    pad_m: Point,
    /// Corners between the pad and the first lane, where zones lie between.
    approach_m: Ring,
    /// And between the last lane and the pad.
    way_back_m: Ring,
    transit_m: f64,
    return_m: f64,
}

#[derive(Serialize)]
struct Mode<'a> {
    split: &'static str,
    duration_s: Option<f64>,
    length_m: Option<f64>,
    meets_mission_time: bool,
    /// Why there is no such plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<&'a str>,
}

#[derive(Serialize)]
struct Link {
    environment: Environment,
    frequency_mhz: f64,
    max_path_loss_db: f64,
    elevation_deg: f64,
}

/// See [`SweepReport::to_json`].
pub(super) fn render(report: &SweepReport) -> String {
    let SweepReport { area, request, plan, .. } = report;
    let sweep = Sweep {
        origin: area
            .frame
            .map(|frame| frame.origin_lon_lat_deg())
            .map(|[lon_deg, lat_deg]| Origin { lon_deg, lat_deg }),
        split: name(plan.split),
        sweep_direction_rad: plan.direction_rad,
        width_m: plan.width_m,
        swath_m: plan.swath_m,
        sub_areas: plan.sub_areas.iter().map(|sub_area| fleet(report, sub_area)).collect(),
        covered_fraction: plan.covered_fraction,
        residue_m: plan.residue_m.iter().map(|ring_m| ring(ring_m)).collect(),
        separation_m: plan.separation_m,
        duration_s: plan.duration_s(),
        length_m: plan.length_m(),
        mission_time_s: report.mission_time_s,
        meets_mission_time: report.meets(plan.duration_s()),
        modes: report.modes.iter().map(|tried| mode(report, tried)).collect(),
        area_m2: area.region.area_m2(),
        no_fly_m: area.region.no_fly().iter().map(polygon).collect(),
        radius_m: request.radius_m,
        spacing_m: request.spacing_m,
        margin_m: request.margin_m,
        speed_mps: request.speed_mps,
        altitude_m: report.altitude_m,
        link: report.link.map(|(link, disk)| Link {
            environment: link.environment,
            frequency_mhz: link.frequency_hz / 1e6,
            max_path_loss_db: link.max_path_loss_db,
            elevation_deg: disk.elevation_deg,
        }),
        left_out: &area.left_out,
    };
    let mut text = serde_json::to_string_pretty(&sweep).expect("plain data serializes");
    text.push('\n');
    text
}

fn fleet(report: &SweepReport, sub_area: &SubArea) -> Fleet {
    let [transit_m, return_m] = report.transits_m(sub_area);
    let own = sub_area.region.as_ref();
    let one_ring = own.and_then(Region::as_polygon);
    let several = own.filter(|_| one_ring.is_none());
    Fleet {
        fleet: sub_area.fleet,
        proportion: sub_area.proportion,
        area_m2: sub_area.area_m2,
        polygon_m: one_ring.map(polygon),
        polygons_m: several.map(|region| region.parts().iter().map(part).collect()),
        path_m: ring(&sub_area.path_m),
        lane_direction_rad: sub_area.direction_rad,
        length_m: sub_area.length_m,
        turns: sub_area.turns,
        duration_s: sub_area.duration_s,
        covered_fraction: sub_area.covered_fraction,
        pad_m: report.pads.centre_m(sub_area.fleet).into(),
        approach_m: ring(&sub_area.approach_m),
        way_back_m: ring(&sub_area.way_back_m),
        transit_m,
        return_m,
    }
}

fn mode<'a>(report: &SweepReport, tried: &'a ModeTried) -> Mode<'a> {
    let figures = tried.figures.as_ref();
    Mode {
        split: name(tried.split),
        duration_s: figures.ok().map(|found| found.duration_s),
        length_m: figures.ok().map(|found| found.length_m),
        meets_mission_time: figures.is_ok_and(|found| report.meets(found.duration_s)),
        refused: figures.err().map(String::as_str),
    }
}

fn ring(points_m: &[V2]) -> Ring {
    points_m.iter().map(|&point_m| point_m.into()).collect()
}

fn polygon(polygon: &Polygon) -> Ring {
    ring(polygon.vertices_m())
}

fn part(part: &Part) -> Vec<Ring> {
    part.borders_m().map(|border_m| ring(&border_m)).collect()
}
