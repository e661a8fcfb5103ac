//! Isosurface by naive surface nets (Gibson, *Constrained elastic surface nets*, MICCAI 1998):
//! a vertex in every cell that the surface crosses, a quad across every crossed grid edge.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};

/// A closed mesh in voxel coordinates; triangles are counter-clockwise seen from where the field
/// is not positive.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Corners.
    pub positions: Vec<Point3<f64>>,
    /// Corner indices.
    pub triangles: Vec<[u32; 3]>,
}

/// The surface where the field passes through 0. The field must not be positive on the edge of
/// the grid, else the mesh is open there.
///
/// # Errors
/// When it is cancelled.
pub fn zero_surface(field: &Grid<f32>, cancel: &dyn Cancel) -> Result<Mesh, Cancelled> {
    let dims = field.dims();
    if dims.iter().any(|&d| d < 2) {
        return Ok(Mesh::default());
    }
    let layer = |k: usize| cancel.check().map(|()| Layer::of(field, k));
    let layers: Vec<Layer> = (0..dims[2] - 1).into_par_iter().map(layer).collect::<Result<_, _>>()?;
    let mut first = vec![0];
    for layer in &layers {
        first.push(first[first.len() - 1] + super::field::id(layer.cells.len()));
    }
    let triangles = |k: usize| {
        let vertex = |[i, j, layer]: [usize; 3]| first[layer] + layers[layer].number(i + dims[0] * j);
        cancel.check()?;
        let mut triangles = Vec::new();
        // A crossed edge has a crossed cell before it.
        for &cell in &layers[k].cells {
            let [i, j] = [cell as usize % dims[0], cell as usize / dims[0]];
            if i > 0 && j > 0 {
                (0..3).for_each(|axis| quad(field, vertex, [i, j, k], axis, &mut triangles));
            }
        }
        Ok(triangles)
    };
    let triangles = (1..dims[2] - 1).into_par_iter().map(triangles);
    let triangles = triangles.collect::<Result<Vec<Vec<_>>, Cancelled>>()?.concat();
    Ok(Mesh { positions: layers.into_iter().flat_map(|layer| layer.vertices).collect(), triangles })
}

/// The crossed cells between two planes of the grid.
struct Layer {
    /// Places of the cells in their plane, ascending.
    cells: Vec<u32>,
    /// One vertex for each.
    vertices: Vec<Point3<f64>>,
}

impl Layer {
    fn of(field: &Grid<f32>, k: usize) -> Self {
        let [nx, ny, _] = field.dims();
        let row = |j: usize, k: usize| &field.as_slice()[nx * (j + ny * k)..nx * (j + ny * k + 1)];
        let mut layer = Self { cells: Vec::new(), vertices: Vec::new() };
        for j in 0..ny - 1 {
            let rows = [row(j, k), row(j + 1, k), row(j, k + 1), row(j + 1, k + 1)];
            let inside = |i: usize| rows.iter().filter(|row| row[i] > 0.0).count();
            let mut here = inside(0);
            for i in 0..nx - 1 {
                let next = inside(i + 1);
                if (1..8).contains(&(here + next)) {
                    layer.cells.push(super::field::id(i + nx * j));
                    layer.vertices.push(cell_vertex(field, [i, j, k]));
                }
                here = next;
            }
        }
        layer
    }

    /// The number of a crossed cell.
    fn number(&self, cell: usize) -> u32 {
        super::field::id(self.cells.partition_point(|&c| (c as usize) < cell))
    }
}

/// Mean of the crossings on the twelve edges of a cell.
fn cell_vertex(field: &Grid<f32>, cell: [usize; 3]) -> Point3<f64> {
    let corner =
        |bits: usize| f64::from(field[[cell[0] + (bits & 1), cell[1] + (bits >> 1 & 1), cell[2] + (bits >> 2 & 1)]]);
    let values: [f64; 8] = std::array::from_fn(corner);
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for axis in 0..3 {
        for a in (0..8).filter(|a| a >> axis & 1 == 0) {
            let b = a | 1 << axis;
            let (fa, fb) = (values[a], values[b]);
            if (fa > 0.0) != (fb > 0.0) {
                let mut at = Vector3::new((a & 1) as f64, (a >> 1 & 1) as f64, (a >> 2 & 1) as f64);
                at[axis] = fa / (fa - fb);
                sum += at;
                count += 1.0;
            }
        }
    }
    Point3::from(Vector3::new(cell[0] as f64, cell[1] as f64, cell[2] as f64) + sum / count)
}

/// The quad across the edge from `at` one step along `axis`.
fn quad(
    field: &Grid<f32>,
    vertex: impl Fn([usize; 3]) -> u32,
    at: [usize; 3],
    axis: usize,
    triangles: &mut Vec<[u32; 3]>,
) {
    let mut next = at;
    next[axis] += 1;
    let (inside, inside_next) = (field[at] > 0.0, field[next] > 0.0);
    if inside == inside_next {
        return;
    }
    let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |dp: usize, dq: usize| {
        let mut cell = at;
        cell[p] -= dp;
        cell[q] -= dq;
        vertex(cell)
    };
    let mut around = [corner(1, 1), corner(0, 1), corner(0, 0), corner(1, 0)];
    if !inside {
        around.reverse();
    }
    triangles.push([around[0], around[1], around[2]]);
    triangles.push([around[0], around[2], around[3]]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    #[test]
    fn a_ball_gets_a_closed_outward_mesh_of_its_volume() {
        let radius = 7.3f32;
        let mut field = Grid::filled([21, 21, 21], 0.0f32);
        for o in 0..field.as_slice().len() {
            let [i, j, k] = field.index(o).map(|x| x as f32 - 10.0);
            field.as_mut_slice()[o] = radius - (i * i + j * j + k * k).sqrt();
        }
        let mesh = zero_surface(&field, &Never).expect("not stopped");
        let mut edges = std::collections::BTreeMap::new();
        let mut volume = 0.0;
        for t in &mesh.triangles {
            let p = t.map(|v| mesh.positions[v as usize].coords - Vector3::new(10.0, 10.0, 10.0));
            volume += p[0].dot(&p[1].cross(&p[2])) / 6.0;
            for e in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *edges.entry(e).or_insert(0) += 1;
            }
        }
        assert!(edges.iter().all(|((a, b), n)| edges.get(&(*b, *a)) == Some(n)), "closed");
        let ball = 4.0 / 3.0 * std::f64::consts::PI * f64::from(radius).powi(3);
        // Vertices are means of crossings and facets are flat: both lie inside of a ball.
        assert!((volume / ball - 1.0).abs() < 0.03, "volume {volume} of {ball}");
    }
}
