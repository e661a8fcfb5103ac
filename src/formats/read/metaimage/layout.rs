//! What the voxels are and how they are written: the header checked field by field, but for their place in the world.

use super::header::LAST_FIELD;
use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Fields, Line, LineFault};
use crate::formats::read::stored::{ByteOrder, Datatype, Layers, Packing, Stored, voxels_of};

const SINGLE_FILE: &str = "save it as a single file, with header and voxels in it (.mha)";
const INTEGERS: &str = "save the mask with an integer type, such as MET_UCHAR or MET_SHORT";
const ONE_MAP: &str = "save it as one label map with three dimensions and one channel";

/// What the voxels are and how they are written, checked.
#[derive(Debug)]
pub(super) struct Layout {
    pub stored: Stored,
    pub packing: Packing,
    /// Dimensions in the header, 2 to 4.
    pub rank: usize,
}

impl Layout {
    /// Checks all fields but those of the place.
    pub fn check(fields: &Fields, max_voxels: u64) -> Result<Self, ReadError> {
        check_kind(fields)?;
        let datatype = datatype(fields.needed("ElementType")?)?;
        let packing = packing(fields)?;
        let order = if flag(fields, "BinaryDataByteOrderMSB", false)? { ByteOrder::Big } else { ByteOrder::Little };
        let rank = rank(fields.needed("NDims")?)?;
        let line = fields.needed("DimSize")?;
        let dims = dims(line, rank)?;
        let voxels = voxels_of(dims, max_voxels)
            .map_err(|voxels| line.fault(LineFault::TooManyVoxels { voxels, allowed: max_voxels }))?;
        Ok(Self { stored: Stored { dims, voxels, datatype, order, scaling: None, layers: Layers::ONE }, packing, rank })
    }
}

/// That it is an image whose voxels follow the header, one number each.
fn check_kind(fields: &Fields) -> Result<(), ReadError> {
    if let Some(line) = fields.get("ObjectType")
        && !line.value.eq_ignore_ascii_case("Image")
    {
        return Err(line.unsupported("an object other than an image", ONE_MAP));
    }
    let line = fields.needed(LAST_FIELD)?;
    if !line.value.eq_ignore_ascii_case("LOCAL") {
        return Err(line.fault(LineFault::Detached { hint: SINGLE_FILE }));
    }
    if let Some(line) = fields.get("HeaderSize")
        && line.value != "0"
    {
        return Err(line.unsupported("a place of the voxels other than right after the header", SINGLE_FILE));
    }
    match fields.get("ElementNumberOfChannels") {
        Some(line) if line.value != "1" => Err(line.unsupported("a voxel of several numbers", ONE_MAP)),
        _ => Ok(()),
    }
}

fn datatype(line: &Line) -> Result<Datatype, ReadError> {
    match line.value.as_str() {
        "MET_CHAR" | "MET_ASCII_CHAR" => Ok(Datatype::Int8),
        "MET_UCHAR" => Ok(Datatype::Uint8),
        "MET_SHORT" => Ok(Datatype::Int16),
        "MET_USHORT" => Ok(Datatype::Uint16),
        // Four bytes, whatever a `long` is elsewhere.
        "MET_INT" | "MET_LONG" => Ok(Datatype::Int32),
        "MET_UINT" | "MET_ULONG" => Ok(Datatype::Uint32),
        "MET_LONG_LONG" => Ok(Datatype::Int64),
        "MET_ULONG_LONG" => Ok(Datatype::Uint64),
        "MET_FLOAT" => Ok(Datatype::Float32),
        "MET_DOUBLE" => Ok(Datatype::Float64),
        value if value.starts_with("MET_") => Err(line.unsupported("a voxel that is not one number", INTEGERS)),
        _ => Err(line.malformed("a type of MetaImage, such as MET_UCHAR or MET_SHORT")),
    }
}

fn packing(fields: &Fields) -> Result<Packing, ReadError> {
    let is_binary = flag(fields, "BinaryData", true)?;
    let is_packed = flag(fields, "CompressedData", false)?;
    Ok(match (is_binary, is_packed) {
        (_, true) => Packing::Deflated,
        (true, false) => Packing::Raw,
        (false, false) => Packing::Text,
    })
}

/// A field that is true or false.
fn flag(fields: &Fields, field: &str, default: bool) -> Result<bool, ReadError> {
    let Some(line) = fields.get(field) else { return Ok(default) };
    match line.value.to_ascii_lowercase().as_str() {
        "true" | "t" | "yes" | "1" => Ok(true),
        "false" | "f" | "no" | "0" => Ok(false),
        _ => Err(line.malformed("True or False")),
    }
}

fn rank(line: &Line) -> Result<usize, ReadError> {
    match line.value.parse::<usize>() {
        Ok(rank @ 2..=4) => Ok(rank),
        Ok(1 | 5..) => Err(line.unsupported("an image of one or of more than four dimensions", ONE_MAP)),
        _ => Err(line.malformed("a number of dimensions from 2 to 4")),
    }
}

/// The three lengths; a plane is a volume of one slice, and a series of one a volume.
fn dims(line: &Line, rank: usize) -> Result<[usize; 3], ReadError> {
    let expected = "as many whole numbers above 0 as there are dimensions";
    let sizes = line.sizes(expected)?;
    if sizes.len() != rank {
        return Err(line.malformed(expected));
    }
    match sizes[..] {
        [x, y] => Ok([x, y, 1]),
        [x, y, z] | [x, y, z, 1] => Ok([x, y, z]),
        [_, _, _, count] => Err(line.fault(LineFault::SeveralVolumes { count: count as u64 })),
        _ => Err(line.malformed(expected)),
    }
}
