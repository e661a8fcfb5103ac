//! Which NIfTI a file is, from its first bytes. Names and media types are not trusted.

use crate::formats::read::answers::Sniffed;
use crate::formats::read::error::ReadError;
use crate::formats::read::stored::ByteOrder;

/// A NIfTI header of either version, and its byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    pub version: Version,
    pub order: ByteOrder,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Version {
    Nifti1,
    Nifti2,
}

impl Version {
    /// Bytes of the header, without extensions.
    pub fn header_bytes(self) -> usize {
        match self {
            Self::Nifti1 => 348,
            Self::Nifti2 => 540,
        }
    }
}

/// Bytes that [`kind`] needs.
pub(in crate::formats) const KIND_BYTES: usize = 348;

/// Whether a file is one.
pub(in crate::formats) fn sniff(head: &[u8]) -> Sniffed {
    match kind(head) {
        Ok(Some(_)) => Sniffed::Own,
        Ok(None) => Sniffed::Other,
        Err(error) => Sniffed::Refused(error),
    }
}

/// Tells the version from the size field, which comes first, and the magic; `None` for another format.
///
/// # Errors
/// When it is a NIfTI that ends early, or half of a pair.
pub(super) fn kind(head: &[u8]) -> Result<Option<Kind>, ReadError> {
    let Some(size) = head.first_chunk::<4>() else { return Ok(None) };
    let (version, order) = match (i32::from_le_bytes(*size), i32::from_be_bytes(*size)) {
        (348, _) => (Version::Nifti1, ByteOrder::Little),
        (_, 348) => (Version::Nifti1, ByteOrder::Big),
        (540, _) => (Version::Nifti2, ByteOrder::Little),
        (_, 540) => (Version::Nifti2, ByteOrder::Big),
        _ => return Ok(None),
    };
    if head.len() < KIND_BYTES {
        return Err(ReadError::Truncated { expected: version.header_bytes() as u64, got: head.len() as u64 });
    }
    match version {
        Version::Nifti1 => match &head[344..348] {
            b"n+1\0" => Ok(Some(Kind { version, order })),
            b"ni1\0" => Err(ReadError::TwoFileNifti),
            _ => Ok(None),
        },
        Version::Nifti2 => match &head[4..12] {
            b"n+2\0\r\n\x1a\n" => Ok(Some(Kind { version, order })),
            [b'n', b'i', b'2', 0, ..] => Err(ReadError::TwoFileNifti),
            _ => Ok(None),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_size_field_is_a_truncated_header() {
        assert!(matches!(kind(&[0x5c, 1, 0, 0]), Err(ReadError::Truncated { expected: 348, got: 4 })));
    }
}
