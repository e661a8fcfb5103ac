//! Takes a mask from an archive in place of an upload. It is fetched before the job is accepted: so the job has its
//! mask and its hash from the first moment, as any other; what is promised of accepted jobs needs no second thought,
//! and who sends the request hears at once what is wrong with its source.

use std::future::Future;
use std::time::Duration;

use tokio::time::{Instant, sleep, timeout_at};

use super::service::Jobs;
use super::upload::{self, Received, UploadError, UploadLimits};
use crate::dicomweb::client::Archive;
use crate::dicomweb::multipart::MultipartError;
use crate::dicomweb::{FetchError, Pacs, Wanted};
use crate::formats::{IDENTITY_BYTES, Identity};

/// Waits between tries. With longer ones, the client of the request gives up first.
const WAITS: [Duration; 3] = [Duration::from_millis(300), Duration::from_secs(1), Duration::from_secs(3)];
/// How long a request waits for its turn to ask an archive.
const PATIENCE: Duration = Duration::from_secs(20);

/// Why there is no mask.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// No archive has this name.
    #[error("no PACS has this name")]
    UnknownServer {
        /// The names there are.
        known: Vec<String>,
    },
    /// The archive is asked as often as it may be.
    #[error("as much is fetched from this PACS as may be")]
    Busy,
    /// The series has other instances only.
    #[error("the series has no segmentation among its {instances} instances")]
    NoSegmentation {
        /// Instances that it has.
        instances: usize,
    },
    /// The series has several.
    #[error("the series has {count} segmentations")]
    Several {
        /// As many.
        count: usize,
    },
    /// The archive sent something other than was asked for. Its own fault, and not that of who sent the request.
    #[error("the PACS sent something other than was asked for: {0}")]
    Wrong(WrongAnswer),
    /// More bytes than an upload may have.
    #[error("the answer of the PACS is larger than {limit} bytes")]
    TooLarge {
        /// Bytes allowed.
        limit: u64,
    },
    /// It came too slowly.
    #[error("the PACS sent too slowly")]
    TooSlow,
    /// It was not fetched.
    #[error(transparent)]
    Fetch(#[from] FetchError),
    /// It was fetched and could not be kept.
    #[error(transparent)]
    Upload(UploadError),
}

/// What an archive sent in place of an instance.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WrongAnswer {
    /// A part of no bytes.
    #[error("a part is empty")]
    Empty,
    /// A part that is no file that can hold a mask.
    #[error("a part is no mask: {0}")]
    NoMask(String),
    /// Several parts for one instance.
    #[error("{0} parts for one instance")]
    Several(usize),
    /// The file is another instance.
    #[error("another instance")]
    OtherInstance,
}

impl SourceError {
    /// Whether the same request may succeed a moment later.
    fn is_passing(&self) -> bool {
        match self {
            Self::Fetch(error) => error.is_passing(),
            _ => false,
        }
    }
}

impl Jobs {
    /// The same, with archives that masks may be fetched from.
    #[must_use]
    pub fn with_pacs(mut self, pacs: Pacs) -> Self {
        self.pacs = Some(pacs);
        self
    }

    /// Whether there are any.
    #[must_use]
    pub fn has_pacs(&self) -> bool {
        self.pacs.is_some()
    }

    /// Whether there is one of this name.
    ///
    /// # Errors
    /// [`SourceError::UnknownServer`] when there is not.
    pub fn check_pacs(&self, name: &str) -> Result<(), SourceError> {
        self.archive(name).map(|_| ())
    }

    fn archive(&self, name: &str) -> Result<Archive<'_>, SourceError> {
        let pacs = self.pacs.as_ref();
        pacs.and_then(|pacs| pacs.archive(name)).ok_or_else(|| {
            let known = pacs.map(|pacs| pacs.names().map(str::to_owned).collect());
            SourceError::UnknownServer { known: known.unwrap_or_default() }
        })
    }

    /// Fetches a segmentation from the archive `server`: the instance that is wanted, or the only segmentation of the
    /// series. Tried a few times; bounded as an upload is.
    ///
    /// # Errors
    /// When there is no such archive, it does not have it or does not answer, or the file is refused; nothing is left
    /// then.
    pub async fn fetch(&self, server: &str, wanted: &Wanted) -> Result<Received, SourceError> {
        let archive = self.archive(server)?;
        let turn = timeout_at(Instant::now() + PATIENCE, archive.turn()).await;
        let _turn = turn.ok().flatten().ok_or(SourceError::Busy)?;
        let deadline = Instant::now() + self.limits().upload.total;
        let mut waits = WAITS.iter();
        loop {
            match (self.fetch_once(archive, wanted, deadline).await, waits.next()) {
                (Err(error), Some(wait)) if error.is_passing() => {
                    tracing::info!(pacs = server, %error, "a mask is fetched again");
                    sleep(*wait).await;
                }
                (tried, _) => return tried,
            }
        }
    }

    /// Tries once; nothing is left where it fails.
    async fn fetch_once(
        &self,
        archive: Archive<'_>,
        wanted: &Wanted,
        deadline: Instant,
    ) -> Result<Received, SourceError> {
        let mut kept = None;
        let seen = self.take_parts(archive, wanted, deadline, &mut kept).await;
        match (seen, kept) {
            (Ok(Seen { masks: 1, .. }), Some(received)) => Ok(received),
            (seen, kept) => {
                if let Some(received) = kept {
                    received.forget().await;
                }
                Err(seen.map_or_else(|error| error, |seen| seen.fault(wanted)))
            }
        }
    }

    /// Keeps the first segmentation of an answer, and counts the others.
    async fn take_parts(
        &self,
        archive: Archive<'_>,
        wanted: &Wanted,
        deadline: Instant,
        kept: &mut Option<Received>,
    ) -> Result<Seen, SourceError> {
        let limits = self.limits().upload;
        let mut parts = in_time(deadline, archive.fetch(wanted, limits.max_bytes)).await??;
        let mut seen = Seen::default();
        loop {
            let next = in_time(deadline, parts.next_part()).await?;
            let Some(mut part) = next.map_err(|error| unusable(error, limits))? else { return Ok(seen) };
            seen.instances += 1;
            let head = in_time(deadline, part.peek(IDENTITY_BYTES)).await?;
            let identity = Identity::of_head(head.map_err(|error| unusable(error, limits))?).unwrap_or_default();
            if !is_wanted(wanted, &identity)? {
                continue;
            }
            seen.masks += 1;
            if kept.is_none() {
                let left = deadline.saturating_duration_since(Instant::now());
                // How long an archive may be silent is its client's to tell: with two clocks, chance would say whether it
                // is asked again.
                let bounds = UploadLimits { idle: left, total: left, ..limits };
                let received = upload::receive((self.blobs(), self.limits().min_free_bytes), bounds, &mut part).await;
                let fault = parts.fault();
                *kept = Some(received.map_err(|error| not_kept(error, fault, limits))?);
            }
        }
    }
}

/// What an answer had.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    instances: usize,
    /// Those of them that may be what is wanted.
    masks: usize,
}

impl Seen {
    /// What it is where it is not one mask.
    fn fault(self, wanted: &Wanted) -> SourceError {
        match self {
            Self { instances: 0, .. } => FetchError::NotFound(200).into(),
            Self { masks: 0, instances } => SourceError::NoSegmentation { instances },
            Self { masks, .. } if wanted.instance.is_some() => SourceError::Wrong(WrongAnswer::Several(masks)),
            Self { masks: count, .. } => SourceError::Several { count },
        }
    }
}

/// Whether a part is kept. One that is named is, whatever it is: its reader says why it is refused. Of a series all are
/// passed over that say that they are no segmentation.
///
/// # Errors
/// When another instance was named than the part says that it is.
fn is_wanted(wanted: &Wanted, identity: &Identity) -> Result<bool, SourceError> {
    match (&wanted.instance, &identity.instance) {
        (Some(named), Some(found)) if named != found => Err(SourceError::Wrong(WrongAnswer::OtherInstance)),
        (Some(_), _) => Ok(true),
        (None, _) => Ok(identity.class.is_none() || identity.is_segmentation()),
    }
}

async fn in_time<T>(deadline: Instant, reading: impl Future<Output = T>) -> Result<T, SourceError> {
    timeout_at(deadline, reading).await.map_err(|_| SourceError::TooSlow)
}

fn unusable(error: MultipartError, limits: UploadLimits) -> SourceError {
    match error {
        MultipartError::TooLarge { .. } => SourceError::TooLarge { limit: limits.max_bytes },
        error => SourceError::Fetch(error.into()),
    }
}

/// `fault` is what went wrong with the answer, which the upload tells as an end that came early.
fn not_kept(error: UploadError, fault: Option<MultipartError>, limits: UploadLimits) -> SourceError {
    match error {
        UploadError::TooLarge { limit } => SourceError::TooLarge { limit },
        UploadError::TooSlow => SourceError::TooSlow,
        UploadError::Empty => SourceError::Wrong(WrongAnswer::Empty),
        UploadError::Refused(problem) => SourceError::Wrong(WrongAnswer::NoMask(problem.detail)),
        UploadError::Interrupted => unusable(fault.unwrap_or(MultipartError::Broken), limits),
        error @ (UploadError::StorageLow | UploadError::Storage(_)) => SourceError::Upload(error),
    }
}
