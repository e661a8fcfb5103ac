//! Takes a mask from an archive in place of an upload. It is fetched before the job is accepted: so the job has its
//! mask and its hash from the first moment, as any other; what is promised of accepted jobs needs no second thought,
//! and who sends the request hears at once what is wrong with its source.

use std::time::Duration;

use tokio::time::{Instant, sleep, timeout_at};

use super::service::Jobs;
use super::upload::{self, Received, UploadError, UploadLimits};
use crate::dicomweb::client::Archive;
use crate::dicomweb::multipart::{Chunks, MultipartError, Part};
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
    /// It was fetched and not kept.
    #[error(transparent)]
    Upload(UploadError),
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

    /// Fetches a segmentation from the archive `server`: the instance that is wanted, or the only segmentation of the
    /// series. Tried a few times; bounded as an upload is.
    ///
    /// # Errors
    /// When there is no such archive, it does not have it or does not answer, or the file is refused; nothing is left
    /// then.
    pub async fn fetch(&self, server: &str, wanted: &Wanted) -> Result<Received, SourceError> {
        let pacs = self.pacs.as_ref();
        let Some(archive) = pacs.and_then(|pacs| pacs.archive(server)) else {
            let known = pacs.map(|pacs| pacs.names().map(str::to_owned).collect());
            return Err(SourceError::UnknownServer { known: known.unwrap_or_default() });
        };
        let turn = timeout_at(Instant::now() + PATIENCE, archive.turn()).await;
        let _turn = turn.ok().flatten().ok_or(SourceError::Busy)?;
        let deadline = Instant::now() + self.limits().upload.total;
        let mut waits = WAITS.iter();
        loop {
            let tried = timeout_at(deadline, self.fetch_once(archive, wanted)).await;
            let tried = tried.unwrap_or(Err(SourceError::TooSlow));
            match (tried, waits.next()) {
                (Err(error), Some(wait)) if error.is_passing() => {
                    tracing::info!(pacs = server, %error, "a mask is fetched again");
                    sleep(*wait).await;
                }
                (tried, _) => return tried,
            }
        }
    }

    async fn fetch_once(&self, archive: Archive<'_>, wanted: &Wanted) -> Result<Received, SourceError> {
        let limits = self.limits().upload;
        let mut parts = archive.fetch(wanted, limits.max_bytes).await?;
        let (mut instances, mut count, mut received) = (0, 0, None);
        while let Some(mut part) = parts.next_part().await.map_err(|error| unusable(error, limits))? {
            instances += 1;
            // One that is named is taken whatever it is: its reader says why it is refused.
            if wanted.instance.is_none() && is_something_else(&mut part, limits).await? {
                continue;
            }
            count += 1;
            if received.is_none() {
                let kept = upload::receive((self.blobs(), self.limits().min_free_bytes), limits, &mut part).await;
                let fault = parts.fault();
                received = Some(kept.map_err(|error| not_kept(error, fault, limits))?);
            }
        }
        match received {
            Some(received) if count > 1 => {
                received.forget().await;
                Err(SourceError::Several { count })
            }
            Some(received) => Ok(received),
            None if instances == 0 => Err(FetchError::NotFound(200).into()),
            None => Err(SourceError::NoSegmentation { instances }),
        }
    }
}

/// Whether a part says that it is no segmentation.
async fn is_something_else(part: &mut Part<'_, Chunks>, limits: UploadLimits) -> Result<bool, SourceError> {
    let head = part.peek(IDENTITY_BYTES).await.map_err(|error| unusable(error, limits))?;
    let identity = Identity::of(head).filter(|identity| identity.class.is_some());
    Ok(identity.is_some_and(|identity| !identity.is_segmentation()))
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
        UploadError::Interrupted => unusable(fault.unwrap_or(MultipartError::Broken), limits),
        error => SourceError::Upload(error),
    }
}
