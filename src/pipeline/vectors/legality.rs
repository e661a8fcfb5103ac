//! Whether thickness vectors cross: looked at while they are laid, and told by the stage `quality`.
//!
//! A *cell* is the hexahedron between a medial quad and its upper or lower quad, filled by the
//! trilinear map. A *wedge* is the prism between the triangles (medial node, surface node, crest
//! point) of two neighbours on the edge of the lattice, filled linearly along the edge. Where
//! the Jacobian of such a map has the wrong sign, the part is turned over and vectors cross.
//! It is looked at in all corners and in the centre: a hexahedron can be turned over in its
//! middle with all corners right. A part that is right there can still be wrong in between.
//! A Jacobian of zero is wrong too: a vector without length, an edge without length.
//!
//! The right sign is decided once for a figure, by the majority over the cells of both sides:
//! (i, j, vector) is a right-handed frame on one side if and only if it is left-handed on the
//! other. A side that was swapped as a whole is therefore found.

use nalgebra::{Point3, Vector3};

use crate::model::{EdgeStep, LatticePlace, Quad, Shell, Side};

/// Kind of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Between a medial quad and the quad of a side.
    Cell,
    /// Between edge, nodes of a side and crest.
    Wedge,
}

/// A part that is turned over somewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Illegal {
    /// What it is.
    pub part: Part,
    /// Its side and first node: of a cell the one with the lowest i and j, of a wedge the one that
    /// comes first in the ring.
    pub place: LatticePlace,
    /// Bad corners, of 8 or 6.
    pub corners: usize,
    /// Whether the centre is bad.
    pub is_centre_bad: bool,
}

/// What was found in a figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Legality {
    /// Sign of the Jacobian of (i, j, vector) on the upper side; the lower side has the other.
    pub orientation: f64,
    /// Places looked at: corners and centres of cells and wedges.
    pub checked: usize,
    /// Corners of cells among them.
    pub corners: usize,
    /// Bad corners of cells.
    pub folds: usize,
    /// Cells with a bad centre.
    pub folded_centres: usize,
    /// Wedges with a bad corner or centre.
    pub folded_wedges: usize,
    /// The bad parts: upper and lower cells row-major, then wedges in ring order.
    pub parts: Vec<Illegal>,
}

impl Legality {
    /// Whether nothing is turned over.
    #[must_use]
    pub fn is_legal(&self) -> bool {
        self.parts.is_empty()
    }
}

/// Looks at every cell and wedge of a figure.
#[must_use]
pub fn legality(shell: Shell<'_>) -> Legality {
    let mut found = Legality { orientation: orientation(shell), ..Legality::default() };
    for side in Side::BOTH {
        for quad in shell.quads() {
            let jacobians = cell_jacobians(shell, side, quad);
            found.checked += jacobians.len();
            found.corners += jacobians.len() - 1;
            let expected = expected(found.orientation, side);
            let place = LatticePlace { side, i: quad.i, j: quad.j };
            if let Some(cell) = judged(&jacobians.map(Some), expected, Part::Cell, place) {
                found.folds += cell.corners;
                found.folded_centres += usize::from(cell.is_centre_bad);
                found.parts.push(cell);
            }
        }
    }
    for side in Side::BOTH {
        for step in shell.edge_steps() {
            let jacobians = wedge_jacobians(shell, side, step);
            found.checked += jacobians.iter().flatten().count();
            let (i, j) = (step.nodes[0] / shell.size.cols, step.nodes[0] % shell.size.cols);
            let (expected, place) = (expected(found.orientation, side), LatticePlace { side, i, j });
            if let Some(wedge) = judged(&jacobians, expected, Part::Wedge, place) {
                found.folded_wedges += 1;
                found.parts.push(wedge);
            }
        }
    }
    found
}

/// The sign that most corners and centres of the upper side have and most of the lower side have
/// not. A tie (one side is a copy of the other) goes to the upper side, so that the lower one is
/// named.
#[must_use]
pub fn orientation(shell: Shell<'_>) -> f64 {
    let (upper, lower) = (positive_less_negative(shell, Side::Upper), positive_less_negative(shell, Side::Lower));
    let decided = if upper == lower { upper } else { upper - lower };
    if decided >= 0 { 1.0 } else { -1.0 }
}

/// How many more Jacobians of the cells of a side are positive than negative.
fn positive_less_negative(shell: Shell<'_>, side: Side) -> i64 {
    let mut votes = 0;
    for quad in shell.quads() {
        for jacobian in cell_jacobians(shell, side, quad) {
            votes += i64::from(jacobian > 0.0) - i64::from(jacobian < 0.0);
        }
    }
    votes
}

fn expected(orientation: f64, side: Side) -> f64 {
    match side {
        Side::Upper => orientation,
        Side::Lower => -orientation,
    }
}

/// The last Jacobian is that of the centre.
fn judged(jacobians: &[Option<f64>], expected: f64, part: Part, place: LatticePlace) -> Option<Illegal> {
    let (centre, corners) = jacobians.split_last()?;
    let corners = corners.iter().filter(|corner| is_bad(**corner, expected)).count();
    let found = Illegal { part, place, corners, is_centre_bad: is_bad(*centre, expected) };
    (found.corners > 0 || found.is_centre_bad).then_some(found)
}

/// Whether a Jacobian has not the expected sign. What is no number is bad; a place that is not looked at is not.
fn is_bad(jacobian: Option<f64>, expected: f64) -> bool {
    jacobian.is_some_and(|j| j.is_nan() || j * expected <= 0.0)
}

/// Jacobians of the trilinear map of a cell: four corners on the medial quad, four on the
/// surface, the centre.
fn cell_jacobians(shell: Shell<'_>, side: Side, quad: Quad) -> [f64; 9] {
    cell_edges([quad.corners(shell.medial), quad.corners(shell.side(side))]).map(determinant)
}

/// The derivatives along i, along j and across, in the same nine places, of the trilinear map of the
/// cell between two quads, the medial one first.
#[must_use]
pub(crate) fn cell_edges(layers: [[Point3<f64>; 4]; 2]) -> [[Vector3<f64>; 3]; 9] {
    let mut edges = [[Vector3::zeros(); 3]; 9];
    let mut middle = [Vector3::zeros(); 3];
    for (slot, edges) in edges.iter_mut().take(8).enumerate() {
        let (layer, k) = (&layers[slot / 4], slot % 4);
        let along_i = layer[2 | (k & 1)] - layer[k & 1];
        let along_j = layer[(k & 2) | 1] - layer[k & 2];
        *edges = [along_i, along_j, layers[1][k] - layers[0][k]];
        // In the centre the derivatives are the means of the edges of a direction.
        middle = [middle[0] + edges[0], middle[1] + edges[1], middle[2] + edges[2]];
    }
    edges[8] = middle.map(|sum| sum / 8.0);
    edges
}

/// One end of a wedge.
struct End {
    medial: Point3<f64>,
    crest: Point3<f64>,
    skin: Point3<f64>,
    /// Whether crest and surface node are one.
    is_merged: bool,
}

impl End {
    fn of(shell: Shell<'_>, side: Side, place: usize, node: usize) -> Self {
        let (medial, crest, skin) = (shell.medial[node], shell.crest[place], shell.side(side)[node]);
        Self { medial, crest, skin, is_merged: shell.is_merged(side, place, node) }
    }
}

/// Jacobians of a wedge's map: three corners at each end, the centre. Signs agree with the cells
/// of the side. At an end where the crest has merged with the surface node the triangle has no
/// area and the corners have no sign; a wedge merged at both ends has no volume. That is a sharp
/// rim, nothing is turned over there, and nothing is looked at (`None`).
fn wedge_jacobians(shell: Shell<'_>, side: Side, step: EdgeStep) -> [Option<f64>; 7] {
    let here = End::of(shell, side, step.here, step.nodes[0]);
    let next = End::of(shell, side, step.next, step.nodes[1]);
    let along = [next.medial - here.medial, next.crest - here.crest, next.skin - here.skin];
    let mut jacobians = [None; 7];
    let (mut crest, mut skin) = (Vector3::zeros(), Vector3::zeros());
    for (end, corners) in [&here, &next].into_iter().zip(jacobians.chunks_mut(3)) {
        let sides = [end.crest - end.medial, end.skin - end.medial];
        (crest, skin) = (crest + sides[0], skin + sides[1]);
        if !end.is_merged {
            for (corner, along) in corners.iter_mut().zip(along) {
                *corner = Some(determinant([sides[0], sides[1], along]));
            }
        }
    }
    if !(here.is_merged && next.is_merged) {
        let along = (along[0] + along[1] + along[2]) / 3.0;
        jacobians[6] = Some(determinant([crest / 2.0, skin / 2.0, along]));
    }
    jacobians
}

/// Determinant of three columns.
#[must_use]
pub fn determinant([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    a.cross(&b).dot(&c)
}
