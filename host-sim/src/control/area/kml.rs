//! KML 2.3 (OGC 12-007r2): longitude before latitude, WGS84.

use roxmltree::{Document, Node, ParsingOptions};

use super::border::Ring;
use super::check_rings;
use super::fault::{Fault, listed, quoted};
use super::outline::{Outline, Outlines};

/// Elements, texts and comments; far more than an area with its styles has.
const MAX_NODES: u32 = 500_000;

/// Elements that show something on a map and are no area.
const NO_AREAS: [&str; 7] =
    ["Point", "LineString", "Model", "Track", "NetworkLink", "GroundOverlay", "PhotoOverlay"];

/// All polygons of the one placemark that has any, wherever it lies in folders and multi-geometries.
///
/// Elements count that are in the root's namespace, so files of any version and without a namespace read
/// alike. Document type definitions are refused, and with them all entities but the five of XML.
pub(super) fn read(text: &str) -> Result<Outlines, Fault> {
    let options = ParsingOptions { nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|e| {
        let at = e.pos();
        Fault::content(format!("line {}, column {}", at.row, at.col), e.to_string(), "KML")
    })?;
    let kml = Kml::new(&document, text)?;
    let polygons: Vec<Node> = kml.below(document.root_element(), "Polygon").collect();
    check_rings(polygons.len())?;
    let mut placemarks: Vec<Option<Node>> = Vec::new();
    for polygon in &polygons {
        let placemark = polygon.ancestors().find(|it| kml.is(*it, "Placemark"));
        if !placemarks.contains(&placemark) {
            placemarks.push(placemark);
        }
    }
    let [placemark] = placemarks[..] else {
        let labels: Vec<String> = placemarks.iter().map(|it| kml.label(*it)).collect();
        let found = match labels.len() {
            0 => "no polygon".to_owned(),
            n => format!("{n} placemarks with polygons: {}", listed(&labels)),
        };
        return Err(Fault::file(found, "exactly one placemark with a Polygon, or with several"));
    };
    let label = kml.label(placemark);
    let mut areas = Vec::new();
    for (i, polygon) in polygons.iter().enumerate() {
        let place = if polygons.len() == 1 { label.clone() } else { format!("{label}, polygon {}", i + 1) };
        areas.push(kml.outline(*polygon, &place)?);
    }
    Ok(Outlines { areas, zones: Vec::new(), left_out: kml.left_out(document.root_element()) })
}

/// A document and what is needed to find the way in it.
struct Kml<'a> {
    namespace: Option<&'a str>,
    /// Where lines end, in bytes.
    line_ends: Vec<usize>,
}

impl<'a> Kml<'a> {
    fn new(document: &'a Document<'a>, text: &str) -> Result<Self, Fault> {
        let root = document.root_element();
        let line_ends = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i).collect();
        let kml = Self { namespace: root.tag_name().namespace(), line_ends };
        if root.tag_name().name() != "kml" {
            let found = format!("the element {}", quoted(root.tag_name().name()));
            return Err(Fault::content(kml.line(root), found, "\"kml\""));
        }
        Ok(kml)
    }

    fn line(&self, node: Node) -> String {
        format!("line {}", 1 + self.line_ends.partition_point(|&end| end < node.range().start))
    }

    fn is(&self, node: Node, name: &str) -> bool {
        node.is_element() && node.tag_name().name() == name && node.tag_name().namespace() == self.namespace
    }

    fn children<'n>(&'n self, node: Node<'n, 'n>, name: &'n str) -> impl Iterator<Item = Node<'n, 'n>> + 'n {
        node.children().filter(move |it| self.is(*it, name))
    }

    fn below<'n>(&'n self, node: Node<'n, 'n>, name: &'n str) -> impl Iterator<Item = Node<'n, 'n>> + 'n {
        node.descendants().filter(move |it| self.is(*it, name))
    }

    fn label(&self, placemark: Option<Node>) -> String {
        let Some(placemark) = placemark else { return "the polygons outside of any placemark".into() };
        let name = self.children(placemark, "name").find_map(|name| name.text().map(str::trim));
        let name = name.map(|name| format!("{} ", quoted(name))).unwrap_or_default();
        format!("placemark {name}({})", self.line(placemark))
    }

    fn left_out(&self, root: Node) -> Vec<String> {
        let count = |name: &str| match self.below(root, name).count() {
            0 => None,
            n => Some(format!("{n} of {name}")),
        };
        NO_AREAS.into_iter().filter_map(count).collect()
    }

    fn outline(&self, polygon: Node, place: &str) -> Result<Outline, Fault> {
        let outer: Vec<Node> = self.rings(polygon, "outerBoundaryIs").collect();
        let [outer] = outer[..] else {
            let place = format!("{place}, {}", self.line(polygon));
            let found = format!("{} outer boundaries", outer.len());
            return Err(Fault::content(place, found, "one outerBoundaryIs with one LinearRing"));
        };
        let mut holes = Vec::new();
        for (i, hole) in self.rings(polygon, "innerBoundaryIs").enumerate() {
            check_rings(i)?;
            holes.push(self.ring(hole, &format!("{place}, hole {}", i + 1))?.into());
        }
        Ok(Outline { outer: self.ring(outer, place)?.into(), holes })
    }

    fn rings<'n>(&'n self, polygon: Node<'n, 'n>, name: &'n str) -> impl Iterator<Item = Node<'n, 'n>> + 'n {
        self.children(polygon, name).flat_map(|boundary| self.children(boundary, "LinearRing"))
    }

    fn ring(&self, ring: Node, place: &str) -> Result<Ring, Fault> {
        let place = format!("{place}, {}", self.line(ring));
        // A comment may split the text.
        let texts = self.children(ring, "coordinates").flat_map(|it| it.descendants());
        let text: String = texts.filter(Node::is_text).filter_map(|it| it.text()).collect();
        let mut lon_lat_deg = Vec::new();
        for (i, tuple) in text.split_whitespace().enumerate() {
            let fault = || {
                let expected = "longitude,latitude or longitude,latitude,altitude, and no space between them";
                Fault::content(format!("{place}, vertex {}", i + 1), quoted(tuple), expected)
            };
            let numbers: Result<Vec<f64>, _> = tuple.split(',').take(4).map(str::parse::<f64>).collect();
            match numbers.as_deref() {
                Ok([lon_deg, lat_deg] | [lon_deg, lat_deg, _]) => lon_lat_deg.push([*lon_deg, *lat_deg]),
                _ => return Err(fault()),
            }
        }
        Ring::closed(place, lon_lat_deg)
    }
}
