//! The elements of a data set, one after the other. What is wanted of them is handed on, all else is passed over.
//!
//! Nothing in a file makes it recurse or reserve: open sequences are on a stack of bounded depth, no length reaches
//! beyond what holds it, memory grows with what comes, and what is kept is counted.

use super::error::DicomFault;
use super::source::Source;
use super::syntax::{Head, IMPLICIT, Syntax, UNDEFINED};
use super::tag::{Tag, TagPath, Use, usage};
use super::values::{Item, Value};
use crate::formats::read::error::ReadError;

/// Sequences in sequences: segmentations have five.
const MAX_DEPTH: usize = 16;
/// Elements: a segmentation of 100 000 frames has five million.
const MAX_ELEMENTS: u64 = 20_000_000;
/// Bytes of all values that are kept for a while, with what keeping them costs: the groups of 100 000 frames take 40
/// MB.
const MAX_KEPT_BYTES: u64 = 256 << 20;
/// Bytes of a value that is kept: real ones have a hundred.
const MAX_VALUE_BYTES: u32 = 1 << 20;
/// What an item or a value costs beside its bytes.
const COST_BYTES: u64 = 64;

/// What was met on the way.
#[derive(Debug)]
pub(super) enum Met {
    /// A value that no sequence holds.
    Value { tag: Tag, bytes: Vec<u8> },
    /// An item of a sequence that no other holds; they count from 1.
    Item { sequence: Tag, number: u32, item: Item },
    /// The pixels come next.
    Pixels(Head),
}

/// What is open.
enum Level {
    Sequence {
        tag: Tag,
        /// Where it ends, if that is told.
        end: Option<u64>,
        /// How what is in it is written.
        syntax: Syntax,
        /// Whether anything in it is wanted.
        is_kept: bool,
        /// Items that were begun.
        begun: u32,
        /// The first one, where another sequence holds this one: no more is ever looked at.
        first: Option<Item>,
    },
    Item {
        end: Option<u64>,
        item: Item,
    },
}

impl Level {
    fn end(&self) -> Option<u64> {
        match self {
            Self::Sequence { end, .. } | Self::Item { end, .. } => *end,
        }
    }
}

/// On the way through a data set.
pub(super) struct Walk<'s, 'f> {
    pub source: Source<'s, 'f>,
    /// How elements outside of sequences are written.
    pub syntax: Syntax,
    open: Vec<Level>,
    elements: u64,
    kept_bytes: u64,
    /// The last element outside of sequences: they ascend.
    last: Tag,
}

impl<'s, 'f> Walk<'s, 'f> {
    /// At the begin of a data set.
    pub fn new(source: Source<'s, 'f>, syntax: Syntax) -> Self {
        Self { source, syntax, open: Vec::new(), elements: 0, kept_bytes: 0, last: Tag(0) }
    }

    /// Goes on to the next thing that is wanted; `None` at the end. After [`Met::Pixels`] the pixels must be taken from
    /// the source first.
    ///
    /// # Errors
    /// When the data set is malformed, more than allowed, or cannot be read.
    pub fn next(&mut self) -> Result<Option<Met>, ReadError> {
        loop {
            while self.has_reached_end() {
                if let Some(met) = self.close() {
                    return Ok(Some(met));
                }
            }
            let Some(head) = self.head()? else { return Ok(None) };
            let met = match self.open.last() {
                Some(Level::Sequence { .. }) => self.in_sequence(head)?,
                Some(Level::Item { .. }) | None => self.element(head)?,
            };
            if met.is_some() {
                return Ok(met);
            }
        }
    }

    /// The head of the next element or item; `None` at the end of the file.
    fn head(&mut self) -> Result<Option<Head>, ReadError> {
        let (start, syntax) = (self.source.position(), self.syntax_here());
        let Some(head) = syntax.head(&mut self.source)? else {
            return match self.open.len() {
                0 => Ok(None),
                _ => Err(ReadError::Truncated { expected: start + 8, got: start }),
            };
        };
        self.elements += 1;
        if self.elements > MAX_ELEMENTS {
            return Err(self.over("more elements than a segmentation has", MAX_ELEMENTS));
        }
        if self.bound().is_some_and(|bound| self.source.position() > bound) {
            return Err(self.malformed("an element runs over the end of what holds it"));
        }
        Ok(Some(head))
    }

    /// What comes in a sequence: items, and its end.
    fn in_sequence(&mut self, head: Head) -> Result<Option<Met>, ReadError> {
        match head.tag {
            Tag::ITEM => {
                let end = self.end_of(head)?;
                let is_big_endian = self.syntax_here().is_big_endian;
                if self.is_kept() {
                    self.keep(0)?;
                }
                if let Some(Level::Sequence { begun, .. }) = self.open.last_mut() {
                    *begun += 1;
                }
                self.open.push(Level::Item { end, item: Item::new(is_big_endian) });
                Ok(None)
            }
            Tag::SEQUENCE_END if self.has_marked_end() => Ok(self.close()),
            _ => Err(self.malformed("a sequence has something else than items")),
        }
    }

    /// What comes in an item or outside of all.
    fn element(&mut self, head: Head) -> Result<Option<Met>, ReadError> {
        if head.tag == Tag::ITEM_END && self.has_marked_end() {
            return Ok(self.close());
        }
        if head.tag.is_frame() {
            return Err(self.malformed("an item stands where an element should"));
        }
        if self.open.is_empty() {
            if head.tag <= self.last {
                return Err(self.malformed("elements do not ascend"));
            }
            self.last = head.tag;
            if head.tag == Tag::PIXELS {
                return Ok(Some(Met::Pixels(head)));
            }
        }
        let end = self.end_of(head)?;
        let wanted = if self.is_kept() { usage(self.sequence(), head.tag) } else { Use::None };
        let is_sequence = head.kind.is_none_or(|kind| matches!(&kind, b"SQ" | b"UN"));
        match (wanted, end) {
            (Use::Value, Some(_)) => return self.value(head),
            (Use::Sequence, _) if is_sequence => self.begin(head, end, true)?,
            (Use::Value, None) | (Use::Sequence, _) => return Err(self.malformed("an element has the wrong kind (VR)")),
            (Use::None, Some(_)) => self.source.skip(u64::from(head.length))?,
            (Use::None, None) if is_sequence => self.begin(head, end, false)?,
            (Use::None, None) => self.pass_fragments()?,
        }
        Ok(None)
    }

    fn value(&mut self, head: Head) -> Result<Option<Met>, ReadError> {
        if head.length > MAX_VALUE_BYTES {
            let what = "a value longer than a segmentation has";
            let fault = DicomFault::OverLimit { what, allowed: u64::from(MAX_VALUE_BYTES) };
            return Err(fault.at(self.path_to(head.tag)));
        }
        self.keep(u64::from(head.length))?;
        let bytes = self.source.take(u64::from(head.length))?;
        match self.open.last_mut() {
            Some(Level::Item { item, .. }) => item.push(head.tag, Value::Bytes(bytes)),
            _ => return Ok(Some(Met::Value { tag: head.tag, bytes })),
        }
        Ok(None)
    }

    /// Opens a sequence. What is of unknown kind is written without kinds, and all that is in it.
    fn begin(&mut self, head: Head, end: Option<u64>, is_kept: bool) -> Result<(), ReadError> {
        // Each has one item on the stack, but for the last.
        if self.open.len() >= 2 * MAX_DEPTH {
            return Err(self.over("sequences nested deeper than a segmentation has", MAX_DEPTH as u64));
        }
        let syntax = if head.kind == Some(*b"UN") { IMPLICIT } else { self.syntax_here() };
        self.open.push(Level::Sequence { tag: head.tag, end, syntax, is_kept, begun: 0, first: None });
        Ok(())
    }

    /// Passes over the fragments of an element that is no sequence and whose length is not told: an icon's pixels.
    fn pass_fragments(&mut self) -> Result<(), ReadError> {
        loop {
            let Some(head) = self.head()? else {
                let got = self.source.position();
                return Err(ReadError::Truncated { expected: got + 8, got });
            };
            match head.tag {
                Tag::SEQUENCE_END => return Ok(()),
                Tag::ITEM if self.end_of(head)?.is_some() => self.source.skip(u64::from(head.length))?,
                _ => return Err(self.malformed("something else than a fragment")),
            }
        }
    }

    /// Closes what was opened last. What is done goes into what holds it, or out.
    fn close(&mut self) -> Option<Met> {
        match self.open.pop()? {
            Level::Item { item, .. } => {
                let is_outermost = self.open.len() == 1;
                if let Some(Level::Sequence { tag, begun, is_kept: true, first, .. }) = self.open.last_mut() {
                    if is_outermost {
                        return Some(Met::Item { sequence: *tag, number: *begun, item });
                    }
                    first.get_or_insert(item);
                }
            }
            Level::Sequence { tag, first: Some(first), .. } => {
                if let Some(Level::Item { item, .. }) = self.open.last_mut() {
                    item.push(tag, Value::Item(first));
                }
            }
            Level::Sequence { first: None, .. } => {}
        }
        None
    }

    /// Whether what is open ends here, by its length.
    fn has_reached_end(&self) -> bool {
        self.open.last().and_then(Level::end).is_some_and(|end| self.source.position() >= end)
    }

    /// Whether the end of what is open is marked.
    fn has_marked_end(&self) -> bool {
        self.open.last().is_some_and(|level| level.end().is_none())
    }

    /// Where the innermost thing ends whose length is told.
    fn bound(&self) -> Option<u64> {
        self.open.iter().rev().find_map(Level::end)
    }

    /// Where an element ends, if its length is told.
    fn end_of(&self, head: Head) -> Result<Option<u64>, ReadError> {
        if head.length == UNDEFINED {
            return Ok(None);
        }
        let end = self.source.position() + u64::from(head.length);
        if self.bound().is_some_and(|bound| end > bound) {
            return Err(self.malformed("an element is longer than what holds it"));
        }
        Ok(Some(end))
    }

    fn syntax_here(&self) -> Syntax {
        for level in self.open.iter().rev() {
            if let Level::Sequence { syntax, .. } = level {
                return *syntax;
            }
        }
        self.syntax
    }

    /// The innermost sequence that is open.
    fn sequence(&self) -> Option<Tag> {
        self.open.iter().rev().find_map(|level| match level {
            Level::Sequence { tag, .. } => Some(*tag),
            Level::Item { .. } => None,
        })
    }

    /// Whether anything here is wanted.
    fn is_kept(&self) -> bool {
        self.open.iter().all(|level| !matches!(level, Level::Sequence { is_kept: false, .. }))
    }

    fn keep(&mut self, bytes: u64) -> Result<(), ReadError> {
        self.kept_bytes += bytes + COST_BYTES;
        if self.kept_bytes > MAX_KEPT_BYTES {
            return Err(self.over("more bytes of attributes than a segmentation has", MAX_KEPT_BYTES));
        }
        Ok(())
    }

    /// The way to where the walk is.
    fn path(&self) -> TagPath {
        let mut path = TagPath::default();
        for level in &self.open {
            if let Level::Sequence { tag, begun, .. } = level {
                path = path.join(*tag).item(*begun);
            }
        }
        path
    }

    /// The way to an element where the walk is.
    fn path_to(&self, tag: Tag) -> TagPath {
        self.path().join(tag)
    }

    fn malformed(&self, what: &'static str) -> ReadError {
        DicomFault::Malformed { what, at: self.source.position() }.at(self.path())
    }

    fn over(&self, what: &'static str, allowed: u64) -> ReadError {
        DicomFault::OverLimit { what, allowed }.at(self.path())
    }
}
