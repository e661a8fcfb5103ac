//! Why a shape has no medial representation: an answer, not a failure of the program.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::params::LENGTH_MM;
use crate::space::significant;

/// A shape that is refused by name. Lengths are mm.
#[derive(Clone, Debug, PartialEq, thiserror::Error, Serialize, Deserialize)]
pub enum Refusal {
    /// No voxel has the label.
    #[error("label {label} is not in the mask")]
    LabelMissing {
        /// The label asked for.
        label: i64,
        /// Labels that are there (the first few).
        present: Vec<i64>,
    },
    /// No voxel is foreground.
    #[error("the mask is empty: every voxel is 0")]
    EmptyMask,
    /// Thinner than the grid can resolve.
    #[error("the object is {} mm thick: {voxels:.1} voxels of {} mm", significant(*thickness_mm), significant(*voxel_mm))]
    TooThin {
        /// Largest inscribed diameter, mm.
        thickness_mm: f64,
        /// The same in working voxels.
        voxels: f64,
        /// Working voxel, mm.
        voxel_mm: f64,
        /// A working voxel that would do, mm.
        resolution_mm: f64,
    },
    /// A few voxels, which no organ is.
    #[error("the object is a fragment of {voxels} voxels")]
    Fragment {
        /// Its voxels.
        voxels: usize,
    },
    /// Riddled with cavities none of which is a lumen: filled, it would be thicker than it is.
    #[error(
        "the object is riddled with holes: closed cavities inside it, each too small for a lumen, hold {voxels} voxels, \
         {:.0} % of its own volume", 100.0 * share
    )]
    Hollow {
        /// Voxels in cavities that are neither noise nor a lumen.
        voxels: usize,
        /// The same over the object's own voxels.
        share: f64,
    },
    /// Too few medial points for a sheet.
    #[error("the medial sheet has only {points} points, a lattice needs {needed}")]
    TooSmall {
        /// Points found.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// All three extents alike: a ball has a medial point, not a sheet.
    #[error("the object is a ball of radius {} mm: its medial sheet is shorter than that", significant(*radius_mm))]
    Ball {
        /// Largest inscribed radius.
        radius_mm: f64,
    },
    /// Two extents alike: a tube has a medial curve, not a sheet.
    #[error(
        "the object is a tube of radius {} mm: its medial set is {} mm long and narrower than that radius",
        significant(*radius_mm), significant(*length_mm)
    )]
    Tube {
        /// Length of the medial sheet or curve.
        length_mm: f64,
        /// Largest inscribed radius.
        radius_mm: f64,
    },
    /// Its cross-sections have several curves: it forks, or has a hole.
    #[error("the object is no tube: many of its cross-sections are in several pieces")]
    NoTube,
    /// The sheet has one side only (a Möbius band).
    #[error("the medial sheet has only one side: {conflicts} of its {links} links turn it over")]
    NotOrientable {
        /// Links across which the sides disagree.
        conflicts: usize,
        /// Links in all.
        links: usize,
    },
    /// Holes take too much of the sheet: a lattice over it would lie on nothing there.
    #[error("the medial sheet has holes that take {:.0} % of its area, at most {:.0} % are filled", 100.0 * share, 100.0 * allowed)]
    SheetHasHoles {
        /// Area of the holes over that of the sheet with its holes.
        share: f64,
        /// What is filled at most.
        allowed: f64,
    },
    /// Laying the surface flat would need more memory than is allowed.
    #[error("{method} of {points} points was asked for, at most {limit} are allowed")]
    TooManyPoints {
        /// How it was to be laid flat.
        method: Cow<'static, str>,
        /// Points of the surface.
        points: usize,
        /// Points allowed.
        limit: usize,
    },
    /// The neighbourhood graph would need more memory than there is.
    #[error("the neighbourhood graph would take {needed_mib} MiB of memory, there are {allowed_mib} for it")]
    NeighborhoodTooLarge {
        /// Memory that it needs.
        needed_mib: u64,
        /// Memory that there is for it.
        allowed_mib: u64,
    },
    /// The eigenproblem of the embedding has no answer.
    #[error("the sheet could not be laid flat by {method}: {reason}")]
    NoEmbedding {
        /// How it was to be laid flat.
        method: Cow<'static, str>,
        /// What went wrong.
        reason: String,
    },
    /// The working grid would be larger than allowed.
    #[error("the working grid would have {voxels} voxels, allowed are {allowed}")]
    TooLarge {
        /// Voxels wanted.
        voxels: u64,
        /// Voxels allowed.
        allowed: u64,
        /// A working voxel that would do, mm.
        resolution_mm: f64,
    },
    /// The label lies all around the image, as a background does.
    #[error(
        "label {label} fills {:.0} % of the image and most of each of its faces: it is the background, not an object",
        100.0 * share
    )]
    Background {
        /// Its value.
        label: i64,
        /// Its share of the image's voxels.
        share: f64,
    },
    /// Greys where labels should be.
    #[error(
        "the mask has {labels} labels, {small_labels} of them of a few voxels, and {run_voxels:.1} voxels of a row on \
         end have the same one: it is an image of intensities, not a label map"
    )]
    IntensityImage {
        /// Labels.
        labels: usize,
        /// How many of them have a few voxels.
        small_labels: usize,
        /// Voxels of a row that have the same label on end, in the mean.
        run_voxels: f64,
    },
}

/// The codes that speak of the object's shape, not of the file it came in: all but those of [`Refusal::LabelMissing`],
/// [`Refusal::EmptyMask`], [`Refusal::Background`] and [`Refusal::IntensityImage`].
pub const SHAPE_CODES: [&str; 13] = [
    "too_thin",
    "hollow_object",
    "too_small",
    "fragment",
    "shape_is_a_ball",
    "shape_is_a_tube",
    "shape_is_no_tube",
    "not_orientable",
    "sheet_has_holes",
    "too_many_points",
    "neighborhood_too_large",
    "no_embedding",
    "working_grid_too_large",
];

impl Refusal {
    /// Stable code, snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::LabelMissing { .. } => "label_missing",
            Self::EmptyMask => "empty_mask",
            Self::TooThin { .. } => "too_thin",
            Self::Hollow { .. } => "hollow_object",
            Self::TooSmall { .. } => "too_small",
            Self::Fragment { .. } => "fragment",
            Self::Ball { .. } => "shape_is_a_ball",
            Self::Tube { .. } => "shape_is_a_tube",
            Self::NoTube => "shape_is_no_tube",
            Self::NotOrientable { .. } => "not_orientable",
            Self::SheetHasHoles { .. } => "sheet_has_holes",
            Self::TooManyPoints { .. } => "too_many_points",
            Self::NeighborhoodTooLarge { .. } => "neighborhood_too_large",
            Self::NoEmbedding { .. } => "no_embedding",
            Self::TooLarge { .. } => "working_grid_too_large",
            Self::Background { .. } => "label_is_background",
            Self::IntensityImage { .. } => "intensity_image",
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn hint(&self) -> String {
        match self {
            Self::LabelMissing { present, .. } => format!("ask for one of the labels that are there: {present:?}"),
            Self::EmptyMask => "check the segmentation: send a mask with at least one non-zero voxel".to_owned(),
            Self::TooThin { resolution_mm, .. } if LENGTH_MM.contains(resolution_mm) => {
                format!("send a finer mask, or try resolution_mm {}", significant(*resolution_mm))
            }
            Self::Fragment { .. } => "leave it out: it is a stray piece of a segmentation, or send a finer mask".to_owned(),
            Self::Hollow { .. } => {
                "check the segmentation: send it with its holes filled".to_owned()
            }
            Self::TooThin { .. } => "send a finer mask".to_owned(),
            Self::TooSmall { .. } => "send a finer mask or a larger object, or set a smaller resolution_mm".to_owned(),
            Self::Ball { .. } => "a ball has no medial sheet: let tubes be made (kinds), it is one of two caps".to_owned(),
            Self::Tube { .. } => {
                "a tube has a medial curve, not a sheet: let tubes be made (kinds)".to_owned()
            }
            Self::NoTube => "leave kinds at \"auto\", or let sheets be made too".to_owned(),
            Self::NotOrientable { .. } => "check the segmentation for a bridge that turns the object over".to_owned(),
            Self::SheetHasHoles { .. } => {
                "fill the holes in the segmentation if they are errors, or let the sheet be cut in more parts (max_figures)"
                    .to_owned()
            }
            Self::TooManyPoints { .. } => {
                "leave landmarks at \"auto\" and embedding at \"isomap\", or set a larger resolution_mm".to_owned()
            }
            Self::NeighborhoodTooLarge { .. } => "leave neighbors at \"auto\", or ask for fewer".to_owned(),
            Self::NoEmbedding { .. } => "leave embedding at \"isomap\"".to_owned(),
            Self::Background { .. } => {
                "write the background as 0: change the two over if the mask is inverted; an object that fills its image \
                 needs a border of background"
                    .to_owned()
            }
            Self::IntensityImage { .. } => {
                "threshold the image first; if these are labels, name those to work on (parameter labels)".to_owned()
            }
            Self::TooLarge { resolution_mm, .. } => format!("set resolution_mm to {} or more", significant(*resolution_mm)),
        }
    }
}
