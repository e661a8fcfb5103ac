//! The paper's figures 5, 6 and 7, drawn from stand-ins: with the paper's parameters, and with the defaults.
//!
//! `examples/paper.rs` writes what is made here to `docs/paper.md` and `docs/paper/`; a test makes it again.

pub mod solids;

pub mod rows;

pub mod pictures;

pub mod document;

use medialrep::model::Structure;
use medialrep::params::{Correspondence, GridChoice, Kinds, Landmarks, LatticeKind, Neighbors, Params};
use medialrep::pipeline::PipelineError;
use medialrep::samples::{Sample, Solid};
use medialrep::space::LabelVolume;
use nalgebra::Rotation3;

use super::run_of;
use super::shapes::PHASE;

/// What a figure of the paper shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// The medial sheet with its vectors.
    Sheet,
    /// The same, and both surfaces.
    Surfaces,
    /// The points of several sheets.
    Points,
}

/// Whom a point of a surface is joined with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joined {
    /// Its k nearest.
    Nearest(usize),
    /// All within so many voxels.
    Within(u8),
}

/// A figure of the paper, of one of its subjects.
pub struct Figure {
    /// Its number in the paper.
    pub number: u8,
    /// What it is of, and the word that names masks of it.
    pub subject: &'static str,
    /// What it shows.
    pub shows: Shows,
    /// The neighbourhood that the paper names.
    pub joined: Joined,
    /// The stand-in.
    pub sample: fn() -> Sample,
    /// Edge of its voxels, mm.
    pub voxel_mm: f64,
}

/// All of them.
pub const FIGURES: [Figure; 5] = [
    Figure {
        number: 5,
        subject: "thalamus",
        shows: Shows::Sheet,
        joined: Joined::Nearest(8),
        sample: solids::thalamus,
        voxel_mm: 0.75,
    },
    Figure {
        number: 5,
        subject: "caudate",
        shows: Shows::Sheet,
        joined: Joined::Nearest(8),
        sample: solids::caudate,
        voxel_mm: 1.0,
    },
    Figure {
        number: 6,
        subject: "caudate",
        shows: Shows::Surfaces,
        joined: Joined::Nearest(12),
        sample: solids::caudate,
        voxel_mm: 1.0,
    },
    Figure {
        number: 6,
        subject: "supraspinatus",
        shows: Shows::Surfaces,
        joined: Joined::Nearest(12),
        sample: solids::supraspinatus,
        voxel_mm: 2.0,
    },
    Figure {
        number: 7,
        subject: "artificial object",
        shows: Shows::Points,
        joined: Joined::Within(4),
        sample: solids::finned_plate,
        voxel_mm: 1.0,
    },
];

impl Figure {
    /// `5-thalamus`: the name of its file, and of its place in the document.
    pub fn slug(&self) -> String {
        format!("{}-{}", self.number, self.subject.replace(' ', "-"))
    }

    /// Its neighbourhood as the paper writes it.
    pub fn joined_told(&self) -> String {
        match self.joined {
            Joined::Nearest(count) => format!("k = {count}"),
            Joined::Within(voxels) => format!("ε = {voxels}"),
        }
    }

    /// The mask of the stand-in.
    pub fn stand_in(&self) -> LabelVolume {
        let volume = (self.sample)().voxelise_at([self.voxel_mm; 3], Rotation3::identity(), PHASE);
        volume.expect("fits in memory")
    }
}

/// The paper's own way: three embeddings by exact ISOMAP of that neighbourhood, a rectangle of 6 × 8 over each.
pub fn paper_params(joined: Joined, voxel_mm: f64) -> Params {
    let neighbors = match joined {
        Joined::Nearest(count) => Neighbors::Count(count),
        Joined::Within(voxels) => Neighbors::RadiusMm(f64::from(voxels) * voxel_mm),
    };
    Params {
        grid: GridChoice::Fixed { rows: 6, cols: 8 },
        neighbors,
        landmarks: Landmarks::All,
        lattice: LatticeKind::Regular,
        correspondence: Correspondence::Paper,
        kinds: Kinds::These { sheet: true, tube: false },
        ..Params::default()
    }
}

/// One mask with the paper's parameters, and with the defaults. A refusal is kept as its sentence.
pub struct Pair {
    /// With the paper's.
    pub paper: Result<Structure, String>,
    /// With none.
    pub defaults: Result<Structure, String>,
    /// What the mask was made of, if that is known.
    pub solid: Option<Solid>,
}

impl Pair {
    /// A stand-in.
    pub fn of_stand_in(figure: &Figure) -> Self {
        let solid = (figure.sample)().into_solids().into_iter().next();
        Self { solid, ..Self::of_mask(figure.joined, &figure.stand_in()) }
    }

    /// The largest structure of a mask.
    pub fn of_mask(joined: Joined, mask: &LabelVolume) -> Self {
        let voxel_mm = mask.world_from_voxel().spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let paper = structure_of(mask, paper_params(joined, voxel_mm));
        Self { paper, defaults: structure_of(mask, Params::default()), solid: None }
    }

    /// Both, that of the paper first.
    pub fn both(&self) -> [&Result<Structure, String>; 2] {
        [&self.paper, &self.defaults]
    }
}

fn structure_of(mask: &LabelVolume, params: Params) -> Result<Structure, String> {
    match run_of(mask, params) {
        Ok(model) => Ok(model.structures.into_iter().next().expect("a mask has a label")),
        Err(PipelineError::Refused(refusal)) => Err(refusal.to_string()),
        Err(PipelineError::Cancelled(_)) => unreachable!("nobody cancels"),
    }
}
