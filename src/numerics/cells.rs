//! Points of the plane in square cells, to find those around a place.

use nalgebra::{Point2, Vector2};

use super::field::{floor_index, id};

/// Points in cells of equal width.
#[derive(Clone, Debug)]
pub struct Cells {
    origin: Point2<f64>,
    width: f64,
    counts: [usize; 2],
    members: Vec<Vec<u32>>,
}

impl Cells {
    /// Puts points into cells of `width`, in their order.
    #[must_use]
    pub fn new(points: &[Point2<f64>], width: f64) -> Self {
        let low = points.iter().fold(Vector2::repeat(f64::INFINITY), |a, p| a.inf(&p.coords));
        let high = points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |a, p| a.sup(&p.coords));
        let counts = [0, 1].map(|a| floor_index((high - low)[a] / width) + 1);
        let mut cells = Self { origin: low.into(), width, counts, members: vec![Vec::new(); counts[0] * counts[1]] };
        for (k, p) in points.iter().enumerate() {
            let [i, j] = cells.of(*p);
            cells.members[i + counts[0] * j].push(id(k));
        }
        cells
    }

    fn of(&self, p: Point2<f64>) -> [usize; 2] {
        [0, 1].map(|a| floor_index((p - self.origin)[a] / self.width).min(self.counts[a] - 1))
    }

    /// The points of all cells that come within `radius` of `p`, and some more.
    pub fn around(&self, p: Point2<f64>, radius: f64) -> impl Iterator<Item = usize> + '_ {
        let reach = floor_index((radius / self.width).ceil());
        let [i, j] = self.of(p);
        let (i0, i1) = (i.saturating_sub(reach), (i + reach).min(self.counts[0] - 1));
        let (j0, j1) = (j.saturating_sub(reach), (j + reach).min(self.counts[1] - 1));
        let cells = (j0..=j1).flat_map(move |j| (i0..=i1).map(move |i| (i, j)));
        cells.flat_map(|(i, j)| self.members[i + self.counts[0] * j].iter().map(|k| *k as usize))
    }
}
