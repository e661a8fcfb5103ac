//! Stores instances in an archive: STOW-RS (PS3.18 section 10.5), one instance a request, so that it is known of each
//! whether the archive has it.

use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, StreamExt, stream};
use reqwest::header::{ACCEPT, AUTHORIZATION, CONTENT_LENGTH, CONTENT_TYPE};
use reqwest::{Body, Response, Url};
use serde_json::Value;

use super::client::Archive;
use super::multipart::{CLOSE, Framing};
use crate::outbound::Fault;

/// Bytes of an answer that are read. That for one instance has some hundred; more would fill the memory.
const MAX_ANSWER_BYTES: usize = 64 << 10;
/// Longest time for a request, beside that for its bytes. With less, an archive that sorts an instance in before it
/// answers is taken for one that does not.
const ANSWER_TIME: Duration = Duration::from_secs(60);
/// Bytes that an archive takes in a second at the least. With more, one behind a slow line gets no large instance.
const LEAST_BYTES_PER_SECOND: u64 = 256 << 10;

/// Values of Failure Reason (0008,1197).
mod reason {
    /// The instance is there already.
    pub const DUPLICATE: u16 = 0x0111;
    /// The same of Azure's.
    pub const ALREADY_THERE: u16 = 0xB00E;
    /// Processing failure: it failed, and it is not said why.
    pub const FAILED: u16 = 0x0110;
    pub const CLASS_NOT_SUPPORTED: u16 = 0x0122;
}

/// Why an archive did not store an instance. Holds nothing that the archive wrote but numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreFault {
    /// It says so, with a Failure Reason.
    #[error("the PACS did not store the instance (failure reason {reason:04X})")]
    NotStored {
        /// Status of the answer.
        status: u16,
        /// Value of Failure Reason (0008,1197).
        reason: u16,
    },
    /// The request was not taken.
    #[error("the answer of the PACS was status {0}")]
    Status(u16),
    /// Some of it was taken, and it is not said what.
    #[error("the PACS does not say what it stored (status {0})")]
    Unclear(u16),
    /// There was no answer.
    #[error("the PACS gave no answer")]
    NoAnswer(Fault),
}

impl StoreFault {
    /// Stable, snake case.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::NotStored { reason: reason::CLASS_NOT_SUPPORTED, .. } => "class_not_supported",
            Self::NotStored { .. } => "instance_refused",
            Self::Status(300..=399) => "redirected",
            Self::Status(_) => "refused_status",
            Self::Unclear(_) => "answer_unclear",
            Self::NoAnswer(fault) => fault.code(),
        }
    }

    /// Status of the answer, where there was one.
    #[must_use]
    pub fn status(self) -> Option<u16> {
        match self {
            Self::NotStored { status, .. } | Self::Status(status) | Self::Unclear(status) => Some(status),
            Self::NoAnswer(_) => None,
        }
    }

    /// Whether the archive will never store this instance. All else may be mended: by itself, or by who runs the archive.
    #[must_use]
    pub fn is_final(self) -> bool {
        let Self::NotStored { reason, .. } = self else { return false };
        // A9xx: the data set does not match its class; Cxxx: it cannot be understood.
        matches!(reason, reason::CLASS_NOT_SUPPORTED | 0xA900..=0xA9FF | 0xC000..=0xCFFF)
    }
}

/// Longest time for storing an instance of so many bytes.
#[must_use]
pub fn time_to_store(bytes: u64) -> Duration {
    ANSWER_TIME + Duration::from_secs(bytes / LEAST_BYTES_PER_SECOND)
}

impl Archive<'_> {
    /// Stores an instance of `bytes` bytes, which come as `content`; the status of the answer.
    ///
    /// # Errors
    /// When there is no answer, or the archive did not store it.
    pub async fn store<S, E>(&self, content: S, bytes: u64) -> Result<u16, StoreFault>
    where
        S: Stream<Item = Result<Bytes, E>> + Send + 'static,
        E: Into<Box<dyn std::error::Error + Send + Sync>> + 'static,
    {
        let framing = Framing::new();
        let head = framing.begin("application/dicom");
        let tail = Bytes::from([CLOSE, &framing.end()].concat());
        let length = head.len() as u64 + bytes + tail.len() as u64;
        let around = |part| stream::iter([Ok(part)]);
        let body = around(head).chain(content.map(|chunk| chunk.map_err(Into::into))).chain(around(tail));
        let mut request = self
            .storer
            .post(self.studies())
            .timeout(time_to_store(bytes))
            .header(ACCEPT, "application/dicom+json")
            .header(CONTENT_TYPE, framing.media_type("application/dicom"))
            // Some archives take no body of unknown length.
            .header(CONTENT_LENGTH, length)
            .body(Body::wrap_stream(body));
        if let Some(credentials) = &self.server.credentials {
            request = request.header(AUTHORIZATION, credentials.header());
        }
        let answer = request.send().await.map_err(|error| StoreFault::NoAnswer(self.no_answer(error)))?;
        let status = answer.status().as_u16();
        judge(status, read(answer).await.as_deref())
    }

    fn studies(&self) -> Url {
        let mut url = self.server.url.clone();
        // It has a host, and with it a path.
        if let Ok(mut path) = url.path_segments_mut() {
            path.pop_if_empty().push("studies");
        }
        url
    }
}

/// A whole answer; `None` when it is longer than any is, or breaks off.
async fn read(mut answer: Response) -> Option<Vec<u8>> {
    let mut text = Vec::new();
    while let Some(chunk) = answer.chunk().await.ok()? {
        text.extend_from_slice(&chunk);
        if text.len() > MAX_ANSWER_BYTES {
            return None;
        }
    }
    Some(text)
}

/// What an answer means (PS3.18 table 10.5.3-1). Some archives answer 200 and name what failed, others answer 409 for an
/// instance that they have, or XML to whoever asks for JSON. A page of a proxy in between says nothing.
fn judge(status: u16, answer: Option<&[u8]>) -> Result<u16, StoreFault> {
    let told = answer.map_or(Told::Nothing, understood);
    match (status, told) {
        (200 | 202 | 409, Told::Failed(reason::DUPLICATE | reason::ALREADY_THERE)) => Ok(status),
        (200 | 202 | 409, Told::Failed(reason)) => Err(StoreFault::NotStored { status, reason }),
        (200 | 202, Told::Stored) => Ok(status),
        (200, Told::Nothing) if answer.is_some_and(<[u8]>::is_empty) => Ok(status),
        (200..=299, _) => Err(StoreFault::Unclear(status)),
        _ => Err(StoreFault::Status(status)),
    }
}

/// What the body of an answer says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    /// That the instance was not stored, and why: Failure Reason.
    Failed(u16),
    /// An answer as STOW-RS has it, without a failure.
    Stored,
    /// Nothing that is understood.
    Nothing,
}

/// Reads an answer in the JSON of PS3.18 annex F; of one in XML whether it names what failed.
fn understood(answer: &[u8]) -> Told {
    let Ok(json) = serde_json::from_slice::<Value>(answer) else {
        let text = String::from_utf8_lossy(answer);
        let names = |tag: &str, keyword: &str| text.contains(tag) || text.contains(keyword);
        return if names("00081198", "FailedSOPSequence") || names("0008119A", "OtherFailuresSequence") {
            Told::Failed(reason::FAILED)
        } else if names("00081199", "ReferencedSOPSequence") {
            Told::Stored
        } else {
            Told::Nothing
        };
    };
    let json = json.get(0).unwrap_or(&json);
    for sequence in ["00081198", "0008119A"] {
        let Some(failed) = json.get(sequence).and_then(|sequence| sequence.pointer("/Value/0")) else { continue };
        let reason = failed.pointer("/00081197/Value/0").and_then(Value::as_u64);
        return Told::Failed(reason.and_then(|reason| u16::try_from(reason).ok()).unwrap_or(reason::FAILED));
    }
    if json.is_object() { Told::Stored } else { Told::Nothing }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STORED: &str = r#"{"00081199": {"vr": "SQ", "Value": [{}]}}"#;

    fn failed(reason: u16) -> String {
        format!(r#"{{"00081198": {{"vr": "SQ", "Value": [{{"00081197": {{"vr": "US", "Value": [{reason}]}}}}]}}}}"#)
    }

    #[test]
    fn an_answer_says_whether_the_archive_has_the_instance() {
        let judge = |status, text: &str| judge(status, Some(text.as_bytes()));
        for status in [200, 202] {
            assert_eq!(judge(status, STORED), Ok(status));
            assert_eq!(
                judge(status, "<NativeDicomModel><a keyword=\"ReferencedSOPSequence\"/></NativeDicomModel>"),
                Ok(status)
            );
            let failed = "<NativeDicomModel><a tag=\"00081198\"/></NativeDicomModel>";
            assert_eq!(judge(status, failed), Err(StoreFault::NotStored { status, reason: reason::FAILED }));
            assert_eq!(judge(status, "<html>sign in</html>"), Err(StoreFault::Unclear(status)));
        }
        assert_eq!(judge(200, ""), Ok(200));
        for status in [200, 202, 409] {
            let reason = 0xA700;
            assert_eq!(judge(status, &failed(reason)), Err(StoreFault::NotStored { status, reason }));
            assert_eq!(judge(status, &failed(reason::DUPLICATE)), Ok(status));
            assert_eq!(judge(status, &failed(reason::ALREADY_THERE)), Ok(status));
        }
        assert_eq!(judge(204, ""), Err(StoreFault::Unclear(204)), "no content was seen");
        for status in [302, 400, 401, 409, 415, 500, 503] {
            assert_eq!(judge(status, ""), Err(StoreFault::Status(status)));
        }
    }

    #[test]
    fn an_answer_that_breaks_off_says_nothing() {
        assert_eq!(judge(200, None), Err(StoreFault::Unclear(200)));
    }

    #[test]
    fn only_what_the_archive_will_never_take_is_final() {
        let fault = |reason| StoreFault::NotStored { status: 409, reason };
        for reason in [reason::CLASS_NOT_SUPPORTED, 0xC122, 0xA900, 0xC000] {
            assert!(fault(reason).is_final(), "{reason:04X}");
        }
        for other in [fault(0xA700), fault(0x0110), StoreFault::Status(401), StoreFault::NoAnswer(Fault::TimedOut)] {
            assert!(!other.is_final(), "{other:?}");
        }
    }

    #[test]
    fn a_large_instance_has_more_time() {
        assert_eq!(time_to_store(0), ANSWER_TIME);
        assert_eq!(time_to_store(LEAST_BYTES_PER_SECOND * 100), ANSWER_TIME + Duration::from_secs(100));
    }
}
