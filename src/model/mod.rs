//! The medial representation as plain data: what the pipeline returns and the formats write.

mod lattice;

mod side;

mod stage;

mod warning;

mod refusal;

mod frame;

mod automatic;

mod uncertainty;

mod quality;

mod meshes;

mod figure;

mod shell;

mod closed;

mod patches;

mod tube;

mod tube_patches;

mod body;

mod structure;

mod summary;

pub use automatic::{Automatic, GridFrom, KindEvidence};
pub use body::{Body, FigurePatches};
pub use closed::closed;
pub use figure::{Figure, FlatPoints, Sheet};
pub use frame::{FrameFacts, FrameRule};
pub use lattice::{LatticeSize, Links, ring};
pub use meshes::{SurfaceMesh, TriangleMesh, normals};
pub use patches::Patches;
pub use quality::{
    Coverage, DistanceSummary, Distortion, EmbeddingQuality, FigureQuality, Kept, LatticePlace, MeanAndP95, NodeRepair,
    Reason, Repair, Stretch, StructureQuality, Threshold, Verdict, WorldPlace,
};
pub use refusal::{Refusal, SHAPE_CODES};
pub(crate) use shell::{EdgeStep, quad_area};
pub use shell::{FLANK, Flanks, Quad, Shell, straight_flanks};
pub use side::{PerSurface, Side};
pub use stage::{Stage, StageTimings};
pub use structure::{Junction, LabelPart, Model, Pruning, Structure};
pub use summary::{LengthSummary, ThicknessSummary, node_areas};
pub use tube::{Tube, TubeSection, TubeShell, TubeSummary, WallSummary, WallUncertainty, opposite_sums};
pub use tube_patches::TubePatches;
pub use uncertainty::Uncertainty;
pub use warning::Warning;
