//! Any bytes as a content type, a line break and a body of DICOMweb: taken apart as the whole body says, however the
//! bytes are cut into pieces, and with no more of them kept than a head and a boundary.

use bytes::Bytes;
use futures_util::{FutureExt, StreamExt, stream};
use medialrep::dicomweb::multipart::{MultipartError, MultipartLimits, Parts, Splitter, Step, boundary_of};

/// Few parts, and fewer bytes than a long input has.
const LIMITS: MultipartLimits = MultipartLimits { max_bytes: 3 << 10, max_parts: 4 };
/// White space behind a boundary, as in the reader.
const MAX_PADDING_BYTES: usize = 64;

type Split = Result<Vec<Vec<u8>>, MultipartError>;

/// What must hold of any bytes.
pub fn check(bytes: &[u8]) {
    let (line, body) = match bytes.iter().position(|byte| *byte == b'\n') {
        Some(end) => (&bytes[..end], &bytes[end + 1..]),
        None => (bytes, &[][..]),
    };
    let Ok(boundary) = boundary_of(&String::from_utf8_lossy(line)) else { return };
    let whole = split(body, &boundary, body.len().max(1));
    for length in [1, 2, 3 + body.len() % 61] {
        let in_pieces = split(body, &boundary, length);
        check_same(&whole, &in_pieces);
        check_same(&in_pieces, &streamed(body, &boundary, length));
    }
    match &whole {
        Ok(parts) => assert_eq!(Some(parts), data_of(body, &boundary).as_ref()),
        Err(MultipartError::CutOff) => assert_eq!(data_of(body, &boundary), None),
        Err(_) => {}
    }
}

/// A body that is too long may be refused for that, or be done or faulty before.
fn check_same(left: &Split, right: &Split) {
    let too_large = Err(MultipartError::TooLarge { limit: LIMITS.max_bytes });
    assert!(left == right || *left == too_large || *right == too_large, "{left:?} {right:?}");
}

/// The data of all parts, of a body that comes in chunks of this length.
fn split(body: &[u8], boundary: &str, length: usize) -> Split {
    let mut splitter = Splitter::new(boundary, LIMITS);
    let (mut parts, mut chunks) = (Vec::new(), body.chunks(length));
    let mut is_open = false;
    loop {
        match splitter.step()? {
            Step::Begin => {
                assert!(!is_open && parts.len() < LIMITS.max_parts);
                is_open = true;
                parts.push(Vec::new());
            }
            Step::Data(bytes) => {
                assert!(is_open && !bytes.is_empty());
                parts.last_mut().unwrap().extend_from_slice(&bytes);
            }
            Step::End => {
                assert!(is_open);
                is_open = false;
            }
            Step::Done => return Ok(parts),
            Step::More => splitter.feed(chunks.next().ok_or(MultipartError::CutOff)?)?,
        }
    }
}

/// The same through the stream: the first bytes of each part looked at before all of it is read, as archives' are.
fn streamed(body: &[u8], boundary: &str, length: usize) -> Split {
    let chunks: Vec<_> = body.chunks(length).map(|chunk| Ok(Bytes::copy_from_slice(chunk))).collect();
    let mut parts = Parts::new(stream::iter(chunks), boundary, LIMITS);
    let mut data = Vec::new();
    let read = async {
        while let Some(mut part) = parts.next_part().await? {
            let head = part.peek(5).await?.to_vec();
            let mut own = Vec::new();
            while let Some(bytes) = part.next().await {
                own.extend_from_slice(&bytes?);
            }
            assert!(own.starts_with(&head) && (head.len() == 5 || head.len() == own.len()));
            data.push(own);
        }
        Ok(data)
    };
    // The chunks are there, so that nothing waits.
    read.now_or_never().unwrap()
}

/// A line with a boundary.
struct Line {
    begin: usize,
    end: usize,
    is_last: bool,
}

/// The data of all parts, looked for in the whole body at once. `None` without a last boundary.
fn data_of(body: &[u8], boundary: &str) -> Option<Vec<Vec<u8>>> {
    // The first boundary needs no line break before it.
    let text = [b"\r\n", body].concat();
    let boundary = format!("\r\n--{boundary}").into_bytes();
    let mut parts = Vec::new();
    let mut line = next_line(&text, 0, &boundary)?;
    while !line.is_last {
        let head = &text[line.end..];
        let data = if head.starts_with(b"\r\n") {
            line.end + 2
        } else {
            line.end + head.windows(4).position(|four| four == b"\r\n\r\n")? + 4
        };
        line = next_line(&text, data, &boundary)?;
        parts.push(text[data..line.begin].to_vec());
    }
    Some(parts)
}

/// The next from `from` on.
fn next_line(text: &[u8], from: usize, boundary: &[u8]) -> Option<Line> {
    for begin in from..text.len() {
        let Some(rest) = text[begin..].strip_prefix(boundary) else { continue };
        let padding = rest.iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
        let is_last = rest.starts_with(b"--");
        if is_last || (padding <= MAX_PADDING_BYTES && rest[padding..].starts_with(b"\r\n")) {
            return Some(Line { begin, end: begin + boundary.len() + padding + 2, is_last });
        }
    }
    None
}
