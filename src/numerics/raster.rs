//! Pixels over a part of the plane.

use nalgebra::{Point2, Vector2};

use super::field::floor_index;
use super::moments::bounds;
use crate::space::Grid;

/// Where the pixels of a raster lie.
#[derive(Clone, Copy, Debug)]
pub struct Raster {
    /// Centre of the first pixel.
    pub origin: Point2<f64>,
    /// Distance of neighbouring pixels.
    pub pitch: f64,
    /// Pixels along both axes.
    pub dims: [usize; 2],
}

impl Raster {
    /// Over points, with `padding` pixels more on every side.
    #[must_use]
    pub fn around(points: &[Point2<f64>], pitch: f64, padding: usize) -> Self {
        let [low, high] = bounds(points);
        let origin = Point2::from(low - Vector2::repeat(padding as f64 * pitch));
        let dims = [0, 1].map(|axis| floor_index(((high - low)[axis] / pitch).ceil()) + 1 + 2 * padding);
        Self { origin, pitch, dims }
    }

    /// Centre of a pixel.
    #[must_use]
    pub fn place(&self, i: usize, j: usize) -> Point2<f64> {
        self.origin + Vector2::new(i as f64, j as f64) * self.pitch
    }

    /// A place in pixels.
    #[must_use]
    pub fn pixels_of(&self, p: Point2<f64>) -> Vector2<f64> {
        (p - self.origin) / self.pitch
    }

    /// Whether a place in pixels lies between the centres of the outermost.
    #[must_use]
    pub fn holds(&self, at: Vector2<f64>) -> bool {
        let [nx, ny] = self.dims;
        at.x >= 0.0 && at.y >= 0.0 && at.x <= (nx - 1) as f64 && at.y <= (ny - 1) as f64
    }

    /// The pixels that points lie in, ascending, each once.
    #[must_use]
    pub fn taken_by(&self, points: &[Point2<f64>]) -> Vec<usize> {
        let mut taken = Vec::with_capacity(points.len());
        for p in points {
            let at = self.pixels_of(*p);
            taken.push(floor_index(at.x + 0.5) + self.dims[0] * floor_index(at.y + 0.5));
        }
        taken.sort_unstable();
        taken.dedup();
        taken
    }

    /// Distance of every pixel to a closed outline that runs counter-clockwise, in pixels, positive inside of it and no
    /// more than `band`.
    #[must_use]
    pub fn signed_distance(&self, outline: &[Point2<f64>], band: f64) -> Grid<f32> {
        let [nx, ny] = self.dims;
        let mut distance = vec![band * self.pitch; nx * ny];
        let mut turns = vec![0i32; nx * ny];
        for (k, a) in outline.iter().enumerate() {
            let edge = Edge { a: *a, b: outline[(k + 1) % outline.len()] };
            self.lower(&mut distance, &edge, band);
            self.add_crossings(&mut turns, &edge, band);
        }
        let mut signed = Grid::filled([nx, ny, 1], 0.0);
        for j in 0..ny {
            let mut winding = 0;
            for o in nx * j..nx * (j + 1) {
                winding += turns[o];
                let sign = if winding > 0 { 1.0 } else { -1.0 };
                #[expect(clippy::cast_possible_truncation, reason = "the field is f32")]
                let value = (sign * distance[o] / self.pitch) as f32;
                signed.as_mut_slice()[o] = value;
            }
        }
        signed
    }

    /// The first and the last pixel, along both axes, that are within `band` pixels of an edge.
    fn window(&self, edge: &Edge, band: f64) -> [[usize; 2]; 2] {
        let [nx, ny] = self.dims;
        let low = (edge.a.coords.inf(&edge.b.coords) - self.origin.coords) / self.pitch;
        let high = (edge.a.coords.sup(&edge.b.coords) - self.origin.coords) / self.pitch;
        let from = [floor_index(low.x - band).min(nx - 1), floor_index(low.y - band).min(ny - 1)];
        let to = [floor_index(high.x + band + 1.0).min(nx - 1), floor_index(high.y + band + 1.0).min(ny - 1)];
        [from, to]
    }

    /// Lowers distances to those from an edge, where these are less.
    fn lower(&self, distance: &mut [f64], edge: &Edge, band: f64) {
        let [from, to] = self.window(edge, band);
        for j in from[1]..=to[1] {
            for i in from[0]..=to[0] {
                let d = &mut distance[i + self.dims[0] * j];
                *d = d.min(edge.distance(self.place(i, j)));
            }
        }
    }

    /// Notes, in every row of pixels that an edge crosses, the sense in which it does so, at the first pixel to the right.
    fn add_crossings(&self, turns: &mut [i32], edge: &Edge, band: f64) {
        let Edge { a, b } = edge;
        let nx = self.dims[0];
        let [from, to] = self.window(edge, band);
        for j in from[1]..=to[1] {
            let y = self.place(0, j).y;
            if (a.y <= y) == (b.y <= y) {
                continue;
            }
            let x = a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y);
            let first = floor_index(((x - self.origin.x) / self.pitch).ceil()).min(nx - 1);
            turns[nx * j + first] += if b.y > a.y { -1 } else { 1 };
        }
    }
}

/// An edge of an outline.
struct Edge {
    a: Point2<f64>,
    b: Point2<f64>,
}

impl Edge {
    fn distance(&self, p: Point2<f64>) -> f64 {
        let way = self.b - self.a;
        let along = ((p - self.a).dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
        (p - (self.a + way * along)).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_positive_inside_and_end_at_the_band() {
        let square = [(2.0, 2.0), (8.0, 2.0), (8.0, 8.0), (2.0, 8.0)].map(|(x, y)| Point2::new(x, y));
        let raster = Raster::around(&square, 0.5, 4);
        assert_eq!((raster.dims, raster.origin), ([21, 21], Point2::new(0.0, 0.0)));
        let signed = raster.signed_distance(&square, 3.0);
        let at = |x: f64, y: f64| signed.as_slice()[raster.taken_by(&[Point2::new(x, y)])[0]];
        assert_eq!([at(3.0, 5.0), at(5.0, 5.0), at(1.0, 5.0), at(0.0, 0.0)], [2.0, 3.0, -2.0, -3.0]);
        assert_eq!(at(2.0, 5.0).abs(), 0.0);
    }
}
