//! Which medial point a place belongs to: the one whose inscribed ball comes nearest to it.

use nalgebra::Point3;

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

    /// [`Self::nearest`] of every skin point.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of_skin(&self, depth: &Depth, cancel: &dyn Cancel) -> Result<Vec<Option<(usize, f64)>>, Cancelled> {
        each(&depth.skin, 1, |point| self.nearest(point.position), cancel)
    }

    /// How far each of some skin points is outside of all balls.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn heights(&self, depth: &Depth, skin: &[usize], cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
        each(skin, 1, |&s| self.height(depth.skin[s].position), cancel)
    }

    /// How far `p` is outside of all balls; 0 inside, and without balls.
    fn height(&self, p: Point3<f64>) -> f64 {
        self.nearest(p).map_or(0.0, |(_, outside)| outside.max(0.0))
    }

    /// The medial point whose ball comes nearest to `p`, and how far `p` is outside of it.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<(usize, f64)> {
        let k = self.balls.nearest(p)?;
        let (centre, radius) = self.centres[k];
        Some((self.points[k] as usize, (p - centre).norm() - radius))
    }
}
