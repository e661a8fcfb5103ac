//! Which part of the mask each figure of several has to account for.

use nalgebra::Point3;
use rayon::prelude::*;

use super::placed::Placed;
use super::samples::{bilinear, places_in};
use crate::cancel::{Cancel, Cancelled};
use crate::model::Shell;
use crate::numerics::balls::Balls;
use crate::numerics::field::floor_index;
use crate::pipeline::draft::AnyDraft;
use crate::pipeline::solid::depth::SkinPoint;
use crate::pipeline::tubes::TubeDraft;
use crate::pipeline::vectors::Nodes;
use crate::space::VoxelFromVoxel;

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

/// Inscribed balls all over the medial set of a figure, in the common space.
fn balls_of(figure: &Placed<'_>) -> Vec<(Point3<f64>, f64)> {
    match figure.draft {
        AnyDraft::Sheet(draft) => of_sheet(&draft.nodes, &figure.into_common),
        AnyDraft::Tube(draft) => of_tube(draft, &figure.into_common),
    }
}

/// All along the centreline.
fn of_tube(draft: &TubeDraft, into_common: &VoxelFromVoxel) -> Vec<(Point3<f64>, f64)> {
    let (centres, radii, scale) = (&draft.nodes.centres, &draft.radii, into_common.scale());
    let mut balls = vec![(into_common.point(centres[0]), scale * radii[0])];
    for n in 1..centres.len() {
        let pieces = floor_index(((centres[n] - centres[n - 1]).norm() / BALL_STEP).ceil());
        for piece in 1..=pieces {
            let share = piece as f64 / pieces as f64;
            let centre = centres[n - 1] + (centres[n] - centres[n - 1]) * share;
            balls.push((into_common.point(centre), scale * (radii[n - 1] * (1.0 - share) + radii[n] * share)));
        }
    }
    balls
}

/// All over the medial quads, their radii interpolated.
fn of_sheet(nodes: &Nodes, into_common: &VoxelFromVoxel) -> Vec<(Point3<f64>, f64)> {
    let (mut balls, scale) = (Vec::new(), into_common.scale());
    for quad in Shell::from(nodes).quads() {
        let (corners, radii) = (quad.corners(&nodes.medial), quad.corners(&nodes.radii));
        for place in places_in(corners, BALL_STEP) {
            balls.push((into_common.point(bilinear(corners, place)), scale * bilinear(radii, place)));
        }
    }
    balls
}
