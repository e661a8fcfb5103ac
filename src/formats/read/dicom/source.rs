//! Bytes of a data set: as they stand in the file, or inflated.

use flate2::{Decompress, FlushDecompress, Status};

use super::error::DicomFault;
use super::tag::TagPath;
use crate::formats::read::error::ReadError;
use crate::formats::read::stream::Stream;

/// Bytes that are read ahead: elements are a few bytes each.
const BUFFER_BYTES: usize = 1 << 16;

/// Bytes, counted and bounded.
pub(super) struct Source<'s, 'f> {
    stream: &'s mut Stream<'f>,
    inflater: Option<Inflater>,
    buffer: Vec<u8>,
    /// What of the buffer was taken, and what is filled.
    taken: usize,
    filled: usize,
    position: u64,
    limit: u64,
}

/// Deflate without a header around it, and what of it was read but not inflated.
struct Inflater {
    state: Decompress,
    input: Vec<u8>,
    taken: usize,
    has_ended: bool,
}

impl<'s, 'f> Source<'s, 'f> {
    /// Nothing beyond `limit` bytes will come out.
    pub fn new(stream: &'s mut Stream<'f>, limit: u64) -> Self {
        Self { stream, inflater: None, buffer: vec![0; BUFFER_BYTES], taken: 0, filled: 0, position: 0, limit }
    }

    /// Inflates all that comes from now on.
    pub fn inflate(&mut self) {
        let input = self.buffer[self.taken..self.filled].to_vec();
        (self.taken, self.filled) = (0, 0);
        self.inflater = Some(Inflater { state: Decompress::new(false), input, taken: 0, has_ended: false });
    }

    /// Bytes that were taken so far.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// The stream that it reads from.
    pub fn stream(&self) -> &Stream<'f> {
        self.stream
    }

    /// Takes bytes into `out` as far as there are any.
    ///
    /// # Errors
    /// When they cannot be read or inflated, or are more than allowed.
    pub fn fill(&mut self, out: &mut [u8]) -> Result<usize, ReadError> {
        let mut count = 0;
        while count < out.len() {
            if self.taken == self.filled && !self.refill()? {
                break;
            }
            let some = (out.len() - count).min(self.filled - self.taken);
            out[count..count + some].copy_from_slice(&self.buffer[self.taken..self.taken + some]);
            self.taken += some;
            count += some;
        }
        self.position += count as u64;
        if self.position > self.limit {
            return Err(ReadError::DecompressedTooLarge { limit: self.limit });
        }
        Ok(count)
    }

    /// Takes as many bytes as `out` has.
    ///
    /// # Errors
    /// As [`Self::fill`], and when there are fewer.
    pub fn exact(&mut self, out: &mut [u8]) -> Result<(), ReadError> {
        let start = self.position;
        if self.fill(out)? < out.len() {
            return Err(ReadError::Truncated { expected: start + out.len() as u64, got: self.position });
        }
        Ok(())
    }

    /// Takes so many bytes.
    ///
    /// # Errors
    /// As [`Self::exact`].
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], ReadError> {
        let mut out = [0; N];
        self.exact(&mut out)?;
        Ok(out)
    }

    /// Takes `count` bytes. Memory grows with what comes: a length may lie.
    ///
    /// # Errors
    /// As [`Self::exact`].
    pub fn take(&mut self, count: u64) -> Result<Vec<u8>, ReadError> {
        let expected = self.position + count;
        let mut out = Vec::new();
        while self.position < expected {
            let (filled, some) = (out.len(), chunk(expected - self.position));
            out.resize(filled + some, 0);
            if self.fill(&mut out[filled..])? < some {
                return Err(ReadError::Truncated { expected, got: self.position });
            }
        }
        Ok(out)
    }

    /// Takes and drops `count` bytes.
    ///
    /// # Errors
    /// As [`Self::exact`].
    pub fn skip(&mut self, count: u64) -> Result<(), ReadError> {
        let expected = self.position + count;
        loop {
            let some = chunk(expected - self.position).min(self.filled - self.taken);
            self.taken += some;
            self.position += some as u64;
            if self.position > self.limit {
                return Err(ReadError::DecompressedTooLarge { limit: self.limit });
            }
            if self.position == expected {
                return Ok(());
            }
            if self.taken == self.filled && !self.refill()? {
                return Err(ReadError::Truncated { expected, got: self.position });
            }
        }
    }

    /// Fills the buffer anew; whether anything came.
    fn refill(&mut self) -> Result<bool, ReadError> {
        self.taken = 0;
        self.filled = match &mut self.inflater {
            None => self.stream.fill(&mut self.buffer)?,
            Some(inflater) => inflater.fill(self.stream, &mut self.buffer, self.position)?,
        };
        Ok(self.filled > 0)
    }
}

/// Bytes that are taken at a time, of so many.
fn chunk(count: u64) -> usize {
    usize::try_from(count).unwrap_or(BUFFER_BYTES).min(BUFFER_BYTES)
}

impl Inflater {
    /// Inflates into `out`; 0 at the end.
    fn fill(&mut self, stream: &mut Stream<'_>, out: &mut [u8], position: u64) -> Result<usize, ReadError> {
        let damaged = || DicomFault::CorruptDeflate { after: position }.at(TagPath::default());
        while !self.has_ended {
            let is_last = self.taken == self.input.len() && !self.refill(stream)?;
            let (read, written) = (self.state.total_in(), self.state.total_out());
            let status = self.state.decompress(&self.input[self.taken..], out, FlushDecompress::None);
            let (read, written) = (self.state.total_in() - read, self.state.total_out() - written);
            self.taken += usize::try_from(read).unwrap_or(0);
            self.has_ended = matches!(status.map_err(|_| damaged())?, Status::StreamEnd);
            if written > 0 {
                return Ok(usize::try_from(written).unwrap_or(0));
            }
            if is_last && !self.has_ended {
                return Err(ReadError::Truncated { expected: position + 1, got: position });
            }
            if read == 0 && !self.has_ended {
                return Err(damaged());
            }
        }
        Ok(0)
    }

    /// Reads more to inflate; whether anything came.
    fn refill(&mut self, stream: &mut Stream<'_>) -> Result<bool, ReadError> {
        self.input.resize(BUFFER_BYTES, 0);
        let count = stream.fill(&mut self.input)?;
        self.input.truncate(count);
        self.taken = 0;
        Ok(count > 0)
    }
}
