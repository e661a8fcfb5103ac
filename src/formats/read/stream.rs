//! The bytes of a file, hashed as they were sent, decompressed, counted and bounded.

use std::io::{BufRead, BufReader, Read};

use flate2::bufread::GzDecoder;
use sha2::{Digest, Sha256};

use super::error::ReadError;
use super::sniff::GZIP_MAGIC;
use crate::cancel::Cancel;

/// A source that hashes all that passes.
struct Hashed<'a> {
    source: Box<dyn Read + 'a>,
    hash: Sha256,
    bytes: u64,
}

impl Read for Hashed<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.hash.update(&buffer[..count]);
        self.bytes += count as u64;
        Ok(count)
    }
}

type Source<'a> = BufReader<Hashed<'a>>;

enum Inner<'a> {
    Plain(Source<'a>),
    Gzip(Box<GzDecoder<Source<'a>>>),
    /// Between two states, and for good after an error.
    Gone,
}

/// A file's content, from its first byte to its last.
pub(in crate::formats) struct Stream<'a> {
    inner: Inner<'a>,
    cancel: &'a dyn Cancel,
    compressed: bool,
    /// Bytes that were looked at and not taken yet.
    head: Vec<u8>,
    /// Bytes that came out of the file so far, the head included.
    came: u64,
    limit: u64,
}

/// What was hashed.
pub(in crate::formats) struct Digested {
    pub sha256: String,
    pub bytes: u64,
}

impl<'a> Stream<'a> {
    /// Opens; gzip is told by its magic. No more than `limit` bytes will come out.
    pub fn open(source: impl Read + 'a, limit: u64, cancel: &'a dyn Cancel) -> Result<Self, ReadError> {
        let hashed = Hashed { source: Box::new(source), hash: Sha256::new(), bytes: 0 };
        let mut source = BufReader::with_capacity(1 << 16, hashed);
        let compressed = source.fill_buf().map_err(ReadError::Io)?.starts_with(&GZIP_MAGIC);
        let inner = if compressed { Inner::Gzip(Box::new(GzDecoder::new(source))) } else { Inner::Plain(source) };
        Ok(Self { inner, cancel, compressed, head: Vec::new(), came: 0, limit })
    }

    /// Whether it was gzip.
    pub fn is_compressed(&self) -> bool {
        self.compressed
    }

    /// Bytes that were taken so far.
    pub fn position(&self) -> u64 {
        self.came - self.head.len() as u64
    }

    /// What is asked whether to go on reading.
    pub fn cancel(&self) -> &'a dyn Cancel {
        self.cancel
    }

    /// The next `count` bytes, or all that there are; they stay to be taken.
    pub fn peek(&mut self, count: usize) -> Result<&[u8], ReadError> {
        let mut head = vec![0; count];
        let filled = self.fill(&mut head)?;
        head.truncate(filled);
        self.head.splice(..0, head);
        Ok(&self.head)
    }

    /// Takes bytes into `buffer` as far as the content goes, unless it is told to stop.
    pub fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, ReadError> {
        self.cancel.check()?;
        let mut filled = self.head.len().min(buffer.len());
        buffer[..filled].copy_from_slice(&self.head[..filled]);
        self.head.drain(..filled);
        while filled < buffer.len() {
            let count = self.read_some(&mut buffer[filled..])?;
            if count == 0 {
                break;
            }
            filled += count;
            self.came += count as u64;
            if self.came > self.limit {
                return Err(ReadError::DecompressedTooLarge { limit: self.limit });
            }
        }
        Ok(filled)
    }

    /// Reads and drops up to `count` bytes; how many there were.
    pub fn skip(&mut self, count: u64) -> Result<u64, ReadError> {
        let mut buffer = [0; 8192];
        let mut skipped = 0;
        while skipped < count {
            let wanted = usize::try_from(count - skipped).unwrap_or(buffer.len()).min(buffer.len());
            let got = self.fill(&mut buffer[..wanted])?;
            if got == 0 {
                break;
            }
            skipped += got as u64;
        }
        Ok(skipped)
    }

    fn read_some(&mut self, buffer: &mut [u8]) -> Result<usize, ReadError> {
        loop {
            let result = match &mut self.inner {
                Inner::Plain(source) => source.read(buffer),
                Inner::Gzip(decoder) => decoder.read(buffer),
                Inner::Gone => return Ok(0),
            };
            let count = result.map_err(|error| self.fault(error))?;
            if count > 0 || !self.next_member()? {
                return Ok(count);
            }
        }
    }

    /// At the end of a gzip member: whether another one follows. Zeros after the last one are
    /// padding (tapes and some archives leave them).
    fn next_member(&mut self) -> Result<bool, ReadError> {
        let mut source = match std::mem::replace(&mut self.inner, Inner::Gone) {
            Inner::Gzip(decoder) => decoder.into_inner(),
            other => {
                self.inner = other;
                return Ok(false);
            }
        };
        loop {
            let rest = source.fill_buf().map_err(ReadError::Io)?;
            if rest.is_empty() {
                self.inner = Inner::Plain(source);
                return Ok(false);
            }
            let zeros = rest.iter().take_while(|byte| **byte == 0).count();
            if zeros == 0 {
                break;
            }
            source.consume(zeros);
        }
        if !source.fill_buf().map_err(ReadError::Io)?.starts_with(&GZIP_MAGIC[..1]) {
            return Err(ReadError::CorruptGzip { after: self.came });
        }
        self.inner = Inner::Gzip(Box::new(GzDecoder::new(source)));
        Ok(true)
    }

    /// flate2 tells damage by the kind of the error, a wrong checksum by its words alone.
    fn fault(&self, error: std::io::Error) -> ReadError {
        use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        match error.kind() {
            UnexpectedEof if self.compressed => ReadError::Truncated { expected: self.came + 1, got: self.came },
            InvalidData | InvalidInput if self.compressed => {
                if error.to_string().contains("checksum") {
                    ReadError::BadChecksum
                } else {
                    ReadError::CorruptGzip { after: self.came }
                }
            }
            _ => ReadError::Io(error),
        }
    }

    /// The hash of the file as sent; call it after the content has been read to its end.
    pub fn finish(self) -> Digested {
        let hashed = match self.inner {
            Inner::Plain(source) => source.into_inner(),
            Inner::Gzip(decoder) => decoder.into_inner().into_inner(),
            Inner::Gone => return Digested { sha256: String::new(), bytes: 0 },
        };
        Digested { sha256: hex(&hashed.hash.finalize()), bytes: hashed.bytes }
    }
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
