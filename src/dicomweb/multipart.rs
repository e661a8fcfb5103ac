//! Bodies of `multipart/related` (RFC 2046 section 5.1, RFC 2387), taken apart while they come. Memory is that of one
//! chunk and a head, whatever is sent; what would need more is refused.
//!
//! ```text
//! preamble CRLF --boundary CRLF  head CRLF CRLF data  CRLF --boundary CRLF  …  CRLF --boundary-- epilogue
//! ```

use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::{Bytes, BytesMut};
use futures_util::{Stream, StreamExt};
use uuid::Uuid;

use crate::media_type::parameter;

const CRLF: &[u8] = b"\r\n";
const END_OF_HEAD: &[u8] = b"\r\n\r\n";
/// Longest boundary. RFC 2046 has 70, and Orthanc sends two UUIDs: with less, it could not store here. It is searched for
/// and kept back at the end of each chunk, so that a very long one would cost time and memory.
const MAX_BOUNDARY_BYTES: usize = 200;
/// Longest text before the first boundary. Nobody sends any; with more, a body of another kind is read for long before
/// it is refused.
const MAX_PREAMBLE_BYTES: usize = 4 << 10;
/// Longest head of a part. Those of DICOMweb have one to three short lines; with less, long locations would be refused.
const MAX_HEAD_BYTES: usize = 8 << 10;
/// White space that may follow a boundary on its line. Some gateways pad; with no bound, it would be kept for ever.
const MAX_PADDING_BYTES: usize = 64;

/// What bounds a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MultipartLimits {
    /// Bytes of the whole body, heads and boundaries included.
    pub max_bytes: u64,
    /// Parts.
    pub max_parts: usize,
}

/// Why a body cannot be taken apart. Holds nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MultipartError {
    /// Another kind of body, or no usable boundary.
    #[error("the content type is not multipart/related of application/dicom with a boundary")]
    NotMultipart,
    /// No boundary where the first was to be.
    #[error("the body does not begin with the boundary that its content type names")]
    NoFirstBoundary,
    /// The head of a part is no list of fields, or too long.
    #[error("the head of part {part} is malformed or longer than {MAX_HEAD_BYTES} bytes")]
    BadHead {
        /// Counted from 1.
        part: usize,
    },
    /// A part in base64 or the like.
    #[error("part {part} has a Content-Transfer-Encoding, which HTTP has not")]
    Encoded {
        /// Counted from 1.
        part: usize,
    },
    /// More parts than allowed.
    #[error("the body has more than {limit} parts")]
    TooManyParts {
        /// Parts allowed.
        limit: usize,
    },
    /// More bytes than allowed.
    #[error("the body is larger than {limit} bytes")]
    TooLarge {
        /// Bytes allowed.
        limit: u64,
    },
    /// It ended before its last boundary.
    #[error("the body ended before its last boundary")]
    CutOff,
    /// What it came over broke.
    #[error("the connection broke")]
    Broken,
    /// It paused for too long.
    #[error("the body paused for too long")]
    TooSlow,
}

/// The boundary that a content type of `multipart/related` names, where its parts may be DICOM.
///
/// # Errors
/// When it is another type, or has no boundary that can be used.
pub fn boundary_of(content_type: &str) -> Result<String, MultipartError> {
    let kind = content_type.split(';').next().unwrap_or_default().trim();
    // Some leave the type of the parts out: they are told by their bytes.
    let of = parameter(content_type, "type").unwrap_or_else(|| DICOM.to_owned());
    let boundary = parameter(content_type, "boundary").filter(|boundary| is_boundary(boundary));
    match boundary {
        Some(boundary) if kind.eq_ignore_ascii_case(MULTIPART) && of.eq_ignore_ascii_case(DICOM) => Ok(boundary),
        _ => Err(MultipartError::NotMultipart),
    }
}

/// The media type of bodies of parts.
pub const MULTIPART: &str = "multipart/related";
/// What ends the body of a part that is written.
pub const CLOSE: &[u8] = CRLF;

/// How the parts of a body are told apart that is written here.
#[derive(Clone, Debug)]
pub struct Framing {
    boundary: String,
}

impl Framing {
    /// With a boundary that nobody can guess, so that no file has it.
    #[must_use]
    #[expect(clippy::new_without_default, reason = "each is another")]
    pub fn new() -> Self {
        Self { boundary: Uuid::now_v7().simple().to_string() }
    }

    /// What goes before the body of a part.
    #[must_use]
    pub fn begin(&self, media_type: &str) -> Bytes {
        format!("--{}\r\nContent-Type: {media_type}\r\n\r\n", self.boundary).into()
    }

    /// What goes behind the last part.
    #[must_use]
    pub fn end(&self) -> Bytes {
        format!("--{}--\r\n", self.boundary).into()
    }

    /// The media type of the body, whose parts are of type `part`.
    #[must_use]
    pub fn media_type(&self, part: &str) -> String {
        format!("{MULTIPART}; type=\"{part}\"; boundary={}", self.boundary)
    }
}
const DICOM: &str = "application/dicom";

fn is_boundary(text: &str) -> bool {
    let is_printed = text.bytes().all(|byte| (b' '..=b'~').contains(&byte));
    (1..=MAX_BOUNDARY_BYTES).contains(&text.len()) && is_printed && !text.ends_with(' ')
}

/// What a body holds next.
#[derive(Debug, PartialEq, Eq)]
pub enum Step {
    /// Nothing before more bytes are fed.
    More,
    /// A part begins.
    Begin,
    /// Bytes of the part.
    Data(Bytes),
    /// The part has ended.
    End,
    /// There are no more parts; what follows is not looked at.
    Done,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Preamble,
    Head,
    Data,
    Done,
}

/// What stands at the beginning of the buffer.
enum Found {
    /// So many bytes that belong to no boundary.
    Bytes(usize),
    /// The line of a boundary, of so many bytes.
    Boundary(usize),
    /// The last boundary.
    Last,
    /// Too little to tell.
    Unclear,
}

/// Takes a body apart that is fed to it in chunks.
#[derive(Debug)]
pub struct Splitter {
    /// The line break before it included: only at the beginning of a line is it a boundary.
    boundary: Vec<u8>,
    limits: MultipartLimits,
    state: State,
    buffer: BytesMut,
    fed_bytes: u64,
    preamble_bytes: usize,
    parts: usize,
}

impl Splitter {
    /// For bodies with this boundary, as [`boundary_of`] gives it.
    #[must_use]
    pub fn new(boundary: &str, limits: MultipartLimits) -> Self {
        Self {
            boundary: [CRLF, b"--", boundary.as_bytes()].concat(),
            limits,
            state: State::Preamble,
            // The first boundary has no line break before it where there is no preamble.
            buffer: BytesMut::from(CRLF),
            fed_bytes: 0,
            preamble_bytes: 0,
            parts: 0,
        }
    }

    /// Takes the next chunk.
    ///
    /// # Errors
    /// When the body is longer than allowed.
    pub fn feed(&mut self, chunk: &[u8]) -> Result<(), MultipartError> {
        self.fed_bytes = self.fed_bytes.saturating_add(chunk.len() as u64);
        if self.fed_bytes > self.limits.max_bytes {
            return Err(MultipartError::TooLarge { limit: self.limits.max_bytes });
        }
        self.buffer.extend_from_slice(chunk);
        Ok(())
    }

    /// What comes next; to be asked until it is [`Step::More`] or [`Step::Done`].
    ///
    /// # Errors
    /// When the body is malformed or has too many parts.
    pub fn step(&mut self) -> Result<Step, MultipartError> {
        loop {
            let step = match self.state {
                State::Preamble => self.pass_preamble()?,
                State::Head => return self.read_head(),
                State::Data => return Ok(self.read_data()),
                State::Done => return Ok(Step::Done),
            };
            if let Some(step) = step {
                return Ok(step);
            }
        }
    }

    /// `None` once something else was reached.
    fn pass_preamble(&mut self) -> Result<Option<Step>, MultipartError> {
        match self.look() {
            Found::Unclear => return Ok(Some(Step::More)),
            Found::Boundary(length) => self.begin_part(length),
            Found::Last => self.state = State::Done,
            Found::Bytes(length) => {
                self.preamble_bytes += length;
                if self.preamble_bytes > MAX_PREAMBLE_BYTES {
                    return Err(MultipartError::NoFirstBoundary);
                }
                self.pass(length);
            }
        }
        Ok(None)
    }

    fn read_head(&mut self) -> Result<Step, MultipartError> {
        let bad = MultipartError::BadHead { part: self.parts };
        // A head without a line ends at once.
        let (length, passed) = if self.buffer.starts_with(CRLF) {
            (0, CRLF.len())
        } else {
            let within = self.buffer.len().min(MAX_HEAD_BYTES);
            match find(&self.buffer[..within], END_OF_HEAD) {
                Some(length) => (length, length + END_OF_HEAD.len()),
                None if within < MAX_HEAD_BYTES => return Ok(Step::More),
                None => return Err(bad),
            }
        };
        if self.parts > self.limits.max_parts {
            return Err(MultipartError::TooManyParts { limit: self.limits.max_parts });
        }
        check_head(&self.buffer[..length], self.parts)?;
        self.pass(passed);
        self.state = State::Data;
        Ok(Step::Begin)
    }

    fn read_data(&mut self) -> Step {
        match self.look() {
            Found::Unclear => Step::More,
            Found::Bytes(length) => Step::Data(self.buffer.split_to(length).freeze()),
            Found::Boundary(length) => {
                self.begin_part(length);
                Step::End
            }
            Found::Last => {
                self.state = State::Done;
                Step::End
            }
        }
    }

    fn begin_part(&mut self, length: usize) {
        self.pass(length);
        self.parts += 1;
        self.state = State::Head;
    }

    fn pass(&mut self, length: usize) {
        drop(self.buffer.split_to(length));
    }

    fn look(&self) -> Found {
        match find(&self.buffer, &self.boundary) {
            Some(0) => self.look_behind_boundary(),
            Some(before) => Found::Bytes(before),
            // The last bytes may be the beginning of a boundary.
            None => match self.buffer.len().saturating_sub(self.boundary.len() - 1) {
                0 => Found::Unclear,
                length => Found::Bytes(length),
            },
        }
    }

    /// Data may hold a boundary with something behind it: then it is none.
    fn look_behind_boundary(&self) -> Found {
        let rest = &self.buffer[self.boundary.len()..];
        if rest.starts_with(b"--") {
            return Found::Last;
        }
        let padding = rest.iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
        let (line_end, is_padding) = (&rest[padding..], padding <= MAX_PADDING_BYTES);
        if is_padding && line_end.starts_with(CRLF) {
            return Found::Boundary(self.boundary.len() + padding + CRLF.len());
        }
        let is_unclear = line_end.is_empty() || line_end == b"\r" || rest == b"-";
        if is_padding && is_unclear { Found::Unclear } else { Found::Bytes(self.boundary.len()) }
    }
}

/// Where `wanted`, which begins with a line break, stands.
fn find(bytes: &[u8], wanted: &[u8]) -> Option<usize> {
    let mut from = 0;
    while let Some(step) = bytes[from..].iter().position(|byte| *byte == b'\r') {
        let at = from + step;
        if bytes[at..].starts_with(wanted) {
            return Some(at);
        }
        from = at + 1;
    }
    None
}

/// Of the fields only that is heeded which would change the meaning of the data. What a part is, its bytes tell.
fn check_head(head: &[u8], part: usize) -> Result<(), MultipartError> {
    let head = String::from_utf8_lossy(head);
    for line in head.split("\r\n").filter(|line| !line.is_empty()) {
        // A line that goes on with that before it.
        if line.starts_with([' ', '\t']) {
            continue;
        }
        let (name, value) = line.split_once(':').ok_or(MultipartError::BadHead { part })?;
        let is_plain = ["binary", "8bit", "7bit"].iter().any(|plain| value.trim().eq_ignore_ascii_case(plain));
        if name.trim().eq_ignore_ascii_case("content-transfer-encoding") && !is_plain {
            return Err(MultipartError::Encoded { part });
        }
    }
    Ok(())
}

/// A body of any origin.
pub type Chunks = Pin<Box<dyn Stream<Item = Result<Bytes, MultipartError>> + Send>>;

/// The parts of a body that comes as a stream.
#[derive(Debug)]
pub struct Parts<S> {
    body: S,
    splitter: Splitter,
    fault: Option<MultipartError>,
}

impl<S> Parts<S>
where
    S: Stream<Item = Result<Bytes, MultipartError>> + Unpin,
{
    /// Of `body`, whose content type names `boundary`.
    #[must_use]
    pub fn new(body: S, boundary: &str, limits: MultipartLimits) -> Self {
        Self { body, splitter: Splitter::new(boundary, limits), fault: None }
    }

    /// What went wrong so far: whoever is given a part as a stream may not tell.
    #[must_use]
    pub fn fault(&self) -> Option<MultipartError> {
        self.fault
    }

    /// The next part; what was not read of the one before is passed over.
    ///
    /// # Errors
    /// When the body is malformed, larger than allowed, or ends early.
    pub async fn next_part(&mut self) -> Result<Option<Part<'_, S>>, MultipartError> {
        loop {
            match std::future::poll_fn(|context| self.poll_step(context)).await? {
                Step::Begin => return Ok(Some(Part { parts: self, peeked: BytesMut::new(), has_ended: false })),
                Step::Done => return Ok(None),
                Step::Data(_) | Step::End | Step::More => {}
            }
        }
    }

    fn poll_step(&mut self, context: &mut Context<'_>) -> Poll<Result<Step, MultipartError>> {
        // It is final: a body that has ended must not be asked for more.
        if let Some(fault) = self.fault {
            return Poll::Ready(Err(fault));
        }
        let step = ready!(self.poll_step_once(context));
        if let Err(error) = step {
            self.fault = Some(error);
        }
        Poll::Ready(step)
    }

    fn poll_step_once(&mut self, context: &mut Context<'_>) -> Poll<Result<Step, MultipartError>> {
        loop {
            let step = self.splitter.step()?;
            if step != Step::More {
                return Poll::Ready(Ok(step));
            }
            match ready!(self.body.poll_next_unpin(context)) {
                Some(chunk) => self.splitter.feed(&chunk?)?,
                None => return Poll::Ready(Err(MultipartError::CutOff)),
            }
        }
    }
}

/// One part: its bytes as a stream.
#[derive(Debug)]
pub struct Part<'p, S> {
    parts: &'p mut Parts<S>,
    peeked: BytesMut,
    has_ended: bool,
}

impl<S> Part<'_, S>
where
    S: Stream<Item = Result<Bytes, MultipartError>> + Unpin,
{
    /// Its first `length` bytes, or all of a shorter one. They come in the stream all the same.
    ///
    /// # Errors
    /// As [`Parts::next_part`].
    pub async fn peek(&mut self, length: usize) -> Result<&[u8], MultipartError> {
        while self.peeked.len() < length && !self.has_ended {
            match std::future::poll_fn(|context| self.parts.poll_step(context)).await? {
                Step::Data(bytes) => self.peeked.extend_from_slice(&bytes),
                _ => self.has_ended = true,
            }
        }
        Ok(&self.peeked[..length.min(self.peeked.len())])
    }
}

impl<S> Stream for Part<'_, S>
where
    S: Stream<Item = Result<Bytes, MultipartError>> + Unpin,
{
    type Item = Result<Bytes, MultipartError>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        if !self.peeked.is_empty() {
            return Poll::Ready(Some(Ok(self.peeked.split().freeze())));
        }
        if self.has_ended {
            return Poll::Ready(None);
        }
        match ready!(self.parts.poll_step(context)) {
            Ok(Step::Data(bytes)) => Poll::Ready(Some(Ok(bytes))),
            Ok(_) => {
                self.has_ended = true;
                Poll::Ready(None)
            }
            Err(error) => {
                self.has_ended = true;
                Poll::Ready(Some(Err(error)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::stream;

    use super::*;

    const LIMITS: MultipartLimits = MultipartLimits { max_bytes: 1 << 20, max_parts: 3 };

    /// The data of all parts, of a body that comes in chunks of this length.
    fn split(body: &[u8], chunk: usize) -> Result<Vec<Vec<u8>>, MultipartError> {
        let mut splitter = Splitter::new("X", LIMITS);
        let (mut parts, mut chunks) = (Vec::new(), body.chunks(chunk));
        loop {
            match splitter.step()? {
                Step::Begin => parts.push(Vec::new()),
                Step::Data(bytes) => parts.last_mut().expect("data of a part").extend_from_slice(&bytes),
                Step::End => {}
                Step::Done => return Ok(parts),
                Step::More => splitter.feed(chunks.next().ok_or(MultipartError::CutOff)?)?,
            }
        }
    }

    #[track_caller]
    fn check(body: &[u8], expected: Result<&[&[u8]], MultipartError>) {
        let expected = expected.map(|parts| parts.iter().map(|part| part.to_vec()).collect::<Vec<_>>());
        for chunk in 1..=body.len().max(1) {
            assert_eq!(split(body, chunk), expected, "in chunks of {chunk}");
        }
    }

    #[test]
    fn parts_are_the_same_however_they_come() {
        check(b"--X\r\nContent-Type: a/b\r\n\r\none\r\n--X\r\nA: b\r\n\r\ntwo\r\n--X--", Ok(&[b"one", b"two"]));
        check(b"before\r\n--X \t\r\n\r\n\r\n--X--\r\nbehind", Ok(&[b""]));
        check(b"--X--", Ok(&[]));
    }

    #[test]
    fn data_may_hold_what_looks_like_a_boundary() {
        let body = b"--X\r\n\r\n\r\n--Y\r\n--Xy\r\n--X-\r\n\r\r\n--\r\n--X \t.\r\n--X--";
        check(body, Ok(&[b"\r\n--Y\r\n--Xy\r\n--X-\r\n\r\r\n--\r\n--X \t."]));
        // A boundary stands at the beginning of a line that ends in both bytes.
        check(b"--X\r\n\r\n--X\r\n--X\n\r\n--X--", Ok(&[b"--X\r\n--X\n"]));
    }

    #[test]
    fn a_body_without_its_last_boundary_is_cut_off() {
        let body = b"--X\r\nA: b\r\n\r\none\r\n--X--";
        for end in 0..body.len() {
            check(&body[..end], Err(MultipartError::CutOff));
        }
    }

    #[test]
    fn what_is_no_body_of_parts_is_refused() {
        let long = |head: &[u8], length| [head, &vec![b'a'; length]].concat();
        let split = |body: Vec<u8>| split(&body, 1000);
        assert_eq!(split(long(b"", MAX_PREAMBLE_BYTES + 100)), Err(MultipartError::NoFirstBoundary));
        let bad = MultipartError::BadHead { part: 1 };
        assert_eq!(split(long(b"--X\r\nA: ", MAX_HEAD_BYTES)), Err(bad));
        assert_eq!(split(b"--X\r\nno field\r\n\r\n--X--".to_vec()), Err(bad));
        let encoded = b"--X\r\nContent-Transfer-Encoding: base64\r\n\r\n\r\n--X--".to_vec();
        assert_eq!(split(encoded), Err(MultipartError::Encoded { part: 1 }));
        assert_eq!(split(long(b"--X\r\n\r\n", 1 << 20)), Err(MultipartError::TooLarge { limit: 1 << 20 }));
        assert_eq!(split(b"--X\r\n\r\n\r\n".repeat(4)), Err(MultipartError::TooManyParts { limit: 3 }));
    }

    #[tokio::test]
    async fn a_fault_is_told_again_and_the_body_not_asked_for_more() {
        // It panics where it is polled after its end.
        let body = Box::pin(stream::unfold(Some(()), |begun| async move {
            begun.map(|()| (Ok(Bytes::from_static(b"--X\r\n\r\nabc")), None))
        }));
        let mut parts = Parts::new(body, "X", LIMITS);
        let mut part = parts.next_part().await.expect("a part").expect("a part");
        assert_eq!(part.peek(10).await, Err(MultipartError::CutOff));
        assert_eq!(part.peek(10).await, Err(MultipartError::CutOff));
        assert_eq!(parts.next_part().await.err(), Some(MultipartError::CutOff));
        assert_eq!(parts.fault(), Some(MultipartError::CutOff));
    }

    #[test]
    fn a_boundary_that_is_never_told_apart_takes_no_memory() {
        let mut splitter = Splitter::new("X", LIMITS);
        splitter.feed(b"--X\r\n\r\n\r\n--X").expect("few bytes");
        for _ in 0..10_000 {
            splitter.feed(b" ").expect("few bytes");
            while !matches!(splitter.step().expect("well formed"), Step::More) {}
            assert!(splitter.buffer.len() <= splitter.boundary.len() + MAX_PADDING_BYTES + CRLF.len());
        }
    }

    #[test]
    fn the_boundary_stands_in_the_content_type() {
        for (content_type, boundary) in [
            ("multipart/related; type=\"application/dicom\"; boundary=abc", Some("abc")),
            ("Multipart/Related;boundary=\"a b;c\";type=application/dicom;transfer-syntax=*", Some("a b;c")),
            ("multipart/related; boundary=abc", Some("abc")),
            ("multipart/related; type=\"application/dicom+json\"; boundary=abc", None),
            ("multipart/mixed; boundary=abc", None),
            ("multipart/related; type=\"application/dicom\"", None),
            ("multipart/related; boundary=\"\"", None),
            ("application/dicom", None),
            ("", None),
        ] {
            assert_eq!(boundary_of(content_type).ok().as_deref(), boundary, "{content_type}");
        }
        assert!(boundary_of(&format!("multipart/related; boundary={}", "a".repeat(201))).is_err());
    }
}
