//! The bytes of a file, hashed as they were sent, decompressed, counted and bounded.

use std::io::{BufRead, BufReader, Read};

use flate2::bufread::{GzDecoder, ZlibDecoder};
use sha2::{Digest, Sha256};

use super::error::ReadError;
use super::sniff::GZIP_MAGIC;
use crate::cancel::Cancel;
use crate::space::VolumeNotice;

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

/// Where the bytes of voxels come from.
pub(super) trait Values {
    /// Takes bytes into `buffer` as far as there are any; how many.
    fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, ReadError>;

    /// Bytes that were taken so far.
    fn position(&self) -> u64;

    /// What is asked whether to go on reading.
    fn cancel(&self) -> &dyn Cancel;
}

impl Values for Stream<'_> {
    fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, ReadError> {
        Stream::fill(self, buffer)
    }

    fn position(&self) -> u64 {
        Stream::position(self)
    }

    fn cancel(&self) -> &dyn Cancel {
        self.cancel
    }
}

/// The rest of a stream as a source of another one.
struct Rest<'r, 'a>(&'r mut Stream<'a>);

impl Read for Rest<'_, '_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.0.fill(buffer).map_err(std::io::Error::other)
    }
}

/// What failed below: a stream within a stream passes the fault of the outer one on.
fn io_fault(error: std::io::Error) -> ReadError {
    match error.downcast::<ReadError>() {
        Ok(fault) => fault,
        Err(error) => ReadError::Io(error),
    }
}

type Source<'a> = BufReader<Hashed<'a>>;

enum Inner<'a> {
    Plain(Source<'a>),
    Gzip(Box<GzDecoder<Source<'a>>>),
    Zlib(Box<ZlibDecoder<Source<'a>>>),
    /// After the last gzip member, or after zlib: what there is does not belong to the content.
    Ended(Source<'a>),
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
    /// Where the last gzip member ended that was read to its end, with the zeros after it, in bytes as sent.
    member_end: Option<u64>,
}

/// Bytes tolerated after the last voxel, in gzip and after it: some tools pad or append. More means that the header
/// does not describe the file.
const MAX_TAIL_BYTES: u64 = 1 << 20;
/// Bytes looked at together for the end of a line: longer than most lines, and moved for each of them.
const LINE_BYTES: usize = 2048;

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
        let compressed = source.fill_buf().map_err(io_fault)?.starts_with(&GZIP_MAGIC);
        let inner = if compressed { Inner::Gzip(Box::new(GzDecoder::new(source))) } else { Inner::Plain(source) };
        Ok(Self { inner, cancel, compressed, head: Vec::new(), came: 0, limit, member_end: None })
    }

    /// What is packed in the rest of this one, as gzip or zlib: told by the magic of gzip, for zlib has none. No more
    /// than `limit` bytes will come out.
    pub fn unpacked(&mut self, limit: u64) -> Result<Stream<'_>, ReadError> {
        let cancel = self.cancel;
        let mut stream = Stream::open(Rest(self), limit, cancel)?;
        stream.compressed = true;
        stream.inner = match stream.inner {
            Inner::Plain(source) => Inner::Zlib(Box::new(ZlibDecoder::new(source))),
            inner => inner,
        };
        Ok(stream)
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

    /// Takes bytes to the next line feed, which is one of them, but no more than `most`, or all that there are.
    pub fn line(&mut self, most: usize) -> Result<Vec<u8>, ReadError> {
        let mut line = Vec::new();
        loop {
            if self.head.is_empty() {
                self.peek(LINE_BYTES)?;
            }
            let end = self.head.iter().position(|byte| *byte == b'\n');
            let count = end.map_or(self.head.len(), |end| end + 1).min(most - line.len());
            line.extend(self.head.drain(..count));
            if end.is_some() || count == 0 || line.len() == most {
                return Ok(line);
            }
        }
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
                Inner::Zlib(decoder) => decoder.read(buffer),
                Inner::Ended(_) | Inner::Gone => return Ok(0),
            };
            let count = match result {
                Ok(count) => count,
                Err(error) => self.end_if_no_member(error)?,
            };
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
            Inner::Zlib(decoder) => return Ok(self.end_of_zlib(decoder.into_inner())),
            other => {
                self.inner = other;
                return Ok(false);
            }
        };
        let follows = first_after_zeros(&mut source).map_err(io_fault)? == Some(GZIP_MAGIC[0]);
        self.member_end = Some(source.get_ref().bytes - source.buffer().len() as u64);
        self.inner = if follows { Inner::Gzip(Box::new(GzDecoder::new(source))) } else { Inner::Ended(source) };
        Ok(follows)
    }

    /// Nothing follows zlib that belongs to it.
    fn end_of_zlib(&mut self, source: Source<'a>) -> bool {
        self.member_end = Some(source.get_ref().bytes - source.buffer().len() as u64);
        self.inner = Inner::Ended(source);
        false
    }

    /// What follows a whole member and has not the header of another is none: a line feed that a form added, a
    /// signature. It ends the content; whether that is complete, the reader of the format knows.
    fn end_if_no_member(&mut self, error: std::io::Error) -> Result<usize, ReadError> {
        use std::io::ErrorKind::Other;
        match std::mem::replace(&mut self.inner, Inner::Gone) {
            Inner::Gzip(decoder)
                if self.member_end.is_some() && decoder.header().is_none() && error.kind() != Other =>
            {
                self.inner = Inner::Ended(decoder.into_inner());
                Ok(0)
            }
            other => {
                self.inner = other;
                Err(self.fault(error))
            }
        }
    }

    /// Reads and drops what follows the last gzip member; how many bytes, to the end or until they are `most`.
    pub fn drop_foreign(&mut self, most: u64) -> Result<u64, ReadError> {
        while self.foreign() < most
            && let Inner::Ended(source) = &mut self.inner
        {
            self.cancel.check()?;
            let count = source.fill_buf().map_err(io_fault)?.len();
            source.consume(count);
            if count == 0 {
                break;
            }
        }
        Ok(self.foreign())
    }

    /// Bytes that came after the last gzip member so far.
    pub fn foreign(&self) -> u64 {
        match (&self.inner, self.member_end) {
            (Inner::Ended(source), Some(end)) => source.get_ref().bytes - end,
            _ => 0,
        }
    }

    /// What is to be told of bytes after the last gzip member.
    pub fn foreign_notice(&self) -> Option<VolumeNotice> {
        let message = format!("{} bytes after the end of the gzip stream were left unread", self.foreign());
        (self.foreign() > 0).then_some(VolumeNotice { code: "bytes_after_gzip", message })
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
            _ => io_fault(error),
        }
    }

    /// Reads to the end: only then has gzip compared its checksum, and is the hash that of the whole file.
    ///
    /// # Errors
    /// When more follows than is tolerated after the last voxel.
    pub fn drain(&mut self) -> Result<(), ReadError> {
        let expected = self.position();
        if self.skip(MAX_TAIL_BYTES + 1)? + self.drop_foreign(MAX_TAIL_BYTES + 1)? > MAX_TAIL_BYTES {
            return Err(ReadError::TrailingData { expected, allowed: MAX_TAIL_BYTES });
        }
        Ok(())
    }

    /// The hash of the file as sent; call it after the content has been read to its end.
    pub fn finish(self) -> Digested {
        let hashed = match self.inner {
            Inner::Plain(source) | Inner::Ended(source) => source.into_inner(),
            Inner::Gzip(decoder) => decoder.into_inner().into_inner(),
            Inner::Zlib(decoder) => decoder.into_inner().into_inner(),
            Inner::Gone => return Digested { sha256: String::new(), bytes: 0 },
        };
        Digested { sha256: hex(&hashed.hash.finalize()), bytes: hashed.bytes }
    }
}

/// Passes over zeros; the first byte that is none.
fn first_after_zeros(source: &mut Source<'_>) -> std::io::Result<Option<u8>> {
    loop {
        let rest = source.fill_buf()?;
        match rest.iter().position(|byte| *byte != 0) {
            Some(zeros) => {
                let first = rest[zeros];
                source.consume(zeros);
                return Ok(Some(first));
            }
            None if rest.is_empty() => return Ok(None),
            None => {
                let zeros = rest.len();
                source.consume(zeros);
            }
        }
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
