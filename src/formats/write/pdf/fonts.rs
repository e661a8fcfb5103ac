//! The typeface in a PDF: the whole TrueType file, its glyphs by number, and the characters that they stand for.

use std::collections::BTreeMap;
use std::io;

use super::File;
use crate::drawing::Typeface;

/// Pairs of a `bfchar` block at the most (Adobe technical note 5411).
const BLOCK: usize = 100;

/// The name of a face on pages.
pub(super) fn resource(face: Typeface) -> &'static str {
    match face {
        Typeface::Regular => "F0",
        Typeface::Bold => "F1",
    }
}

/// A face as a font with the glyphs that are used; what it consists of is added to the file.
pub(super) fn font(file: &mut File, face: Typeface, used: &BTreeMap<u16, char>) -> io::Result<String> {
    let (name, measures) = (face.name(), face.measures());
    let program = file.add_stream(&format!("/Length1 {} ", face.bytes().len()), face.bytes())?;
    let [left, bottom, right, top] = measures.bounds.map(f64::round);
    // Flag 4: the characters are not those of the standard Latin set alone. A stem of that width is usual.
    let stem = if face == Typeface::Bold { 140 } else { 80 };
    let descriptor = file.add(format!(
        "<< /Type /FontDescriptor /FontName /{name} /Flags 4 /FontBBox [{left} {bottom} {right} {top}] /ItalicAngle 0 \
         /Ascent {:.0} /Descent {:.0} /CapHeight {:.0} /StemV {stem} /FontFile2 {program} 0 R >>",
        measures.ascent, measures.descent, measures.capitals
    ));
    let mut widths = String::new();
    for glyph in used.keys() {
        widths.push_str(&format!("{glyph} [{:.0}] ", 1000.0 * face.advance(*glyph)));
    }
    let glyphs = file.add(format!(
        "<< /Type /Font /Subtype /CIDFontType2 /BaseFont /{name} /CIDToGIDMap /Identity \
         /CIDSystemInfo << /Registry (Adobe) /Ordering (Identity) /Supplement 0 >> \
         /FontDescriptor {descriptor} 0 R /DW 600 /W [ {widths}] >>"
    ));
    let characters = file.add_stream("", characters(used).as_bytes())?;
    Ok(format!(
        "<< /Type /Font /Subtype /Type0 /BaseFont /{name} /Encoding /Identity-H /DescendantFonts [{glyphs} 0 R] \
         /ToUnicode {characters} 0 R >>"
    ))
}

/// Which character each glyph stands for, so that words can be searched and copied.
fn characters(used: &BTreeMap<u16, char>) -> String {
    let mut map = "/CIDInit /ProcSet findresource begin\n12 dict begin\nbegincmap\n\
        /CIDSystemInfo << /Registry (Adobe) /Ordering (UCS) /Supplement 0 >> def\n\
        /CMapName /Adobe-Identity-UCS def\n/CMapType 2 def\n\
        1 begincodespacerange\n<0000> <FFFF>\nendcodespacerange\n"
        .to_owned();
    let pairs: Vec<(&u16, &char)> = used.iter().collect();
    for block in pairs.chunks(BLOCK) {
        map.push_str(&format!("{} beginbfchar\n", block.len()));
        for (glyph, character) in block {
            map.push_str(&format!("<{glyph:04X}> <"));
            let mut units = [0; 2];
            for unit in character.encode_utf16(&mut units) {
                map.push_str(&format!("{unit:04X}"));
            }
            map.push_str(">\n");
        }
        map.push_str("endbfchar\n");
    }
    map.push_str("endcmap\nCMapName currentdict /CMap defineresource pop\nend\nend\n");
    map
}
