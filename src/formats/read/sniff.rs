//! What a file is that nothing here reads, and what gzip begins with.

/// First two bytes of every gzip member.
pub(in crate::formats) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// What a file that no reader knows looks like.
pub(in crate::formats) fn guess(head: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 10] = [
        (b"NRRD", "NRRD"),
        (&GZIP_MAGIC, "gzip within gzip"),
        (b"PK\x03\x04", "a zip archive"),
        (b"\x89PNG", "a PNG picture"),
        (b"\xff\xd8\xff", "a JPEG picture"),
        (b"\x89HDF", "HDF5"),
        (b"ObjectType", "MetaImage"),
        (b"{", "JSON"),
        // Its header has the size of that of NIfTI-1, in either byte order, but no magic.
        (&[0x5c, 1, 0, 0], "an Analyze 7.5 header"),
        (&[0, 0, 1, 0x5c], "an Analyze 7.5 header"),
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
            assert_eq!(guess(&bytes), name);
        }
    }
}
