//! What a verdict is worth: a plate with known faults in it, how wrong its thickness comes out, and what the verdict says.
//!
//! The thickness that the mask has is known from the faults' areas. What the program makes of it is told relative to the
//! plate without faults, so that the rim of the plate is in neither.

use medialrep::model::{Coverage, Kept, Structure, Verdict};
use medialrep::params::{GridChoice, Params};
use medialrep::pipeline::PipelineError;
use medialrep::samples::by_name;
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel};

use super::run_of;
use super::shapes::{CASES, counted, roughened};

/// The plate: where it begins, and how long, wide and thick it is, voxels.
const FIRST: usize = 8;
const SIZE: [usize; 3] = [64, 44, 8];
/// Its lattice.
const GRID: GridChoice = GridChoice::Fixed { rows: 12, cols: 20 };

/// A fault of a mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// A second plate, half as thick, that touches it nowhere.
    Piece,
    /// A fin of one voxel on its longer side.
    Fin,
    /// A slit of one voxel in its middle plane, open at its end.
    Slit,
    /// A cavity of three voxels in its middle plane.
    Cavity,
    /// Voxels of its boundary that are flipped.
    Noise,
    /// A lattice with fewer nodes along each axis.
    Lattice,
    /// Sheets of a cross that are left out.
    LeftOut,
}

/// A fault in some size, and what came of it.
pub struct Row {
    /// What is wrong.
    pub fault: Fault,
    /// How much: voxels over those of the plate, flipped over boundary voxels, nodes or sheets left over all.
    pub amount: f64,
    /// Mean thickness over that of the mask, less one; no number of what is refused.
    pub mean_error: f64,
    /// The refusal's code, or what the program says of itself.
    pub outcome: Result<Said, String>,
}

/// What the program says of a result.
pub struct Said {
    /// The verdict.
    pub verdict: Verdict,
    /// The codes that speak against it.
    pub reasons: Vec<String>,
    /// The fit.
    pub coverage: Coverage,
    /// The label's voxels.
    pub kept: Kept,
}

/// All faults in all sizes.
pub fn rows() -> Vec<Row> {
    let cases: [(Fault, &[f64]); 7] = [
        // From 0.02 on it has a figure.
        (Fault::Piece, &[0.01, 0.018, 0.045, 0.1, 0.3]),
        (Fault::Fin, &[0.004, 0.008, 0.016, 0.04, 0.08]),
        (Fault::Slit, &[0.006, 0.012, 0.03, 0.06]),
        // One that holds more is a lumen, and no fault.
        (Fault::Cavity, &[0.001, 0.004, 0.02, 0.045]),
        (Fault::Noise, &[0.0, 0.05, 0.15, 0.3]),
        (Fault::Lattice, &[0.5, 0.25]),
        (Fault::LeftOut, &[0.25, 0.5, 0.75]),
    ];
    let plain = thickness(&run(&plate(Fault::Noise, 0.0), GRID).expect("a plate has a sheet"));
    let mut rows = Vec::new();
    for (fault, amounts) in cases {
        for &amount in amounts {
            rows.push(row(fault, amount, plain));
        }
    }
    rows
}

fn row(fault: Fault, amount: f64, plain: f64) -> Row {
    let outcome = match fault {
        Fault::LeftOut => cross(amount),
        Fault::Lattice => run(&plate(fault, amount), coarser(amount)),
        _ => run(&plate(fault, amount), GRID),
    };
    let truth = if fault == Fault::LeftOut { thickness_of_cross() } else { plain * true_ratio(fault, amount) };
    match outcome {
        Ok(structure) => {
            Row { fault, amount, mean_error: thickness(&structure) / truth - 1.0, outcome: Ok(said(structure)) }
        }
        Err(code) => Row { fault, amount, mean_error: f64::NAN, outcome: Err(code) },
    }
}

fn said(structure: Structure) -> Said {
    let quality = structure.quality;
    Said {
        verdict: quality.verdict,
        reasons: quality.reasons.iter().map(|reason| reason.code.to_string()).collect(),
        coverage: quality.coverage,
        kept: quality.kept,
    }
}

fn run(volume: &LabelVolume, grid: GridChoice) -> Result<Structure, String> {
    run_with(volume, Params { grid, margin: Some(0.02), ..Params::default() })
}

fn run_with(volume: &LabelVolume, params: Params) -> Result<Structure, String> {
    match run_of(volume, params) {
        Ok(mut model) => Ok(model.structures.remove(0)),
        Err(PipelineError::Refused(refusal)) => Err(refusal.code().to_owned()),
        Err(PipelineError::Cancelled(_)) => unreachable!("nobody cancels"),
    }
}

/// A cross of four sheets of which a share is left out.
fn cross(amount: f64) -> Result<Structure, String> {
    let sample = by_name("cross").expect("a sample of that name");
    let kept = whole(4.0 * (1.0 - amount));
    run_with(&CASES[0].mask(&sample), Params { grid: GRID, max_figures: Some(kept), ..Params::default() })
}

/// All its sheets are as thick.
fn thickness_of_cross() -> f64 {
    let sample = by_name("cross").expect("a sample of that name");
    let whole = run_with(&CASES[0].mask(&sample), Params { grid: GRID, ..Params::default() });
    thickness(&whole.expect("a cross has sheets"))
}

fn coarser(share: f64) -> GridChoice {
    GridChoice::Fixed { rows: whole(12.0 * share), cols: whole(20.0 * share) }
}

fn thickness(structure: &Structure) -> f64 {
    structure.thickness_summary().total_mm.expect("sheets with an area").mean
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small numbers above nought")]
fn whole(number: f64) -> usize {
    number.round() as usize
}

/// How long a fault is that runs all across the plate and holds this share of its voxels.
fn length(amount: f64, thickness: usize) -> usize {
    whole(amount * (SIZE[0] * SIZE[2]) as f64 / thickness as f64)
}

/// Mean thickness of the mask with its fault over that of the plate, by area.
fn true_ratio(fault: Fault, amount: f64) -> f64 {
    let (whole, full) = (SIZE[0] as f64, SIZE[2] as f64);
    let of = |thickness: usize| length(amount, thickness) as f64;
    // Lengths of what is added with its thickness, and of what is split with the sum of its walls.
    let (added, thin, split, walls) = match fault {
        Fault::Piece => (of(4), 4.0, 0.0, 0.0),
        Fault::Fin => (of(1), 1.0, 0.0, 0.0),
        Fault::Slit => (0.0, 0.0, of(1), full - 1.0),
        Fault::Cavity => (0.0, 0.0, of(3) * 0.5, full - 3.0),
        _ => return 1.0,
    };
    ((whole - split) * full + added * thin + split * walls) / (whole + added + split) / full
}

/// The plate with a fault. A cavity is half as wide as the plate and twice as long as one that runs across it would be.
fn plate(fault: Fault, amount: f64) -> LabelVolume {
    let ends = [0, 1, 2].map(|axis| FIRST + SIZE[axis]);
    let is_plate = |at: [usize; 3]| (0..3).all(|axis| (FIRST..ends[axis]).contains(&at[axis]));
    let is_across = |at: [usize; 3]| (FIRST..ends[1]).contains(&at[1]);
    let middle = FIRST + SIZE[2] / 2;
    let inside = |at: [usize; 3]| match fault {
        Fault::Piece => {
            let along = ends[0] + 4..ends[0] + 4 + length(amount, 4);
            is_plate(at) || (along.contains(&at[0]) && is_across(at) && (middle..middle + 4).contains(&at[2]))
        }
        Fault::Fin => {
            let along = ends[0]..ends[0] + length(amount, 1);
            is_plate(at) || (along.contains(&at[0]) && is_across(at) && at[2] == middle)
        }
        Fault::Slit => is_plate(at) && !(at[0] >= ends[0] - length(amount, 1) && at[2] == middle),
        Fault::Cavity => {
            let (along, across) = (FIRST + 6..FIRST + 6 + length(amount, 3), FIRST + 11..FIRST + 33);
            let is_cavity =
                along.contains(&at[0]) && across.contains(&at[1]) && (middle - 2..middle + 1).contains(&at[2]);
            is_plate(at) && !is_cavity
        }
        _ => is_plate(at),
    };
    let dims = [ends[0] + 64, ends[1] + FIRST, ends[2] + FIRST];
    let mut indices = Grid::filled(dims, 0u16);
    for offset in 0..indices.as_slice().len() {
        indices.as_mut_slice()[offset] = u16::from(inside(indices.index(offset)));
    }
    let volume = counted(indices, WorldFromVoxel::axis_aligned([1.0; 3], [0.0; 3]).expect("a box"));
    if fault == Fault::Noise && amount > 0.0 { roughened(&volume, amount) } else { volume }
}

/// As a table in Markdown.
pub fn to_markdown(rows: &[Row]) -> String {
    let mut text =
        "| fault | amount | mean is off by | verdict | kept | filled | closed | Dice | far | reasons |\n".to_owned();
    text += &format!("|{}\n", "---|".repeat(10));
    for row in rows {
        let start = format!("| {} | {:.3} |", title(row.fault), row.amount);
        text += &match &row.outcome {
            Err(code) => format!("{start} – | refused: `{code}` | | | | | | |\n"),
            Ok(said) => format!(
                "{start} {:+.1} % | {} | {:.3} | {:.3} | {:.3} | {:.2} | {:.2} | {} |\n",
                100.0 * row.mean_error,
                said.verdict.name(),
                said.kept.kept,
                said.kept.filled,
                said.kept.closed,
                said.coverage.dice,
                said.coverage.far_share,
                said.reasons.join(", "),
            ),
        };
    }
    text
}

fn title(fault: Fault) -> &'static str {
    match fault {
        Fault::Piece => "a second piece, half as thick",
        Fault::Fin => "a fin of one voxel",
        Fault::Slit => "a slit of one voxel",
        Fault::Cavity => "a cavity of three voxels",
        Fault::Noise => "boundary voxels flipped",
        Fault::Lattice => "nodes along each axis, of 12 × 20",
        Fault::LeftOut => "sheets of a cross left out",
    }
}
