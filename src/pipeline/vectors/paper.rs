//! `paper`: the two sides are laid flat on their own, turned rigidly onto the medial embedding
//! through the pairs of stage 4 (eigenvectors leave signs open, and on square sheets the
//! rotation too), get a lattice of their own, and nodes of equal (i, j) are paired.

use nalgebra::Point3;

use super::crest::{crest, look_ahead};
use super::nodes::Nodes;
use crate::cancel::{Cancel, Cancelled};
use crate::model::PerSurface;
use crate::numerics::field::Field;
use crate::pipeline::lattice::Lattice;
use crate::pipeline::lattice::map::SpaceFromPlane;
use crate::pipeline::plane::Flat;
use crate::pipeline::sheets::sides::{SheetSides, Side};
use crate::pipeline::solid::Solid;

/// Newton steps that carry a node onto the sub-voxel boundary.
const NEWTON_STEPS: usize = 4;
/// How far a node may be carried, voxels: further off, the boundary near it is not its own.
const MAX_CARRY: f64 = 2.0;

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
    let medial_map = SpaceFromPlane::new(&flat.medial.points, &sheet.medial.positions, &sheet.radii);
    let medial = medial_map.nodes(&lattices.medial.nodes, cancel)?;
    let side = |side: &Side, flat: &Flat, lattice: &Lattice| {
        let map = SpaceFromPlane::new(&flat.points, &side.surface.positions, &[]);
        let nodes = map.nodes(&lattice.nodes, cancel)?;
        Ok(nodes.iter().map(|node| onto_boundary(&solid.level, node.position)).collect::<Vec<_>>())
    };
    let (upper, lower) =
        (side(&sheet.upper, &flat.upper, &lattices.upper)?, side(&sheet.lower, &flat.lower, &lattices.lower)?);
    let valid = (0..size.rows * size.cols).map(|n| lattices.named().iter().all(|(_, l)| l.valid[n])).collect();
    let ahead = look_ahead(&lattices.medial, &medial_map, &[]);
    let crest = crest(&solid.level, size, &medial, &ahead);
    Ok(Nodes {
        size,
        radii: medial.iter().map(|n| n.value).collect(),
        medial: medial.iter().map(|n| n.position).collect(),
        upper,
        lower,
        crest,
        valid,
        intrinsic: PerSurface {
            medial: lattices.medial.nodes,
            upper: lattices.upper.nodes,
            lower: lattices.lower.nodes,
        },
    })
}

/// The point of the boundary that a point near it is carried to along the gradient.
fn onto_boundary(level: &Field, from: Point3<f64>) -> Point3<f64> {
    let mut p = from;
    for _ in 0..NEWTON_STEPS {
        let gradient = level.gradient(p);
        let step = -gradient * (level.at(p) / gradient.norm_squared().max(1e-6));
        p += step * (0.5 / step.norm().max(0.5));
    }
    if (p - from).norm() <= MAX_CARRY { p } else { from }
}
