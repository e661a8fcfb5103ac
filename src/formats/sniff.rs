//! What a file is, from its first bytes. Names and media types are not trusted.

use super::read_error::ReadError;

/// First two bytes of every gzip member.
pub(super) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

/// Bytes that [`sniff`] needs.
pub(super) const SNIFF_BYTES: usize = 348;

/// Tells the version from the size field, which comes first, and the magic.
///
/// # Errors
/// When it is something else, with a guess what.
pub(super) fn sniff(head: &[u8]) -> Result<Kind, ReadError> {
    let other = || ReadError::NotNifti { looks_like: guess(head) };
    let size: [u8; 4] = head.get(..4).and_then(|b| b.try_into().ok()).ok_or_else(other)?;
    let (version, order) = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
        (348, _) => (Version::Nifti1, ByteOrder::Little),
        (_, 348) => (Version::Nifti1, ByteOrder::Big),
        (540, _) => (Version::Nifti2, ByteOrder::Little),
        (_, 540) => (Version::Nifti2, ByteOrder::Big),
        _ => return Err(other()),
    };
    if head.len() < SNIFF_BYTES {
        return Err(ReadError::Truncated { expected: version.header_bytes() as u64, got: head.len() as u64 });
    }
    match version {
        Version::Nifti1 => match &head[344..348] {
            b"n+1\0" => Ok(Kind { version, order }),
            b"ni1\0" => Err(ReadError::TwoFileNifti),
            _ => Err(ReadError::NotNifti { looks_like: Some("an Analyze 7.5 header") }),
        },
        Version::Nifti2 => match &head[4..12] {
            b"n+2\0\r\n\x1a\n" => Ok(Kind { version, order }),
            [b'n', b'i', b'2', 0, ..] => Err(ReadError::TwoFileNifti),
            _ => Err(other()),
        },
    }
}

fn guess(head: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 8] = [
        (b"NRRD", "NRRD"),
        (b"\x1f\x8b", "gzip within gzip"),
        (b"PK\x03\x04", "a zip archive"),
        (b"\x89PNG", "a PNG picture"),
        (b"\xff\xd8\xff", "a JPEG picture"),
        (b"\x89HDF", "HDF5"),
        (b"ObjectType", "MetaImage"),
        (b"{", "JSON"),
    ];
    if head.get(128..132) == Some(b"DICM") {
        return Some("DICOM");
    }
    KNOWN.iter().find(|(magic, _)| head.starts_with(magic)).map(|(_, name)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_formats_are_named() {
        let mut dicom = vec![0; 200];
        dicom[128..132].copy_from_slice(b"DICM");
        for (bytes, name) in [(dicom, Some("DICOM")), (b"NRRD0004".to_vec(), Some("NRRD")), (b"abc".to_vec(), None)] {
            match sniff(&bytes) {
                Err(ReadError::NotNifti { looks_like }) => assert_eq!(looks_like, name),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn a_bare_size_field_is_a_truncated_header() {
        assert!(matches!(sniff(&[0x5c, 1, 0, 0]), Err(ReadError::Truncated { expected: 348, got: 4 })));
    }
}
