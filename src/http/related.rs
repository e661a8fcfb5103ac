//! Answers of `multipart/related`, a part for each file (RFC 2387), and whether such a one or a file alone is accepted.

use std::io;

use axum::body::{Body, Bytes};
use axum::http::Response;
use axum::http::header::{CONTENT_LENGTH, CONTENT_TYPE};
use futures_util::stream::{self, BoxStream};
use futures_util::{StreamExt, TryStreamExt};

use super::accept::{Accepted, Range};
use super::error::ApiError;
use crate::dicomweb::multipart::{CLOSE, Framing, MULTIPART};
use crate::problem::Problem;

/// How results are written: explicit VR, little endian.
const TRANSFER_SYNTAX: &str = "1.2.840.10008.1.2.1";

/// How the answer is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A part for each file.
    Multipart,
    /// One file and nothing else.
    Single,
}

impl Form {
    /// The one that is wanted more, multipart of equals: parts of type `part`, or something as it is of type `single`.
    pub fn of(accepted: &Accepted, part: &str, single: Option<&str>) -> Option<Self> {
        let is_syntax =
            |range: &Range| range.lets("transfer-syntax", "*") || range.lets("transfer-syntax", TRANSFER_SYNTAX);
        let is_multipart = |range: &Range| range.covers(MULTIPART) && range.has_parts(part) && is_syntax(range);
        let multipart = accepted.weight(is_multipart);
        let single = single.map_or(0.0, |single| accepted.weight(|range| range.covers(single) && is_syntax(range)));
        match (multipart, single) {
            (multipart, single) if multipart >= single && multipart > 0.0 => Some(Self::Multipart),
            (_, single) if single > 0.0 => Some(Self::Single),
            _ => None,
        }
    }
}

/// A part of an answer.
pub struct Part {
    media_type: &'static str,
    /// Bytes of its body.
    pub bytes: u64,
    /// As many of them.
    pub body: BoxStream<'static, io::Result<Bytes>>,
}

impl Part {
    /// A file of so many bytes, without any yet.
    pub fn of(media_type: &'static str, bytes: u64) -> Self {
        Self { media_type, bytes, body: stream::empty().boxed() }
    }

    /// The same with a body, which has as many bytes.
    pub fn with(self, body: BoxStream<'static, io::Result<Bytes>>) -> Self {
        Self { body, ..self }
    }

    /// Bytes that it takes in an answer.
    pub fn length(&self, framing: &Framing) -> u64 {
        (framing.begin(self.media_type).len() + CLOSE.len()) as u64 + self.bytes
    }
}

/// All parts, framed.
pub fn body_of(parts: BoxStream<'static, io::Result<Part>>, framing: Framing) -> Body {
    let last = framing.end();
    let framed = parts.map_ok(move |part| {
        once(framing.begin(part.media_type)).chain(part.body).chain(once(Bytes::from_static(CLOSE)))
    });
    Body::from_stream(framed.try_flatten().chain(once(last)))
}

/// A stream of these bytes.
pub fn once(bytes: Bytes) -> BoxStream<'static, io::Result<Bytes>> {
    stream::once(async move { Ok(bytes) }).boxed()
}

/// An answer of so many bytes.
///
/// # Errors
/// Never: media types are ours.
pub fn finish(media_type: &str, bytes: u64, body: Body) -> Result<Response<Body>, ApiError> {
    let answer = Response::builder().header(CONTENT_TYPE, media_type).header(CONTENT_LENGTH, bytes);
    answer.body(body).map_err(|_| Problem::internal().into())
}

#[cfg(test)]
mod tests {
    use axum::http::header::ACCEPT;

    use super::*;

    const DICOM: &str = "application/dicom";

    fn form(accept: &str, single: Option<&str>) -> Option<Form> {
        let headers = [(ACCEPT, accept.parse().unwrap())].into_iter().collect();
        Form::of(&Accepted::of(&headers, &[]), DICOM, single)
    }

    #[test]
    fn an_answer_has_the_form_that_is_accepted_most() {
        let (one, many) = (Some(Form::Single), Some(Form::Multipart));
        for (accept, of_instance, of_study) in [
            ("", many, many),
            ("*/*", many, many),
            ("multipart/related", many, many),
            ("multipart/related; type=application/dicom; transfer-syntax=*", many, many),
            ("multipart/related; type=\"application/dicom\"; transfer-syntax=1.2.840.10008.1.2.1", many, many),
            ("application/dicom", one, None),
            ("application/dicom; transfer-syntax=*", one, None),
            ("application/dicom, */*;q=0.1", one, many),
            ("application/dicom;q=0.1, multipart/related", many, many),
            ("multipart/related; type=\"application/dicom\"; transfer-syntax=1.2.840.10008.1.2.4.70", None, None),
            ("multipart/related; type=\"application/octet-stream\"", None, None),
            ("multipart/related; type=\"*/*\"", many, many),
            ("image/png", None, None),
        ] {
            assert_eq!([form(accept, Some(DICOM)), form(accept, None)], [of_instance, of_study], "{accept}");
        }
    }
}
