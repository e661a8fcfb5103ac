//! Receives a mask: streamed to disk, counted, hashed and sniffed on the way, so that memory
//! stays the size of one chunk and a refusal comes as early as the bytes allow.

use std::fs::File;
use std::future::Future;
use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tempfile::TempPath;
use tokio::time::{Instant, timeout, timeout_at};

use super::blocking::on_own_thread;
use super::job::MaskInfo;
use super::process::InputLimits;
use super::store::blobs::Blobs;
use crate::formats::readers::{MAGIC_BYTES, check_header, check_magic};
use crate::formats::{HeaderFacts, ReadError, hex};
use crate::problem::Problem;

/// What is still read of a refused upload, so that a client that writes before it reads gets the
/// answer instead of a reset connection.
const DISCARD_BYTES: usize = 1 << 20;
/// How long that may take.
const DISCARD_TIME: Duration = Duration::from_secs(2);

/// Bounds on an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadLimits {
    /// Bytes as sent.
    pub max_bytes: u64,
    /// Longest wait for the next bytes.
    pub idle: Duration,
    /// Longest time for the whole.
    pub total: Duration,
    /// Slowest pace, once `PATIENCE` is over.
    pub bytes_per_second: u64,
}

/// Bytes after which it is looked again whether there is room.
const ROOM_EVERY_BYTES: u64 = 1 << 20;

/// How long an upload may be slower than its slowest pace: a mask may be small and a line slow to begin.
const PATIENCE: Duration = Duration::from_secs(10);

/// Why an upload was refused.
#[derive(Debug, thiserror::Error)]
pub enum UploadError {
    /// Not one byte.
    #[error("the upload is empty")]
    Empty,
    /// More bytes than allowed.
    #[error("the upload is larger than {limit} bytes")]
    TooLarge {
        /// Bytes allowed.
        limit: u64,
    },
    /// Its first bytes are those of something else.
    #[error("{}", .0.code)]
    Refused(Box<Problem>),
    /// The connection broke, or the body was malformed.
    #[error("the upload ended early or was malformed")]
    Interrupted,
    /// The bytes came too slowly.
    #[error("the upload took too long")]
    TooSlow,
    /// The disk has less room than is to be left free.
    #[error("the disk is nearly full")]
    StorageLow,
    /// It could not be written.
    #[error("the upload could not be stored: {0}")]
    Storage(#[from] io::Error),
}

/// An upload on disk, synced, not yet a job's; the file vanishes when this is dropped, but see [`Self::forget`].
#[derive(Debug)]
pub struct Received {
    /// The file.
    pub file: TempPath,
    /// What it is.
    pub mask: MaskInfo,
}

impl Received {
    /// Removes the file, where nobody waits for the disk.
    pub async fn forget(self) {
        remove(self.file).await;
    }
}

/// A large file is not removed at once.
async fn remove(file: TempPath) {
    let removed = on_own_thread(move || file.close()).await;
    if let Err(error) = removed {
        tracing::error!(%error, "an upload cannot be removed; it is swept later");
    }
}

/// Writes `body` to a new file among the incoming ones, as long as so many bytes of the disk are left free.
///
/// # Errors
/// As [`UploadError`]; nothing is left on disk then.
pub async fn receive<S, E>(
    (blobs, min_free_bytes): (&Blobs, u64),
    limits: UploadLimits,
    mut body: S,
) -> Result<Received, UploadError>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let (blobs, room) = (blobs.clone(), blobs.clone());
    let (to, file) = on_own_thread(move || blobs.begin_upload()).await?.into_parts();
    let received = receive_all(to, (&room, min_free_bytes), limits, &mut body).await;
    match received {
        Ok(mask) => Ok(Received { file, mask }),
        Err(error) => {
            remove(file).await;
            if matches!(error, UploadError::TooLarge { .. } | UploadError::Refused(_) | UploadError::StorageLow) {
                discard(&mut body).await;
            }
            Err(error)
        }
    }
}

async fn receive_all<S, E>(
    to: File,
    (blobs, min_free_bytes): (&Blobs, u64),
    limits: UploadLimits,
    body: &mut S,
) -> Result<MaskInfo, UploadError>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let mut incoming = Incoming { file: to, head: Vec::new(), bytes: 0, hash: Sha256::new() };
    let (begun, mut looked) = (Instant::now(), 0);
    while let Some(chunk) = next_chunk(body, limits.idle, begun + limits.total).await? {
        incoming.look_at(&chunk, limits.max_bytes)?;
        if incoming.bytes >= looked + ROOM_EVERY_BYTES {
            // Others write too, and a length need not be said.
            looked = incoming.bytes;
            if !blobs.room()?.has(min_free_bytes) {
                return Err(UploadError::StorageLow);
            }
        }
        let took = begun.elapsed();
        if took > PATIENCE && incoming.bytes < limits.bytes_per_second.saturating_mul(took.as_secs()) {
            return Err(UploadError::TooSlow);
        }
        incoming = on_own_thread(move || incoming.write(&chunk)).await?;
    }
    incoming.check_whole()?;
    Ok(on_own_thread(move || incoming.finish()).await?)
}

async fn next_chunk<S, E>(body: &mut S, idle: Duration, deadline: Instant) -> Result<Option<Bytes>, UploadError>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let next: Result<_, _> = timeout_at(deadline, within(idle, body.next())).await;
    let chunk = next.map_err(|_| UploadError::TooSlow)??;
    chunk.transpose().map_err(|_| UploadError::Interrupted)
}

async fn within<T>(idle: Duration, next: impl Future<Output = T>) -> Result<T, UploadError> {
    timeout(idle, next).await.map_err(|_| UploadError::TooSlow)
}

async fn discard<S, E>(body: &mut S)
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let read = async {
        let mut bytes = 0;
        while bytes < DISCARD_BYTES {
            match body.next().await {
                Some(Ok(chunk)) => bytes += chunk.len(),
                _ => break,
            }
        }
    };
    // A client that sends nothing more has nothing to be read.
    let _ = timeout(DISCARD_TIME, read).await;
}

/// What came so far.
struct Incoming {
    file: File,
    head: Vec<u8>,
    bytes: u64,
    hash: Sha256,
}

impl Incoming {
    fn look_at(&mut self, chunk: &[u8], max_bytes: u64) -> Result<(), UploadError> {
        self.bytes += chunk.len() as u64;
        if self.bytes > max_bytes {
            return Err(UploadError::TooLarge { limit: max_bytes });
        }
        if self.head.len() < MAGIC_BYTES {
            self.head.extend(chunk.iter().take(MAGIC_BYTES - self.head.len()));
            if self.head.len() == MAGIC_BYTES {
                self.check_magic()?;
            }
        }
        Ok(())
    }

    /// Blocks.
    fn write(mut self, chunk: &[u8]) -> io::Result<Self> {
        self.hash.update(chunk);
        self.file.write_all(chunk)?;
        Ok(self)
    }

    fn check_whole(&self) -> Result<(), UploadError> {
        if self.bytes == 0 {
            return Err(UploadError::Empty);
        }
        self.check_magic()
    }

    /// Blocks.
    fn finish(self) -> io::Result<MaskInfo> {
        self.file.sync_all()?;
        Ok(MaskInfo { sha256: hex(&self.hash.finalize()), bytes: self.bytes })
    }

    fn check_magic(&self) -> Result<(), UploadError> {
        check_magic(&self.head).map_err(|error| UploadError::Refused(Box::new(Problem::from(&error))))
    }
}

/// Looks at a received file before its job is accepted; what is found here is told at once
/// instead of in a failed job. Blocks.
///
/// # Errors
/// When the header shows that the job would fail, or cannot be read.
pub fn preflight(path: &Path, limits: InputLimits) -> Result<HeaderFacts, Box<Problem>> {
    check_header(path, limits).map_err(|error| {
        if let ReadError::Io(error) = &error {
            tracing::error!(%error, "a received file cannot be read");
        }
        Box::new(Problem::from(&error))
    })
}
