//! What is measured of a result. Nothing that the program says of its nodes is believed but the overlap.

use medialrep::model::{Model, Sheet};
use medialrep::pipeline::PipelineError;
use medialrep::samples::{Sample, Solid, by_name};
use medialrep::space::{WorldPoint, WorldVector};
use serde::{Deserialize, Serialize};

use super::shapes::{CASES, Shape};
use super::{params, run_of};

/// How far a result is from the truth. Lengths are in voxels of the finest spacing; 0 is the truth for all but
/// the counts and the overlap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// Sheets found.
    pub sheets: usize,
    /// Root mean square distance of the medial nodes to the true sheet.
    pub medial: f64,
    /// Root mean square distance of the upper and lower nodes to the true boundary.
    pub skin: f64,
    /// Root mean square relative error of the inscribed radius. Of single sheets only: where sheets meet the
    /// largest ball is not that of either.
    pub radius: Option<f64>,
    /// Mean relative error of the length of the vectors against the true radius, over the middle half of rows
    /// and columns.
    pub vector: f64,
    /// The largest of these errors.
    pub worst: f64,
    /// Of a turned grid: root mean square distance of its nodes from those of the plain one.
    pub drift: Option<f64>,
    /// Corners of cells that are turned over.
    pub folds: usize,
    /// Corners of cells.
    pub corners: usize,
    /// Overlap of the cells with the mask, as the quality report has it.
    pub dice: f64,
}

/// What became of a mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Outcome {
    /// A result.
    Measured(Accuracy),
    /// A refusal, though the shape has a medial sheet.
    Refused {
        /// Its code.
        refused: String,
    },
}

impl Outcome {
    /// What was measured, if there is a result.
    pub fn measured(&self) -> Option<&Accuracy> {
        match self {
            Self::Measured(accuracy) => Some(accuracy),
            Self::Refused { .. } => None,
        }
    }
}

/// A shape in every case, in their order. A turned case drifts from the first one.
pub fn measured(shape: &Shape) -> Vec<Outcome> {
    let sample = by_name(shape.sample).expect("a sample of that name");
    let mut plain = None;
    let mut all = Vec::new();
    for case in &CASES {
        let model = match run_of(&case.mask(&sample), params()) {
            Ok(model) => model,
            Err(PipelineError::Refused(refusal)) => {
                all.push(Outcome::Refused { refused: refusal.code().to_owned() });
                continue;
            }
            Err(PipelineError::Cancelled(_)) => unreachable!("nobody cancels"),
        };
        let mut accuracy = accuracy(&sample, &model, case.voxel_mm());
        let plain = plain.get_or_insert_with(|| model.clone());
        if case.is_turned {
            accuracy.drift = drift(plain, &model).map(|mm| rounded(mm / case.voxel_mm()));
        }
        all.push(Outcome::Measured(accuracy));
    }
    all
}

fn accuracy(sample: &Sample, model: &Model, voxel_mm: f64) -> Accuracy {
    let (solid, structure) = (&sample.solids()[0], &model.structures[0]);
    let sheets: Vec<&Sheet> = structure.sheets().collect();
    let (mut medial, mut skin, mut radius, mut vector) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut folds, mut corners) = (0, 0);
    for &figure in &sheets {
        medial.extend(figure.medial.iter().map(|p| solid.to_sheet_mm(*p) / voxel_mm));
        skin.extend(figure.upper.iter().chain(&figure.lower).map(|p| solid.signed_mm(*p) / voxel_mm));
        radius.extend(figure.medial.iter().zip(&figure.medial_radius_mm).map(|(p, r)| r / solid.radius_mm(*p) - 1.0));
        vector.extend(vector_errors(solid, figure));
        let (bad, all) = folded_corners(figure);
        folds += bad;
        corners += all;
    }
    let is_single = solid.sheets() == 1;
    Accuracy {
        sheets: sheets.len(),
        medial: rounded(rms(medial)),
        skin: rounded(rms(skin)),
        radius: is_single.then(|| rounded(rms(radius))),
        vector: rounded(vector.iter().sum::<f64>() / vector.len() as f64),
        worst: rounded(vector.iter().copied().fold(0.0, f64::max)),
        drift: None,
        folds,
        corners,
        dice: rounded(structure.quality.coverage.dice),
    }
}

/// Four decimals: a tenth of a micrometre at 1 mm. More would change with every machine's sine.
fn rounded(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

/// Relative errors of the lengths of both vectors of the inner nodes.
pub fn vector_errors(solid: &Solid, figure: &Sheet) -> Vec<f64> {
    let (rows, cols) = (figure.grid.rows, figure.grid.cols);
    let mut errors = Vec::new();
    for i in rows / 4..rows - rows / 4 {
        for j in cols / 4..cols - cols / 4 {
            let n = i * cols + j;
            let true_mm = solid.radius_mm(figure.medial[n]);
            for end in [figure.upper[n], figure.lower[n]] {
                errors.push(((end - figure.medial[n]).norm() / true_mm - 1.0).abs());
            }
        }
    }
    errors
}

/// Corners of the cells of a figure that are turned over, and all of them. The right sign is that of the most,
/// with the lower side counted the other way round.
pub fn folded_corners(figure: &Sheet) -> (usize, usize) {
    let (mut positive, mut negative, mut all) = (0, 0, 0);
    for (skin, sign) in [(&figure.upper, 1.0), (&figure.lower, -1.0)] {
        for i in 0..figure.grid.rows - 1 {
            for j in 0..figure.grid.cols - 1 {
                for volume in corner_volumes(figure, skin, i, j) {
                    positive += usize::from(sign * volume > 0.0);
                    negative += usize::from(sign * volume < 0.0);
                    all += 1;
                }
            }
        }
    }
    (all - positive.max(negative), all)
}

/// Signed volumes that the edges span at the eight corners of a cell; none with an invalid node.
fn corner_volumes(figure: &Sheet, skin: &[WorldPoint], i: usize, j: usize) -> Vec<f64> {
    let node = |di: usize, dj: usize| (i + di) * figure.grid.cols + j + dj;
    let corners = [(0, 0), (0, 1), (1, 0), (1, 1)];
    if corners.iter().any(|&(di, dj)| !figure.valid[node(di, dj)]) {
        return Vec::new();
    }
    let mut volumes = Vec::new();
    for layer in [&figure.medial[..], skin] {
        for (di, dj) in corners {
            let down: WorldVector = layer[node(1, dj)] - layer[node(0, dj)];
            let along = layer[node(di, 1)] - layer[node(di, 0)];
            let across = skin[node(di, dj)] - figure.medial[node(di, dj)];
            volumes.push(down.cross(&along).dot(&across));
        }
    }
    volumes
}

/// Mean distance of the sheets of one result from those of another that come nearest, mm. `None` when they are
/// not as many.
pub fn drift(one: &Model, other: &Model) -> Option<f64> {
    let [one, other] = [one, other].map(|model| model.structures[0].sheets().collect::<Vec<_>>());
    if one.len() != other.len() {
        return None;
    }
    let nearest = one.iter().map(|a| other.iter().map(|b| figure_drift(a, b)).fold(f64::INFINITY, f64::min));
    Some(nearest.sum::<f64>() / one.len() as f64)
}

/// Root mean square distance between the nodes of two figures, mm.
pub fn figure_drift(a: &Sheet, b: &Sheet) -> f64 {
    let mut distances = Vec::new();
    for (from, to) in [(&a.medial, &b.medial), (&a.upper, &b.upper), (&a.lower, &b.lower)] {
        distances.extend(from.iter().zip(to).map(|(p, q)| (p - q).norm()));
    }
    rms(distances)
}

/// Root mean square; 0 of nothing.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0.0), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}
