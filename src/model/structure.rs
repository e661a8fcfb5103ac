//! A whole result, and one label's part of it.

use serde::{Deserialize, Serialize};

use super::figure::{Figure, Sheet};
use super::meshes::TriangleMesh;
use super::quality::{Coverage, StructureQuality};
use super::refusal::Refusal;
use super::stage::StageTimings;
use super::tube::Tube;
use super::warning::Warning;
use crate::params::CheckedParams;
use crate::space::{LabelCode, WorldFromVoxel, WorldPoint};

/// Where figures meet: sheets at a hinge, tubes at a fork, portions of a solid at a cut.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Junction {
    /// Indices of the figures that meet.
    pub figures: Vec<usize>,
    /// Points of the hinge, centres of the open ends of tubes, or points of the cut.
    pub points: Vec<WorldPoint>,
}

/// How the sheets of the medial surface were pruned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pruning {
    /// Strength, 0 to 1.
    pub strength: f64,
    /// Share of the object's volume that a sheet must account for to be kept.
    pub loss_needed: f64,
    /// Sheets that were pruned.
    pub pruned: usize,
}

/// A part of a label that touches no other: one of a pair of organs, or all of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LabelPart {
    /// Its voxels.
    pub voxels: u64,
    /// Its figures; none when it is refused.
    pub figures: Vec<usize>,
    /// Share of its voxels that they stand for.
    pub kept_share: f64,
    /// How well they fit it.
    pub coverage: Coverage,
    /// Why it has no medial representation.
    pub refusal: Option<Refusal>,
}

/// One label's result.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Structure {
    /// Its value in the file.
    pub label: i64,
    /// What it is called: by the parameter `names`, else by the file.
    pub name: Option<String>,
    /// The colour that the file gives it: red, green, blue.
    pub color: Option<[u8; 3]>,
    /// What it is, by the code that the file gives it.
    #[serde(default, with = "code")]
    pub code: Option<LabelCode>,
    /// Voxels with that value.
    pub voxels: u64,
    /// Their volume.
    pub volume_mm3: f64,
    /// Edge of the isotropic working voxel, mm.
    pub working_voxel_mm: f64,
    /// Edges of the voxels that the mask was made on, along the axes of the file, mm: those of the file, or larger ones
    /// where it repeats them.
    #[serde(default)]
    pub grain_mm: [f64; 3],
    /// The parts that were worked on, the largest first.
    #[serde(default)]
    pub parts: Vec<LabelPart>,
    /// The figures, those of the first part first and of each part the largest first; empty when refused.
    pub figures: Vec<Figure>,
    /// Where they meet.
    pub junctions: Vec<Junction>,
    /// How the medial surface was pruned.
    pub pruning: Pruning,
    /// How good it is.
    pub quality: StructureQuality,
    /// What its reader should know.
    pub warnings: Vec<Warning>,
    /// Why there is no medial representation.
    pub refusal: Option<Refusal>,
    /// The smooth outer surface of the mask.
    pub object: TriangleMesh,
    /// Wall time of each stage.
    pub timings: StageTimings,
}

/// A whole result: one structure per label.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Model {
    /// The parameters used.
    #[serde(skip)]
    pub params: CheckedParams,
    /// Where the input's voxels lie.
    #[serde(with = "affine")]
    pub world_from_voxel: WorldFromVoxel,
    /// Voxels of the input along each axis.
    pub dims: [usize; 3],
    /// One per label, ascending, or in the order asked for.
    pub structures: Vec<Structure>,
}

impl Structure {
    /// Its sheets, in the order of the figures.
    pub fn sheets(&self) -> impl Iterator<Item = &Sheet> {
        self.figures.iter().filter_map(Figure::as_sheet)
    }

    /// Its tubes, in the order of the figures.
    pub fn tubes(&self) -> impl Iterator<Item = &Tube> {
        self.figures.iter().filter_map(Figure::as_tube)
    }

    /// The sheets of a part.
    pub fn sheets_of_part(&self, part: usize) -> impl Iterator<Item = &Sheet> {
        self.sheets().filter(move |sheet| sheet.part == part)
    }

    /// How many parts of the label have figures.
    #[must_use]
    pub fn components(&self) -> usize {
        self.parts.iter().filter(|part| !part.figures.is_empty()).count()
    }
}

/// The map from voxels to the world as its rows, checked again when it is read.
mod affine {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    use crate::space::WorldFromVoxel;

    pub fn serialize<S: Serializer>(map: &WorldFromVoxel, serializer: S) -> Result<S::Ok, S::Error> {
        map.rows().serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<WorldFromVoxel, D::Error> {
        let [x, y, z, _] = <[[f64; 4]; 4]>::deserialize(deserializer)?;
        WorldFromVoxel::from_rows([x, y, z]).map_err(D::Error::custom)
    }
}

/// A code as its three texts: space knows no serialisation.
mod code {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use crate::space::LabelCode;

    pub fn serialize<S: Serializer>(code: &Option<LabelCode>, serializer: S) -> Result<S::Ok, S::Error> {
        code.as_ref().map(|code| [&code.value, &code.scheme, &code.meaning]).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<LabelCode>, D::Error> {
        let texts = Option::<[String; 3]>::deserialize(deserializer)?;
        Ok(texts.map(|[value, scheme, meaning]| LabelCode { value, scheme, meaning }))
    }
}
