//! Values written as text → bytes, as if they had been stored.

use super::error::ReadError;
use super::stored::Datatype;
use super::stream::{Stream, Values};
use crate::cancel::Cancel;

/// Bytes of text read at a time.
const BLOCK_BYTES: usize = 1 << 16;
/// Bytes of a number: the longest that tools write has 25.
const MAX_NUMBER_BYTES: usize = 64;

/// The rest of a stream as numbers between spaces, line ends or commas. Gives them as little-endian values.
pub(super) struct TextValues<'s, 'a> {
    stream: &'s mut Stream<'a>,
    datatype: Datatype,
    block: Vec<u8>,
    /// Bytes of the block that were taken.
    taken: usize,
    given: u64,
}

impl<'s, 'a> TextValues<'s, 'a> {
    /// From here on.
    pub fn of(stream: &'s mut Stream<'a>, datatype: Datatype) -> Self {
        Self { stream, datatype, block: Vec::new(), taken: 0, given: 0 }
    }

    fn next_byte(&mut self) -> Result<Option<u8>, ReadError> {
        if self.taken == self.block.len() {
            self.block.resize(BLOCK_BYTES, 0);
            let got = self.stream.fill(&mut self.block)?;
            self.block.truncate(got);
            self.taken = 0;
        }
        let byte = self.block.get(self.taken).copied();
        self.taken += usize::from(byte.is_some());
        Ok(byte)
    }

    /// The next number as it is written, into `number`; empty at the end.
    fn next_number(&mut self, number: &mut Vec<u8>) -> Result<(), ReadError> {
        number.clear();
        while let Some(byte) = self.next_byte()? {
            match (byte.is_ascii_whitespace() || byte == b',', number.is_empty()) {
                (true, true) => {}
                (true, false) => break,
                (false, _) if number.len() == MAX_NUMBER_BYTES => return Err(self.no_number()),
                (false, _) => number.push(byte),
            }
        }
        Ok(())
    }

    fn no_number(&self) -> ReadError {
        let ahead = (self.block.len() - self.taken) as u64;
        ReadError::BadNumber { byte: (self.stream.position() - ahead).saturating_sub(1) }
    }
}

impl Values for TextValues<'_, '_> {
    fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, ReadError> {
        let mut filled = 0;
        let mut number = Vec::with_capacity(MAX_NUMBER_BYTES);
        for place in buffer.chunks_exact_mut(self.datatype.bytes()) {
            self.next_number(&mut number)?;
            if number.is_empty() {
                break;
            }
            let stored = stored(&number, self.datatype).ok_or_else(|| self.no_number())?;
            place.copy_from_slice(&stored[..place.len()]);
            filled += place.len();
        }
        self.given += filled as u64;
        Ok(filled)
    }

    /// Of the values, as if they had been stored.
    fn position(&self) -> u64 {
        self.given
    }

    fn cancel(&self) -> &dyn Cancel {
        self.stream.cancel()
    }
}

/// A number as it is stored, the low byte first; `None` where it is none or does not fit.
fn stored(text: &[u8], datatype: Datatype) -> Option<[u8; 8]> {
    let text = std::str::from_utf8(text).ok()?;
    let mut bytes = [0; 8];
    let mut put = |stored: &[u8]| bytes[..stored.len()].copy_from_slice(stored);
    match datatype {
        Datatype::Uint8 => put(&text.parse::<u8>().ok()?.to_le_bytes()),
        Datatype::Int8 => put(&text.parse::<i8>().ok()?.to_le_bytes()),
        Datatype::Int16 => put(&text.parse::<i16>().ok()?.to_le_bytes()),
        Datatype::Uint16 => put(&text.parse::<u16>().ok()?.to_le_bytes()),
        Datatype::Int32 => put(&text.parse::<i32>().ok()?.to_le_bytes()),
        Datatype::Uint32 => put(&text.parse::<u32>().ok()?.to_le_bytes()),
        Datatype::Int64 => put(&text.parse::<i64>().ok()?.to_le_bytes()),
        Datatype::Uint64 => put(&text.parse::<u64>().ok()?.to_le_bytes()),
        Datatype::Float32 => put(&text.parse::<f32>().ok()?.to_le_bytes()),
        Datatype::Float64 => put(&text.parse::<f64>().ok()?.to_le_bytes()),
    }
    Some(bytes)
}
