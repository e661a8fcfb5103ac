//! Asks archives, and fetches instances from them: WADO-RS (PS3.18 section 10.4). No proxy and no redirects: credentials go to the
//! server that the operator named, and to no other.

use std::sync::Arc;

use futures_util::stream;
use reqwest::header::{ACCEPT, AUTHORIZATION, CONTENT_ENCODING, CONTENT_TYPE};
use reqwest::redirect::Policy;
use reqwest::{Client, ClientBuilder, Response, Url};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::multipart::{Chunks, MultipartError, MultipartLimits, Parts, boundary_of};
use super::server::{PacsConfig, PacsServer};
use crate::formats::Uid;
use crate::outbound::{Fault, RootsError, USER_AGENT, causes, parse_roots};

/// Files as the archive keeps them: what it would transcode may fail there (RLE of one bit), and is read here.
const ACCEPTED: &str = "multipart/related; type=\"application/dicom\"; transfer-syntax=*";
/// Requests to one archive at the same time: it serves a hospital beside us.
const AT_ONCE: usize = 4;
/// Parts of an answer. A series has as many as images; with no bound, empty ones would be counted for ever.
const MAX_PARTS: usize = 10_000;
/// Bytes of an answer beside the file: boundaries and heads.
const OVERHEAD_BYTES: u64 = 1 << 20;

/// Why there is no client.
#[derive(Debug, thiserror::Error)]
pub enum PacsError {
    /// No certificates where some were meant.
    #[error(transparent)]
    Roots(#[from] RootsError),
    /// The client refused its settings.
    #[error("the HTTP client cannot be made: {0}")]
    Client(#[from] reqwest::Error),
}

/// What is fetched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// Study Instance UID.
    pub study: Uid,
    /// Series Instance UID.
    pub series: Uid,
    /// SOP Instance UID; all instances of the series where it is `None`.
    pub instance: Option<Uid>,
}

/// Why nothing was fetched. Holds nothing that the archive wrote but its status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FetchError {
    /// It is not there: 404 or 410, or an answer without a part.
    #[error("the PACS does not have it (status {0})")]
    NotFound(u16),
    /// The archive does not let us, or does not understand.
    #[error("the PACS refused the request (status {0})")]
    Refused(u16),
    /// The answer points elsewhere, where nothing is asked.
    #[error("the PACS answered with a redirect (status {0}), which is not followed")]
    Redirected(u16),
    /// The archive fails at the moment.
    #[error("the PACS failed (status {0})")]
    Failed(u16),
    /// There was no answer.
    #[error("{}", unreachable(*.0))]
    Unreachable(Fault),
    /// The answer is not what was asked for.
    #[error("the answer of the PACS is unusable: {0}")]
    Malformed(#[from] MultipartError),
}

fn unreachable(fault: Fault) -> &'static str {
    match fault {
        Fault::TimedOut => "the PACS did not answer in time",
        Fault::TlsFailed => "the secure connection to the PACS could not be made",
        Fault::ConnectFailed => "the connection to the PACS could not be made",
        Fault::Interrupted => "the connection to the PACS ended without an answer",
    }
}

impl FetchError {
    /// Whether the same request may succeed a moment later.
    #[must_use]
    pub fn is_passing(self) -> bool {
        match self {
            Self::Failed(_) => true,
            // A certificate does not get better by itself.
            Self::Unreachable(fault) => fault != Fault::TlsFailed,
            Self::Malformed(error) => {
                matches!(error, MultipartError::CutOff | MultipartError::Broken | MultipartError::TooSlow)
            }
            Self::NotFound(_) | Self::Refused(_) | Self::Redirected(_) => false,
        }
    }
}

/// All archives that may be asked.
#[derive(Clone, Debug)]
pub struct Pacs {
    client: Client,
    /// For instances that are stored: nothing comes back while one is sent, however long that takes.
    storer: Client,
    servers: Arc<[(PacsServer, Arc<Semaphore>)]>,
}

/// One archive.
#[derive(Clone, Copy, Debug)]
pub struct Archive<'p> {
    client: &'p Client,
    pub(super) storer: &'p Client,
    pub(super) server: &'p PacsServer,
    turns: &'p Arc<Semaphore>,
}

impl Pacs {
    /// For these archives.
    ///
    /// # Errors
    /// When the extra certificates cannot be used.
    pub fn new(config: PacsConfig) -> Result<Self, PacsError> {
        let roots = parse_roots(&config.extra_roots)?;
        let client = || {
            let client = Client::builder().user_agent(USER_AGENT).no_proxy().redirect(Policy::none());
            roots.iter().cloned().fold(client.connect_timeout(config.connect), ClientBuilder::add_root_certificate)
        };
        let (fetcher, storer) = (client().read_timeout(config.idle).build()?, client().build()?);
        let servers = config.servers.into_iter().map(|server| (server, Arc::new(Semaphore::new(AT_ONCE))));
        Ok(Self { client: fetcher, storer, servers: servers.collect() })
    }

    /// The archive of this name.
    #[must_use]
    pub fn archive(&self, name: &str) -> Option<Archive<'_>> {
        let (server, turns) = self.servers.iter().find(|(server, _)| server.name == name)?;
        Some(Archive { client: &self.client, storer: &self.storer, server, turns })
    }

    /// The names of all archives.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.servers.iter().map(|(server, _)| server.name.as_str())
    }
}

impl Archive<'_> {
    /// Waits until the archive may be asked: few at a time. The turn lasts until it is dropped.
    pub async fn turn(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(self.turns).acquire_owned().await.ok()
    }

    /// Asks once for what is wanted: its instances, one after the other, `max_bytes` at the most together.
    ///
    /// # Errors
    /// When there is no answer, or another than these instances.
    pub async fn fetch(&self, wanted: &Wanted, max_bytes: u64) -> Result<Parts<Chunks>, FetchError> {
        let mut request = self.client.get(self.address(wanted)).header(ACCEPT, ACCEPTED);
        if let Some(credentials) = &self.server.credentials {
            request = request.header(AUTHORIZATION, credentials.header());
        }
        let answer = request.send().await.map_err(|error| FetchError::Unreachable(self.no_answer(error)))?;
        judge(answer.status().as_u16())?;
        let header = |name| answer.headers().get(name).and_then(|value| value.to_str().ok()).unwrap_or_default();
        // Nothing but plain bytes was asked for.
        if !matches!(header(CONTENT_ENCODING), "" | "identity") {
            return Err(MultipartError::NotMultipart.into());
        }
        let boundary = boundary_of(header(CONTENT_TYPE))?;
        let limits = MultipartLimits { max_bytes: max_bytes.saturating_add(OVERHEAD_BYTES), max_parts: MAX_PARTS };
        Ok(Parts::new(chunks(answer), &boundary, limits))
    }

    fn address(&self, wanted: &Wanted) -> Url {
        let mut url = self.server.url.clone();
        // It has a host, and with it a path.
        if let Ok(mut path) = url.path_segments_mut() {
            path.pop_if_empty().extend(["studies", wanted.study.as_str(), "series", wanted.series.as_str()]);
            if let Some(instance) = &wanted.instance {
                path.extend(["instances", instance.as_str()]);
            }
        }
        url
    }

    /// Why there was no answer, which is logged.
    pub(super) fn no_answer(&self, error: reqwest::Error) -> Fault {
        let error = error.without_url();
        let cause = causes(&error).last().map(ToString::to_string);
        tracing::info!(pacs = self.server.name, cause, "a PACS gave no answer");
        Fault::of(&error)
    }
}

fn judge(status: u16) -> Result<(), FetchError> {
    match status {
        200 => Ok(()),
        // No content is nothing found, part of it is not what was asked for.
        204 | 404 | 410 => Err(FetchError::NotFound(status)),
        300..=399 => Err(FetchError::Redirected(status)),
        408 | 425 | 429 | 500..=599 => Err(FetchError::Failed(status)),
        _ => Err(FetchError::Refused(status)),
    }
}

fn chunks(answer: Response) -> Chunks {
    Box::pin(stream::unfold(answer, |mut answer| async {
        let chunk = answer.chunk().await.transpose()?;
        let fault = |error: reqwest::Error| {
            if error.is_timeout() { MultipartError::TooSlow } else { MultipartError::Broken }
        };
        Some((chunk.map_err(fault), answer))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_ends_in_what_is_wanted() {
        let uid = |text| Uid::parse(text).expect("a UID");
        let wanted = |instance| Wanted { study: uid("1.2"), series: uid("3.4"), instance };
        for (base, instance, address) in [
            ("http://h/dicom-web", None, "http://h/dicom-web/studies/1.2/series/3.4"),
            ("http://h/dicom-web/", Some(uid("5")), "http://h/dicom-web/studies/1.2/series/3.4/instances/5"),
            ("http://h", None, "http://h/studies/1.2/series/3.4"),
        ] {
            let server: PacsServer = format!("main={base}").parse().expect("a server");
            let archive = Archive {
                client: &Client::new(),
                storer: &Client::new(),
                server: &server,
                turns: &Arc::new(Semaphore::new(1)),
            };
            assert_eq!(archive.address(&wanted(instance)).as_str(), address);
        }
    }

    #[test]
    fn only_200_is_what_was_asked_for() {
        assert_eq!(judge(200), Ok(()));
        for (status, error) in [
            (204, FetchError::NotFound(204)),
            (206, FetchError::Refused(206)),
            (302, FetchError::Redirected(302)),
            (401, FetchError::Refused(401)),
            (404, FetchError::NotFound(404)),
            (406, FetchError::Refused(406)),
            (429, FetchError::Failed(429)),
            (503, FetchError::Failed(503)),
        ] {
            assert_eq!(judge(status), Err(error));
        }
    }
}
