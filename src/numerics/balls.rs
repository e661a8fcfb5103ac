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
    /// Box by box.
    balls: Vec<Ball>,
}

#[derive(Clone, Copy, Debug)]
struct Ball {
    centre: Point3<f64>,
    radius: f64,
    number: u32,
    group: u32,
}

#[derive(Clone, Debug)]
struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
    largest: f64,
    /// The group that all its balls belong to.
    group: Option<u32>,
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
        Self::grouped(balls, |_| 0, cancel)
    }

    /// The same, each with the group that it belongs to, by its number.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn grouped(
        balls: &[(Point3<f64>, f64)],
        group_of: impl Fn(usize) -> u32,
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let mut all = Vec::with_capacity(balls.len());
        for (number, &(centre, radius)) in balls.iter().enumerate() {
            all.push(Ball { centre, radius, number: id(number), group: group_of(number) });
        }
        let mut boxes = Vec::new();
        if !all.is_empty() {
            split(&mut all, 0, &mut boxes, cancel)?;
        }
        Ok(Self { boxes, balls: all })
    }

    /// Number of the nearest ball (the first of equals), or `None` without balls.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<usize> {
        self.nearest_beside(p, None)
    }

    /// The same of the balls that are not of some group. Boxes that hold that group alone are not looked into, so one that owns
    /// most of what is around costs no more than another.
    #[must_use]
    pub fn nearest_beside(&self, p: Point3<f64>, group: Option<u32>) -> Option<usize> {
        let mut best = (f64::INFINITY, u32::MAX);
        // Boxes still to be looked at, and the least power in them.
        let mut waiting = Vec::with_capacity(32);
        waiting.extend(self.boxes.first().map(|root| (root.least_power(p), 0)));
        while let Some((least, k)) = waiting.pop() {
            if least > best.0 {
                continue;
            }
            let bounds = &self.boxes[k];
            if group.is_some() && bounds.group == group {
                continue;
            }
            if bounds.second == 0 {
                for ball in &self.balls[bounds.from as usize..bounds.to as usize] {
                    let power = (p - ball.centre).norm_squared() - ball.radius * ball.radius;
                    if (power, ball.number) < best && group != Some(ball.group) {
                        best = (power, ball.number);
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
fn split(balls: &mut [Ball], from: usize, boxes: &mut Vec<Bounds>, cancel: &dyn Cancel) -> Result<(), Cancelled> {
    cancel.check()?;
    let low = balls.iter().fold(balls[0].centre, |low, ball| low.inf(&ball.centre));
    let high = balls.iter().fold(balls[0].centre, |high, ball| high.sup(&ball.centre));
    let largest = balls.iter().map(|ball| ball.radius).fold(0.0, f64::max);
    let group = balls.iter().all(|ball| ball.group == balls[0].group).then_some(balls[0].group);
    let own = boxes.len();
    boxes.push(Bounds { low, high, largest, group, from: id(from), to: id(from + balls.len()), second: 0 });
    if balls.len() <= LEAF {
        return Ok(());
    }
    let axis = (high - low).imax();
    let middle = balls.len() / 2;
    balls
        .select_nth_unstable_by(middle, |a, b| a.centre[axis].total_cmp(&b.centre[axis]).then(a.number.cmp(&b.number)));
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
    fn of_the_balls_beside_a_group_the_nearest_is_that_of_a_tree_without_it() {
        let of = |n: usize, k: usize| ((n * n * 37 + n * 7919 * k) % 1009) as f64 / 50.0;
        let balls: Vec<_> = (0..400).map(|n| (Point3::new(of(n, 1), of(n, 2), of(n, 3)), of(n, 5) / 4.0)).collect();
        // Half of space is of one group, the rest of three that are mixed.
        let group = |n: usize| if balls[n].0.x < 10.0 { 0 } else { 1 + id(n % 3) };
        let tree = Balls::grouped(&balls, group, &Never).expect("not stopped");
        for n in 0..200 {
            let p = Point3::new(of(n, 7), of(n, 11), of(n, 13));
            let power = |k: usize| (p - balls[k].0).norm_squared() - balls[k].1.powi(2);
            for without in 0..4 {
                let others = (0..balls.len()).filter(|k| group(*k) != without);
                let best = others.min_by(|&a, &b| power(a).total_cmp(&power(b)));
                assert_eq!(tree.nearest_beside(p, Some(without)), best);
            }
        }
        assert_eq!(Balls::new(&balls, &Never).expect("not stopped").nearest_beside(Point3::origin(), Some(0)), None);
    }

    #[test]
    fn without_balls_none_is_nearest_and_of_equal_ones_the_first_is() {
        let nearest = |balls: &[_]| Balls::new(balls, &Never).expect("not stopped").nearest(Point3::origin());
        assert_eq!(nearest(&[]), None);
        assert_eq!(nearest(&[(Point3::new(1.0, 0.0, 0.0), 0.5); 40]), Some(0));
    }
}
