//! The ball nearest to a place in power distance, |p − m|² − r².
//!
//! A tree of boxes: a box holds the centres of its balls and knows the largest radius, so that no
//! ball in it is nearer than dist(p, box)² − r². (A k-d tree over the balls lifted to four-space has
//! no such bound: it cannot see that the whole of a sheet is a radius away.)

use nalgebra::{Point3, Vector3};

use super::field::id;
use crate::cancel::{Cancel, Cancelled};

/// Balls of a box that is not split further.
const LEAF: usize = 8;

/// Balls in space, searchable by power distance.
#[derive(Clone, Debug, Default)]
pub struct Balls {
    /// In depth-first order, the root first; empty without balls.
    boxes: Vec<Bounds>,
    /// Centre, radius and number, box by box.
    balls: Vec<(Point3<f64>, f64, u32)>,
}

#[derive(Clone, Debug)]
struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
    largest: f64,
    /// Its balls.
    from: u32,
    to: u32,
    /// The second of its two halves; the first follows it. 0 for a leaf.
    second: u32,
}

impl Bounds {
    /// No ball in the box is nearer.
    fn least_power(&self, p: Point3<f64>) -> f64 {
        let outside = |axis: usize| (self.low[axis] - p[axis]).max(p[axis] - self.high[axis]).max(0.0);
        Vector3::from_fn(|axis, _| outside(axis)).norm_squared() - self.largest * self.largest
    }
}

impl Balls {
    /// From centres and radii, which must be finite.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn new(balls: &[(Point3<f64>, f64)], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let mut all: Vec<_> = balls.iter().enumerate().map(|(n, &(m, r))| (m, r, id(n))).collect();
        let mut boxes = Vec::new();
        if !all.is_empty() {
            split(&mut all, 0, &mut boxes, cancel)?;
        }
        Ok(Self { boxes, balls: all })
    }

    /// Number of the nearest ball (the first of equals), or `None` without balls.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<usize> {
        let mut best = (f64::INFINITY, u32::MAX);
        // Boxes still to be looked at, and the least power in them.
        let mut waiting = Vec::with_capacity(32);
        waiting.extend(self.boxes.first().map(|root| (root.least_power(p), 0)));
        while let Some((least, k)) = waiting.pop() {
            if least > best.0 {
                continue;
            }
            let bounds = &self.boxes[k];
            if bounds.second == 0 {
                for (m, r, number) in &self.balls[bounds.from as usize..bounds.to as usize] {
                    let power = (p - m).norm_squared() - r * r;
                    if (power, *number) < best {
                        best = (power, *number);
                    }
                }
                continue;
            }
            let halves = [k + 1, bounds.second as usize].map(|half| (self.boxes[half].least_power(p), half));
            let [first, second] = halves;
            // The nearer one is looked at first.
            waiting.extend(if first.0 <= second.0 { [second, first] } else { [first, second] });
        }
        (best.1 != u32::MAX).then_some(best.1 as usize)
    }
}

/// Halves balls along the longest edge of their box until few are left; `from` is the place of the
/// first one.
fn split(
    balls: &mut [(Point3<f64>, f64, u32)],
    from: usize,
    boxes: &mut Vec<Bounds>,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    cancel.check()?;
    let low = balls.iter().fold(balls[0].0, |low, b| low.inf(&b.0));
    let high = balls.iter().fold(balls[0].0, |high, b| high.sup(&b.0));
    let largest = balls.iter().map(|b| b.1).fold(0.0, f64::max);
    let own = boxes.len();
    boxes.push(Bounds { low, high, largest, from: id(from), to: id(from + balls.len()), second: 0 });
    if balls.len() <= LEAF {
        return Ok(());
    }
    let axis = (high - low).imax();
    let middle = balls.len() / 2;
    balls.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.2.cmp(&b.2)));
    let (first, second) = balls.split_at_mut(middle);
    split(first, from, boxes, cancel)?;
    boxes[own].second = id(boxes.len());
    split(second, from + middle, boxes, cancel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    #[test]
    fn the_nearest_is_the_one_that_looking_at_all_finds() {
        let of = |n: usize, k: usize| ((n * n * 37 + n * 7919 * k) % 1009) as f64 / 50.0;
        let balls: Vec<_> =
            (0..700).map(|n| (Point3::new(of(n, 1), of(n, 2), 0.1 * of(n, 3)), of(n, 5) / 4.0)).collect();
        let tree = Balls::new(&balls, &Never).expect("not stopped");
        for n in 0..300 {
            let p = Point3::new(of(n, 7), of(n, 11), of(n, 13));
            let power = |k: usize| (p - balls[k].0).norm_squared() - balls[k].1.powi(2);
            let best = (0..balls.len()).min_by(|&a, &b| power(a).total_cmp(&power(b)));
            assert_eq!(tree.nearest(p), best);
        }
    }

    #[test]
    fn without_balls_none_is_nearest_and_of_equal_ones_the_first_is() {
        let nearest = |balls: &[_]| Balls::new(balls, &Never).expect("not stopped").nearest(Point3::origin());
        assert_eq!(nearest(&[]), None);
        assert_eq!(nearest(&[(Point3::new(1.0, 0.0, 0.0), 0.5); 40]), Some(0));
    }
}
