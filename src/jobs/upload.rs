//! Receives a mask: streamed to disk, counted, hashed and sniffed on the way, so that memory
//! stays the size of one chunk and a refusal comes as early as the bytes allow.

use std::fs::File;
use std::future::Future;
use std::io::{self, Read};
use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use sha2::{Digest, Sha256};
use tempfile::TempPath;
use tokio::io::AsyncWriteExt;
use tokio::time::{Instant, timeout, timeout_at};

use super::blobs::Blobs;
use super::job::MaskInfo;
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
}

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
    /// Neither gzip nor a NIfTI header.
    #[error("the upload is no NIfTI file")]
    NotNifti,
    /// The connection broke, or the body was malformed.
    #[error("the upload ended early or was malformed")]
    Interrupted,
    /// The bytes came too slowly.
    #[error("the upload took too long")]
    TooSlow,
    /// It could not be written.
    #[error("the upload could not be stored: {0}")]
    Storage(#[from] io::Error),
}

/// An upload on disk, synced, not yet a job's; the file vanishes when this is dropped.
#[derive(Debug)]
pub struct Received {
    /// The file.
    pub file: TempPath,
    /// What it is.
    pub mask: MaskInfo,
}

/// Writes `body` to a new file among the incoming ones.
///
/// # Errors
/// As [`UploadError`]; nothing is left on disk then.
pub async fn receive<S, E>(blobs: &Blobs, limits: UploadLimits, mut body: S) -> Result<Received, UploadError>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let received = receive_all(blobs, limits, &mut body).await;
    if matches!(received, Err(UploadError::TooLarge { .. } | UploadError::NotNifti)) {
        discard(&mut body).await;
    }
    received
}

async fn receive_all<S, E>(blobs: &Blobs, limits: UploadLimits, body: &mut S) -> Result<Received, UploadError>
where
    S: Stream<Item = Result<Bytes, E>> + Unpin,
{
    let (file, path) = blobs.begin_upload()?.into_parts();
    let mut file = tokio::fs::File::from_std(file);
    let mut progress = Incoming::default();
    let deadline = Instant::now() + limits.total;
    while let Some(chunk) = next_chunk(body, limits.idle, deadline).await? {
        progress.take(&chunk, limits.max_bytes)?;
        file.write_all(&chunk).await?;
    }
    let mask = progress.finish()?;
    file.flush().await?;
    file.sync_all().await?;
    Ok(Received { file: path, mask })
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
#[derive(Default)]
struct Incoming {
    head: Vec<u8>,
    bytes: u64,
    hash: Sha256,
}

impl Incoming {
    fn take(&mut self, chunk: &[u8], max_bytes: u64) -> Result<(), UploadError> {
        self.bytes += chunk.len() as u64;
        if self.bytes > max_bytes {
            return Err(UploadError::TooLarge { limit: max_bytes });
        }
        if self.head.len() < MAGIC_BYTES {
            self.head.extend(chunk.iter().take(MAGIC_BYTES - self.head.len()));
            if self.head.len() == MAGIC_BYTES && !is_nifti_magic(&self.head) {
                return Err(UploadError::NotNifti);
            }
        }
        self.hash.update(chunk);
        Ok(())
    }

    fn finish(self) -> Result<MaskInfo, UploadError> {
        match self.head.len() {
            0 => Err(UploadError::Empty),
            MAGIC_BYTES => Ok(MaskInfo { sha256: hex(&self.hash.finalize()), bytes: self.bytes }),
            _ => Err(UploadError::NotNifti),
        }
    }
}

const MAGIC_BYTES: usize = 4;
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// Header sizes of NIfTI-1 and NIfTI-2, the first number of a file.
const HEADER_SIZES: [i32; 2] = [348, 540];

/// Whether a file that begins like this can be NIfTI: gzip, or a header's size in either byte
/// order.
#[must_use]
pub fn is_nifti_magic(head: &[u8]) -> bool {
    let Some(first) = head.first_chunk::<MAGIC_BYTES>() else { return false };
    let sizes = [i32::from_le_bytes(*first), i32::from_be_bytes(*first)];
    first.starts_with(&GZIP_MAGIC) || sizes.iter().any(|size| HEADER_SIZES.contains(size))
}

/// Looks at a received file before its job is accepted; what is found here is told at once
/// instead of in a failed job. Blocks.
///
/// # Errors
/// When the file is not what it must be, or cannot be read.
pub fn preflight(path: &Path) -> Result<(), Box<Problem>> {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MAGIC_BYTES as u64).read_to_end(&mut head));
    match read {
        Ok(_) if is_nifti_magic(&head) => Ok(()),
        Ok(_) => Err(Box::new(not_nifti())),
        Err(_) => Err(Box::new(Problem::internal())),
    }
}

/// What a client is told whose file is neither gzip nor NIfTI.
#[must_use]
pub fn not_nifti() -> Problem {
    Problem::new(415, "not_nifti", "the upload begins neither with gzip's magic nor with a NIfTI header's size")
        .at("byte 0")
        .hint("send a NIfTI-1 or NIfTI-2 file (.nii or .nii.gz) as it lies on disk")
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
