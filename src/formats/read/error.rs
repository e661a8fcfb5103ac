//! Why a file is refused. The fields hold numbers and fixed words only: text of a header may
//! name a patient.

use std::borrow::Cow;

use super::dicom::DicomError;
use super::lines::LineFault;
use crate::cancel::Cancelled;
use crate::space::LabelVolumeError;

/// A file that is not read. Every variant has its own stable code.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A format that nothing here reads.
    #[error("the file is not a {read} image{}", .looks_like.map(looking).unwrap_or_default())]
    UnknownFormat {
        /// What it seems to be instead.
        looks_like: Option<Look>,
        /// Names of the formats that are read: `NIfTI`.
        read: String,
        /// The same with what their files' names end in: `NIfTI (.nii or .nii.gz)`.
        read_from: String,
    },
    /// A header whose voxels are in another file.
    #[error("the file is one half of a NIfTI pair (.hdr and .img): its voxels are in another file")]
    TwoFileNifti,
    /// The file ends early.
    #[error("the file is truncated: {expected} bytes are needed, it ends after {got}")]
    Truncated {
        /// Bytes needed, decompressed.
        expected: u64,
        /// Bytes that came, decompressed.
        got: u64,
    },
    /// The gzip stream does not decode.
    #[error("the gzip stream is damaged after {after} decompressed bytes")]
    CorruptGzip {
        /// Bytes that were decoded before.
        after: u64,
    },
    /// The gzip stream decodes to something else than was packed.
    #[error("the gzip checksum does not match: the file was damaged on its way")]
    BadChecksum,
    /// More bytes than the volume can have.
    #[error("the file holds more than {allowed} bytes after its {expected} bytes of header and voxels")]
    TrailingData {
        /// Bytes of header and voxels.
        expected: u64,
        /// Bytes tolerated after them.
        allowed: u64,
    },
    /// A decompression bomb, or a volume larger than allowed.
    #[error("the file is larger than {limit} bytes when decompressed")]
    DecompressedTooLarge {
        /// Bytes allowed.
        limit: u64,
    },
    /// An axis of no or an absurd length.
    #[error("dimension {axis} is {got}, allowed is {allowed}")]
    BadDimensions {
        /// Index into `dim`.
        axis: usize,
        /// The value.
        got: i64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// More voxels than allowed.
    #[error("the volume has {voxels} voxels, allowed are {allowed}")]
    TooManyVoxels {
        /// Voxels.
        voxels: u128,
        /// Voxels allowed.
        allowed: u64,
    },
    /// A series or a vector image.
    #[error("the file holds {count} volumes along dimension {axis}, one is needed")]
    SeveralVolumes {
        /// Index into `dim`.
        axis: usize,
        /// Their number.
        count: i64,
    },
    /// Voxels that are no plain numbers.
    #[error("voxels of datatype {code} ({name}) are not supported")]
    UnsupportedDatatype {
        /// NIfTI's code.
        code: i32,
        /// NIfTI's name.
        name: &'static str,
    },
    /// A header field with a senseless value.
    #[error("header field {field} is {got}, allowed is {allowed}")]
    BadHeaderField {
        /// The field.
        field: &'static str,
        /// The value, a number.
        got: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// No usable orientation.
    #[error("the orientation in {field} is unusable: {reason}")]
    BadAffine {
        /// Where it stands.
        field: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// A line of a header of text that is not as it should be.
    #[error("header line {line}{}: {fault}", in_brackets(.field))]
    HeaderLine {
        /// From 1.
        line: u64,
        /// The field, empty where it is none that is known.
        field: &'static str,
        /// What is wrong.
        fault: LineFault,
    },
    /// A header of text without a line that is needed.
    #[error("the header has no line {field:?}")]
    NoHeaderLine {
        /// The field.
        field: &'static str,
    },
    /// Voxels as text, and one that is no number of their type.
    #[error("what is written before byte {byte} is no number of the type that the header says")]
    BadNumber {
        /// Offset of its end, decompressed.
        byte: u64,
    },
    /// An intensity or probability image.
    #[error("voxel {voxel:?} has the value {value:?}: labels are whole numbers")]
    NotALabelMap {
        /// Where.
        voxel: [u64; 3],
        /// The value after scaling.
        value: f64,
        /// Whether the header scales values.
        is_scaled: bool,
    },
    /// A writer that set the header in one byte order and left the voxels in the other.
    #[error(
        "header and voxels have different byte orders: voxel {voxel:?} is {value:?} in that of the header, {swapped} in the other"
    )]
    WrongByteOrder {
        /// Where.
        voxel: [u64; 3],
        /// The value in the byte order of the header.
        value: f64,
        /// The value in the other.
        swapped: f64,
    },
    /// Segments that overlap so much that they need many layers.
    #[error("segments overlap so much that they need more than {allowed} layers")]
    TooManyLayers {
        /// Layers allowed.
        allowed: usize,
    },
    /// More labels than an index can hold.
    #[error("the volume has more than {allowed} different labels")]
    TooManyLabels {
        /// Labels allowed.
        allowed: usize,
    },
    /// What is wrong with a DICOM file, or not read of it.
    #[error(transparent)]
    Dicom(Box<DicomError>),
    /// The file could not be read at all: our fault or the disk's.
    #[error("reading failed: {0}")]
    Io(std::io::Error),
    /// The reader was told to stop; nothing is known of the file.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// What a file that is not read looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// What it is, with an article.
    pub name: &'static str,
    /// How to get at the file that was meant, where there is a way.
    pub advice: Option<&'static str>,
}

fn in_brackets(field: &str) -> String {
    if field.is_empty() { String::new() } else { format!(" ({field})") }
}

fn looking(like: Look) -> String {
    format!(": it looks like {}", like.name)
}

impl ReadError {
    /// Stable code, snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            // NIfTI was all that was read when the code was fixed.
            Self::UnknownFormat { .. } => "not_nifti",
            Self::TwoFileNifti => "two_file_nifti",
            Self::Truncated { .. } => "truncated",
            Self::CorruptGzip { .. } => "corrupt_gzip",
            Self::BadChecksum => "bad_checksum",
            Self::TrailingData { .. } => "trailing_data",
            Self::DecompressedTooLarge { .. } => "decompressed_too_large",
            Self::BadDimensions { .. } => "bad_dimensions",
            Self::TooManyVoxels { .. } => "too_many_voxels",
            Self::SeveralVolumes { .. } => "several_volumes",
            Self::UnsupportedDatatype { .. } => "unsupported_datatype",
            Self::BadHeaderField { .. } => "bad_header_field",
            Self::BadAffine { .. } => "bad_affine",
            Self::HeaderLine { fault, .. } => fault.code(),
            Self::NoHeaderLine { .. } => "missing_header_line",
            Self::BadNumber { .. } => "bad_number",
            Self::NotALabelMap { .. } => "not_a_label_map",
            Self::WrongByteOrder { .. } => "wrong_byte_order",
            Self::TooManyLabels { .. } => "too_many_labels",
            Self::TooManyLayers { .. } => "too_many_layers",
            Self::Dicom(error) => error.code(),
            Self::Io(_) => "internal",
            Self::Cancelled(_) => "cancelled",
        }
    }

    /// HTTP status: 400 malformed, 413 too large, 415 another format, 422 understood but
    /// impossible.
    #[must_use]
    pub fn status(&self) -> u16 {
        match self {
            Self::HeaderLine { fault, .. } => fault.status(),
            Self::UnknownFormat { .. } | Self::TwoFileNifti => 415,
            Self::Truncated { .. }
            | Self::CorruptGzip { .. }
            | Self::BadChecksum
            | Self::TrailingData { .. }
            | Self::WrongByteOrder { .. }
            | Self::NoHeaderLine { .. }
            | Self::BadNumber { .. }
            | Self::BadDimensions { .. }
            | Self::BadHeaderField { .. } => 400,
            Self::DecompressedTooLarge { .. } | Self::TooManyVoxels { .. } => 413,
            Self::SeveralVolumes { .. }
            | Self::UnsupportedDatatype { .. }
            | Self::BadAffine { .. }
            | Self::NotALabelMap { .. }
            | Self::TooManyLabels { .. }
            | Self::TooManyLayers { .. } => 422,
            Self::Dicom(error) => error.status(),
            Self::Io(_) | Self::Cancelled(_) => 500,
        }
    }

    /// A header field, a line of the header, a path of tags or a byte offset (decompressed).
    #[must_use]
    pub fn location(&self) -> String {
        match self {
            Self::UnknownFormat { .. } => "byte 0".to_owned(),
            Self::TwoFileNifti => "header.magic".to_owned(),
            Self::Truncated { got, .. } => format!("byte {got}"),
            Self::CorruptGzip { after } => format!("byte {after}"),
            Self::BadChecksum => "the gzip trailer".to_owned(),
            Self::TrailingData { expected, .. } => format!("byte {expected}"),
            Self::DecompressedTooLarge { limit } => format!("byte {limit}"),
            Self::BadDimensions { axis, .. } | Self::SeveralVolumes { axis, .. } => format!("header.dim[{axis}]"),
            Self::TooManyVoxels { .. } => "header.dim".to_owned(),
            Self::UnsupportedDatatype { .. } => "header.datatype".to_owned(),
            Self::BadHeaderField { field, .. } | Self::BadAffine { field, .. } => format!("header.{field}"),
            Self::HeaderLine { line, field, .. } => format!("header line {line}{}", in_brackets(field)),
            Self::NoHeaderLine { .. } => "the header".to_owned(),
            Self::BadNumber { byte } => format!("byte {byte}"),
            Self::NotALabelMap { voxel, .. } | Self::WrongByteOrder { voxel, .. } => format!("voxel {voxel:?}"),
            Self::Dicom(error) => error.location(),
            Self::TooManyLabels { .. } | Self::TooManyLayers { .. } | Self::Io(_) | Self::Cancelled(_) => {
                "the voxels".to_owned()
            }
        }
    }

    /// What to do.
    #[must_use]
    pub fn hint(&self) -> Cow<'static, str> {
        let fixed = match self {
            Self::UnknownFormat { looks_like: Some(Look { advice: Some(advice), .. }), read_from, .. } => {
                return format!("{advice}, and send the mask as {read_from}").into();
            }
            Self::UnknownFormat { read_from, .. } => return format!("send the mask as {read_from}").into(),
            Self::Dicom(error) => return error.hint(),
            Self::TwoFileNifti => "save it as a single file (.nii or .nii.gz)",
            Self::Truncated { .. } | Self::CorruptGzip { .. } | Self::BadChecksum => {
                "send the file again; if that does not help, export it again"
            }
            Self::TrailingData { .. } => "export the mask again: its header does not match its content",
            Self::DecompressedTooLarge { .. } | Self::TooManyVoxels { .. } => {
                "crop the volume to the structures of interest, or resample it"
            }
            Self::HeaderLine { fault, .. } => fault.hint(),
            Self::TooManyLayers { .. } => "export segments that overlap as files of their own",
            Self::BadNumber { .. } => "export the mask again, with the encoding raw or gzip",
            Self::BadDimensions { .. } | Self::BadHeaderField { .. } | Self::NoHeaderLine { .. } => {
                "export the mask again, or repair its header with the tool that wrote it"
            }
            Self::SeveralVolumes { .. } => "send one volume: split the series and send the one with the mask",
            Self::UnsupportedDatatype { .. } => "save the mask with an integer datatype, such as uint8 or int16",
            Self::BadAffine { .. } => "set a valid sform or qform (finite, no two axes parallel, spacing in mm)",
            Self::NotALabelMap { is_scaled: true, .. } => {
                "save the labels unscaled, as integers: the header scales its values (scl_slope, scl_inter)"
            }
            Self::WrongByteOrder { .. } => {
                "write the file again with a tool that sets header and voxels in one byte order"
            }
            Self::NotALabelMap { .. } => "threshold it first, and save labels without interpolation",
            Self::TooManyLabels { .. } => "send a label map, not an intensity image",
            Self::Io(_) | Self::Cancelled(_) => "try again later",
        };
        fixed.into()
    }
}

impl From<LabelVolumeError> for ReadError {
    /// A reader hands over what fits together; where it does not, the fault is ours.
    fn from(error: LabelVolumeError) -> Self {
        match error {
            LabelVolumeError::Cancelled(stop) => Self::Cancelled(stop),
            LabelVolumeError::TooManyLabels => Self::TooManyLabels { allowed: usize::from(u16::MAX) },
            error => Self::Io(std::io::Error::other(error)),
        }
    }
}
