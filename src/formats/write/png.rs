//! Pixels → PNG (ISO/IEC 15948), 8 bits of red, green and blue.

use std::io::{self, Write};

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};

use crate::drawing::Pixels;

/// Writes a picture.
///
/// # Errors
/// When writing fails, or a side is of more than 2³² pixels.
pub fn write(pixels: &Pixels, mut out: impl Write) -> io::Result<()> {
    let mut header = Vec::new();
    for side in [pixels.width(), pixels.height()] {
        header.extend(u32::try_from(side).map_err(io::Error::other)?.to_be_bytes());
    }
    // Bits of a channel, colour without opacity, the only compression and filtering that there are, row after row.
    header.extend([8, 2, 0, 0, 0]);
    out.write_all(b"\x89PNG\r\n\x1a\n")?;
    chunk(*b"IHDR", &header, &mut out)?;
    chunk(*b"IDAT", &filtered(pixels)?, &mut out)?;
    chunk(*b"IEND", &[], &mut out)
}

/// Rows as differences to the row above, each after the number of that filter, compressed.
///
/// # Errors
/// Never, but for the type of the writer.
pub(super) fn filtered(pixels: &Pixels) -> io::Result<Vec<u8>> {
    const UP: u8 = 2;
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    let mut above = vec![0; 3 * pixels.width()];
    for y in 0..pixels.height() {
        let row = pixels.row(y).as_flattened();
        let mut line = vec![UP];
        line.extend(row.iter().zip(&above).map(|(own, above)| own.wrapping_sub(*above)));
        packed.write_all(&line)?;
        above.copy_from_slice(row);
    }
    packed.finish()
}

fn chunk(kind: [u8; 4], content: &[u8], out: &mut impl Write) -> io::Result<()> {
    let mut crc = Crc::new();
    crc.update(&kind);
    crc.update(content);
    out.write_all(&u32::try_from(content.len()).map_err(io::Error::other)?.to_be_bytes())?;
    out.write_all(&kind)?;
    out.write_all(content)?;
    out.write_all(&crc.sum().to_be_bytes())
}
