//! Surfaces as pixels: the near hides the far, in every pixel by itself, so that surfaces may run through each other.
//!
//! A depth buffer with several samples for each pixel. Values and normals are mixed between the corners of a triangle, and
//! a value becomes a colour in each sample: colours mixed between corners would be none of the map.

use super::colors::{Rgb, mixed, viridis};
use super::flat::lit;
use super::legend::Range;
use super::pixels::Pixels;
use super::view::View;
use crate::model::{Figure, SurfaceMesh, Tube, TubeShell};
use crate::model::{Sheet, Side, Structure, TriangleMesh, normals};
use crate::space::{WorldPoint, WorldVector};

/// Samples of a pixel along each axis: with two, edges show steps; with four it takes twice as long as with three.
const SAMPLES: usize = 3;
/// The mask where no figure hides it.
pub const BARE: Rgb = [214, 216, 221];
/// How much of its colour a sample keeps beside an edge.
const EDGE_SHADE: f64 = 0.55;
/// A step towards the eye between neighbouring samples is an edge from this share of the picture's size on. Smaller, and
/// slopes are full of edges; larger, and an organ before another has none.
const EDGE_STEP: f64 = 0.03;
const WHITE: Rgb = [255; 3];
const BLACK: Rgb = [0; 3];

/// Surfaces in the world, with a thickness at their corners.
#[derive(Clone, Debug, Default)]
pub struct Solid {
    corners: Vec<Corner>,
    triangles: Vec<[usize; 3]>,
    /// How many of the triangles are of figures; those after them are of masks.
    of_figures: usize,
}

#[derive(Clone, Copy, Debug)]
struct Corner {
    at: WorldPoint,
    normal: WorldVector,
    /// mm; no number where there is none.
    thickness_mm: f64,
}

/// Where a picture of a solid lies in its view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Pixels along each axis.
    pub size_px: [usize; 2],
    /// What is in the middle of the picture, mm to the right and upwards.
    pub center_mm: [f64; 2],
    /// Pixels per mm.
    pub scale: f64,
}

impl Solid {
    /// The surfaces of structures: figures, and the masks behind them.
    #[must_use]
    pub fn of<'a>(structures: impl IntoIterator<Item = &'a Structure> + Clone) -> Self {
        let mut solid = Self::default();
        for structure in structures.clone() {
            for figure in &structure.figures {
                match figure {
                    Figure::Sheet(sheet) => solid.add_sheet(sheet),
                    Figure::Tube(tube) => solid.add_tube(tube),
                }
            }
        }
        solid.of_figures = solid.triangles.len();
        for structure in structures {
            solid.add_mask(&structure.object);
        }
        solid
    }

    /// Both sides of a sheet and the rim between them, with the thickness of the node.
    fn add_sheet(&mut self, sheet: &Sheet) {
        let mut totals = sheet.total_mm();
        for (node, total) in totals.iter_mut().enumerate() {
            if sheet.is_marred(node) {
                *total = f64::NAN;
            }
        }
        let surfaces = [sheet.side_mesh(Side::Upper), sheet.side_mesh(Side::Lower), sheet.crest_mesh()];
        for surface in surfaces.into_iter().flatten() {
            self.add_surface(&surface, &totals);
        }
    }

    /// The wall of a tube and its ends.
    fn add_tube(&mut self, tube: &Tube) {
        let mut totals = tube.total_mm();
        for (node, total) in totals.iter_mut().enumerate() {
            if tube.is_marred(node) {
                *total = f64::NAN;
            }
        }
        if let Some(wall) = tube.wall_mesh() {
            self.add_surface(&wall, &totals);
        }
        let (rows, cols) = (tube.grid.rows, tube.grid.cols);
        for (tip, col) in TubeShell::from(tube).fans() {
            let mut fan = SurfaceMesh::default();
            let Some(&center) = tube.centreline.get(col) else { continue };
            let outward = tip - center;
            fan.mesh.positions = vec![tip];
            fan.normals = vec![outward.try_normalize(1e-9).unwrap_or_else(WorldVector::z)];
            fan.nodes = vec![col];
            for row in 0..rows {
                let node = row * cols + col;
                let Some(&wall) = tube.wall.get(node) else { continue };
                fan.mesh.positions.push(wall);
                fan.normals.push((wall - center + outward).try_normalize(1e-9).unwrap_or_else(WorldVector::z));
                fan.nodes.push(node);
            }
            let count = fan.nodes.len() - 1;
            for row in 0..count {
                let [a, b] = [row, (row + 1) % count].map(|row| u32::try_from(row + 1).unwrap_or(0));
                fan.mesh.triangles.push([0, a, b]);
            }
            self.add_surface(&fan, &totals);
        }
    }

    fn add_surface(&mut self, surface: &SurfaceMesh, values: &[f64]) {
        let first = self.corners.len();
        let places = surface.mesh.positions.iter().zip(&surface.normals).zip(&surface.nodes);
        for ((at, normal), node) in places {
            let thickness_mm = values.get(*node).copied().unwrap_or(f64::NAN);
            self.corners.push(Corner { at: *at, normal: *normal, thickness_mm });
        }
        self.triangles.extend(surface.mesh.triangles.iter().map(|corners| corners.map(|n| first + n as usize)));
    }

    fn add_mask(&mut self, mesh: &TriangleMesh) {
        let triangles: Vec<[usize; 3]> = mesh.triangles.iter().map(|corners| corners.map(|n| n as usize)).collect();
        let first = self.corners.len();
        for (at, normal) in mesh.positions.iter().zip(normals(&mesh.positions, &triangles, None)) {
            self.corners.push(Corner { at: *at, normal, thickness_mm: f64::NAN });
        }
        self.triangles.extend(triangles.iter().map(|corners| corners.map(|n| first + n)));
    }

    /// The smallest and largest coordinates in a view, mm to the right and upwards; `None` of nothing that is finite.
    #[must_use]
    pub fn bounds(&self, view: &View) -> Option<[[f64; 2]; 2]> {
        let mut bounds: Option<[[f64; 2]; 2]> = None;
        for corner in self.triangles.iter().flatten().map(|n| &self.corners[*n]) {
            let [x, y, z] = view.project(corner.at);
            if ![x, y, z].iter().all(|x| x.is_finite()) {
                continue;
            }
            let [low, high] = bounds.get_or_insert([[x, y]; 2]);
            *low = [low[0].min(x), low[1].min(y)];
            *high = [high[0].max(x), high[1].max(y)];
        }
        bounds
    }

    /// The picture, on white. Thickness has the colours of `range`, which [`Legend::Map`](super::Legend) tells.
    #[must_use]
    pub fn picture(&self, view: &View, frame: Frame, range: Range) -> Pixels {
        let [width, height] = frame.size_px;
        let mut samples = Samples::new([width * SAMPLES, height * SAMPLES]);
        let (figures, masks) = self.triangles.split_at(self.of_figures.min(self.triangles.len()));
        let scale = frame.scale * SAMPLES as f64;
        for (layer, triangles) in [(Layer::Figure, figures), (Layer::Mask, masks)] {
            for triangle in triangles {
                let corners = triangle.map(|n| Seen::of(&self.corners[n], view, frame.center_mm, scale, &samples));
                samples.add(corners, layer, range);
            }
            samples.end_layer();
        }
        samples.picture()
    }
}

/// A corner in a picture.
#[derive(Clone, Copy)]
struct Seen {
    /// Samples to the right and downwards, and towards the eye.
    at: [f64; 3],
    normal: [f64; 3],
    thickness_mm: f64,
}

impl Seen {
    fn of(corner: &Corner, view: &View, center_mm: [f64; 2], scale: f64, samples: &Samples) -> Self {
        let [x, y, z] = view.project(corner.at);
        let [width, height] = samples.size.map(|count| count as f64);
        Self {
            at: [width / 2.0 + scale * (x - center_mm[0]), height / 2.0 - scale * (y - center_mm[1]), scale * z],
            normal: view.project_vector(corner.normal),
            thickness_mm: corner.thickness_mm,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Layer {
    Figure,
    Mask,
}

/// The samples of a picture.
struct Samples {
    size: [usize; 2],
    /// Towards the eye; −∞ where nothing is.
    near: Vec<f64>,
    colors: Vec<Rgb>,
    /// Whether an earlier layer has a sample: later ones lie behind it.
    is_taken: Vec<bool>,
}

impl Samples {
    fn new(size: [usize; 2]) -> Self {
        let count = size[0] * size[1];
        Self { size, near: vec![f64::NEG_INFINITY; count], colors: vec![WHITE; count], is_taken: vec![false; count] }
    }

    /// Draws a triangle where it is nearer than what was drawn before.
    fn add(&mut self, corners: [Seen; 3], layer: Layer, range: Range) {
        let [a, b, c] = corners.map(|corner| corner.at);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        // Seen edge-on, or no number.
        if area == 0.0 || !area.is_finite() || !(a[2] + b[2] + c[2]).is_finite() {
            return;
        }
        let [left, right] = span([a[0], b[0], c[0]], self.size[0]);
        let [top, bottom] = span([a[1], b[1], c[1]], self.size[1]);
        for y in top..bottom {
            for x in left..right {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let opposite =
                    |p: [f64; 3], q: [f64; 3]| ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) / area;
                let shares = [opposite(b, c), opposite(c, a), opposite(a, b)];
                if shares.iter().all(|share| *share >= 0.0) {
                    self.put(y * self.size[0] + x, &corners, shares, (layer, range));
                }
            }
        }
    }

    fn put(&mut self, place: usize, corners: &[Seen; 3], shares: [f64; 3], (layer, range): (Layer, Range)) {
        let mix =
            |value: fn(&Seen) -> f64| corners.iter().zip(shares).map(|(own, share)| share * value(own)).sum::<f64>();
        let near = mix(|corner| corner.at[2]);
        if self.is_taken[place] || near <= self.near[place] {
            return;
        }
        let color = match layer {
            Layer::Mask => BARE,
            Layer::Figure => viridis(range.share(mix(|corner| corner.thickness_mm))),
        };
        let normal = [mix(|own| own.normal[0]), mix(|own| own.normal[1]), mix(|own| own.normal[2])];
        self.near[place] = near;
        self.colors[place] = lit(color, WorldVector::from(normal));
    }

    /// Later triangles lie behind those that were drawn so far.
    fn end_layer(&mut self) {
        for (is_taken, near) in self.is_taken.iter_mut().zip(&self.near) {
            *is_taken = near.is_finite();
        }
    }

    /// Whether something nearer begins beside a sample.
    fn is_edge(&self, x: usize, y: usize) -> bool {
        let [width, height] = self.size;
        let step = EDGE_STEP * width.max(height) as f64;
        let own = self.near[y * width + x];
        if own == f64::NEG_INFINITY {
            return false;
        }
        let beside = [(x + 1, y), (x.wrapping_sub(1), y), (x, y + 1), (x, y.wrapping_sub(1))];
        beside.into_iter().any(|(x, y)| x < width && y < height && own - self.near[y * width + x] > step)
    }

    /// The means of the samples of each pixel.
    fn picture(&self) -> Pixels {
        let [width, height] = self.size.map(|count| count / SAMPLES);
        let mut pixels = Pixels::new(width, height, WHITE);
        for y in 0..height {
            for x in 0..width {
                let mut sums = [0_usize; 3];
                for n in 0..SAMPLES * SAMPLES {
                    let (x, y) = (x * SAMPLES + n % SAMPLES, y * SAMPLES + n / SAMPLES);
                    let own = self.colors[y * self.size[0] + x];
                    let color = if self.is_edge(x, y) { mixed(BLACK, own, EDGE_SHADE) } else { own };
                    sums.iter_mut().zip(color).for_each(|(sum, part)| *sum += usize::from(part));
                }
                let mean = sums.map(|sum| u8::try_from(sum / (SAMPLES * SAMPLES)).unwrap_or(u8::MAX));
                pixels.set(x, y, mean);
            }
        }
        pixels
    }
}

/// The samples that lie between the least and the largest of three places, first and beyond the last.
fn span(places: [f64; 3], count: usize) -> [usize; 2] {
    let low = places.into_iter().fold(f64::INFINITY, f64::min);
    let high = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "kept within the picture")]
    let [first, last] = [low.floor(), high.ceil()].map(|place| place.clamp(0.0, count as f64) as usize);
    [first, last]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::colors::NO_THICKNESS;

    /// A square of 2 mm at a height, with a thickness.
    fn add_square(solid: &mut Solid, (x, z): (f64, f64), thickness_mm: f64) {
        let mut surface = SurfaceMesh::default();
        for (dx, dy) in [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)] {
            surface.mesh.positions.push(WorldPoint::new(x + dx, dy, z));
            surface.normals.push(WorldVector::z());
            surface.nodes.push(0);
        }
        surface.mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
        solid.add_surface(&surface, &[thickness_mm]);
        solid.of_figures = solid.triangles.len();
    }

    fn shot(solid: &Solid, view: View) -> Pixels {
        let frame = Frame { size_px: [40, 20], center_mm: [0.0, 1.0], scale: 10.0 };
        solid.picture(&view, frame, Range { low_mm: 0.0, high_mm: 10.0, is_exceeded: [false; 2] })
    }

    fn from_above() -> View {
        View::new(WorldVector::z(), WorldVector::y()).expect("two directions")
    }

    #[test]
    fn the_near_hides_the_far_whatever_comes_first() {
        for order in [[0, 1], [1, 0]] {
            let mut solid = Solid::default();
            for n in order {
                add_square(&mut solid, [(-1.0, 0.0), (0.0, 5.0)][n], [0.0, 10.0][n]);
            }
            let pixels = shot(&solid, from_above());
            let [low, high] = [0.0, 1.0].map(|share| lit(viridis(share), WorldVector::z()));
            assert_eq!([pixels.row(10)[0], pixels.row(10)[15], pixels.row(10)[30]], [WHITE, low, high]);
        }
    }

    #[test]
    fn the_mask_is_seen_where_no_figure_hides_it() {
        let mut solid = Solid::default();
        add_square(&mut solid, (0.0, 0.0), f64::NAN);
        let corners = [[-2.0, 0.0], [2.0, 0.0], [2.0, 2.0], [-2.0, 2.0]];
        let positions = corners.map(|[x, y]| WorldPoint::new(x, y, 9.0)).to_vec();
        solid.add_mask(&TriangleMesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]] });
        let pixels = shot(&solid, from_above());
        let [bare, none] = [BARE, NO_THICKNESS].map(|color| lit(color, WorldVector::z()));
        assert_eq!([pixels.row(10)[10], pixels.row(10)[30]], [bare, none]);
        assert_eq!(solid.bounds(&from_above()), Some([[-2.0, 0.0], [2.0, 2.0]]));
    }

    #[test]
    fn nothing_and_what_is_no_number_are_pictures_too() {
        let mut solid = Solid::default();
        assert_eq!(solid.bounds(&from_above()), None);
        add_square(&mut solid, (f64::NAN, 0.0), 1.0);
        assert_eq!(shot(&solid, from_above()), Pixels::new(40, 20, WHITE));
        assert_eq!(solid.bounds(&from_above()), None);
    }
}
