//! Correspondence `paper` (section 4 of the paper): nodes of equal (i, j) on three lattices are paired.
//!
//! The two sides are laid flat on their own, turned rigidly onto the medial embedding through the pairs of the stage of
//! the sides (eigenvectors leave signs open, and on square sheets the rotation too), and get a lattice of their own.
//! We leave the paper where it says nothing: nodes are carried onto the sub-voxel boundary, and the edge gets a crest.

use nalgebra::Point3;

use super::nodes::Nodes;
use super::rim::crest::{crest, look_ahead};
use crate::cancel::{Cancel, Cancelled};
use crate::model::PerSurface;
use crate::pipeline::chart::Lattice;
use crate::pipeline::lattice::map::SpaceFromPlane;
use crate::pipeline::plane::Flat;
use crate::pipeline::sides::{SheetSides, Side};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::level::Level;

/// Newton steps that carry a node onto the sub-voxel boundary. The second moves the overlap with the mask by 0.0001, those
/// after it by less.
const NEWTON_STEPS: usize = 4;
/// How far a node may be carried, voxels: further off, the boundary near it is not its own. On samples and organs no node
/// comes near it: from 0.5 to 8 nothing changes.
const MAX_CARRY: f64 = 2.0;
/// How far a fit may lie from the point of the side that is nearest in the plane, voxels. A graph of few neighbours lays a
/// tail on a line; what a fit says beside the line is made of rounding, and with eight neighbours a node of a caudate
/// nucleus was nearly 800 voxels off. Fits are made of points within 5 voxels.
const MAX_OFF: f64 = 10.0;

/// Nodes of equal (i, j) on the three lattices.
///
/// # Errors
/// When it is cancelled.
pub fn paper(
    solid: &Solid,
    sheet: &SheetSides,
    flat: &PerSurface<Flat>,
    lattices: PerSurface<Lattice>,
    cancel: &dyn Cancel,
) -> Result<Nodes, Cancelled> {
    let size = lattices.medial.size;
    let map = SpaceFromPlane::new(&flat.medial.points, &sheet.medial.positions, &sheet.radii);
    let medial = map.nodes(&lattices.medial.nodes, cancel)?;
    let crest = crest(&solid.level, lattices.medial.links(), &medial, &look_ahead(&lattices.medial, &map, &[]));
    Ok(Nodes {
        size,
        radii: medial.iter().map(|n| n.value).collect(),
        medial: medial.iter().map(|n| n.position).collect(),
        upper: on_side(&sheet.upper, &flat.upper, &lattices.upper, &solid.level, cancel)?,
        lower: on_side(&sheet.lower, &flat.lower, &lattices.lower, &solid.level, cancel)?,
        crest,
        flanks: Vec::new(),
        valid: valid_on_all(&lattices),
        repaired: vec![None; medial.len()],
        intrinsic: PerSurface {
            medial: lattices.medial.nodes,
            upper: lattices.upper.nodes,
            lower: lattices.lower.nodes,
        },
    })
}

/// The nodes of a side's lattice, on the boundary. Where a fit runs astray, the side's nearest point stands for the place.
fn on_side(
    side: &Side,
    flat: &Flat,
    lattice: &Lattice,
    level: &Level,
    cancel: &dyn Cancel,
) -> Result<Vec<Point3<f64>>, Cancelled> {
    let points = &side.surface.positions;
    let map = SpaceFromPlane::new(&flat.points, points, &[]);
    let nodes = map.nodes(&lattice.nodes, cancel)?;
    let mut carried = Vec::with_capacity(nodes.len());
    for (node, place) in nodes.iter().zip(&lattice.nodes) {
        let nearest = points[map.nearest(*place).0];
        let is_sound = (node.position - nearest).norm() <= MAX_OFF;
        carried.push(onto_boundary(level, if is_sound { node.position } else { nearest }));
    }
    Ok(carried)
}

/// Whether a node lies inside of the outline on all three surfaces.
fn valid_on_all(lattices: &PerSurface<Lattice>) -> Vec<bool> {
    let mut valid = lattices.medial.valid.clone();
    for side in [&lattices.upper, &lattices.lower] {
        for (valid, on_side) in valid.iter_mut().zip(&side.valid) {
            *valid &= on_side;
        }
    }
    valid
}

/// The point of the boundary that a point near it is carried to along the gradient.
fn onto_boundary(level: &Level, from: Point3<f64>) -> Point3<f64> {
    let mut p = from;
    for _ in 0..NEWTON_STEPS {
        let gradient = level.gradient(p);
        let step = -gradient * (level.at(p) / gradient.norm_squared().max(1e-6));
        p += step * (0.5 / step.norm().max(0.5));
    }
    if (p - from).norm() <= MAX_CARRY { p } else { from }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::cancel::Never;
    use crate::model::LatticeSize;
    use crate::pipeline::surface::Surface;
    use crate::space::Grid;

    /// A solid below z = 5.
    fn half_space() -> Level {
        let mut grid = Grid::filled([24, 12, 12], 0.0_f32);
        for offset in 0..grid.as_slice().len() {
            let [_, _, z] = grid.index(offset);
            grid.as_mut_slice()[offset] = 5.0 - u8::try_from(z).map_or(0.0, f32::from);
        }
        Level::new(grid)
    }

    #[test]
    fn a_node_beside_a_tail_that_is_laid_on_a_line_stays_at_the_tail() {
        // Two rows of points that the plane has a thousandth of a voxel apart.
        let (mut positions, mut points) = (Vec::new(), Vec::new());
        for n in 0..20 {
            let (along, row) = (f64::from(n), f64::from(n % 2));
            positions.push(Point3::new(along + 2.0, 5.0 + row, 5.0));
            points.push(Point2::new(along, 1e-3 * row));
        }
        let flat = Flat { points, ..Flat::default() };
        let side = Side { surface: Surface { positions, adjacency: Vec::new() }, partners: Vec::new() };
        let nodes = vec![Point2::new(9.0, 0.8), Point2::new(9.0, 0.0)];
        let size = LatticeSize { rows: 2, cols: 1 };
        let lattice = Lattice { size, valid: vec![true; 2], rim: nodes.clone(), nodes, period: None };
        let on_side = on_side(&side, &flat, &lattice, &half_space(), &Never).expect("not cancelled");
        for node in on_side {
            assert!((node - Point3::new(11.0, 5.5, 5.0)).norm() < 1.0, "{node}");
        }
    }
}
