//! What a file is that nothing here reads, and what gzip begins with.

use super::error::Look;

/// First two bytes of every gzip member.
pub(in crate::formats) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Bytes from which on nothing but zeros is no accident: shorter files are in no state to be told.
const FEW_BYTES: usize = 16;

const CONVERT: Option<&str> = Some("convert it (3D Slicer and ITK read and write both)");
const UNPACK: Option<&str> = Some("unpack it");
const DOWNLOAD: Option<&str> = Some("download the file itself: what came is the server's answer in its place");

/// What files begin with, the more telling first.
const BEGINNINGS: &[(&[u8], &str, Option<&str>)] = &[
    (b"\x89HDF", "HDF5, as MINC 2 and MATLAB write it", CONVERT),
    (b"CDF\x01", "NetCDF, as MINC 1 writes it", CONVERT),
    (b"#INRIMAGE", "INRIMAGE", CONVERT),
    (b"# vtk DataFile", "VTK", CONVERT),
    (b"MATLAB 5.0", "a MATLAB file", None),
    (b"\x93NUMPY", "a NumPy array", Some("save it with its affine (nibabel)")),
    (b"\xff\xff\xfe", "a FreeSurfer surface", Some("make a volume of it (mri_surf2vol)")),
    (&GZIP_MAGIC, "gzip within gzip", Some("unpack it once")),
    (b"\x1f\xef\xbf\xbd", "gzip that was treated as text, which destroys it", Some("transfer it as binary")),
    (b"PK\x03\x04", "a zip archive", UNPACK),
    (b"BZh", "bzip2", UNPACK),
    (b"\xfd7zXZ", "xz", UNPACK),
    (b"\x28\xb5\x2f\xfd", "zstd", UNPACK),
    (b"7z\xbc\xaf", "a 7-Zip archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
    (b"\x89PNG", "a PNG picture", None),
    (b"\xff\xd8\xff", "a JPEG picture", None),
    (b"GIF8", "a GIF picture", None),
    (b"II*\0", "a TIFF picture", CONVERT),
    (b"MM\0*", "a TIFF picture", CONVERT),
    (b"%PDF", "a PDF document", None),
    (
        b"version https://git-lfs",
        "a Git LFS pointer, which stands for a file",
        Some("fetch the file itself (git lfs pull)"),
    ),
    (b"/annex/objects/", "a git-annex pointer, which stands for a file", Some("fetch the file itself (git annex get)")),
    (b"HTTP/", "an answer of a server with its headers", DOWNLOAD),
    (b"H4sI", "gzip in base64", Some("decode it")),
    (b"XAEAA", "NIfTI in base64", Some("decode it")),
    (b"data:", "a data: address", Some("decode it")),
    (b"{", "JSON", None),
    (b"[", "JSON", None),
    // Its header has the size of that of NIfTI-1, in either byte order, but no magic.
    (&[0x5c, 1, 0, 0], "an Analyze 7.5 header", None),
    (&[0, 0, 1, 0x5c], "an Analyze 7.5 header", None),
];

/// What texts of the Web begin with, after space and in lower case.
const MARKUP: &[(&[u8], &str, Option<&str>)] = &[
    (b"<!doctype html", "a web page (HTML)", DOWNLOAD),
    (b"<html", "a web page (HTML)", DOWNLOAD),
    (b"<head", "a web page (HTML)", DOWNLOAD),
    (b"<error", "an error message (XML)", DOWNLOAD),
    (b"<?xml", "an XML document", None),
];

/// What a file that no reader knows looks like.
pub(in crate::formats) fn guess(head: &[u8]) -> Option<Look> {
    let look = |name, advice| Some(Look { name, advice });
    if head.is_empty() {
        return look("an empty file", None);
    }
    if is_mgh(head) {
        return look("a FreeSurfer volume (.mgz, .mgh)", Some("convert it (mri_convert mask.mgz mask.nii.gz)"));
    }
    if head.get(257..262) == Some(b"ustar") {
        return look("a tar archive", UNPACK);
    }
    if head.len() >= FEW_BYTES && head.iter().all(|byte| *byte == 0) {
        return look("zeros, which a transfer that was cut leaves", Some("send or copy it again"));
    }
    begins(head, BEGINNINGS).or_else(|| markup(head)).or_else(|| text(head))
}

fn begins(head: &[u8], known: &[(&[u8], &'static str, Option<&'static str>)]) -> Option<Look> {
    for (beginning, name, advice) in known {
        if head.starts_with(beginning) {
            return Some(Look { name, advice: *advice });
        }
    }
    None
}

/// A page, or what else there is between angle brackets. Stores answer with an `<Error>` after the declaration.
fn markup(head: &[u8]) -> Option<Look> {
    let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head).trim_ascii_start().to_ascii_lowercase();
    let is_declared = text.starts_with(b"<?xml");
    for (tag, name) in [(&b"<error"[..], "an error message (XML)"), (b"<html", "a web page (HTML)")] {
        if is_declared && text.windows(tag.len()).any(|part| part == tag) {
            return Some(Look { name, advice: DOWNLOAD });
        }
    }
    begins(&text, MARKUP)
}

/// What is text and nothing else, be it of one line or of a table. A link into git-annex becomes text where there are no
/// links.
fn text(head: &[u8]) -> Option<Look> {
    const LINK: &[u8] = b".git/annex/objects/";
    if head.windows(LINK.len()).any(|part| part == LINK) {
        return begins(b"/annex/objects/", BEGINNINGS);
    }
    let is_text = head.iter().all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace());
    is_text.then_some(Look { name: "plain text", advice: None })
}

/// FreeSurfer's volumes have no magic: version 1, three lengths and a count of frames, each of four bytes, the high one
/// first, then a type below 11.
fn is_mgh(head: &[u8]) -> bool {
    let Some((fields, _)) = head.split_first_chunk::<24>() else { return false };
    let mut numbers = Vec::new();
    for field in fields.as_chunks::<4>().0 {
        numbers.push(i32::from_be_bytes(*field));
    }
    numbers[0] == 1 && numbers[1..5].iter().all(|n| (1..1 << 16).contains(n)) && (0..=10).contains(&numbers[5])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name_of(bytes: &[u8]) -> Option<&'static str> {
        guess(bytes).map(|look| look.name)
    }

    fn at(offset: usize, magic: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; 348];
        bytes[offset..offset + magic.len()].copy_from_slice(magic);
        bytes
    }

    #[test]
    fn other_formats_are_named() {
        let mgh: Vec<u8> = [1_i32, 8, 9, 10, 1, 3, 0].iter().flat_map(|n| n.to_be_bytes()).collect();
        let xml = "<?xml version=\"1.0\"?>\n";
        for (bytes, part) in [
            (at(257, b"ustar"), "tar"),
            (b"# vtk DataFile Version 3.0\n".to_vec(), "VTK"),
            (mgh, "FreeSurfer volume"),
            (b"version https://git-lfs.github.com/spec/v1\noid sha256:0123".to_vec(), "Git LFS"),
            (b"\xef\xbb\xbf\n <!DOCTYPE HTML PUBLIC>".to_vec(), "web page"),
            (b"../../.git/annex/objects/Xk/2V/MD5E-s15203.nii.gz".to_vec(), "git-annex"),
            (b"<html lang=\"en\">".to_vec(), "web page"),
            (format!("{xml}<Error><Code>NoSuchKey</Code>").into_bytes(), "error message"),
            (format!("{xml}<GIFTI>").into_bytes(), "XML document"),
            (b"\x1f\xef\xbf\xbd\x08".to_vec(), "treated as text"),
            (b"NoSuchKey: mask.nii.gz\n".to_vec(), "plain text"),
            (b"".to_vec(), "empty file"),
            (vec![0; 348], "zeros"),
        ] {
            let name = name_of(&bytes).unwrap_or_default();
            assert!(name.contains(part), "{:?}: {name}", String::from_utf8_lossy(&bytes));
        }
        assert_eq!(name_of(&[7, 200, 3]), None);
    }
}
