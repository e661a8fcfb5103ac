//! The nodes of a sheet's lattices, in work space.

use nalgebra::{Point2, Point3};

use crate::model::{Flanks, LatticeSize, Links, NodeRepair, PerSurface, Shell, ring, straight_flanks};

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
    /// Crest points in the order of [`ring`](crate::model::ring).
    pub crest: Vec<Point3<f64>>,
    /// The flanks of the arc through each.
    pub flanks: Vec<Flanks>,
    /// Whether a node lies on all three surfaces.
    pub valid: Vec<bool>,
    /// What was done to each so that no vectors cross.
    pub repaired: Vec<Option<NodeRepair>>,
    /// Plane coordinates on each surface, voxels.
    pub intrinsic: PerSurface<Vec<Point2<f64>>>,
}

impl Nodes {
    /// Which nodes are neighbours.
    #[must_use]
    pub fn links(&self) -> Links {
        Shell::from(self).links()
    }

    /// Lets all arcs lead straight from the surface nodes to the crest points.
    pub fn straighten_arcs(&mut self) {
        self.flanks.clear();
        for (node, &crest) in ring(self.size).into_iter().zip(&self.crest) {
            self.flanks.push(straight_flanks(self.upper[node], crest, self.lower[node]));
        }
    }
}

impl<'a> From<&'a Nodes> for Shell<'a> {
    fn from(nodes: &'a Nodes) -> Self {
        Self {
            size: nodes.size,
            medial: &nodes.medial,
            upper: &nodes.upper,
            lower: &nodes.lower,
            crest: &nodes.crest,
            flanks: &nodes.flanks,
            valid: &nodes.valid,
        }
    }
}
