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
    let crest = crest(&solid.level, size, &medial, &look_ahead(&lattices.medial, &map, &[]));
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

/// The nodes of a side's lattice, on the boundary.
fn on_side(
    side: &Side,
    flat: &Flat,
    lattice: &Lattice,
    level: &Level,
    cancel: &dyn Cancel,
) -> Result<Vec<Point3<f64>>, Cancelled> {
    let map = SpaceFromPlane::new(&flat.points, &side.surface.positions, &[]);
    let nodes = map.nodes(&lattice.nodes, cancel)?;
    Ok(nodes.iter().map(|node| onto_boundary(level, node.position)).collect())
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
