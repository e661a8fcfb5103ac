//! A picture as pixels, drawn without a graphics card: filled outlines with smooth edges.
//!
//! Coverage is the exact area of the outline in each pixel, summed from its edges (as font-rs does, R. Levien 2016).

use super::colors::{Rgb, mixed};
use super::typeface::Typeface;

/// A picture of `width` × `height` pixels, sRGB, row by row from the upper left corner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    width: usize,
    height: usize,
    colors: Vec<Rgb>,
}

/// An outline that is larger than so many times the picture is not drawn: it is a mistake, and would take memory for what
/// nobody sees.
const MOST_OUTSIDE: f64 = 4.0;

impl Pixels {
    /// A picture in one colour.
    #[must_use]
    pub fn new(width: usize, height: usize, color: Rgb) -> Self {
        Self { width, height, colors: vec![color; width * height] }
    }

    /// Pixels along a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Red, green and blue of every pixel.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.colors.as_flattened()
    }

    /// The colours of a row; none beyond the picture.
    #[must_use]
    pub fn row(&self, y: usize) -> &[Rgb] {
        let start = y.saturating_mul(self.width);
        self.colors.get(start..start.saturating_add(self.width)).unwrap_or_default()
    }

    /// Gives a pixel a colour; nothing beyond the picture.
    pub fn set(&mut self, x: usize, y: usize, color: Rgb) {
        if x < self.width
            && let Some(pixel) = self.colors.get_mut(y * self.width + x)
        {
            *pixel = color;
        }
    }

    /// Lays another picture over this one, its upper left corner there.
    pub fn lay(&mut self, other: &Self, [left, top]: [usize; 2]) {
        for y in 0..other.height {
            for (x, color) in other.row(y).iter().enumerate() {
                self.set(left + x, top + y, *color);
            }
        }
    }

    /// Fills what closed lines enclose; where they run the other way round, they cut out.
    pub fn fill(&mut self, outline: &[Vec<[f64; 2]>], color: Rgb) {
        let Some(mut cover) = Cover::of(outline, MOST_OUTSIDE * (self.width + self.height) as f64) else { return };
        for line in outline {
            for (n, from) in line.iter().enumerate() {
                let to = line[(n + 1) % line.len()];
                cover.add_edge(*from, to);
            }
        }
        cover.each(|x, y, share| {
            let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
            if let Some(below) = self.row(y).get(x) {
                self.set(x, y, mixed(*below, color, share));
            }
        });
    }

    /// Fills a rectangle from its upper left corner.
    pub fn rectangle(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], color: Rgb) {
        self.fill(&[vec![[x, y], [x + width, y], [x + width, y + height], [x, y + height]]], color);
    }

    /// A disc.
    pub fn disc(&mut self, middle: [f64; 2], radius: f64, color: Rgb) {
        self.fill(&[circle(middle, radius)], color);
    }

    /// Words from the left end of their base line.
    pub fn words(&mut self, text: &str, [x, y]: [f64; 2], (face, size): (Typeface, f64), color: Rgb) {
        let mut left = x;
        for character in text.chars() {
            let glyph = face.glyph(character);
            let mut outline = face.outline(glyph);
            for point in outline.iter_mut().flatten() {
                *point = [left + point[0] * size, y - point[1] * size];
            }
            self.fill(&outline, color);
            left += face.advance(glyph) * size;
        }
    }
}

/// A circle as a polygon.
pub(super) fn circle([x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    /// Corners; fewer are seen on a disc as large as a letter.
    const CORNERS: u32 = 32;
    let mut corners = Vec::new();
    for corner in 0..CORNERS {
        let (sin, cos) = (f64::from(corner) / f64::from(CORNERS) * std::f64::consts::TAU).sin_cos();
        corners.push([x + radius * cos, y + radius * sin]);
    }
    corners
}

/// What part of each pixel of a box an outline covers, as differences along each row.
struct Cover {
    left: i64,
    top: i64,
    width: usize,
    height: usize,
    changes: Vec<f64>,
}

impl Cover {
    /// Of the box round an outline; `None` of nothing, of what is not finite, and of what is larger than `most`.
    fn of(outline: &[Vec<[f64; 2]>], most: f64) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in outline.iter().flatten() {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if ![low, high].as_flattened().iter().all(|x| x.abs() < most) {
            return None;
        }
        let [left, top] = low.map(whole);
        // A pixel more on either side for what edges hand on to the next.
        let [width, height] = [whole(high[0]) - left + 3, whole(high[1]) - top + 1];
        let (width, height) = (usize::try_from(width).ok()?, usize::try_from(height).ok()?);
        Some(Self { left, top, width, height, changes: vec![0.0; width * height] })
    }

    fn add_edge(&mut self, from: [f64; 2], to: [f64; 2]) {
        let (sign, [x0, y0], [x1, y1]) = if from[1] < to[1] { (1.0, from, to) } else { (-1.0, to, from) };
        let [x0, x1] = [x0, x1].map(|x| x - self.left as f64);
        let [y0, y1] = [y0, y1].map(|y| y - self.top as f64);
        if y1 <= y0 {
            return;
        }
        let slope = (x1 - x0) / (y1 - y0);
        let mut x = x0;
        for row in index(y0)..self.height {
            let (above, below) = (y0.max(row as f64), y1.min(row as f64 + 1.0));
            if below <= above {
                break;
            }
            let next = x + slope * (below - above);
            self.add_piece(row, [x.min(next), x.max(next)], sign * (below - above));
            x = next;
        }
    }

    /// A piece of an edge in a row, from left to right, with the height that it covers.
    fn add_piece(&mut self, row: usize, [from, to]: [f64; 2], height: f64) {
        let (first, last) = (index(from), index(to));
        let mut covered = 0.0;
        for column in first..=last {
            let (begin, end) = (from.max(column as f64), to.min(column as f64 + 1.0));
            let here = if to > from { height * (end - begin) / (to - from) } else { height };
            // What lies right of the piece within this pixel, and then all of it from the next one on.
            let right = here * (column as f64 + 1.0 - f64::midpoint(begin, end));
            self.change(row, column, right);
            self.change(row, column + 1, here - right);
            covered += here;
            if to <= from {
                break;
            }
        }
        debug_assert!((covered - height).abs() < 1e-6, "{covered} of {height}");
    }

    fn change(&mut self, row: usize, column: usize, by: f64) {
        if let Some(change) = self.changes.get_mut(row * self.width + column) {
            *change += by;
        }
    }

    /// Hands out the pixels that are covered, and how far.
    fn each(&self, mut pixel: impl FnMut(i64, i64, f64)) {
        for (y, row) in (self.top..).zip(self.changes.chunks(self.width.max(1)).take(self.height)) {
            let mut sum = 0.0;
            for (x, change) in (self.left..).zip(row) {
                sum += change;
                // Less is rounding.
                if sum.abs() > 1e-4 {
                    pixel(x, y, sum.abs().min(1.0));
                }
            }
        }
    }
}

/// The whole number below; what is no number is 0.
fn whole(x: f64) -> i64 {
    #[expect(clippy::cast_possible_truncation, reason = "places in a picture; the cast keeps to the ends")]
    let whole = x.floor() as i64;
    whole
}

/// The same as a number of a row or column.
fn index(x: f64) -> usize {
    usize::try_from(whole(x)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_covers_its_area() {
        let mut pixels = Pixels::new(4, 3, [0; 3]);
        pixels.rectangle([1.0, 0.5], [1.5, 1.5], [200; 3]);
        let reds = |y: usize| pixels.row(y).iter().map(|color| color[0]).collect::<Vec<u8>>();
        assert_eq!([reds(0), reds(1), reds(2)], [[0, 100, 50, 0], [0, 200, 100, 0], [0; 4]].map(Vec::from));
    }

    #[test]
    fn a_slope_covers_half_of_what_it_crosses() {
        let mut pixels = Pixels::new(4, 4, [0; 3]);
        pixels.fill(&[vec![[0.0, 0.0], [4.0, 4.0], [0.0, 4.0]]], [200; 3]);
        let total: u32 = pixels.bytes().iter().step_by(3).map(|byte| u32::from(*byte)).sum();
        assert_eq!(total, 8 * 200);
        assert_eq!(pixels.row(2)[2], [100; 3]);
    }

    #[test]
    fn what_is_outside_or_no_number_is_not_drawn() {
        let mut pixels = Pixels::new(2, 2, [7; 3]);
        let before = pixels.clone();
        for far in [1e12, -1e12, f64::NAN] {
            pixels.rectangle([far, 0.0], [1.0, 1.0], [0; 3]);
        }
        pixels.rectangle([-3.0, -3.0], [2.0, 2.0], [0; 3]);
        assert_eq!(pixels, before);
    }

    #[test]
    fn letters_leave_their_inside_open() {
        let mut pixels = Pixels::new(60, 60, [255; 3]);
        pixels.words("O", [5.0, 50.0], (Typeface::Bold, 60.0), [0; 3]);
        assert_eq!(pixels.row(28)[28], [255; 3], "the middle of an O");
        assert!(pixels.bytes().contains(&0));
    }
}
