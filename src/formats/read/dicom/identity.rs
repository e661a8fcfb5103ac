//! Which object a DICOM file is: what archives and services that pass it on need to know, and no more.

use std::io::Read;

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
/// Bytes that are walked for the study, which stands behind the series that is referred to: 100 bytes for each image.
/// With more, a hostile file is inflated for nothing.
const MAX_BYTES: u64 = 64 << 20;

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
    /// Of a file, or of its beginning: at least [`IDENTITY_BYTES`] for all but the study. `None` when it is no DICOM.
    pub fn of(file: impl Read) -> Option<Self> {
        let mut stream = Stream::open(file, MAX_BYTES, &Never).ok()?;
        if !matches!(sniff(stream.peek(super::SNIFF_BYTES).ok()?), Sniffed::Own) {
            return None;
        }
        let mut identity = Self::default();
        // What was found before a fault counts: a beginning of a file ends early.
        let _ = identity.read(&mut stream);
        Some(identity)
    }

    /// Whether it is a segmentation in voxels.
    #[must_use]
    pub fn is_segmentation(&self) -> bool {
        self.class.as_ref().is_some_and(|class| SEGMENTATIONS.contains(&class.as_str()))
    }

    fn read(&mut self, stream: &mut Stream<'_>) -> Result<(), ReadError> {
        let mut source = Source::new(stream, MAX_BYTES);
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
