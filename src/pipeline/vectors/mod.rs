//! Stage 7: which surface nodes belong to which medial node, and the vectors between them
//! (section 4 of the paper).
//!
//! `paper`: the two sides are laid flat on their own, turned rigidly onto the medial embedding
//! through the pairs of stage 4 (eigenvectors leave signs open, and on square sheets the
//! rotation too), get a lattice of their own, and nodes of equal (i, j) are paired.

pub mod legality;

pub mod repair;

pub mod anchored;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use crate::numerics::field::Field;
use crate::numerics::fit::Rigid2;

use crate::model::LatticeSize;
use crate::model::{PerSurface, ring};
use crate::params::CheckedParams;
use crate::pipeline::lattice::outline::Region;
use crate::pipeline::lattice::{Lattice, Node, SpaceFromPlane, lattice};
use crate::pipeline::observer::{Cancelled, Observer};
use crate::pipeline::plane::isomap::Flat;
use crate::pipeline::sheets::sides::{SheetSides, Side};
use crate::pipeline::solid::Solid;

/// Newton steps that carry a node onto the sub-voxel boundary.
const NEWTON_STEPS: usize = 4;
/// How far a node may be carried, voxels: further off, the boundary near it is not its own.
const MAX_CARRY: f64 = 2.0;

/// The nodes of a figure in work space.
#[derive(Clone, Debug)]
pub struct Nodes {
    /// Lattice size.
    pub size: LatticeSize,
    /// Medial nodes.
    pub medial: Vec<Point3<f64>>,
    /// Inscribed radius at each, voxels.
    pub radii: Vec<f64>,
    /// Upper nodes.
    pub upper: Vec<Point3<f64>>,
    /// Lower nodes.
    pub lower: Vec<Point3<f64>>,
    /// Crest points in the order of [`ring`].
    pub crest: Vec<Point3<f64>>,
    /// Whether a node lies on all three surfaces.
    pub valid: Vec<bool>,
    /// Plane coordinates on each surface, voxels.
    pub intrinsic: PerSurface<Vec<Point2<f64>>>,
}

/// Turns the flattened sides onto the flattened medial sheet.
pub fn align_sides(sheet: &SheetSides, flat: &mut PerSurface<Flat>) {
    let medial = &flat.medial.points;
    for (side, flat) in [(&sheet.upper, &mut flat.upper), (&sheet.lower, &mut flat.lower)] {
        let partners: Vec<Point2<f64>> = side.partners.iter().map(|&p| medial[p as usize]).collect();
        let rigid = Rigid2::between(&flat.points, &partners);
        flat.points.iter_mut().for_each(|p| *p = rigid.apply(*p));
    }
}

/// Lattices on the three aligned embeddings. `None` when a region is empty.
///
/// # Errors
/// When the observer asks to stop.
pub fn lattices(
    flat: &PerSurface<Flat>,
    params: &CheckedParams,
    size: LatticeSize,
    observer: &dyn Observer,
) -> Result<Option<PerSurface<Lattice>>, Cancelled> {
    let on = |flat: &Flat| {
        let region = Region::of(&flat.points, observer)?;
        lattice(&region, params.lattice, size, params.margin, crate::pipeline::lattice::RIM_INSET, observer)
    };
    let all = (on(&flat.medial)?, on(&flat.upper)?, on(&flat.lower)?);
    let (Some(medial), Some(upper), Some(lower)) = all else { return Ok(None) };
    Ok(Some(PerSurface { medial, upper, lower }))
}

/// Nodes of equal (i, j) on the three lattices.
///
/// # Errors
/// When the observer asks to stop.
pub fn paper(
    solid: &Solid,
    sheet: &SheetSides,
    flat: &PerSurface<Flat>,
    lattices: PerSurface<Lattice>,
    observer: &dyn Observer,
) -> Result<Nodes, Cancelled> {
    let size = lattices.medial.size;
    let medial_map = SpaceFromPlane::new(&flat.medial.points, &sheet.medial.positions, &sheet.radii);
    let medial = medial_map.nodes(&lattices.medial.nodes, observer)?;
    let side = |side: &Side, flat: &Flat, lattice: &Lattice| {
        let map = SpaceFromPlane::new(&flat.points, &side.surface.positions, &[]);
        let nodes = map.nodes(&lattice.nodes, observer)?;
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

/// What lies ahead of a node of the lattice's edge.
#[derive(Clone, Copy, Debug)]
pub struct Ahead {
    /// The sheet's rim.
    pub rim: Point3<f64>,
    /// Unit direction outward there, in the sheet.
    pub outward: Vector3<f64>,
    /// Whether other sheets are met there.
    pub is_hinge: bool,
}

/// What lies ahead of the nodes of the edge, in the order of [`ring`]. `hinge`: the medial points
/// where other sheets are met.
#[must_use]
pub fn look_ahead(lattice: &Lattice, map: &SpaceFromPlane<'_>, hinge: &[Point3<f64>]) -> Vec<Ahead> {
    /// A rim this near to a point of a hinge lies on it, voxels: hinge points lie on both sides.
    const AT_HINGE: f64 = 1.5;
    let edge = ring(lattice.size).into_iter().zip(&lattice.rim);
    edge.map(|(n, rim)| {
        let flat = outward(lattice, n) + (rim - lattice.nodes[n]);
        let at_rim = map.node(*rim);
        let direction = at_rim.tangents[0] * flat.x + at_rim.tangents[1] * flat.y;
        Ahead {
            rim: at_rim.position,
            outward: direction.try_normalize(1e-9).unwrap_or_else(Vector3::x),
            is_hinge: hinge.iter().any(|h| (h - at_rim.position).norm() < AT_HINGE),
        }
    })
    .collect()
}

/// The crest point of every node of the lattice's edge: where the sheet, carried on outward past
/// its rim in its own plane, meets the boundary. Where it meets other sheets instead, the crest is
/// the rim itself.
#[must_use]
pub fn crest(level: &Field, size: LatticeSize, medial: &[Node], ahead: &[Ahead]) -> Vec<Point3<f64>> {
    /// How far a crest at a hinge lies outside of its node at the least, voxels.
    const LEAST: f64 = 0.25;
    let edge = ring(size).into_iter().zip(ahead);
    edge.map(|(n, ahead)| {
        let node = &medial[n];
        let way = ahead.rim - node.position;
        if ahead.is_hinge {
            return node.position + if way.norm() > LEAST { way } else { ahead.outward * LEAST };
        }
        if level.at(ahead.rim) <= 0.0 {
            // A rim that lies outside of a thin edge: the crest is on the way to it.
            let direction = way.try_normalize(1e-9).unwrap_or_else(Vector3::x);
            return node.position + direction * level.first_zero(node.position, direction, way.norm()).unwrap_or(0.0);
        }
        let reach = 4.0 * node.value.max(1.0) + 4.0;
        ahead.rim + ahead.outward * level.first_zero(ahead.rim, ahead.outward, reach).unwrap_or(0.0)
    })
    .collect()
}

/// The direction in the plane that leads from the inner neighbours of an edge node to it.
fn outward(lattice: &Lattice, n: usize) -> Vector2<f64> {
    let LatticeSize { rows, cols } = lattice.size;
    let (i, j) = (n / cols, n % cols);
    let inner = [
        (i == 0).then(|| n + cols),
        (i + 1 == rows).then(|| n - cols),
        (j == 0).then(|| n + 1),
        (j + 1 == cols).then(|| n - 1),
    ];
    let from = |m: usize| (lattice.nodes[n] - lattice.nodes[m]).try_normalize(1e-9).unwrap_or_default();
    inner.into_iter().flatten().map(from).sum()
}
