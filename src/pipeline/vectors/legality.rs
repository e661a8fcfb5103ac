//! Whether thickness vectors cross: looked at while they are laid, and told by the stage `quality`.
//!
//! A *cell* is the hexahedron between a medial quad and its upper or lower quad, filled by the
//! trilinear map. A *wedge* lies between two neighbours on the edge of the lattice, from their surface nodes to their
//! crest points. It is made of prisms between triangles (medial node, two neighbouring points of the half arc), filled
//! linearly along the edge. Where
//! the Jacobian of such a map has the wrong sign, the part is turned over and vectors cross.
//! It is looked at in all corners and in the centre: a hexahedron can be turned over in its
//! middle with all corners right. A part that is right there can still be wrong in between.
//! A Jacobian of zero is wrong too: a vector without length, an edge without length.
//!
//! The right sign is decided once for a figure, by the majority over the cells of both sides:
//! (i, j, vector) is a right-handed frame on one side if and only if it is left-handed on the
//! other. A side that was swapped as a whole is therefore found.

use nalgebra::{Point3, Vector3};

use crate::model::{EdgeStep, FLANK, LatticePlace, Quad, Shell, Side};

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
    /// Bad corners, of 8 or of 6 of each prism.
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
            found.checked += jacobians.iter().flatten().flatten().count();
            if let Some(wedge) = judged_wedge(shell, side, step, &jacobians, expected(found.orientation, side)) {
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

/// A wedge with a bad prism.
fn judged_wedge(
    shell: Shell<'_>,
    side: Side,
    step: EdgeStep,
    prisms: &[[Option<f64>; 7]],
    expected: f64,
) -> Option<Illegal> {
    let (i, j) = (step.nodes[0] / shell.size.cols, step.nodes[0] % shell.size.cols);
    let place = LatticePlace { side, i, j };
    let mut wedge = None;
    for prism in prisms {
        if let Some(found) = judged(prism, expected, Part::Wedge, place) {
            let bad = wedge.get_or_insert(Illegal { corners: 0, is_centre_bad: false, ..found });
            bad.corners += found.corners;
            bad.is_centre_bad |= found.is_centre_bad;
        }
    }
    wedge
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

/// Jacobians of the maps of a wedge's prisms, from the surface node on.
fn wedge_jacobians(shell: Shell<'_>, side: Side, step: EdgeStep) -> [[Option<f64>; 7]; FLANK + 1] {
    let [here, next] = step.nodes;
    let (here_arc, next_arc) = (shell.half_arc(side, step.here, here), shell.half_arc(side, step.next, next));
    let mut all = [[None; 7]; FLANK + 1];
    for (k, prism) in all.iter_mut().enumerate() {
        let here = End::of(shell, here, [here_arc[k], here_arc[k + 1]]);
        let next = End::of(shell, next, [next_arc[k], next_arc[k + 1]]);
        *prism = prism_jacobians(&here, &next);
    }
    all
}

/// One end of a prism.
struct End {
    medial: Point3<f64>,
    /// The point of the arc nearer to the crest.
    outer: Point3<f64>,
    /// The one nearer to the surface node.
    inner: Point3<f64>,
    /// Whether they are one.
    is_merged: bool,
}

impl End {
    fn of(shell: Shell<'_>, node: usize, [inner, outer]: [Point3<f64>; 2]) -> Self {
        Self { medial: shell.medial[node], outer, inner, is_merged: shell.are_merged(node, inner, outer) }
    }
}

/// Jacobians of a prism's map: three corners at each end, the centre. Signs agree with the cells
/// of the side. At an end where the two points of the arc have merged the triangle has no
/// area and the corners have no sign; a prism merged at both ends has no volume. That is a sharp
/// rim, nothing is turned over there, and nothing is looked at (`None`).
fn prism_jacobians(here: &End, next: &End) -> [Option<f64>; 7] {
    let along = [next.medial - here.medial, next.outer - here.outer, next.inner - here.inner];
    let mut jacobians = [None; 7];
    let (mut outer, mut inner) = (Vector3::zeros(), Vector3::zeros());
    for (end, corners) in [here, next].into_iter().zip(jacobians.chunks_mut(3)) {
        let sides = [end.outer - end.medial, end.inner - end.medial];
        (outer, inner) = (outer + sides[0], inner + sides[1]);
        if !end.is_merged {
            for (corner, along) in corners.iter_mut().zip(along) {
                *corner = Some(determinant([sides[0], sides[1], along]));
            }
        }
    }
    if !(here.is_merged && next.is_merged) {
        let along = (along[0] + along[1] + along[2]) / 3.0;
        jacobians[6] = Some(determinant([outer / 2.0, inner / 2.0, along]));
    }
    jacobians
}

/// Determinant of three columns.
#[must_use]
pub fn determinant([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    a.cross(&b).dot(&c)
}
