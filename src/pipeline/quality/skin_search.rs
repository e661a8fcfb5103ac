//! A surface given by points with normals, to be found by distance.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::points::Points;
use crate::pipeline::solid::depth::SkinPoint;

/// A surface given by points with normals, to be found by distance.
pub struct SkinSearch<'a> {
    /// The points.
    pub points: &'a [SkinPoint],
    tree: Points,
}

impl<'a> SkinSearch<'a> {
    /// The surface of some points; there may be none.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(points: &'a [SkinPoint], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        cancel.check()?;
        let places: Vec<Point3<f64>> = points.iter().map(|s| s.position).collect();
        Ok(Self { points, tree: Points::new(&places) })
    }

    /// Distance from each of `from` to the surface.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn distances(&self, from: &[SkinPoint], cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
        from.par_iter().with_min_len(64).map(|s| self.distance(s.position, cancel)).collect()
    }

    /// Distance from a place to the surface around the nearest point; infinite when there is none.
    fn distance(&self, place: Point3<f64>, cancel: &dyn Cancel) -> Result<f64, Cancelled> {
        cancel.check()?;
        let nearest = self.tree.nearest(place);
        Ok(nearest.map_or(f64::INFINITY, |nearest| self.points[nearest].distance(place)))
    }

    /// The points within `reach` of a place.
    pub fn within(&self, place: Point3<f64>, reach: f64) -> impl Iterator<Item = &SkinPoint> {
        self.tree.within(place, reach).into_iter().map(|found| &self.points[found])
    }
}
