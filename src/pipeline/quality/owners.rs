//! Which part of the mask each figure of several has to account for.

use nalgebra::Point3;
use rayon::prelude::*;

use super::placed::Placed;
use super::samples::{bilinear, places_in};
use crate::cancel::{Cancel, Cancelled};
use crate::model::Shell;
use crate::numerics::balls::Balls;
use crate::pipeline::solid::depth::SkinPoint;

/// Distance between the balls that split the mask among figures, voxels. The split moves by less than a voxel with it,
/// and the search is the slowest part of this stage. From 1 to 6, nothing of a whole structure changes, and no distance
/// between a sheet's part of the mask and its model by more than 3 %.
const BALL_STEP: f64 = 2.0;

/// Which figure a point belongs to: that of the inscribed ball nearest in power distance. Where sheets meet, the mask is
/// so split along the hinge.
pub struct Owners {
    /// None when there is one figure.
    balls: Balls,
    figure_of: Vec<usize>,
    figures: usize,
}

impl Owners {
    /// Of the figures of a structure.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(figures: &[Placed<'_>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut balls, mut figure_of) = (Vec::new(), Vec::new());
        if figures.len() > 1 {
            for (number, figure) in figures.iter().enumerate() {
                cancel.check()?;
                balls.extend(balls_of(figure));
                figure_of.resize(balls.len(), number);
            }
        }
        Ok(Self { balls: Balls::new(&balls, cancel)?, figure_of, figures: figures.len() })
    }

    /// The figure that a point belongs to.
    #[must_use]
    pub fn of_point(&self, place: Point3<f64>) -> usize {
        self.balls.nearest(place).map_or(0, |ball| self.figure_of[ball])
    }

    /// The share of some points that each figure has, in their order.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn shares(&self, points: &[SkinPoint], cancel: &dyn Cancel) -> Result<Vec<Vec<SkinPoint>>, Cancelled> {
        let owner = |point: &SkinPoint| {
            cancel.check()?;
            Ok(self.of_point(point.position))
        };
        let owners: Vec<usize> = points.par_iter().map(owner).collect::<Result<_, _>>()?;
        let mut shares = vec![Vec::new(); self.figures];
        for (point, owner) in points.iter().zip(owners) {
            shares[owner].push(*point);
        }
        Ok(shares)
    }
}

/// Inscribed balls all over the medial quads of a figure, their radii interpolated, in the common space.
fn balls_of(figure: &Placed<'_>) -> Vec<(Point3<f64>, f64)> {
    let (nodes, into_common) = (figure.nodes, &figure.into_common);
    let (mut balls, scale) = (Vec::new(), into_common.scale());
    for quad in Shell::from(nodes).quads() {
        let (corners, radii) = (quad.corners(&nodes.medial), quad.corners(&nodes.radii));
        for place in places_in(corners, BALL_STEP) {
            balls.push((into_common.point(bilinear(corners, place)), scale * bilinear(radii, place)));
        }
    }
    balls
}
