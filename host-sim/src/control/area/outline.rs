//! From outlines in degrees to a region in metres.

use super::border::{Border, Use};
use super::fault::Fault;
use super::{Area, check_rings, check_vertices};
use crate::geometry::V2;
use crate::geometry::frame::LocalFrame;
use crate::geometry::polygon::Polygon;
use crate::geometry::region::Region;

/// Polygons have something in common when that is more of the smaller one than this; less is rounding
/// along a common border.
const COMMON_SHARE: f64 = 1e-6;

/// Edges of different polygons that come near each other; areas of thousands of vertices have some thousands.
const MAX_CROSSINGS: usize = 200_000;

/// All that a file says of its area.
pub(super) struct Outlines {
    pub(super) areas: Vec<Outline>,
    /// No-fly zones that need not lie in the area.
    pub(super) zones: Vec<Border>,
    pub(super) left_out: Vec<String>,
}

/// A polygon with holes, which are no-fly zones.
pub(super) struct Outline {
    pub(super) outer: Border,
    pub(super) holes: Vec<Border>,
}

/// An outline in the frame, still with its places in the file.
struct Part {
    place: String,
    outer: Polygon,
    holes: Vec<(String, Polygon)>,
}

impl Outlines {
    /// Projects, checks and joins everything.
    pub(super) fn into_area(mut self) -> Result<Area, Fault> {
        let borders = || self.areas.iter().flat_map(Outline::borders).chain(&self.zones);
        check_rings(borders().count())?;
        check_vertices(borders().map(Border::vertices).sum())?;
        self.turn_together();
        let frame = self.frame();
        let parts: Vec<Part> = self.areas.iter().map(|it| it.part(&frame)).collect::<Result<_, _>>()?;
        let zones = self.zones.iter().map(|zone| zone.polygon(&frame, Use::Zone));
        let mut no_fly: Vec<Polygon> = zones.collect::<Result<_, _>>()?;
        check_crossings(parts.iter().flat_map(Part::polygons).chain(&no_fly))?;
        refuse_strays(&parts)?;
        refuse_islands(&parts)?;
        let mut outers = Vec::new();
        for Part { outer, holes, .. } in parts {
            outers.push(outer);
            no_fly.extend(holes.into_iter().map(|(_, hole)| hole));
        }
        let region = Region::new(outers, no_fly).map_err(Fault::Region)?;
        Ok(Area { region, frame: Some(frame), left_out: self.left_out })
    }

    /// Counts all longitudes from the same side of the date line. The ends of a cut along it then are equal
    /// to the last bit, and parts cut there meet without a gap.
    fn turn_together(&mut self) {
        let start_deg = self.areas.first().map_or(0.0, |it| it.outer.positions()[0][0]);
        for Outline { outer, holes } in &mut self.areas {
            outer.turn_near(start_deg);
            holes.iter_mut().for_each(|hole| hole.turn_near(start_deg));
        }
    }

    /// The frame at the middle of the bounding box of all outer borders.
    fn frame(&self) -> LocalFrame {
        let positions = || self.areas.iter().flat_map(|it| it.outer.positions());
        let middle = |axis: usize| {
            let along = || positions().map(|it| it[axis]);
            along().fold(f64::INFINITY, f64::min).midpoint(along().fold(f64::NEG_INFINITY, f64::max))
        };
        LocalFrame::new((middle(0) + 180.0).rem_euclid(360.0) - 180.0, middle(1))
    }
}

impl Outline {
    fn borders(&self) -> impl Iterator<Item = &Border> {
        std::iter::once(&self.outer).chain(&self.holes)
    }

    fn part(&self, frame: &LocalFrame) -> Result<Part, Fault> {
        let hole = |it: &Border| Ok((it.place().to_owned(), it.polygon(frame, Use::Zone)?));
        Ok(Part {
            place: self.outer.place().to_owned(),
            outer: self.outer.polygon(frame, Use::Area)?,
            holes: self.holes.iter().map(hole).collect::<Result<_, _>>()?,
        })
    }
}

impl Part {
    fn polygons(&self) -> impl Iterator<Item = &Polygon> {
        std::iter::once(&self.outer).chain(self.holes.iter().map(|(_, hole)| hole))
    }
}

/// Refuses borders that may cross each other so often that computing with them would not end: counts
/// edges of different polygons whose upright boxes overlap.
fn check_crossings<'a>(polygons: impl Iterator<Item = &'a Polygon>) -> Result<(), Fault> {
    let edges = |(number, polygon): (usize, &'a Polygon)| {
        polygon.edges_m().map(move |(a, b)| (number, a.inf(&b), a.sup(&b)))
    };
    let mut boxes: Vec<(usize, V2, V2)> = polygons.enumerate().flat_map(edges).collect();
    boxes.sort_by(|a, b| a.1.x.total_cmp(&b.1.x));
    let mut crossings = 0;
    for (k, (number, low, high)) in boxes.iter().enumerate() {
        let eastwards = boxes[k + 1..].iter().take_while(|it| it.1.x <= high.x);
        let overlap = |it: &&(usize, V2, V2)| it.0 != *number && it.1.y <= high.y && low.y <= it.2.y;
        crossings += eastwards.filter(overlap).count();
    }
    if crossings <= MAX_CROSSINGS {
        return Ok(());
    }
    let found = format!("borders that may cross each other {crossings} times");
    Err(Fault::file(found, format!("at most {MAX_CROSSINGS}: simplify them")))
}

/// Refuses a hole that cuts nothing out of its polygon.
fn refuse_strays(parts: &[Part]) -> Result<(), Fault> {
    for Part { outer, holes, .. } in parts {
        if let Some((place, _)) = holes.iter().find(|(_, hole)| !have_common(outer, hole)) {
            return Err(Fault::content(place, "a hole outside of its polygon", "it to cut something out"));
        }
    }
    Ok(())
}

/// Refuses a polygon in another one's hole: nothing may fly there, and the way there is barred.
fn refuse_islands(parts: &[Part]) -> Result<(), Fault> {
    for (i, Part { place, outer, .. }) in parts.iter().enumerate() {
        let others = parts.iter().enumerate().filter(|(j, _)| *j != i);
        for (hole_place, hole) in others.flat_map(|(_, other)| &other.holes) {
            if have_common(outer, hole) {
                let found = format!("an area that reaches into {hole_place}");
                return Err(Fault::content(place, found, "it outside of holes: no drone may enter them"));
            }
        }
    }
    Ok(())
}

/// Whether two polygons have more in common than a border.
fn have_common(a: &Polygon, b: &Polygon) -> bool {
    let ([a_min, a_max], [b_min, b_max]) = (a.bbox_m(), b.bbox_m());
    if a_min.x >= b_max.x || b_min.x >= a_max.x || a_min.y >= b_max.y || b_min.y >= a_max.y {
        return false;
    }
    let rest_m2 = Region::new(vec![a.clone()], vec![b.clone()]).map_or(0.0, |rest| rest.area_m2());
    a.area_m2() - rest_m2 > COMMON_SHARE * a.area_m2().min(b.area_m2())
}
