//! Which object a DICOM file is: what archives and services that pass it on need to know, and no more.

use std::fs::File;
use std::io::{self, Read};

use super::seg::SEGMENTATIONS;
use super::sniff;
use super::source::Source;
use super::syntax::read_element_syntax;
use super::tag::Tag;
use super::uid::Uid;
use super::walk::{Met, Walk};
use crate::cancel::Never;
use crate::formats::read::answers::Sniffed;
use crate::formats::read::error::ReadError;
use crate::formats::read::stream::Stream;

/// Bytes of a file that hold its class and its own identifier: they stand among its first elements. With less, files
/// of long preludes (a private information of the sender) would not be told.
pub const IDENTITY_BYTES: usize = 16 << 10;
/// Bytes that a beginning of a file may inflate to. With more, whoever sends a hostile one keeps a thread busy that answers
/// requests; with fewer than it is long, an honest one would not be read to its end.
const MAX_HEAD_BYTES: u64 = 1 << 20;
/// Bytes that are walked for the study, which stands behind the series that is referred to: 100 bytes for each image.
/// With more, a hostile file is inflated for nothing.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// What a file says that it is. What is not said, or stands behind what cannot be read, is `None`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// SOP Class UID.
    pub class: Option<Uid>,
    /// SOP Instance UID.
    pub instance: Option<Uid>,
    /// Study Instance UID.
    pub study: Option<Uid>,
}

impl Identity {
    /// Of the beginning of a file, [`IDENTITY_BYTES`] long: all but the study. `None` when it is no DICOM.
    #[must_use]
    pub fn of_head(head: &[u8]) -> Option<Self> {
        // Bytes in memory can be read.
        Self::of(head, MAX_HEAD_BYTES).ok().flatten()
    }

    /// Of a file, the study included. `None` when it is no DICOM. Blocks.
    ///
    /// # Errors
    /// When the file cannot be read. A damaged one is no error: what stands before the damage counts.
    pub fn of_file(file: File) -> io::Result<Option<Self>> {
        Self::of(file, MAX_FILE_BYTES)
    }

    fn of(file: impl Read, max_bytes: u64) -> io::Result<Option<Self>> {
        let mut found = None;
        match Self::read(file, max_bytes, &mut found) {
            Err(ReadError::Io(error)) => Err(error),
            // What was found before a fault counts: a beginning of a file ends early.
            Ok(()) | Err(_) => Ok(found),
        }
    }

    /// Whether it is a segmentation in voxels.
    #[must_use]
    pub fn is_segmentation(&self) -> bool {
        self.class.as_ref().is_some_and(|class| SEGMENTATIONS.contains(&class.as_str()))
    }

    fn read(file: impl Read, max_bytes: u64, found: &mut Option<Self>) -> Result<(), ReadError> {
        let mut stream = Stream::open(file, max_bytes, &Never)?;
        if !matches!(sniff(stream.peek(super::SNIFF_BYTES)?), Sniffed::Own) {
            return Ok(());
        }
        found.insert(Self::default()).walk(&mut stream, max_bytes)
    }

    fn walk(&mut self, stream: &mut Stream<'_>, max_bytes: u64) -> Result<(), ReadError> {
        let mut source = Source::new(stream, max_bytes);
        let (syntax, is_deflated) = read_element_syntax(&mut source)?;
        if is_deflated {
            source.inflate();
        }
        let mut walk = Walk::new(source, syntax);
        while let Some(met) = walk.next()? {
            match met {
                Met::Value { tag: Tag::SOP_CLASS, bytes } => self.class = Uid::of_file(&bytes),
                Met::Value { tag: Tag::SOP_INSTANCE, bytes } => self.instance = Uid::of_file(&bytes),
                Met::Value { tag: Tag::STUDY, bytes } => {
                    self.study = Uid::of_file(&bytes);
                    return Ok(());
                }
                Met::Value { tag, .. } if tag > Tag::STUDY => return Ok(()),
                Met::Pixels(_) => return Ok(()),
                Met::Value { .. } | Met::Item { .. } => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::DeflateEncoder;

    use super::*;

    /// An element of explicit little endian.
    fn element(group: u16, number: u16, kind: [u8; 2], value: &[u8]) -> Vec<u8> {
        let length = u16::try_from(value.len()).expect("a short value");
        [&group.to_le_bytes(), &number.to_le_bytes(), &kind[..], &length.to_le_bytes(), value].concat()
    }

    /// A deflated file whose class stands behind so many bytes of zeros.
    fn deflated(zeros: usize) -> Vec<u8> {
        let transfer = element(2, 0x10, *b"UI", b"1.2.840.10008.1.2.1.99");
        let length = u32::try_from(transfer.len()).expect("a short group").to_le_bytes();
        let mut file = [&[0; 128][..], b"DICM", &element(2, 0, *b"UL", &length), &transfer].concat();
        let private = u32::try_from(zeros).expect("as many").to_le_bytes();
        let mut content = DeflateEncoder::new(Vec::new(), Compression::best());
        let before = [&[7, 0, 0x10, 0x10][..], b"OB", &[0, 0], &private, &vec![0; zeros]].concat();
        content.write_all(&before).expect("memory");
        content.write_all(&element(8, 0x16, *b"UI", b"1.2\0")).expect("memory");
        file.extend(content.finish().expect("memory"));
        file
    }

    #[test]
    fn a_beginning_that_inflates_to_much_is_not_read_to_its_end() {
        let class = |zeros| Identity::of_head(&deflated(zeros)).expect("DICOM").class;
        assert_eq!(class(1 << 19), Uid::parse("1.2"));
        assert!(deflated(8 << 20).len() < IDENTITY_BYTES);
        assert_eq!(class(8 << 20), None);
    }

    #[test]
    fn a_file_that_cannot_be_read_is_told_apart_from_one_that_says_nothing() {
        let folder = File::open(env!("CARGO_MANIFEST_DIR")).expect("a folder can be opened, but not read");
        assert!(Identity::of_file(folder).is_err());
        assert_eq!(Identity::of_head(b"no DICOM"), None);
    }
}
