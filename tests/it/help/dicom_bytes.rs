//! DICOM segmentations element by element, so that every one can be wrong.

use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;

pub const IMPLICIT: &str = "1.2.840.10008.1.2";
pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
pub const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
pub const RLE: &str = "1.2.840.10008.1.2.5";
pub const DEFLATED_FRAMES: &str = "1.2.840.10008.1.2.8.1";

/// Columns, rows, slices and segments of [`Seg::small`]. Frames of bits begin within bytes.
pub const SMALL: [usize; 3] = [5, 3, 3];

/// What an element holds.
#[derive(Clone, Debug)]
pub enum Value {
    Bytes(Vec<u8>),
    Shorts(Vec<u16>),
    Items(Vec<Vec<Element>>),
    /// After a table of where they are, which is empty.
    Fragments(Vec<Vec<u8>>),
}

/// An element: tag, kind and value.
#[derive(Clone, Debug)]
pub struct Element(pub u32, pub &'static str, pub Value);

pub fn text(tag: u32, kind: &'static str, text: impl AsRef<[u8]>) -> Element {
    Element(tag, kind, Value::Bytes(text.as_ref().to_vec()))
}

pub fn short(tag: u32, number: u16) -> Element {
    Element(tag, "US", Value::Shorts(vec![number]))
}

pub fn sequence(tag: u32, items: Vec<Vec<Element>>) -> Element {
    Element(tag, "SQ", Value::Items(items))
}

/// Numbers in decimals.
pub fn numbers(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join("\\")
}

/// A data set; [`Dicom::bytes`] writes it as it stands, checked by nobody.
#[derive(Clone, Debug)]
pub struct Dicom {
    pub transfer: String,
    pub elements: Vec<Element>,
    /// Whether ends are marked instead of lengths told.
    pub marks_ends: bool,
    /// After all elements.
    pub tail: Vec<u8>,
}

impl Dicom {
    /// Replaces the element of a tag, or puts it where it belongs.
    pub fn set(&mut self, element: Element) {
        let place = self.elements.partition_point(|Element(tag, ..)| *tag < element.0);
        match self.elements.get_mut(place) {
            Some(old) if old.0 == element.0 => *old = element,
            _ => self.elements.insert(place, element),
        }
    }

    pub fn remove(&mut self, tag: u32) {
        self.elements.retain(|Element(found, ..)| *found != tag);
    }

    /// The items of a sequence.
    pub fn items(&mut self, tag: u32) -> &mut Vec<Vec<Element>> {
        let found = self.elements.iter_mut().find(|Element(found, ..)| *found == tag);
        match found {
            Some(Element(_, _, Value::Items(items))) => items,
            _ => panic!("no sequence {tag:08x}"),
        }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let writer = |explicit, big| Writer { explicit, big, marks_ends: self.marks_ends };
        let mut meta = Vec::new();
        Writer { marks_ends: false, ..writer(true, false) }
            .element(&text(0x0002_0010, "UI", &self.transfer), &mut meta);
        let mut out = vec![0; 128];
        out.extend(b"DICM");
        out.extend([2, 0, 0, 0, b'U', b'L', 4, 0]);
        out.extend(u32::try_from(meta.len()).unwrap().to_le_bytes());
        out.extend(meta);
        let mut content = Vec::new();
        let writer = writer(self.transfer != IMPLICIT, self.transfer == BIG_ENDIAN);
        writer.elements(&self.elements, &mut content);
        content.extend(&self.tail);
        out.extend(if self.transfer == DEFLATED { deflated(&content) } else { content });
        out
    }
}

/// How elements are written.
#[derive(Clone, Copy)]
struct Writer {
    explicit: bool,
    big: bool,
    marks_ends: bool,
}

impl Writer {
    fn u16(self, number: u16) -> [u8; 2] {
        if self.big { number.to_be_bytes() } else { number.to_le_bytes() }
    }

    fn u32(self, number: u32) -> [u8; 4] {
        if self.big { number.to_be_bytes() } else { number.to_le_bytes() }
    }

    fn head(self, tag: u32, kind: &str, length: u32, out: &mut Vec<u8>) {
        let [group, element] = [tag >> 16, tag & 0xffff].map(|half| u16::try_from(half).unwrap());
        out.extend(self.u16(group));
        out.extend(self.u16(element));
        if !self.explicit || group == 0xfffe {
            out.extend(self.u32(length));
            return;
        }
        out.extend(kind.as_bytes());
        if ["OB", "OW", "SQ", "UN", "UT"].contains(&kind) {
            out.extend([0, 0]);
            out.extend(self.u32(length));
        } else {
            out.extend(self.u16(u16::try_from(length).unwrap()));
        }
    }

    fn elements(self, elements: &[Element], out: &mut Vec<u8>) {
        elements.iter().for_each(|element| self.element(element, out));
    }

    fn element(self, Element(tag, kind, value): &Element, out: &mut Vec<u8>) {
        // What is of unknown kind has no kinds in it.
        let inner = if *kind == "UN" { Self { explicit: false, big: false, ..self } } else { self };
        let (content, is_marked) = match value {
            Value::Bytes(bytes) => (bytes.clone(), false),
            Value::Shorts(numbers) => (numbers.iter().flat_map(|number| self.u16(*number)).collect(), false),
            Value::Items(items) => (inner.items(items), self.marks_ends),
            Value::Fragments(fragments) => {
                let all = [&[Vec::new()], &fragments[..]].concat();
                let mut content = Vec::new();
                for fragment in all {
                    self.head(0xfffe_e000, "", u32::try_from(fragment.len()).unwrap(), &mut content);
                    content.extend(fragment);
                }
                (content, true)
            }
        };
        let odd = content.len() % 2;
        let length = if is_marked { u32::MAX } else { u32::try_from(content.len() + odd).unwrap() };
        self.head(*tag, kind, length, out);
        out.extend(content);
        if is_marked {
            inner.head(0xfffe_e0dd, "", 0, out);
        } else {
            let fill = if matches!(*kind, "UI" | "OB" | "OW") { 0 } else { b' ' };
            out.extend(vec![fill; odd]);
        }
    }

    fn items(self, items: &[Vec<Element>]) -> Vec<u8> {
        let mut out = Vec::new();
        for item in items {
            let mut content = Vec::new();
            self.elements(item, &mut content);
            let length = if self.marks_ends { u32::MAX } else { u32::try_from(content.len()).unwrap() };
            self.head(0xfffe_e000, "", length, &mut out);
            out.extend(content);
            if self.marks_ends {
                self.head(0xfffe_e00d, "", 0, &mut out);
            }
        }
        out
    }
}

/// A frame: where it lies, which segment it shows (0: all), and its pixels, one number each.
#[derive(Clone, Debug)]
pub struct Frame {
    pub position: [f64; 3],
    pub segment: u16,
    pub pixels: Vec<u16>,
}

/// A segmentation before it is written.
#[derive(Clone, Debug)]
pub struct Seg {
    pub transfer: &'static str,
    pub kind: &'static str,
    pub bits: u16,
    pub columns: usize,
    pub rows: usize,
    pub orientation: [f64; 6],
    /// Between rows, columns and slices; 0 is left out.
    pub spacing: [f64; 3],
    pub segments: Vec<u16>,
    pub frames: Vec<Frame>,
    /// Whether each frame of bits begins at a new byte.
    pub pads_frames: bool,
}

/// Whether a segment of [`Seg::small`] has a voxel.
pub fn is_inside(segment: u16, [x, y, z]: [usize; 3]) -> bool {
    match segment {
        1 => x < 2 && (y + z) % 3 != 1,
        2 => x >= 3 && y > 0,
        _ => false,
    }
}

/// The number of the segment of [`Seg::small`] that a voxel is of, 0 for none.
pub fn segment_at(at: [usize; 3]) -> u16 {
    (1..=2).find(|segment| is_inside(*segment, at)).unwrap_or(0)
}

impl Seg {
    /// Two segments in three slices, as bits.
    pub fn small() -> Self {
        let mut frames = Vec::new();
        for segment in 1..=2 {
            frames.extend((0..SMALL[2]).map(|z| frame(segment, z, |at| u16::from(is_inside(segment, at)))));
        }
        Self {
            transfer: EXPLICIT,
            kind: "BINARY",
            bits: 1,
            columns: SMALL[0],
            rows: SMALL[1],
            orientation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            spacing: [0.75, 0.5, 2.0],
            segments: vec![1, 2],
            frames,
            pads_frames: false,
        }
    }

    /// The same with a number for each voxel.
    pub fn labelmap(bits: u16) -> Self {
        let frames = (0..SMALL[2]).map(|z| frame(0, z, segment_at)).collect();
        Self { kind: "LABELMAP", bits, frames, ..Self::small() }
    }

    /// The same with shares of so much.
    pub fn fractional(most: u16) -> Self {
        let mut seg = Self { kind: "FRACTIONAL", bits: 8, ..Self::small() };
        seg.frames.iter_mut().flat_map(|frame| &mut frame.pixels).for_each(|pixel| *pixel *= most);
        seg
    }

    pub fn with(self, transfer: &'static str) -> Self {
        Self { transfer, ..self }
    }

    pub fn dicom(&self) -> Dicom {
        let class =
            if self.kind == "LABELMAP" { "1.2.840.10008.5.1.4.1.1.66.7" } else { "1.2.840.10008.5.1.4.1.1.66.4" };
        let [rows, columns] = [self.rows, self.columns].map(|length| u16::try_from(length).unwrap());
        let segments = self
            .segments
            .iter()
            .map(|number| vec![short(0x0062_0004, *number), text(0x0062_0005, "LO", format!("part {number}"))]);
        let elements = vec![
            text(0x0008_0016, "UI", class),
            text(0x0010_0010, "PN", "CANARY_DOE_JANE"),
            short(0x0028_0002, 1),
            text(0x0028_0008, "IS", self.frames.len().to_string()),
            short(0x0028_0010, rows),
            short(0x0028_0011, columns),
            short(0x0028_0100, self.bits),
            text(0x0062_0001, "CS", self.kind),
            sequence(0x0062_0002, segments.collect()),
            sequence(0x5200_9229, vec![vec![self.measures(), orientation(&self.orientation)]]),
            sequence(0x5200_9230, self.frames.iter().map(groups).collect()),
            Element(0x7fe0_0010, if self.bits == 16 { "OW" } else { "OB" }, self.pixels()),
        ];
        Dicom { transfer: self.transfer.to_owned(), elements, marks_ends: false, tail: Vec::new() }
    }

    pub fn bytes(&self) -> Vec<u8> {
        self.dicom().bytes()
    }

    fn measures(&self) -> Element {
        let [rows, columns, slices] = self.spacing;
        let mut elements = vec![text(0x0028_0030, "DS", numbers(&[rows, columns]))];
        if slices > 0.0 {
            elements.insert(0, text(0x0018_0088, "DS", numbers(&[slices])));
        }
        sequence(0x0028_9110, vec![elements])
    }

    fn pixels(&self) -> Value {
        let plain: Vec<Vec<u8>> = self.frames.iter().map(|frame| self.packed(&frame.pixels)).collect();
        match self.transfer {
            RLE => Value::Fragments(plain.iter().map(|frame| rle(frame, usize::from(self.bits.div_ceil(8)))).collect()),
            DEFLATED_FRAMES => Value::Fragments(plain.iter().map(|frame| even(deflated(frame))).collect()),
            _ if self.bits == 1 && !self.pads_frames => {
                let all: Vec<u16> = self.frames.iter().flat_map(|frame| frame.pixels.clone()).collect();
                Value::Bytes(self.packed(&all))
            }
            _ => Value::Bytes(plain.concat()),
        }
    }

    fn packed(&self, pixels: &[u16]) -> Vec<u8> {
        match self.bits {
            1 => {
                let mut bytes = vec![0; pixels.len().div_ceil(8)];
                for (n, pixel) in pixels.iter().enumerate() {
                    bytes[n / 8] |= u8::from(*pixel > 0) << (n % 8);
                }
                bytes
            }
            8 => pixels.iter().map(|pixel| u8::try_from(*pixel).unwrap()).collect(),
            _ if self.transfer == BIG_ENDIAN => pixels.iter().flat_map(|pixel| pixel.to_be_bytes()).collect(),
            _ => pixels.iter().flat_map(|pixel| pixel.to_le_bytes()).collect(),
        }
    }
}

/// A frame of [`Seg::small`].
pub fn frame(segment: u16, z: usize, pixel_at: impl Fn([usize; 3]) -> u16) -> Frame {
    let pixels = (0..SMALL[1]).flat_map(|y| (0..SMALL[0]).map(move |x| [x, y, z])).map(pixel_at).collect();
    Frame { position: [-10.0, 20.0, 30.0 + 2.0 * z as f64], segment, pixels }
}

pub fn orientation(cosines: &[f64]) -> Element {
    sequence(0x0020_9116, vec![vec![text(0x0020_0037, "DS", numbers(cosines))]])
}

/// What a frame says of itself.
pub fn groups(frame: &Frame) -> Vec<Element> {
    let mut groups = vec![sequence(0x0020_9113, vec![vec![text(0x0020_0032, "DS", numbers(&frame.position))]])];
    if frame.segment > 0 {
        groups.push(sequence(0x0062_000a, vec![vec![short(0x0062_000b, frame.segment)]]));
    }
    groups
}

/// A run for each byte of a pixel, the high one first, in literals.
pub fn rle(frame: &[u8], size: usize) -> Vec<u8> {
    let mut numbers = vec![size];
    let mut runs = Vec::new();
    for byte in (0..size).rev() {
        numbers.push(64 + runs.len());
        let bytes: Vec<u8> = frame.iter().skip(byte).step_by(size).copied().collect();
        for literal in bytes.chunks(128) {
            runs.push(u8::try_from(literal.len() - 1).unwrap());
            runs.extend(literal);
        }
        runs = even(runs);
    }
    numbers.resize(16, 0);
    let mut out: Vec<u8> = numbers.iter().flat_map(|n| u32::try_from(*n).unwrap().to_le_bytes()).collect();
    out.extend(runs);
    out
}

fn even(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(2), 0);
    bytes
}

/// Deflate without a header.
pub fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}
