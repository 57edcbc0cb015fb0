//! A binary tree over the legs of a track: each node stands for a run of consecutive stadiums and bounds
//! their union from inside and from outside by a stadium around the run's chord.

use super::super::V2;
use super::Stadium;

/// A run of consecutive stadiums.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Lies within the union of the run; radius zero or less where nothing is guaranteed.
    pub(super) inner: Stadium,
    /// Radius around the same chord that holds the whole union.
    pub(super) outer_radius_m: f64,
    /// Stadiums in the run.
    leaves: usize,
}

impl Node {
    /// How far apart the two bounds are, metres; zero for a single stadium.
    pub(super) fn gap_m(&self) -> f64 {
        self.outer_radius_m - self.inner.radius_m
    }
}

/// The tree, its nodes in preorder: a node is followed by its first half's subtree, then by the second's.
pub(super) struct Chain {
    nodes: Vec<Node>,
}

impl Chain {
    /// Builds the tree over stadiums in the order flown. Any order is right; a connected one is fast.
    pub(super) fn new(stadiums: &[Stadium]) -> Self {
        let mut nodes = Vec::with_capacity(2 * stadiums.len());
        if !stadiums.is_empty() {
            push_subtree(stadiums, &mut nodes);
        }
        Self { nodes }
    }

    pub(super) fn node(&self, index: usize) -> &Node {
        &self.nodes[index]
    }

    /// The node of the whole track, if there is one.
    pub(super) fn root(&self) -> Option<usize> {
        (!self.nodes.is_empty()).then_some(0)
    }

    /// The two halves of a node; none of a single stadium.
    pub(super) fn halves(&self, index: usize) -> Option<[usize; 2]> {
        let leaves = self.nodes[index].leaves;
        // A subtree over k leaves has 2 k - 1 nodes.
        (leaves > 1).then(|| [index + 1, index + 2 * (leaves / 2)])
    }
}

fn push_subtree(run: &[Stadium], nodes: &mut Vec<Node>) {
    nodes.push(bound(run));
    if run.len() > 1 {
        let (first, second) = run.split_at(run.len() / 2);
        push_subtree(first, nodes);
        push_subtree(second, nodes);
    }
}

/// Bounds of a run. Inside: see [`super::stadiums_from_track`]; the argument needs a connected run.
/// Outside: a distance from a segment is convex along a leg, so its ends tell how far the leg strays.
fn bound(run: &[Stadium]) -> Node {
    let (first, last) = (run[0], run[run.len() - 1]);
    if let [only] = *run {
        return Node { inner: only, outer_radius_m: only.radius_m, leaves: 1 };
    }
    let chord = Stadium { a: first.a, b: last.b, radius_m: 0.0 };
    let axis = chord.b - chord.a;
    let length_m = axis.norm();
    let across =
        |p: V2| if length_m > 0.0 { super::super::cross(axis, p - chord.a).abs() / length_m } else { 0.0 };
    let (mut least_m, mut outer_radius_m, mut across_m) = (first.radius_m, 0.0_f64, 0.0_f64);
    let mut connected = true;
    let mut previous = first.a;
    for s in run {
        connected &= s.a == previous;
        previous = s.b;
        least_m = least_m.min(s.radius_m);
        across_m = across_m.max(across(s.b));
        let strayed_m = chord.axis_distance_m(s.a).max(chord.axis_distance_m(s.b));
        outer_radius_m = outer_radius_m.max(s.radius_m + strayed_m);
    }
    let inner_radius_m = if connected { least_m - across_m } else { f64::NEG_INFINITY };
    Node { inner: Stadium { radius_m: inner_radius_m, ..chord }, outer_radius_m, leaves: run.len() }
}
