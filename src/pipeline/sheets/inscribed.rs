//! Which medial point a place belongs to: the one whose inscribed ball comes nearest to it.

use nalgebra::Point3;

use super::NO_SHEET;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::balls::Balls;
use crate::numerics::field::id;
use crate::numerics::parallel::each;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::solid::depth::Depth;

/// The inscribed balls of medial points, to be found by power distance.
pub struct Inscribed {
    balls: Balls,
    points: Vec<u32>,
    centres: Vec<(Point3<f64>, f64)>,
}

impl Inscribed {
    /// The balls of the medial points (by index) that `take` accepts.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(surface: &MedialSurface, take: impl Fn(usize) -> bool, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut points, mut centres) = (Vec::new(), Vec::new());
        for (p, point) in surface.points.iter().enumerate() {
            if take(p) {
                points.push(id(p));
                centres.push((point.position, point.radius));
            }
        }
        Ok(Self { balls: Balls::new(&centres, cancel)?, points, centres })
    }

    /// The balls of the medial points that are on a sheet, grouped by it.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn by_sheets(surface: &MedialSurface, sheet_of: &[u32], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let all = Self::of(surface, |p| sheet_of[p] != NO_SHEET, cancel)?;
        let balls = Balls::grouped(&all.centres, |k| sheet_of[all.points[k] as usize], cancel)?;
        Ok(Self { balls, ..all })
    }

    /// [`Self::nearest`] of every skin point.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of_skin(&self, depth: &Depth, cancel: &dyn Cancel) -> Result<Vec<Option<(usize, f64)>>, Cancelled> {
        each(&depth.skin, 1, |point| self.nearest(point.position), cancel)
    }

    /// How far each of some skin points is outside of the balls of all other sheets; 0 inside, and without others.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn heights_without(
        &self,
        sheet: u32,
        depth: &Depth,
        skin: &[usize],
        cancel: &dyn Cancel,
    ) -> Result<Vec<f64>, Cancelled> {
        let height = |s: &usize| {
            let place = depth.skin[*s].position;
            let nearest = self.balls.nearest_beside(place, Some(sheet));
            nearest.map_or(0.0, |ball| self.outside(ball, place).max(0.0))
        };
        each(skin, 1, height, cancel)
    }

    /// The medial point whose ball comes nearest to `p`, and how far `p` is outside of it.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<(usize, f64)> {
        let k = self.balls.nearest(p)?;
        Some((self.points[k] as usize, self.outside(k, p)))
    }

    /// How far a place is outside of a ball.
    fn outside(&self, ball: usize, place: Point3<f64>) -> f64 {
        let (centre, radius) = self.centres[ball];
        (place - centre).norm() - radius
    }
}
