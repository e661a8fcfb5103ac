//! What a file of text and voxels may cost.

/// Buffers of the file and of what is packed in it, two inflaters, the table of two-byte values, what is dealt to layers.
const FIXED: usize = 2 << 20;
/// What is remembered of a byte of content: at most every one is a label of its own, or five a key of a segment.
const PER_BYTE: usize = 64;
/// No more is remembered than this, however many values there are.
const REMEMBERED: usize = 16 << 20;
/// Deflate shrinks no more than this, and may be within deflate.
const DEFLATE: usize = 1032;

/// Bytes of heap, besides those for voxels.
pub fn budget(bytes: &[u8]) -> usize {
    let content = DEFLATE.saturating_mul(bytes.len());
    FIXED + REMEMBERED.min(PER_BYTE.saturating_mul(content))
}
