//! Pages → PDF 1.7 (ISO 32000-1): words that can be searched and copied, in fonts that are in the file.
//!
//! Equal pages give equal bytes: nothing in the file tells when it was written.

mod fonts;

mod content;

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use sha2::{Digest, Sha256};

use super::png;
use crate::drawing::{Page, Pixels, Typeface};
use crate::formats::hex;
use content::{Content, Used};

/// A4, points.
const PAPER: [f64; 2] = [595.0, 842.0];

/// Writes a document of pages, each on a sheet of paper: as wide as that, or smaller where it is too long. Pages are
/// taken one by one, and their pictures compressed at once: a report may have hundreds.
///
/// # Errors
/// When writing fails.
pub fn write(title: &str, pages: impl IntoIterator<Item = Page>, mut out: impl Write) -> io::Result<()> {
    let mut file = File::default();
    let [catalog, tree] = [(); 2].map(|()| file.reserve());
    let fonts = Typeface::ALL.map(|_| file.reserve());
    let (mut kids, mut used) = (Vec::new(), Used::default());
    for page in pages {
        kids.push(add_page(&mut file, &page, (fonts, tree), &mut used)?);
    }
    for (face, number) in Typeface::ALL.into_iter().zip(fonts) {
        let font = fonts::font(&mut file, face, &used.of(face))?;
        file.set(number, font);
    }
    let count = kids.len();
    let kids: String = kids.iter().map(|number| format!("{number} 0 R ")).collect();
    file.set(tree, format!("<< /Type /Pages /Kids [ {kids}] /Count {count} >>"));
    file.set(catalog, format!("<< /Type /Catalog /Pages {tree} 0 R /Lang (en) >>"));
    let info = file.add(format!("<< /Title {} /Producer (medialrep {}) >>", text(title), env!("CARGO_PKG_VERSION")));
    file.write(catalog, info, &mut out)
}

/// Adds a page; its number.
fn add_page(file: &mut File, page: &Page, (fonts, tree): ([usize; 2], usize), used: &mut Used) -> io::Result<usize> {
    let [width, height] = page.size;
    let scale = (PAPER[0] / width).min(PAPER[1] / height);
    let content = Content::of(page, used);
    let mut pictures = String::new();
    for (n, pixels) in content.pictures.iter().enumerate() {
        pictures.push_str(&format!("/I{n} {} 0 R ", add_picture(file, pixels)?));
    }
    let mut faces = String::new();
    for (face, number) in Typeface::ALL.into_iter().zip(fonts) {
        faces.push_str(&format!("/{} {number} 0 R ", fonts::resource(face)));
    }
    // Upwards from the lower left corner, as the format has it: turned over, from the upper left one.
    let left = (PAPER[0] - scale * width) / 2.0;
    let head = format!("q {scale:.6} 0 0 {:.6} {left:.3} {} cm\n", -scale, PAPER[1]);
    let stream = file.add_stream("", [head.as_bytes(), content.operators.as_bytes(), b"Q\n"].concat().as_slice())?;
    Ok(file.add(format!(
        "<< /Type /Page /Parent {tree} 0 R /MediaBox [0 0 {} {}] /Contents {stream} 0 R \
         /Resources << /Font << {faces}>> /XObject << {pictures}>> >> >>",
        PAPER[0], PAPER[1]
    )))
}

fn add_picture(file: &mut File, pixels: &Pixels) -> io::Result<usize> {
    let (width, height) = (pixels.width(), pixels.height());
    // Predictor 15: rows are filtered as PNG has them, which halves what is left of shaded surfaces.
    let facts = format!(
        "/Type /XObject /Subtype /Image /Width {width} /Height {height} /ColorSpace /DeviceRGB /BitsPerComponent 8 \
         /DecodeParms << /Predictor 15 /Colors 3 /BitsPerComponent 8 /Columns {width} >> "
    );
    Ok(file.add_packed(&facts, &png::filtered(pixels)?))
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

    fn set(&mut self, number: usize, object: String) {
        if let Some(place) = number.checked_sub(1).and_then(|n| self.objects.get_mut(n)) {
            *place = object.into_bytes();
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
        Ok(self.add_packed(facts, &packed.finish()?))
    }

    /// The same of bytes that are compressed already.
    fn add_packed(&mut self, facts: &str, packed: &[u8]) -> usize {
        let mut object = format!("<< {facts}/Filter /FlateDecode /Length {} >>\nstream\n", packed.len()).into_bytes();
        object.extend(packed);
        object.extend(b"\nendstream");
        self.objects.push(object);
        self.objects.len()
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
