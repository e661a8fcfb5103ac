//! Stage 8: how far a result can be trusted. Everything is measured on the nodes that are handed
//! out, against the mask on the working grid.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Point3};

use crate::numerics::field::floor_index;
use crate::space::Grid;

use super::depth::Depth;
use super::mask::Solid;
use super::model::{DistanceSummary, FigureQuality, PerSurface, Reason, StructureQuality, Verdict, ring};
use super::params::LatticeSize;
use super::spokes::Nodes;

/// Distance between the samples of the model's surface, voxels.
const SAMPLE_STEP: f64 = 0.7;
/// Thresholds of the verdict: `(warn, fail)`.
const DICE: (f64, f64) = (0.90, 0.75);
/// Share of the mask's surface within one voxel of the model's.
const COVERED: (f64, f64) = (0.80, 0.50);
/// 95th percentile of the distance from the mask's surface to the model's, voxels.
const FAR_VOXELS: (f64, f64) = (3.0, 8.0);
/// ISOMAP residual variance of any surface.
const RESIDUAL: (f64, f64) = (0.05, 0.20);
/// Spacing variation of the medial lattice.
const SPACING: (f64, f64) = (0.10, 0.40);

/// Quality of one figure: legality of its cells and evenness of its lattice.
#[must_use]
pub fn figure_quality(nodes: &Nodes, residual_variance: PerSurface<f64>) -> FigureQuality {
    let mut quality = FigureQuality {
        residual_variance,
        spacing_variation: spacing_variation(nodes.size, &nodes.medial),
        valid_share: nodes.valid.iter().filter(|v| **v).count() as f64 / nodes.valid.len().max(1) as f64,
        ..FigureQuality::default()
    };
    for (is_upper, skin) in [(true, &nodes.upper), (false, &nodes.lower)] {
        let corners = corner_signs(nodes.size, &nodes.medial, skin, &nodes.valid);
        let positive = corners.iter().filter(|c| c.2 > 0.0).count();
        let expected = if 2 * positive >= corners.len() { 1.0 } else { -1.0 };
        quality.corners += corners.len();
        for (i, j, jacobian) in corners {
            if jacobian * expected <= 0.0 {
                quality.folds += 1;
                if quality.folded_cells.last() != Some(&(is_upper, i, j)) {
                    quality.folded_cells.push((is_upper, i, j));
                }
            }
        }
    }
    quality
}

/// The Jacobian at the eight corners of every cell between two node grids, with the cell.
fn corner_signs(
    size: LatticeSize,
    medial: &[Point3<f64>],
    skin: &[Point3<f64>],
    valid: &[bool],
) -> Vec<(usize, usize, f64)> {
    let mut corners = Vec::new();
    for (i, j) in cells(size) {
        let quad = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(di, dj)| (i + di) * size.cols + j + dj);
        if quad.iter().any(|&n| !valid[n]) {
            continue;
        }
        for layer in [medial, skin] {
            for (k, &n) in quad.iter().enumerate() {
                let along_i = layer[quad[2 | (k & 1)]] - layer[quad[k & 1]];
                let along_j = layer[quad[(k & 2) | 1]] - layer[quad[k & 2]];
                corners.push((i, j, along_i.cross(&along_j).dot(&(skin[n] - medial[n]))));
            }
        }
    }
    corners
}

fn cells(size: LatticeSize) -> impl Iterator<Item = (usize, usize)> {
    (0..size.rows - 1).flat_map(move |i| (0..size.cols - 1).map(move |j| (i, j)))
}

/// Mean over lattice lines, rows and columns alike, of the coefficient of variation of their
/// edge lengths.
fn spacing_variation(size: LatticeSize, nodes: &[Point3<f64>]) -> f64 {
    let line = |indices: Vec<usize>| {
        let edges: Vec<f64> = indices.windows(2).map(|p| (nodes[p[1]] - nodes[p[0]]).norm()).collect();
        let mean = edges.iter().sum::<f64>() / edges.len() as f64;
        let variance = edges.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / edges.len() as f64;
        variance.sqrt() / mean.max(1e-12)
    };
    let LatticeSize { rows, cols } = size;
    let along: f64 = (0..rows).map(|i| line((0..cols).map(|j| i * cols + j).collect())).sum();
    let across: f64 = (0..cols).map(|j| line((0..rows).map(|i| i * cols + j).collect())).sum();
    (along / rows as f64 + across / cols as f64) / 2.0
}

/// Quality of a structure from all its figures.
#[must_use]
pub fn structure_quality(
    solid: &Solid,
    depth: &Depth,
    figures: &[Nodes],
    qualities: &[FigureQuality],
) -> StructureQuality {
    let samples: Vec<Point3<f64>> = figures.iter().flat_map(surface_samples).collect();
    let skin: Vec<Point3<f64>> = depth.skin.iter().map(|s| s.position).collect();
    let to_model = distances(&skin, &samples);
    let to_mask = distances(&samples, &skin);
    let mut quality = StructureQuality {
        dice: dice(&solid.mask, figures),
        folds: qualities.iter().map(|q| q.folds).sum(),
        covered_share: to_model.iter().filter(|d| **d <= 1.0).count() as f64 / to_model.len().max(1) as f64,
        mask_to_model: summary(to_model, solid.voxel_mm),
        model_to_mask: summary(to_mask, solid.voxel_mm),
        ..StructureQuality::default()
    };
    judge(&mut quality, qualities, solid.voxel_mm);
    quality
}

fn judge(quality: &mut StructureQuality, figures: &[FigureQuality], voxel_mm: f64) {
    let worst = |f: &dyn Fn(&FigureQuality) -> f64| figures.iter().map(f).fold(0.0, f64::max);
    let residual = worst(&|f| f.residual_variance.named().iter().map(|r| *r.1).fold(0.0, f64::max));
    let invalid = worst(&|f| 1.0 - f.valid_share);
    let mut findings = Vec::new();
    if quality.folds > 0 {
        let message = format!("thickness vectors cross: {} corners of cells are turned over", quality.folds);
        findings.push((Verdict::Fail, Reason { code: "folds", message, value: quality.folds as f64, threshold: 0.0 }));
    }
    let measures = [
        ("dice", "overlap of the cells with the mask", -quality.dice, (-DICE.0, -DICE.1)),
        ("covered_share", "share of the mask's surface covered", -quality.covered_share, (-COVERED.0, -COVERED.1)),
        (
            "surface_distance",
            "95 % distance from the mask's surface, voxels",
            quality.mask_to_model.p95_mm / voxel_mm,
            FAR_VOXELS,
        ),
        ("residual_variance", "residual variance of the flattening", residual, RESIDUAL),
        ("spacing_variation", "unevenness of the lattice", worst(&|f| f.spacing_variation), SPACING),
        ("invalid_nodes", "share of nodes off the sheet", invalid, (0.0, 0.5)),
    ];
    for (code, what, value, (warn, fail)) in measures {
        let (verdict, threshold) = if value > fail { (Verdict::Fail, fail) } else { (Verdict::Warn, warn) };
        if value > threshold {
            let (value, threshold) = (value.abs(), threshold.abs());
            let message = format!("{what} is {value:.3}, the threshold is {threshold:.3}");
            findings.push((verdict, Reason { code, message, value, threshold }));
        }
    }
    quality.verdict = findings.iter().map(|f| f.0).max().unwrap_or_default();
    quality.reasons = findings.into_iter().map(|f| f.1).collect();
}

/// Distance from each of `from` to the nearest of `to`; infinite when there is none.
fn distances(from: &[Point3<f64>], to: &[Point3<f64>]) -> Vec<f64> {
    let rows: Vec<[f64; 3]> = to.iter().map(|p| [p.x, p.y, p.z]).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&rows) else {
        return vec![f64::INFINITY; from.len()];
    };
    if to.is_empty() {
        return vec![f64::INFINITY; from.len()];
    }
    let one = |p: &Point3<f64>| tree.query(&[p.x, p.y, p.z]).nearest_one::<SquaredEuclidean<f64>>().execute().distance;
    from.iter().map(|p| one(p).max(0.0).sqrt()).collect()
}

fn summary(mut voxels: Vec<f64>, voxel_mm: f64) -> DistanceSummary {
    voxels.sort_by(f64::total_cmp);
    let Some(&largest) = voxels.last() else { return DistanceSummary::default() };
    let rank = floor_index(0.95 * (voxels.len() - 1) as f64);
    DistanceSummary {
        mean_mm: voxels.iter().sum::<f64>() / voxels.len() as f64 * voxel_mm,
        p95_mm: voxels[rank] * voxel_mm,
        max_mm: largest * voxel_mm,
    }
}

/// Overlap of the mask with the union of all cells and crest wedges.
fn dice(mask: &Grid<bool>, figures: &[Nodes]) -> f64 {
    let mut covered = Grid::filled(mask.dims(), false);
    for nodes in figures {
        for tet in tetrahedra(nodes) {
            fill(&mut covered, &tet);
        }
    }
    let (mut both, mut sum) = (0usize, 0usize);
    for (m, c) in mask.as_slice().iter().zip(covered.as_slice()) {
        both += usize::from(*m && *c);
        sum += usize::from(*m) + usize::from(*c);
    }
    2.0 * both as f64 / sum.max(1) as f64
}

type Tetrahedron = [Point3<f64>; 4];

/// All cells and crest wedges, cut into tetrahedra.
fn tetrahedra(nodes: &Nodes) -> Vec<Tetrahedron> {
    let mut all = Vec::new();
    let cols = nodes.size.cols;
    let edge = ring(nodes.size);
    for skin in [&nodes.upper, &nodes.lower] {
        let m = &nodes.medial;
        for (i, j) in cells(nodes.size) {
            let [a, b, c, d] = [i * cols + j, i * cols + j + 1, (i + 1) * cols + j, (i + 1) * cols + j + 1];
            if [a, b, c, d].iter().all(|&n| nodes.valid[n]) {
                all.extend(prism([m[a], m[b], m[d]], [skin[a], skin[b], skin[d]]));
                all.extend(prism([m[a], m[d], m[c]], [skin[a], skin[d], skin[c]]));
            }
        }
        for k in 0..edge.len() {
            let next = (k + 1) % edge.len();
            let (a, b) = (edge[k], edge[next]);
            if nodes.valid[a] && nodes.valid[b] {
                all.extend(prism([m[a], skin[a], nodes.crest[k]], [m[b], skin[b], nodes.crest[next]]));
            }
        }
    }
    all
}

/// Three tetrahedra between two triangles.
fn prism([a, b, c]: [Point3<f64>; 3], [d, e, f]: [Point3<f64>; 3]) -> [Tetrahedron; 3] {
    [[a, b, c, d], [b, c, d, e], [c, d, e, f]]
}

/// Marks the voxels whose centres lie in a tetrahedron.
fn fill(covered: &mut Grid<bool>, [o, a, b, c]: &Tetrahedron) {
    /// Points this much outside count as inside, so that no voxel falls between two cells.
    const SEAM: f64 = 1e-9;
    let Some(inverse) = Matrix3::from_columns(&[a - o, b - o, c - o]).try_inverse() else { return };
    let dims = covered.dims();
    let bounds: [(usize, usize); 3] = std::array::from_fn(|x| {
        let all = [o[x], a[x], b[x], c[x]];
        let low = all.iter().copied().fold(f64::INFINITY, f64::min).ceil().max(0.0);
        let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max).floor().min((dims[x] - 1) as f64);
        if high < low { (1, 0) } else { (floor_index(low), floor_index(high)) }
    });
    for k in bounds[2].0..=bounds[2].1 {
        for j in bounds[1].0..=bounds[1].1 {
            for i in bounds[0].0..=bounds[0].1 {
                let w = inverse * (Point3::new(i as f64, j as f64, k as f64) - o);
                if w.min() >= -SEAM && w.sum() <= 1.0 + SEAM {
                    covered[[i, j, k]] = true;
                }
            }
        }
    }
}

/// Points spread over the outer surface of a figure: upper, lower and the crest strips.
fn surface_samples(nodes: &Nodes) -> Vec<Point3<f64>> {
    let mut samples = Vec::new();
    let cols = nodes.size.cols;
    let edge = ring(nodes.size);
    for skin in [&nodes.upper, &nodes.lower] {
        for (i, j) in cells(nodes.size) {
            let quad = [i * cols + j, i * cols + j + 1, (i + 1) * cols + j, (i + 1) * cols + j + 1];
            if quad.iter().all(|&n| nodes.valid[n]) {
                sample_quad(quad.map(|n| skin[n]), &mut samples);
            }
        }
        for k in 0..edge.len() {
            let next = (k + 1) % edge.len();
            if nodes.valid[edge[k]] && nodes.valid[edge[next]] {
                sample_quad([skin[edge[k]], skin[edge[next]], nodes.crest[k], nodes.crest[next]], &mut samples);
            }
        }
    }
    samples
}

/// Bilinear samples of a quad given as rows `[a b; c d]`.
fn sample_quad([a, b, c, d]: [Point3<f64>; 4], samples: &mut Vec<Point3<f64>>) {
    /// Samples along an edge at most; a quad of 2 000 voxels is as good as any with these.
    const MOST: usize = 400;
    let pieces = |length: f64| floor_index((length / SAMPLE_STEP).ceil()).clamp(1, MOST);
    let across = pieces((b - a).norm().max((d - c).norm()));
    let down = pieces((c - a).norm().max((d - b).norm()));
    for y in 0..=down {
        let t = y as f64 / down as f64;
        let (left, right) = (a + (c - a) * t, b + (d - b) * t);
        samples.extend((0..=across).map(|x| left + (right - left) * (x as f64 / across as f64)));
    }
}
