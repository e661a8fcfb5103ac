//! Header extensions: the records between header and voxels. Of all that tools write there one thing is looked
//! for, a table of names and colours of labels, in a record of any code: 0, 6 (a comment), 30 and 32 are met.
//! Whatever is wrong with the records is no reason to refuse the voxels.

use super::label_table::{LabelTable, TableFault};
use super::layout::Layout;
use crate::formats::read::error::ReadError;
use crate::formats::read::stream::Stream;
use crate::space::VolumeNotice;

/// Largest document that is looked at: tables of real files hold kilobytes. All records together are no longer
/// than the gap before the voxels, whose end is bounded.
const MAX_DOCUMENT_BYTES: usize = 4 << 20;
/// Bytes read at a time: a record may be shorter than it says.
const CHUNK_BYTES: usize = 1 << 16;
/// Size and code of a record; the size counts them.
const HEAD_BYTES: usize = 8;
/// What the document of a table has in it.
const TABLE_TAG: &[u8] = b"<LabelTable";

/// Reads up to the first voxel. A table that is damaged, hostile or too large is passed over with a notice.
///
/// # Errors
/// When the file ends before its voxels, or cannot be read.
pub(super) fn read_extensions(
    stream: &mut Stream<'_>,
    layout: &Layout,
    notices: &mut Vec<VolumeNotice>,
) -> Result<LabelTable, ReadError> {
    let mut flag = [0; 4];
    fill(stream, &mut flag, layout)?;
    let found = if flag[0] == 0 { Records::default() } else { read_records(stream, layout)? };
    let gap = layout.offset - stream.position();
    if stream.skip(gap)? < gap {
        return Err(truncated(stream, layout));
    }
    let table = match (found.fault, found.document) {
        (Some(fault), _) => Err(fault),
        (None, Some(document)) => LabelTable::parse(&document),
        (None, None) => Ok(LabelTable::default()),
    };
    Ok(table.unwrap_or_else(|fault| {
        let message = format!("names and colours of labels in the header were passed over: {fault}");
        notices.push(VolumeNotice { code: "label_table_ignored", message });
        LabelTable::default()
    }))
}

/// What the records hold that matters here.
#[derive(Default)]
struct Records {
    /// The first one with a table in it.
    document: Option<Vec<u8>>,
    /// What was wrong before one was found.
    fault: Option<TableFault>,
}

impl From<TableFault> for Records {
    fn from(fault: TableFault) -> Self {
        Self { document: None, fault: Some(fault) }
    }
}

/// Reads records until one has a table.
fn read_records(stream: &mut Stream<'_>, layout: &Layout) -> Result<Records, ReadError> {
    loop {
        let left = layout.offset - stream.position();
        if left < HEAD_BYTES as u64 {
            return Ok(Records::default());
        }
        let mut head = [0; HEAD_BYTES];
        fill(stream, &mut head, layout)?;
        let size = layout.stored.order.int32([head[0], head[1], head[2], head[3]]);
        let Some(content) = u64::try_from(size).ok().filter(|size| *size <= left).and_then(past_head) else {
            // Some tools fill up with zeros.
            let is_padding = head == [0; HEAD_BYTES] && rest_is_zero(stream, layout)?;
            return Ok(if is_padding { Records::default() } else { TableFault::BrokenList.into() });
        };
        let document = read_document(stream, content, layout)?;
        if document.windows(TABLE_TAG.len()).any(|bytes| bytes == TABLE_TAG) {
            let is_whole = document.len() as u64 == content;
            return Ok(if is_whole {
                Records { document: Some(document), fault: None }
            } else {
                TableFault::TooLarge.into()
            });
        }
    }
}

/// Bytes of a record after its head.
fn past_head(size: u64) -> Option<u64> {
    size.checked_sub(HEAD_BYTES as u64)
}

/// The content of a record, or as much of it as is looked at; the rest is skipped.
fn read_document(stream: &mut Stream<'_>, content: u64, layout: &Layout) -> Result<Vec<u8>, ReadError> {
    let wanted = usize::try_from(content).unwrap_or(MAX_DOCUMENT_BYTES).min(MAX_DOCUMENT_BYTES);
    let mut document = Vec::new();
    let mut chunk = vec![0; CHUNK_BYTES.min(wanted)];
    while document.len() < wanted {
        let length = chunk.len().min(wanted - document.len());
        fill(stream, &mut chunk[..length], layout)?;
        document.extend_from_slice(&chunk[..length]);
    }
    let rest = content - wanted as u64;
    if stream.skip(rest)? < rest {
        return Err(truncated(stream, layout));
    }
    Ok(document)
}

/// Takes what is left before the voxels.
fn rest_is_zero(stream: &mut Stream<'_>, layout: &Layout) -> Result<bool, ReadError> {
    let mut chunk = vec![0; CHUNK_BYTES];
    loop {
        let left = usize::try_from(layout.offset - stream.position()).unwrap_or(CHUNK_BYTES);
        let length = left.min(CHUNK_BYTES);
        fill(stream, &mut chunk[..length], layout)?;
        if length == 0 || chunk[..length].iter().any(|byte| *byte != 0) {
            return Ok(length == 0);
        }
    }
}

fn fill(stream: &mut Stream<'_>, buffer: &mut [u8], layout: &Layout) -> Result<(), ReadError> {
    if stream.fill(buffer)? < buffer.len() {
        return Err(truncated(stream, layout));
    }
    Ok(())
}

fn truncated(stream: &Stream<'_>, layout: &Layout) -> ReadError {
    let expected = layout.offset + layout.stored.bytes();
    ReadError::Truncated { expected, got: stream.position() }
}
