//! Why a DICOM file is refused. Of its text only UIDs are repeated, after a look that they are digits and points: all
//! else may name a patient.

use std::borrow::Cow;

use super::tag::TagPath;
use crate::formats::read::error::ReadError;
use crate::space::significant;

/// A DICOM file that is not read, and where it shows.
#[derive(Debug, thiserror::Error)]
#[error("{fault}")]
pub struct DicomError {
    /// The element; empty where none is meant.
    pub path: TagPath,
    /// What is wrong.
    pub fault: DicomFault,
}

/// What is wrong with a DICOM file.
#[derive(Debug, thiserror::Error)]
pub enum DicomFault {
    /// What no reader could follow.
    #[error("the DICOM data set is malformed near byte {at}: {what}")]
    Malformed {
        /// What is wrong.
        what: &'static str,
        /// Bytes before it, inflated.
        at: u64,
    },
    /// More of something than a segmentation has.
    #[error("the DICOM data set has {what}: allowed are {allowed}")]
    OverLimit {
        /// Of what.
        what: &'static str,
        /// How much is allowed.
        allowed: u64,
    },
    /// An element that is needed.
    #[error("the DICOM data set has no {name}")]
    Missing {
        /// Its name in the standard.
        name: &'static str,
    },
    /// An element with a senseless value.
    #[error("{name} is unusable: allowed is {allowed}")]
    BadValue {
        /// Its name in the standard.
        name: &'static str,
        /// What is allowed.
        allowed: &'static str,
    },
    /// An image, a structure set, a report.
    #[error("the DICOM file is {}no segmentation (SOP class {uid})", before(*.name))]
    NotSegmentation {
        /// What it is, with an article, where that is known.
        name: Option<&'static str>,
        /// UID of its class.
        uid: String,
    },
    /// Pixels that are compressed in a way that is not read.
    #[error("the pixels are in transfer syntax {uid}{}, which is not read", after(*.name))]
    TransferSyntax {
        /// What it is called, where that is known.
        name: Option<&'static str>,
        /// Its UID.
        uid: String,
    },
    /// A type of segmentation with pixels that it cannot have.
    #[error("a {kind} segmentation with {bits} bits a pixel is not read")]
    Encoding {
        /// Its type.
        kind: &'static str,
        /// Bits of a pixel.
        bits: u16,
    },
    /// A slide.
    #[error("the segmentation is of a tiled slide: it has no slices")]
    Tiled {
        /// UID of the series that it refers to.
        series: Option<String>,
    },
    /// A radiograph, or any other image whose place in the patient is not known.
    #[error("frame {frame} has no {what}: where it lies in the patient is not told, as of a radiograph")]
    NoPlace {
        /// The first such frame, from 1.
        frame: usize,
        /// What it lacks.
        what: &'static str,
        /// UID of the series that it refers to.
        series: Option<String>,
    },
    /// As many groups of attributes are needed as there are frames.
    #[error("NumberOfFrames is {frames}, there are {groups} groups of attributes of frames")]
    FrameCount {
        /// As many are said to be there.
        frames: u64,
        /// As many are described.
        groups: u64,
    },
    /// Pixels of another number of bytes than follows from rows, columns and frames.
    #[error("the pixels have {got} bytes: rows, columns and frames need {needed}")]
    PixelLength {
        /// As many are said to be there.
        got: u64,
        /// As many are needed.
        needed: u64,
    },
    /// Frames that do not lie on one grid.
    #[error("frame {frame} has another {what} than the first one")]
    Mixed {
        /// Its number, from 1.
        frame: usize,
        /// What differs.
        what: &'static str,
    },
    /// Slices at unequal distances.
    #[error("frame {frame} is {} mm off even steps of {} mm", significant(*.off_mm), significant(*.step_mm))]
    Uneven {
        /// Its number, from 1.
        frame: usize,
        /// How far it is off.
        off_mm: f64,
        /// The step.
        step_mm: f64,
    },
    /// Slices that do not lie on one another, as with a tilted gantry.
    #[error("frame {frame} is shifted sideways by {} mm against the first one", significant(*.off_mm))]
    Sheared {
        /// Its number, from 1.
        frame: usize,
        /// How far.
        off_mm: f64,
    },
    /// One slice of unknown thickness.
    #[error("the segmentation has one slice and neither SpacingBetweenSlices nor SliceThickness")]
    NoDepth,
    /// A series in time, or a frame that is there twice.
    #[error("frame {frame} has the segment and the position of frame {earlier}")]
    Repeated {
        /// Its number, from 1.
        frame: usize,
        /// That of the other one.
        earlier: usize,
    },
    /// Too many voxels.
    #[error("the volume has {voxels} voxels, allowed are {allowed}")]
    TooManyVoxels {
        /// Voxels, with an empty slice at both ends.
        voxels: u128,
        /// Voxels allowed.
        allowed: u64,
    },
    /// Segments that overlap so much that they need too many layers.
    #[error("segments overlap so much that they need more than {layers} layers")]
    Overlaps {
        /// Layers allowed.
        layers: usize,
    },
    /// A frame that does not decode.
    #[error("frame {frame} does not decode: {what}")]
    CorruptFrame {
        /// Its number, from 1.
        frame: usize,
        /// What is wrong with it.
        what: &'static str,
    },
    /// A data set that does not inflate.
    #[error("the deflated data set is damaged after {after} bytes")]
    CorruptDeflate {
        /// Bytes that were inflated before.
        after: u64,
    },
}

/// A name before what it is not.
fn before(name: Option<&str>) -> String {
    name.map(|name| format!("{name}, ")).unwrap_or_default()
}

/// A name after what stands for it.
fn after(name: Option<&str>) -> String {
    name.map(|name| format!(" ({name})")).unwrap_or_default()
}

impl DicomFault {
    /// At an element.
    pub(super) fn at(self, path: TagPath) -> ReadError {
        ReadError::Dicom(Box::new(DicomError { path, fault: self }))
    }
}

impl DicomError {
    /// Stable code, snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self.fault {
            DicomFault::Malformed { .. } => "dicom_malformed",
            DicomFault::OverLimit { .. } => "dicom_over_limit",
            DicomFault::Missing { .. } => "dicom_element_missing",
            DicomFault::BadValue { .. } => "bad_dicom_value",
            DicomFault::NotSegmentation { .. } => "not_a_segmentation",
            DicomFault::TransferSyntax { .. } => "unsupported_transfer_syntax",
            DicomFault::Encoding { .. } => "unsupported_segmentation",
            DicomFault::Tiled { .. } => "tiled_image",
            DicomFault::NoPlace { .. } => "no_position",
            DicomFault::FrameCount { .. } => "frame_count",
            DicomFault::PixelLength { .. } => "pixel_data_length",
            DicomFault::Mixed { .. } => "mixed_geometry",
            DicomFault::Uneven { .. } => "uneven_slices",
            DicomFault::Sheared { .. } => "sheared_slices",
            DicomFault::NoDepth => "no_slice_spacing",
            DicomFault::Repeated { .. } => "repeated_frame",
            DicomFault::TooManyVoxels { .. } => "too_many_voxels",
            DicomFault::Overlaps { .. } => "too_many_overlaps",
            DicomFault::CorruptFrame { .. } => "corrupt_frame",
            DicomFault::CorruptDeflate { .. } => "corrupt_deflate",
        }
    }

    /// HTTP status: 400 malformed, 413 too large, 422 understood but impossible.
    #[must_use]
    pub fn status(&self) -> u16 {
        match self.fault {
            DicomFault::Malformed { .. }
            | DicomFault::BadValue { .. }
            | DicomFault::FrameCount { .. }
            | DicomFault::PixelLength { .. }
            | DicomFault::CorruptFrame { .. }
            | DicomFault::CorruptDeflate { .. } => 400,
            DicomFault::OverLimit { .. } | DicomFault::TooManyVoxels { .. } | DicomFault::Overlaps { .. } => 413,
            DicomFault::Missing { .. }
            | DicomFault::NotSegmentation { .. }
            | DicomFault::TransferSyntax { .. }
            | DicomFault::Encoding { .. }
            | DicomFault::Tiled { .. }
            | DicomFault::NoPlace { .. }
            | DicomFault::Mixed { .. }
            | DicomFault::Uneven { .. }
            | DicomFault::Sheared { .. }
            | DicomFault::NoDepth
            | DicomFault::Repeated { .. } => 422,
        }
    }

    /// The path of tags, else a byte.
    #[must_use]
    pub fn location(&self) -> String {
        match self.fault {
            _ if !self.path.is_empty() => self.path.to_string(),
            DicomFault::Malformed { at, .. } => format!("byte {at}"),
            DicomFault::CorruptDeflate { after } => format!("byte {after}"),
            _ => "the data set".to_owned(),
        }
    }

    /// What to do.
    #[must_use]
    pub fn hint(&self) -> Cow<'static, str> {
        let fixed = match &self.fault {
            DicomFault::Tiled { series: Some(series) } | DicomFault::NoPlace { series: Some(series), .. } => {
                return format!("{SEND_VOLUME}; it refers to series {series}").into();
            }
            DicomFault::Tiled { .. } | DicomFault::NoPlace { .. } => SEND_VOLUME,
            DicomFault::Malformed { .. } | DicomFault::CorruptFrame { .. } | DicomFault::CorruptDeflate { .. } => {
                "send the file again; if that does not help, export it again"
            }
            DicomFault::OverLimit { .. } => "send the segmentation alone, without what other tools added to it",
            DicomFault::Missing { .. } | DicomFault::BadValue { .. } | DicomFault::FrameCount { .. } => {
                "export the segmentation again, or repair the element with the tool that wrote it"
            }
            DicomFault::NotSegmentation { .. } => "send a segmentation (SEG): convert contours and images to one first",
            DicomFault::TransferSyntax { .. } => {
                "store uncompressed (Explicit VR Little Endian), or as RLE or deflated"
            }
            DicomFault::Encoding { .. } => "store it as BINARY with 1 bit, or as LABELMAP with 8 or 16 bits",
            DicomFault::PixelLength { .. } => {
                "export the segmentation again: its pixels are not those that it describes"
            }
            DicomFault::Mixed { .. } => "split the segmentation: all frames must lie on one grid",
            DicomFault::Uneven { .. } | DicomFault::Sheared { .. } => {
                "resample the images to even, upright slices, and segment or export on those"
            }
            DicomFault::NoDepth => "export it with SpacingBetweenSlices, or segment more than one slice",
            DicomFault::Repeated { .. } => "send one segmentation of one point in time, each frame once",
            DicomFault::TooManyVoxels { .. } => "crop the volume to the structures of interest, or resample it",
            DicomFault::Overlaps { .. } => "send fewer segments at a time",
        };
        fixed.into()
    }
}

const SEND_VOLUME: &str = "send a segmentation of a volume (CT, MR), with the position and orientation of its frames";
