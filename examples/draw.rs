//! Draws a thickness.json as an SVG picture: on the left the two sides round the medial sheet,
//! on the right the sheet with its thickness vectors, both coloured by thickness.
//!
//!     cargo run --release --example draw -- thickness.json out.svg [AZIMUTH ELEVATION]
//!
//! The angles are degrees: azimuth 0 looks along +y, from behind the patient; 90 along −x,
//! from the patient's right.

use std::fmt::Write;

use anyhow::{Context, ensure};
use medialrep::formats::colors::viridis_srgb;
use nalgebra::{Point2, Point3, Vector3};
use serde_json::Value;

/// Size of a panel, and room below for the legend, in SVG units.
const PANEL: f64 = 420.0;
const GAP: f64 = 24.0;
const LEGEND: f64 = 64.0;
/// From where light comes: right, up, towards the viewer.
const LIGHT: [f64; 3] = [-0.4, 0.6, 0.7];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    ensure!(matches!(arguments.len(), 2 | 4), "usage: draw thickness.json out.svg [AZIMUTH ELEVATION]");
    let document: Value = serde_json::from_slice(&std::fs::read(&arguments[0])?)?;
    let angle = |n: usize, default: f64| arguments.get(n).map_or(Ok(default), |text| text.parse());
    let view = View::new(angle(2, 120.0)?, angle(3, 25.0)?);
    let figures = read_figures(&document).context("this is no thickness.json")?;
    ensure!(!figures.is_empty(), "there is no figure to draw");
    std::fs::write(&arguments[1], picture(&figures, &view))?;
    Ok(())
}

/// What is drawn of a figure.
struct Figure {
    rows: usize,
    cols: usize,
    medial: Vec<Point3<f64>>,
    sides: [Vec<Point3<f64>>; 2],
    crest: Vec<Point3<f64>>,
    valid: Vec<bool>,
}

fn read_figures(document: &Value) -> Option<Vec<Figure>> {
    let mut figures = Vec::new();
    for structure in document["structures"].as_array()? {
        for figure in structure["figures"].as_array()? {
            let size = |name: &str| usize::try_from(figure["grid"][name].as_u64()?).ok();
            figures.push(Figure {
                rows: size("rows")?,
                cols: size("cols")?,
                medial: points(&figure["medial"])?,
                sides: [points(&figure["upper"])?, points(&figure["lower"])?],
                crest: points(&figure["crest"])?,
                valid: figure["valid"].as_array()?.iter().map(|valid| valid == true).collect(),
            });
        }
    }
    Some(figures)
}

fn points(list: &Value) -> Option<Vec<Point3<f64>>> {
    let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
    let point = |p: &Value| Point3::new(number(&p[0]), number(&p[1]), number(&p[2]));
    Some(list.as_array()?.iter().map(point).collect())
}

/// An orthographic camera: right, up and towards the viewer, in the world.
struct View {
    axes: [Vector3<f64>; 3],
}

impl View {
    fn new(azimuth_deg: f64, elevation_deg: f64) -> Self {
        let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
        let toward = Vector3::new(sin_a * cos_e, -cos_a * cos_e, sin_e);
        let right = Vector3::new(cos_a, sin_a, 0.0);
        Self { axes: [right, toward.cross(&right), toward] }
    }

    fn see(&self, v: Vector3<f64>) -> Vector3<f64> {
        Vector3::from(self.axes.map(|axis| axis.dot(&v)))
    }
}

/// Something flat, and how near it is.
struct Shape {
    depth: f64,
    svg: String,
}

/// From what the camera sees, mm, to a panel.
struct Frame<'a> {
    view: &'a View,
    center: Point2<f64>,
    scale: f64,
    middle: Point2<f64>,
}

impl Frame<'_> {
    fn place(&self, point: &Point3<f64>) -> (Point2<f64>, f64) {
        let seen = self.view.see(point.coords);
        let x = self.middle.x + (seen.x - self.center.x) * self.scale;
        let y = self.middle.y - (seen.y - self.center.y) * self.scale;
        (Point2::new(x, y), seen.z)
    }

    fn polygon(&self, corners: &[&Point3<f64>], color: [f64; 3], opacity: f64) -> Shape {
        let placed: Vec<_> = corners.iter().map(|corner| self.place(corner)).collect();
        let across = |a: usize, b: usize| self.view.see(corners[b] - corners[a]);
        let normal = across(0, 2).cross(&across(1, 3)).try_normalize(1e-12).unwrap_or_else(Vector3::z);
        let light = 0.68 + 0.4 * normal.dot(&Vector3::from(LIGHT).normalize()).abs();
        let color = hex(color.map(|channel| channel * light));
        let mut path = String::new();
        for (n, (at, _)) in placed.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if n == 0 { "M" } else { "L" }, at.x, at.y);
        }
        // A hair of its own colour hides the seams between neighbours.
        let svg = if opacity < 1.0 {
            format!("<path d=\"{path}Z\" fill=\"{color}\" fill-opacity=\"{opacity}\"/>\n")
        } else {
            format!("<path d=\"{path}Z\" fill=\"{color}\" stroke=\"{color}\"/>\n")
        };
        Shape { depth: placed.iter().map(|(_, depth)| depth).sum::<f64>() / placed.len() as f64, svg }
    }

    fn line(&self, from: &Point3<f64>, to: &Point3<f64>, color: &str) -> Shape {
        let ((a, a_depth), (b, b_depth)) = (self.place(from), self.place(to));
        let svg = format!(
            "<path stroke=\"{color}\" stroke-width=\"1\" d=\"M{:.1} {:.1}L{:.1} {:.1}\"/>\n",
            a.x, a.y, b.x, b.y
        );
        Shape { depth: (a_depth + b_depth) / 2.0, svg }
    }
}

fn hex(color: [f64; 3]) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    let [r, g, b] = color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Lowest and highest thickness of either side, mm.
fn thickness_range(figures: &[Figure]) -> (f64, f64) {
    let mut range = (f64::INFINITY, f64::NEG_INFINITY);
    for figure in figures {
        for n in (0..figure.medial.len()).filter(|n| figure.valid[*n]) {
            for side in &figure.sides {
                let thickness = (side[n] - figure.medial[n]).norm();
                range = (range.0.min(thickness), range.1.max(thickness));
            }
        }
    }
    range
}

fn picture(figures: &[Figure], view: &View) -> String {
    let everything = figures.iter().flat_map(|f| f.medial.iter().chain(&f.sides[0]).chain(&f.sides[1]).chain(&f.crest));
    let seen: Vec<Vector3<f64>> = everything.map(|p| view.see(p.coords)).filter(|p| p.x.is_finite()).collect();
    let low = seen.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let high = seen.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(p));
    let size = high - low;
    let scale = (PANEL - 2.0 * GAP) / size.x.max(size.y);
    let height = size.y * scale + 2.0 * GAP;
    let (shortest, longest) = thickness_range(figures);
    let color = |thickness: f64| viridis_srgb((thickness - shortest) / (longest - shortest).max(1e-9));
    let mut shapes = Vec::new();
    for panel in 0..2 {
        let middle = Point2::new(PANEL * (f64::from(panel) + 0.5), height / 2.0);
        let center = Point2::new((low.x + high.x) / 2.0, (low.y + high.y) / 2.0);
        let frame = Frame { view, center, scale, middle };
        let mut drawn = Vec::new();
        for figure in figures {
            if panel == 0 {
                draw_sides(figure, &frame, &color, &mut drawn)
            } else {
                draw_vectors(figure, &frame, &mut drawn)
            }
            draw_sheet(figure, &frame, &color, &mut drawn);
        }
        drawn.sort_by(|a: &Shape, b: &Shape| a.depth.total_cmp(&b.depth));
        shapes.extend(drawn);
    }
    let body: String = shapes.into_iter().map(|shape| shape.svg).collect();
    page(height, &body, &legend(height, shortest, longest))
}

fn quads(figure: &Figure) -> impl Iterator<Item = [usize; 4]> + '_ {
    let cols = figure.cols;
    let cells = (1..figure.rows).flat_map(move |i| (1..cols).map(move |j| i * cols + j));
    cells.map(move |d| [d - cols - 1, d - cols, d, d - 1]).filter(|cell| cell.iter().all(|n| figure.valid[*n]))
}

fn draw_sheet(figure: &Figure, frame: &Frame, color: &impl Fn(f64) -> [f64; 3], drawn: &mut Vec<Shape>) {
    for cell in quads(figure) {
        let mean = cell.iter().flat_map(|n| figure.sides.iter().map(|side| (side[*n] - figure.medial[*n]).norm()));
        let corners = cell.map(|n| &figure.medial[n]);
        drawn.push(frame.polygon(&corners, color(mean.sum::<f64>() / 8.0), 1.0));
    }
}

fn draw_sides(figure: &Figure, frame: &Frame, color: &impl Fn(f64) -> [f64; 3], drawn: &mut Vec<Shape>) {
    for side in &figure.sides {
        for cell in quads(figure) {
            let mean = cell.iter().map(|n| (side[*n] - figure.medial[*n]).norm()).sum::<f64>() / 4.0;
            drawn.push(frame.polygon(&cell.map(|n| &side[n]), color(mean), 0.42));
        }
    }
    let edge = ring(figure);
    if edge.len() != figure.crest.len() {
        return;
    }
    for here in 0..edge.len() {
        let next = (here + 1) % edge.len();
        if figure.valid[edge[here]] && figure.valid[edge[next]] {
            for side in &figure.sides {
                let corners = [&side[edge[here]], &side[edge[next]], &figure.crest[next], &figure.crest[here]];
                drawn.push(frame.polygon(&corners, [0.72; 3], 0.35));
            }
        }
    }
}

fn draw_vectors(figure: &Figure, frame: &Frame, drawn: &mut Vec<Shape>) {
    for n in (0..figure.medial.len()).filter(|n| figure.valid[*n]) {
        for (side, color) in figure.sides.iter().zip(["#c2410c", "#475569"]) {
            drawn.push(frame.line(&figure.medial[n], &side[n], color));
        }
    }
}

/// The nodes round the edge, in the order of the crest.
fn ring(figure: &Figure) -> Vec<usize> {
    let grid = medialrep::pipeline::params::LatticeSize { rows: figure.rows, cols: figure.cols };
    medialrep::pipeline::model::ring(grid)
}

fn legend(top: f64, shortest: f64, longest: f64) -> String {
    const STEPS: u8 = 40;
    let (left, width, y) = (PANEL * 0.62, PANEL * 0.76, top + 8.0);
    let mut text = String::from("<g text-anchor=\"middle\">\n");
    for step in 0..STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let (x, color) = (left + share * width, hex(viridis_srgb(share)));
        // A little wider than its step, against seams.
        let step_width = width / f64::from(STEPS) + 0.5;
        let _ = writeln!(
            text,
            "<rect x=\"{x:.1}\" y=\"{y:.0}\" width=\"{step_width:.1}\" height=\"10\" fill=\"{color}\"/>"
        );
    }
    for share in [0.0, 0.5, 1.0] {
        let (x, value) = (left + share * width, shortest + share * (longest - shortest));
        let _ = writeln!(text, "<text x=\"{x:.0}\" y=\"{:.0}\">{value:.1}</text>", y + 24.0);
    }
    let _ = writeln!(text, "<text x=\"{PANEL:.0}\" y=\"{:.0}\">thickness of a side, mm</text>\n</g>", y + 42.0);
    text
}

fn page(height: f64, body: &str, legend: &str) -> String {
    let (width, height) = (2.0 * PANEL, height + LEGEND);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         font-family=\"sans-serif\" font-size=\"12\" stroke-width=\"0.5\" \
         stroke-linejoin=\"round\">\n\
         <rect width=\"100%\" height=\"100%\" rx=\"8\" fill=\"#fff\"/>\n{body}{legend}</svg>\n"
    )
}
