//! What the voxels are and how they are written: the header checked field by field, but for their place in the world.

use super::header::Header;
use super::vectors::vectors;
use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Fields, Line, LineFault};
use crate::formats::read::stored::{ByteOrder, Datatype, Layers, Packing, Stored, voxels_of};
use crate::formats::read::stream::Stream;

/// Label maps in one file: Slicer writes one for each overlap, Slicer 4 one for each segment, and there are atlases of
/// hundreds. Each is looked at by itself.
const MAX_LAYERS: usize = 1024;
/// Voxels of all layers, in times of what one may have.
const LAYERED: u64 = 4;
/// Bytes or lines before the voxels that are none: more is no header of another format.
const MAX_SKIPPED: u64 = 1 << 24;

const SINGLE_FILE: &str = "save it as a single file, with header and voxels in it (.nrrd)";
const ENCODE: &str = "save it with the encoding gzip or raw";
const INTEGERS: &str = "save the mask with an integer type, such as uchar or short";
const ONE_MAP: &str = "save it as one label map with three axes, or as layers with a first axis of kind `list`";

/// What the voxels are and how they are written, checked.
#[derive(Debug)]
pub(super) struct Layout {
    pub stored: Stored,
    pub packing: Packing,
    /// The axis along which layers are counted, if there is one.
    pub layer_axis: Option<usize>,
    pub skipped_lines: u64,
    pub skipped_bytes: u64,
}

impl Layout {
    /// Checks all fields but those of the place.
    pub fn check(header: &Header, max_voxels: u64) -> Result<Self, ReadError> {
        let fields = &header.fields;
        if let Some(line) = fields.get("data file") {
            return Err(line.fault(LineFault::Detached { hint: SINGLE_FILE }));
        }
        let datatype = datatype(fields.needed("type")?)?;
        let packing = packing(fields.needed("encoding")?)?;
        let order = byte_order(fields, datatype, packing)?;
        let line = fields.needed("sizes")?;
        let sizes = sizes(line, fields.needed("dimension")?)?;
        let layer_axis = if sizes.len() == 3 { None } else { Some(layer_axis(header, line, &sizes)?) };
        let (dims, layers) = split(line, sizes, layer_axis)?;
        let voxels = voxels_of(dims, max_voxels)
            .map_err(|voxels| line.fault(LineFault::TooManyVoxels { voxels, allowed: max_voxels }))?;
        let stored = Stored { dims, voxels, datatype, order, scaling: None, layers };
        let allowed = max_voxels.saturating_mul(LAYERED);
        if stored.values() as u64 > allowed {
            return Err(line.fault(LineFault::TooManyVoxels { voxels: stored.values() as u128, allowed }));
        }
        let [skipped_lines, skipped_bytes] = [skipped(fields.get("line skip"))?, skipped(fields.get("byte skip"))?];
        Ok(Self { stored, packing, layer_axis, skipped_lines, skipped_bytes })
    }

    /// Passes over lines that the header says are no voxels.
    pub fn skip_lines(&self, stream: &mut Stream<'_>) -> Result<(), ReadError> {
        let last = stream.position() + MAX_SKIPPED;
        for _ in 0..self.skipped_lines {
            let left = usize::try_from(last.saturating_sub(stream.position())).unwrap_or(0);
            if stream.line(left)?.last() != Some(&b'\n') {
                let got = stream.position();
                return Err(ReadError::Truncated { expected: got.saturating_add(self.stored.bytes()), got });
            }
        }
        Ok(())
    }
}

fn datatype(line: &Line) -> Result<Datatype, ReadError> {
    let words: Vec<&str> = line.words().collect();
    match words.join(" ").to_ascii_lowercase().as_str() {
        "signed char" | "char" | "int8" | "int8_t" => Ok(Datatype::Int8),
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Ok(Datatype::Uint8),
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Ok(Datatype::Int16),
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Ok(Datatype::Uint16),
        "int" | "signed int" | "int32" | "int32_t" => Ok(Datatype::Int32),
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Ok(Datatype::Uint32),
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Ok(Datatype::Int64),
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Ok(Datatype::Uint64),
        "float" => Ok(Datatype::Float32),
        "double" => Ok(Datatype::Float64),
        "block" => Err(line.unsupported("a voxel that is no number", INTEGERS)),
        _ => Err(line.malformed("a type of NRRD, such as uchar or int16")),
    }
}

fn packing(line: &Line) -> Result<Packing, ReadError> {
    match line.value.to_ascii_lowercase().as_str() {
        "raw" => Ok(Packing::Raw),
        "gzip" | "gz" => Ok(Packing::Deflated),
        "ascii" | "text" | "txt" => Ok(Packing::Text),
        "hex" => Err(line.unsupported("the encoding hex", ENCODE)),
        "bzip2" | "bz2" => Err(line.unsupported("the encoding bzip2", ENCODE)),
        "zrl" => Err(line.unsupported("the encoding zrl", ENCODE)),
        _ => Err(line.malformed("raw, gzip or ascii")),
    }
}

/// Of values that have one.
fn byte_order(fields: &Fields, datatype: Datatype, packing: Packing) -> Result<ByteOrder, ReadError> {
    if datatype.bytes() == 1 || packing == Packing::Text {
        return Ok(ByteOrder::Little);
    }
    let line = fields.needed("endian")?;
    match line.value.to_ascii_lowercase().as_str() {
        "little" => Ok(ByteOrder::Little),
        "big" => Ok(ByteOrder::Big),
        _ => Err(line.malformed("little or big")),
    }
}

/// Three or four lengths.
fn sizes(line: &Line, dimension: &Line) -> Result<Vec<usize>, ReadError> {
    match dimension.value.as_str() {
        "3" | "4" => {}
        "1" | "2" => return Err(dimension.unsupported("an image of fewer than three dimensions", ONE_MAP)),
        _ if dimension.value.parse::<u32>().is_ok_and(|n| n > 4) => {
            return Err(dimension.unsupported("an image of more than four dimensions", ONE_MAP));
        }
        _ => return Err(dimension.malformed("3 or 4")),
    }
    let expected = "as many whole numbers above 0 as there are dimensions";
    let sizes = line.sizes(expected)?;
    if sizes.len().to_string() == dimension.value { Ok(sizes) } else { Err(line.malformed(expected)) }
}

/// Which of four axes counts layers: the first where its kind says so or it has no direction, the last where Slicer 4
/// wrote it, or a last one of a single volume.
fn layer_axis(header: &Header, sizes: &Line, lengths: &[usize]) -> Result<usize, ReadError> {
    let fields = &header.fields;
    if fields.get("space dimension").is_some_and(|line| line.value == "4") {
        return Ok(3);
    }
    let kinds: Vec<String> = fields.get("kinds").map(words_in_lower_case).unwrap_or_default();
    let directions = fields.get("space directions").map(vectors).transpose()?.unwrap_or_default();
    let has_direction = |axis: usize| directions.get(axis).map(Option::is_some);
    let is_list = match kinds.first().map(String::as_str) {
        Some("list") => has_direction(0) != Some(true),
        Some("none" | "???") | None => has_direction(0) == Some(false),
        Some(_) => false,
    };
    if is_list || (lengths.first() == Some(&1) && has_direction(0) == Some(false)) {
        return Ok(0);
    }
    match (fields.get("kinds"), lengths.last()) {
        (_, Some(1)) if has_direction(0) != Some(false) => Ok(3),
        (Some(line), _) if has_direction(0) == Some(false) => {
            Err(line.unsupported("an axis of another kind than `list` before those of space", ONE_MAP))
        }
        (_, count) => Err(sizes.fault(LineFault::SeveralVolumes { count: count.map_or(0, |n| *n as u64) })),
    }
}

fn words_in_lower_case(line: &Line) -> Vec<String> {
    line.words().take(4).map(|word| word.trim_matches('"').to_ascii_lowercase()).collect()
}

/// The lengths of the axes of space, and the layers.
fn split(line: &Line, mut sizes: Vec<usize>, layer_axis: Option<usize>) -> Result<([usize; 3], Layers), ReadError> {
    let layers = match layer_axis {
        None => Layers::ONE,
        Some(axis) => Layers { count: sizes.remove(axis), are_interleaved: axis == 0 },
    };
    if layers.count > MAX_LAYERS {
        return Err(line.unsupported("a file of more than 1024 layers", ONE_MAP));
    }
    let dims = sizes.try_into().map_err(|_| line.malformed("three or four whole numbers above 0"))?;
    Ok((dims, layers))
}

/// How many lines or bytes are none of the voxels.
fn skipped(line: Option<&Line>) -> Result<u64, ReadError> {
    let Some(line) = line else { return Ok(0) };
    if line.value == "-1" {
        return Err(line.unsupported("a place of the voxels that is counted from the end", SINGLE_FILE));
    }
    let count = line.value.parse::<u64>().ok().filter(|count| *count <= MAX_SKIPPED);
    count.ok_or_else(|| line.malformed("a whole number from 0 to 16777216"))
}
