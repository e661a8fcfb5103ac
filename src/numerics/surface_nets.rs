//! Isosurface by naive surface nets (Gibson, *Constrained elastic surface nets*, MICCAI 1998):
//! a vertex in every cell that the surface crosses, a quad across every crossed grid edge.

use nalgebra::{Point3, Vector3};

use crate::space::Grid;

use super::parallel::each_number;
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
    let layers = each_number(dims[2] - 1, 1, |k| Layer::of(field, k), cancel)?;
    let mut first = vec![0];
    for layer in &layers {
        first.push(first[first.len() - 1] + super::field::id(layer.cells.len()));
    }
    let net = Net { field, layers, first };
    let triangles = each_number(dims[2] - 2, 1, |k| net.triangles(k + 1), cancel)?.concat();
    Ok(Mesh { positions: net.layers.into_iter().flat_map(|layer| layer.vertices).collect(), triangles })
}

/// The vertices of a surface, and how to find them.
struct Net<'a> {
    field: &'a Grid<f32>,
    layers: Vec<Layer>,
    /// Number of the first vertex of each layer.
    first: Vec<u32>,
}

impl Net<'_> {
    /// Triangles across the edges from the points of a plane of the grid.
    fn triangles(&self, k: usize) -> Vec<[u32; 3]> {
        let nx = self.field.dims()[0];
        let mut triangles = Vec::new();
        // A crossed edge has a crossed cell before it.
        for &cell in &self.layers[k].cells {
            let [i, j] = [cell as usize % nx, cell as usize / nx];
            if i > 0 && j > 0 {
                for axis in 0..3 {
                    triangles.extend(self.quad([i, j, k], axis).into_iter().flatten());
                }
            }
        }
        triangles
    }

    /// The quad across the edge from `at` one step along `axis`, if that is crossed.
    fn quad(&self, at: [usize; 3], axis: usize) -> Option<[[u32; 3]; 2]> {
        let mut next = at;
        next[axis] += 1;
        let (inside, inside_next) = (self.field[at] > 0.0, self.field[next] > 0.0);
        if inside == inside_next {
            return None;
        }
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut around = [[1, 1], [0, 1], [0, 0], [1, 0]].map(|[back_p, back_q]| {
            let mut cell = at;
            cell[p] -= back_p;
            cell[q] -= back_q;
            self.vertex(cell)
        });
        if !inside {
            around.reverse();
        }
        let [a, b, c, d] = around;
        Some([[a, b, c], [a, c, d]])
    }

    /// The vertex of a crossed cell.
    fn vertex(&self, [i, j, k]: [usize; 3]) -> u32 {
        self.first[k] + self.layers[k].number(i + self.field.dims()[0] * j)
    }
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
    let mut values = [0.0; 8];
    for (bits, value) in values.iter_mut().enumerate() {
        let corner = [0, 1, 2].map(|axis| cell[axis] + (bits >> axis & 1));
        *value = f64::from(field[corner]);
    }
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
