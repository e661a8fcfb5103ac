//! Pages → PDF 1.7 (ISO 32000-1): words that can be searched and copied, in fonts that are in the file.
//!
//! Equal pages give equal bytes: nothing in the file tells when it was written.

mod fonts;

mod content;

use std::collections::BTreeMap;
use std::io::{self, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use sha2::{Digest, Sha256};

use crate::drawing::{Page, Pixels, Typeface};
use crate::formats::hex;
use content::Content;

/// A4, points.
const PAPER: [f64; 2] = [595.0, 842.0];

/// Writes a document of pages, each on a sheet of paper: as wide as that, or smaller where it is too long.
///
/// # Errors
/// When writing fails.
pub fn write(title: &str, pages: &[Page], mut out: impl Write) -> io::Result<()> {
    let mut file = File::default();
    let catalog = file.reserve();
    let tree = file.reserve();
    let contents: Vec<Content> = pages.iter().map(Content::of).collect();
    let mut fonts = String::new();
    for face in Typeface::ALL {
        let mut used = BTreeMap::new();
        contents.iter().for_each(|content| used.extend(content.used(face)));
        let font = fonts::add(&mut file, face, &used)?;
        fonts.push_str(&format!("/{} {font} 0 R ", fonts::resource(face)));
    }
    let mut kids = String::new();
    for (page, content) in pages.iter().zip(&contents) {
        kids.push_str(&format!("{} 0 R ", add_page(&mut file, (page, content), &fonts, tree)?));
    }
    file.set(tree, format!("<< /Type /Pages /Kids [ {kids}] /Count {} >>", pages.len()).into_bytes());
    file.set(catalog, format!("<< /Type /Catalog /Pages {tree} 0 R /Lang (en) >>").into_bytes());
    let info = file.add(format!("<< /Title {} /Producer (medialrep {}) >>", text(title), env!("CARGO_PKG_VERSION")));
    file.write(catalog, info, &mut out)
}

fn add_page(file: &mut File, (page, content): (&Page, &Content), fonts: &str, tree: usize) -> io::Result<usize> {
    let [width, height] = page.size;
    let scale = (PAPER[0] / width).min(PAPER[1] / height);
    let mut pictures = String::new();
    for (n, pixels) in content.pictures.iter().enumerate() {
        pictures.push_str(&format!("/I{n} {} 0 R ", add_picture(file, pixels)?));
    }
    // Upwards from the lower left corner, as the format has it: turned over, from the upper left one.
    let left = (PAPER[0] - scale * width) / 2.0;
    let head = format!("q {scale:.6} 0 0 {:.6} {left:.3} {} cm\n", -scale, PAPER[1]);
    let stream = file.add_stream("", [head.as_bytes(), content.operators.as_bytes(), b"Q\n"].concat().as_slice())?;
    Ok(file.add(format!(
        "<< /Type /Page /Parent {tree} 0 R /MediaBox [0 0 {} {}] /Contents {stream} 0 R \
         /Resources << /Font << {fonts}>> /XObject << {pictures}>> >> >>",
        PAPER[0], PAPER[1]
    )))
}

fn add_picture(file: &mut File, pixels: &Pixels) -> io::Result<usize> {
    let facts = format!(
        "/Type /XObject /Subtype /Image /Width {} /Height {} /ColorSpace /DeviceRGB /BitsPerComponent 8 ",
        pixels.width(),
        pixels.height()
    );
    file.add_stream(&facts, pixels.bytes())
}

/// A text as the format has it where it is no content: UTF-16 in hexadecimal digits.
fn text(words: &str) -> String {
    let mut digits = "<FEFF".to_owned();
    for unit in words.encode_utf16() {
        digits.push_str(&format!("{unit:04X}"));
    }
    digits.push('>');
    digits
}

/// The objects of a file; the first has number 1.
#[derive(Default)]
struct File {
    objects: Vec<Vec<u8>>,
}

impl File {
    /// A number for an object that is told later.
    fn reserve(&mut self) -> usize {
        self.add(String::new())
    }

    fn set(&mut self, number: usize, object: Vec<u8>) {
        if let Some(place) = number.checked_sub(1).and_then(|n| self.objects.get_mut(n)) {
            *place = object;
        }
    }

    /// Adds an object; its number.
    fn add(&mut self, object: String) -> usize {
        self.objects.push(object.into_bytes());
        self.objects.len()
    }

    /// Adds bytes, compressed, with what else is said of them.
    fn add_stream(&mut self, facts: &str, bytes: &[u8]) -> io::Result<usize> {
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(bytes)?;
        let packed = packed.finish()?;
        let mut object = format!("<< {facts}/Filter /FlateDecode /Length {} >>\nstream\n", packed.len()).into_bytes();
        object.extend(packed);
        object.extend(b"\nendstream");
        self.objects.push(object);
        Ok(self.objects.len())
    }

    fn write(&self, catalog: usize, info: usize, out: &mut impl Write) -> io::Result<()> {
        // Bytes beyond ASCII say that the file is binary.
        let mut file = b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n".to_vec();
        let mut places = String::new();
        for (n, object) in self.objects.iter().enumerate() {
            places.push_str(&format!("{:010} 00000 n \n", file.len()));
            file.extend(format!("{} 0 obj\n", n + 1).into_bytes());
            file.extend(object);
            file.extend(b"\nendobj\n");
        }
        let (count, table) = (self.objects.len() + 1, file.len());
        let id = hex(&Sha256::digest(&file)[..16]);
        file.extend(format!("xref\n0 {count}\n0000000000 65535 f \n{places}").into_bytes());
        file.extend(
            format!(
                "trailer\n<< /Size {count} /Root {catalog} 0 R /Info {info} 0 R /ID [<{id}> <{id}>] >>\n\
                 startxref\n{table}\n%%EOF\n"
            )
            .into_bytes(),
        );
        out.write_all(&file)
    }
}
