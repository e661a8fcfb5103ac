//! Files with a header of text, line by line, so that every line can be wrong.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;

/// The lines of a file; [`TextFile::bytes`] writes them as they stand, checked by nobody.
#[derive(Clone, Debug)]
pub struct TextFile {
    /// Before all others.
    pub magic: &'static str,
    /// Between field and value.
    pub separator: &'static str,
    /// Of the header.
    pub end: &'static str,
    pub lines: Vec<(String, String)>,
    /// As stored.
    pub body: Vec<u8>,
}

impl TextFile {
    /// A good NRRD of 4 × 3 × 2 uchar voxels with the values 0 to 23, spacing 1 × 2 × 3 mm, LPS.
    pub fn nrrd() -> Self {
        Self { magic: "NRRD0004\n", separator: ": ", end: "\n", lines: Vec::new(), body: (0..24).collect() }
            .with("type", "uchar")
            .with("dimension", "3")
            .with("space", "left-posterior-superior")
            .with("sizes", "4 3 2")
            .with("space directions", "(1,0,0) (0,2,0) (0,0,3)")
            .with("kinds", "domain domain domain")
            .with("encoding", "raw")
            .with("space origin", "(10,20,-30)")
    }

    /// The same as MetaImage.
    pub fn metaimage() -> Self {
        Self { magic: "", separator: " = ", end: "", lines: Vec::new(), body: (0..24).collect() }
            .with("ObjectType", "Image")
            .with("NDims", "3")
            .with("BinaryData", "True")
            .with("BinaryDataByteOrderMSB", "False")
            .with("CompressedData", "False")
            .with("TransformMatrix", "1 0 0 0 1 0 0 0 1")
            .with("Offset", "10 20 -30")
            .with("ElementSpacing", "1 2 3")
            .with("DimSize", "4 3 2")
            .with("ElementType", "MET_UCHAR")
            .with("ElementDataFile", "LOCAL")
    }

    /// With a line instead of that of the same field, else before a last one that ends the header.
    pub fn with(mut self, field: &str, value: &str) -> Self {
        if let Some(line) = self.lines.iter_mut().find(|line| line.0 == field) {
            value.clone_into(&mut line.1);
            return self;
        }
        let is_ended = self.lines.last().is_some_and(|line| line.0 == "ElementDataFile");
        self.lines.insert(self.lines.len() - usize::from(is_ended), (field.to_owned(), value.to_owned()));
        self
    }

    pub fn without(mut self, field: &str) -> Self {
        self.lines.retain(|line| line.0 != field);
        self
    }

    pub fn body(self, body: Vec<u8>) -> Self {
        Self { body, ..self }
    }

    /// The number of the line of a field, from 1.
    pub fn line_of(&self, field: &str) -> usize {
        let place = self.lines.iter().position(|line| line.0 == field).unwrap();
        self.magic.lines().count() + place + 1
    }

    /// `:=` comes without space.
    pub fn bytes(&self) -> Vec<u8> {
        let mut text = self.magic.to_owned();
        for (field, value) in &self.lines {
            let separator = if field.contains('_') && self.separator == ": " { ":=" } else { self.separator };
            text += &format!("{field}{separator}{value}\n");
        }
        [text.as_bytes(), self.end.as_bytes(), &self.body].concat()
    }
}

/// As `compress` of zlib does.
pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Values stored as a type of NRRD or MetaImage, in either byte order.
pub fn stored(datatype: &str, values: &[i8], big_endian: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    for value in values {
        let mut one = match datatype.trim_start_matches("MET_").to_ascii_lowercase().as_str() {
            "uchar" | "uint8" | "unsigned char" | "char" | "signed char" | "int8" => value.to_le_bytes().to_vec(),
            "short" | "int16" | "ushort" | "uint16" | "unsigned short" => i16::from(*value).to_le_bytes().to_vec(),
            "int" | "int32" | "uint" | "uint32" | "long" | "ulong" => i32::from(*value).to_le_bytes().to_vec(),
            "float" => f32::from(*value).to_le_bytes().to_vec(),
            "double" => f64::from(*value).to_le_bytes().to_vec(),
            _ => i64::from(*value).to_le_bytes().to_vec(),
        };
        if big_endian {
            one.reverse();
        }
        bytes.extend(one);
    }
    bytes
}
