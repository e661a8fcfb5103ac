//! The sheet of scattered points as an open triangle mesh: the zero set of an implicit moving-least-squares surface
//! (Shen, O'Brien, Shewchuk, SIGGRAPH 2004; Kolluri, ACM TALG 4, 2008), by surface nets (Gibson, MICCAI 1998) in the
//! cells around the points alone.
//!
//! 1. At the corners of cells near points, f is the mean of the heights over the tangent planes of the points around,
//!    those of another side of a fold left out;
//! 2. every cell in which f changes its sign has a vertex, unless it lies off the points;
//! 3. across every edge on which f changes its sign lies a quad, where all four cells round it have a vertex.

use nalgebra::{Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::parallel::{POINTS_PER_TASK, each, each_number};
use crate::numerics::points::Points;

/// Edge of a cell, voxels. What is said of the constants of this room was tried on two kidneys and on bowls of 90°, 120° and
/// 150°. With 0.7 a hole in the mesh of a kidney is too ragged for a map; with 2, wider than [`BESIDE`], no mesh holds together, and all are cut.
/// With 1.4 a bowl of 150° has 7 nodes cut short, not none.
const CELL: f64 = 1.0;
/// Standard deviation of the weights of points, voxels. From 0.6 to 2.2 nothing changes but by chance.
const SIGMA: f64 = 1.1;
/// Radius in which points count, voxels. From 2 to 4.5 nothing changes but by chance.
const REACH: f64 = 3.0;
/// Cosine between normals above which two points are of one side of a fold. From −0.5 to 0.7 nothing changes but by chance:
/// no sheet that was tried folds so tightly.
const AGREE: f64 = 0.3;
/// How far a vertex may lie from its nearest point along the sheet, voxels. With 0.75 meshes are full of gaps, and all are
/// cut; with 2.5 the mesh goes on beyond the rim, and the energy of a bowl of 150° is 1.40, not 1.36.
const BESIDE: f64 = 1.25;
/// How far it may lie from it across the sheet, voxels. From 0.5 to 2 nothing changes but by chance. Between two parts of a
/// sheet that lie one above the other f has a zero too: without a bound that would be a sheet.
const ABOVE: f64 = 1.0;
/// Cells to each side of a point's own in which the surface is looked for: as many as [`BESIDE`] reaches. With 1 or 3 nothing
/// changes; more only take longer.
const CELLS_AROUND: i32 = 2;

/// Points with agreeing unit normals.
#[derive(Clone, Debug, Default)]
pub(super) struct Oriented {
    pub positions: Vec<Point3<f64>>,
    pub normals: Vec<Vector3<f64>>,
}

/// Triangles in space.
#[derive(Clone, Debug, Default)]
pub(super) struct Triangles {
    /// Corners.
    pub positions: Vec<Point3<f64>>,
    /// Corner indices, counter-clockwise seen from where the normals point.
    pub triangles: Vec<[u32; 3]>,
}

/// The place of a cell or a corner, in cells.
type Place = [i32; 3];

/// The mesh of the surface through some points.
///
/// # Errors
/// When it is cancelled.
pub(super) fn surface_through(points: &Oriented, cancel: &dyn Cancel) -> Result<Triangles, Cancelled> {
    let tree = Points::new(&points.positions);
    let surface = Implicit { points, tree: &tree };
    let places = cells_near(points);
    let corners = corners_of(&places);
    let values = each(&corners, POINTS_PER_TASK, |corner| surface.value(position(*corner)), cancel)?;
    let field = Corners { corners, values };
    let vertices = each(&places, POINTS_PER_TASK, |cell| surface.vertex(*cell, &field), cancel)?;
    let (mut cells, mut positions) = (Vec::new(), Vec::new());
    for (cell, vertex) in places.iter().zip(vertices) {
        if let Some(vertex) = vertex {
            cells.push(*cell);
            positions.push(vertex);
        }
    }
    let net = Net { cells: &cells, positions: &positions, field: &field };
    let triangles = each_number(cells.len(), POINTS_PER_TASK, |k| net.triangles(k), cancel)?.concat();
    Ok(Triangles { positions, triangles })
}

/// Where a corner lies.
fn position(corner: Place) -> Point3<f64> {
    Point3::from(corner.map(|x| f64::from(x) * CELL))
}

/// The corner with the smallest coordinates of the cell that a point lies in.
fn cell_of(p: &Point3<f64>) -> Place {
    #[expect(clippy::cast_possible_truncation, reason = "places in a volume are far below 2³¹")]
    let cell = [0, 1, 2].map(|axis| (p[axis] / CELL).floor() as i32);
    cell
}

/// The cells near points, ascending.
fn cells_near(points: &Oriented) -> Vec<Place> {
    let mut own: Vec<Place> = points.positions.iter().map(cell_of).collect();
    own.sort_unstable();
    own.dedup();
    let mut cells = Vec::new();
    for cell in own {
        for x in -CELLS_AROUND..=CELLS_AROUND {
            for y in -CELLS_AROUND..=CELLS_AROUND {
                for z in -CELLS_AROUND..=CELLS_AROUND {
                    cells.push([cell[0] + x, cell[1] + y, cell[2] + z]);
                }
            }
        }
    }
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// The corners of cells, ascending.
fn corners_of(cells: &[Place]) -> Vec<Place> {
    let mut corners = Vec::with_capacity(8 * cells.len());
    for cell in cells {
        for bits in 0..8 {
            corners.push(corner_of(*cell, bits));
        }
    }
    corners.sort_unstable();
    corners.dedup();
    corners
}

/// A corner of a cell: a bit for each axis.
fn corner_of(cell: Place, bits: usize) -> Place {
    [0, 1, 2].map(|axis| cell[axis] + i32::from(bits >> axis & 1 == 1))
}

/// The function whose zero set is the surface.
struct Implicit<'a> {
    points: &'a Oriented,
    tree: &'a Points,
}

impl Implicit<'_> {
    /// Height over the surface; `None` far from all points.
    fn value(&self, at: Point3<f64>) -> Option<f64> {
        let own = self.points.normals[self.tree.nearest(at)?];
        let mut around = self.tree.within(at, REACH);
        // Summed in the order of the points.
        around.sort_unstable();
        let (mut sum, mut total) = (0.0, 0.0);
        for p in around {
            let (normal, way) = (self.points.normals[p], at - self.points.positions[p]);
            if normal.dot(&own) > AGREE {
                let weight = (-way.norm_squared() / (2.0 * SIGMA * SIGMA)).exp();
                sum += weight * normal.dot(&way);
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// The vertex of a cell that the surface crosses near a point.
    fn vertex(&self, cell: Place, field: &Corners) -> Option<Point3<f64>> {
        let mut values = [0.0; 8];
        for (bits, value) in values.iter_mut().enumerate() {
            *value = field.at(corner_of(cell, bits))?;
        }
        let at = mean_crossing(cell, &values)?;
        let nearest = self.tree.nearest(at)?;
        let way = at - self.points.positions[nearest];
        let above = way.dot(&self.points.normals[nearest]);
        let beside = (way.norm_squared() - above * above).max(0.0).sqrt();
        (beside <= BESIDE && above.abs() <= ABOVE).then_some(at)
    }
}

/// The mean of the places where a function crosses 0 on the edges of a cell, of its values at the corners.
fn mean_crossing(cell: Place, values: &[f64; 8]) -> Option<Point3<f64>> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0f64);
    for axis in 0..3 {
        for a in 0..8usize {
            let b = a | 1 << axis;
            if a == b || (values[a] > 0.0) == (values[b] > 0.0) {
                continue;
            }
            let [from, to] = [a, b].map(|bits| position(corner_of(cell, bits)));
            sum += from.coords + (to - from) * (values[a] / (values[a] - values[b]));
            count += 1.0;
        }
    }
    (count > 0.0).then(|| Point3::from(sum / count))
}

/// A function at corners.
struct Corners {
    /// Ascending.
    corners: Vec<Place>,
    values: Vec<Option<f64>>,
}

impl Corners {
    fn at(&self, corner: Place) -> Option<f64> {
        self.values[self.corners.binary_search(&corner).ok()?]
    }
}

/// Cells with a vertex.
struct Net<'a> {
    /// Ascending.
    cells: &'a [Place],
    positions: &'a [Point3<f64>],
    field: &'a Corners,
}

impl Net<'_> {
    /// The triangles across the three edges from the first corner of a cell.
    fn triangles(&self, k: usize) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        for axis in 0..3 {
            triangles.extend(self.quad(self.cells[k], axis).into_iter().flatten());
        }
        triangles
    }

    /// The quad across the edge from a corner one step along an axis, if that is crossed, and its cells have vertices.
    fn quad(&self, at: Place, axis: usize) -> Option<[[u32; 3]; 2]> {
        let mut next = at;
        next[axis] += 1;
        let is_inside = self.field.at(at)? > 0.0;
        if is_inside == (self.field.at(next)? > 0.0) {
            return None;
        }
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut around = [0; 4];
        for (corner, [back_p, back_q]) in around.iter_mut().zip([[1, 1], [0, 1], [0, 0], [1, 0]]) {
            let mut cell = at;
            cell[p] -= back_p;
            cell[q] -= back_q;
            *corner = id(self.cells.binary_search(&cell).ok()?);
        }
        // Counter-clockwise from where the function is positive.
        if is_inside {
            around.reverse();
        }
        let [a, b, c, d] = around;
        let length = |m: u32, n: u32| (self.positions[m as usize] - self.positions[n as usize]).norm_squared();
        Some(if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] })
    }
}
