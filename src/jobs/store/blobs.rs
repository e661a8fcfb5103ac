//! Files of jobs: masks as they were sent, and results. Kept in an object store, durable when a
//! call returns; one key is written once and never changed.
//!
//! ```text
//! masks/{job}                   one per job
//! results/{job}/{token}/{name}  one folder per attempt, named by its lease token
//! ```
//!
//! The store is a folder of this machine. What an object store elsewhere lacks is beside it, under
//! `scratch/{instance}`: uploads under way, and the files of running attempts, which the pipeline
//! writes as plain files.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::stream::BoxStream;
use futures_util::{StreamExt, TryStreamExt};
use object_store::buffered::BufWriter;
use object_store::local::LocalFileSystem;
use object_store::path::Path as Key;
use object_store::{GetOptions, GetRange, GetResultPayload, ObjectStore, ObjectStoreExt};
use rustix::fs::Access;
use sha2::{Digest, Sha256};
use tempfile::{NamedTempFile, TempPath};
use tokio::fs::File;
use tokio::io::{AsyncWriteExt, BufReader};
use tokio::runtime::Handle;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::KeptFiles;
use crate::formats::hex;
use crate::jobs::blocking::on_own_thread;
use crate::jobs::drafts::sha256_of_file;
use crate::jobs::job::{Job, JobId, ResultFile};
use crate::jobs::make_private;

const SCRATCH: &str = "scratch";
const MASKS: &str = "masks";
const RESULTS: &str = "results";
/// What the names of files begin with that are tried out.
const PROBE: &str = ".probe-";
const RESERVE: &str = "reserve";
/// Room that is kept back: the log of the database grows by a tenth of a MiB for a job that is deleted.
const RESERVE_BYTES: u64 = 4 << 20;
/// Files up to this size are read once: checked or stored, then sent, from memory.
const IN_MEMORY_BYTES: u64 = 8 << 20;
/// Memory of all answers together that are sent from memory, KiB: readers may be slow. Others are read twice.
const ANSWERS_KIB: usize = 64 << 10;
/// How much is read ahead of a file that is copied.
const COPY_BUFFER_BYTES: usize = 1 << 20;

/// The files of all jobs.
#[derive(Clone, Debug)]
pub struct Blobs {
    store: Arc<dyn ObjectStore>,
    root: PathBuf,
    scratch: PathBuf,
    /// Whether files are kept in the folder that scratch files are in, and so need not be copied.
    is_local: bool,
    /// Memory left for answers, KiB.
    answers: Arc<Semaphore>,
}

/// A mask as a local file; a copy vanishes when this is dropped.
#[derive(Debug)]
pub enum LocalMask {
    /// The stored file itself.
    Stored(PathBuf),
    /// A copy of it.
    Copy(TempPath),
}

impl LocalMask {
    /// Where it lies.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Stored(path) => path,
            Self::Copy(path) => path,
        }
    }
}

/// A result whose content was found to be what was published.
pub enum Content {
    /// All of it, and its part of the memory for such answers, to be held until it has been sent.
    Bytes(Bytes, OwnedSemaphorePermit),
    /// Too large for that: to be read with [`Blobs::read_range`].
    Stored,
}

impl Blobs {
    /// Makes the folders that are missing, readable by nobody else: masks are patient data. Blocks.
    ///
    /// # Errors
    /// When a folder cannot be made.
    pub fn open(root: &Path, instance: &str) -> io::Result<Self> {
        let scratch = root.join(SCRATCH).join(instance);
        make_private(&scratch)?;
        Ok(Self { scratch, ..Self::beside(root)? })
    }

    /// The files of a data directory for one who takes no part in its work, and so has no scratch files;
    /// makes nothing.
    ///
    /// # Errors
    /// When the folder is not there.
    pub fn beside(root: &Path) -> io::Result<Self> {
        let store = LocalFileSystem::new_with_prefix(root).map_err(io_error)?.with_fsync(true);
        let store = Arc::new(store.with_automatic_cleanup(true));
        let answers = Arc::new(Semaphore::new(ANSWERS_KIB));
        Ok(Self { store, root: root.to_owned(), scratch: root.join(SCRATCH), is_local: true, answers })
    }

    /// The same with the files in another object store: only scratch files are in the folder.
    #[must_use]
    pub fn stored_in(self, store: Arc<dyn ObjectStore>) -> Self {
        Self { store, is_local: false, ..self }
    }

    /// A file for an upload, in a folder that is made anew when it was lost; it vanishes when dropped. Blocks.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn begin_upload(&self) -> io::Result<NamedTempFile> {
        match NamedTempFile::new_in(&self.scratch) {
            // Whoever removed the folder did not know that somebody needs it.
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                make_private(&self.scratch)?;
                NamedTempFile::new_in(&self.scratch)
            }
            made => made,
        }
    }

    /// Keeps an upload as the mask of a job.
    ///
    /// # Errors
    /// When it cannot be stored.
    pub async fn keep_mask(&self, upload: &Path, id: JobId) -> io::Result<()> {
        self.put(vec![(upload.to_owned(), mask_key(id))]).await
    }

    /// The mask of a job as a local file.
    ///
    /// # Errors
    /// When it is not there or cannot be read.
    pub async fn local_mask(&self, id: JobId) -> io::Result<LocalMask> {
        let found = self.store.get(&mask_key(id)).await.map_err(io_error)?;
        if let GetResultPayload::File(_, path) = &found.payload {
            return Ok(LocalMask::Stored(path.clone()));
        }
        let blobs = self.clone();
        let (file, path) = on_own_thread(move || blobs.begin_upload()).await?.into_parts();
        let mut file = File::from_std(file);
        let mut chunks = found.into_stream();
        while let Some(chunk) = chunks.try_next().await.map_err(io_error)? {
            file.write_all(&chunk).await?;
        }
        file.flush().await?;
        Ok(LocalMask::Copy(path))
    }

    /// Makes the empty local folder of an attempt. Blocks.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn begin_attempt(&self, token: &str) -> io::Result<PathBuf> {
        let folder = self.scratch.join(token);
        make_private(&folder)?;
        Ok(folder)
    }

    /// Stores the files of an attempt; the row may name them afterwards.
    ///
    /// # Errors
    /// When one cannot be stored.
    pub async fn keep_results(&self, id: JobId, token: &str, names: &[&str]) -> io::Result<()> {
        let folder = self.scratch.join(token);
        if self.is_local {
            let files: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
            let (folder, kept) = (folder.clone(), self.root.join(RESULTS).join(id.to_string()).join(token));
            if on_own_thread(move || move_folder(&folder, &files, &kept)).await? {
                return Ok(());
            }
        }
        self.put(names.iter().map(|name| (folder.join(name), result_key(id, token, name))).collect()).await
    }

    /// Stores a file that was made in the folder of a draft beside the published results of a job.
    ///
    /// # Errors
    /// When it cannot be stored.
    pub async fn keep_made(&self, id: JobId, (draft, token): (&str, &str), name: &str) -> io::Result<()> {
        self.put(vec![(self.scratch.join(draft).join(name), result_key(id, token, name))]).await
    }

    /// All bytes of a published result, however large.
    ///
    /// # Errors
    /// When it cannot be read.
    pub async fn read_all(&self, id: JobId, token: &str, file: &ResultFile) -> io::Result<Vec<u8>> {
        let found = self.store.get(&result_key(id, token, &file.name)).await.map_err(io_error)?;
        Ok(found.bytes().await.map_err(io_error)?.to_vec())
    }

    /// Removes the local folder of an attempt. Blocks.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub fn end_attempt(&self, token: &str) -> io::Result<()> {
        gone(fs::remove_dir_all(self.scratch.join(token)))
    }

    /// Copies published results to another job.
    ///
    /// # Errors
    /// When a file is not there any more or cannot be copied.
    pub async fn copy_results(&self, from: (JobId, &str), to: (JobId, &str), files: &[ResultFile]) -> io::Result<()> {
        for file in files {
            let (from, to) = (result_key(from.0, from.1, &file.name), result_key(to.0, to.1, &file.name));
            self.store.copy(&from, &to).await.map_err(io_error)?;
        }
        Ok(())
    }

    /// Reads a published result and compares it with its hash; `None` when it is not what was
    /// published.
    ///
    /// # Errors
    /// When it cannot be read.
    pub async fn read_checked(&self, id: JobId, token: &str, file: &ResultFile) -> io::Result<Option<Content>> {
        let found = self.store.get(&result_key(id, token, &file.name)).await.map_err(io_error)?;
        if found.meta.size != file.bytes {
            return Ok(None);
        }
        if let Some(room) = self.room_in_memory(file.bytes) {
            let bytes = found.bytes().await.map_err(io_error)?;
            let hashed = bytes.clone();
            let hash = on_own_thread(move || Ok(hex(&Sha256::digest(&hashed)))).await?;
            return Ok((hash == file.sha256).then_some(Content::Bytes(bytes, room)));
        }
        let mut chunks = found.into_stream();
        let mut hash = Sha256::new();
        while let Some(chunk) = chunks.try_next().await.map_err(io_error)? {
            hash = on_own_thread(move || Ok(hash.chain_update(&chunk))).await?;
        }
        Ok((hex(&hash.finalize()) == file.sha256).then_some(Content::Stored))
    }

    /// Room for an answer of so many bytes, where it is to be sent from memory.
    fn room_in_memory(&self, bytes: u64) -> Option<OwnedSemaphorePermit> {
        let kib = u32::try_from(bytes.div_ceil(1024)).ok().filter(|_| bytes <= IN_MEMORY_BYTES)?;
        Arc::clone(&self.answers).try_acquire_many_owned(kib).ok()
    }

    /// Bytes `first` to before `end` of a published result.
    ///
    /// # Errors
    /// When it cannot be read.
    pub async fn read_range(
        &self,
        (id, token, name): (JobId, &str, &str),
        (first, end): (u64, u64),
    ) -> io::Result<BoxStream<'static, io::Result<Bytes>>> {
        let options = GetOptions { range: Some(GetRange::Bounded(first..end)), ..GetOptions::default() };
        let found = self.store.get_opts(&result_key(id, token, name), options).await.map_err(io_error)?;
        Ok(found.into_stream().map_err(io_error).boxed())
    }

    /// Whether the mask of a job is there and is what was sent.
    pub async fn is_mask_whole(&self, job: &Job) -> bool {
        let Ok(mask) = self.local_mask(job.id).await else { return false };
        let hash = on_own_thread(move || sha256_of_file(mask.path())).await;
        hash.is_ok_and(|hash| hash == job.mask.sha256)
    }

    /// Copies a mask into another data directory; `false` when it is not there.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub async fn copy_mask_to(&self, other: &Self, id: JobId) -> io::Result<bool> {
        self.copy_to(other, &mask_key(id)).await
    }

    /// Copies a result into another data directory; `false` when it is not there.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub async fn copy_result_to(&self, other: &Self, (id, token, name): (JobId, &str, &str)) -> io::Result<bool> {
        self.copy_to(other, &result_key(id, token, name)).await
    }

    /// Removes the mask of a job.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub async fn erase_mask(&self, id: JobId) -> io::Result<()> {
        gone(self.store.delete(&mask_key(id)).await.map_err(io_error))
    }

    /// Removes all results of a job.
    ///
    /// # Errors
    /// When one cannot be removed.
    pub async fn erase_results(&self, id: JobId) -> io::Result<()> {
        self.erase_under(&Key::from_iter([RESULTS, &id.to_string()])).await
    }

    /// Removes what an attempt stored.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub async fn erase_attempt(&self, id: JobId, token: &str) -> io::Result<()> {
        self.erase_under(&Key::from_iter([RESULTS, &id.to_string(), token])).await
    }

    /// Removes the mask and all results of a job.
    ///
    /// # Errors
    /// When something cannot be removed.
    pub async fn erase(&self, id: JobId) -> io::Result<()> {
        self.erase_mask(id).await?;
        self.erase_results(id).await
    }

    /// All keys: of objects, and of what else lies between them.
    ///
    /// # Errors
    /// When they cannot be listed.
    pub async fn stored(&self) -> io::Result<Vec<StoredKey>> {
        if self.is_local {
            let root = self.root.clone();
            return on_own_thread(move || walk(&root)).await;
        }
        let mut found = Vec::new();
        for folder in [MASKS, RESULTS] {
            let mut objects = self.store.list(Some(&Key::from(folder)));
            while let Some(object) = objects.try_next().await.map_err(io_error)? {
                found.push(StoredKey(Stored::Object(object.location)));
            }
        }
        Ok(found)
    }

    /// Removes what is stored under these keys, and says how many it removed. One that cannot be removed is logged.
    pub async fn remove(&self, keys: &[StoredKey]) -> usize {
        let mut removed = 0;
        for key in keys {
            let done = match &key.0 {
                Stored::Object(key) => self.store.delete(key).await.map_err(io_error),
                Stored::Other(path) => tokio::fs::remove_file(path).await,
            };
            match gone(done) {
                Ok(()) => removed += 1,
                Err(error) => tracing::error!(path = %key, %error, "a file that no job names cannot be removed"),
            }
        }
        removed
    }

    /// Removes the scratch files of all other processes, and what they tried out. One that cannot be removed is logged. Blocks.
    ///
    /// # Errors
    /// When their folder cannot be read.
    pub fn sweep_scratch_of_others(&self) -> io::Result<()> {
        let is_probe = |entry: &fs::DirEntry| entry.file_name().as_encoded_bytes().starts_with(PROBE.as_bytes());
        let is_other = |entry: &fs::DirEntry| entry.path() != self.scratch;
        let mut left: Vec<fs::DirEntry> = fs::read_dir(self.root.join(SCRATCH))?.collect::<io::Result<_>>()?;
        left.retain(is_other);
        left.extend(fs::read_dir(&self.root)?.flatten().filter(is_probe));
        for entry in left {
            let path = entry.path();
            let removed = if entry.file_type()?.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            if let Err(error) = gone(removed) {
                tracing::error!(path = %path.display(), %error, "scratch files cannot be removed");
            }
        }
        Ok(())
    }

    /// Removes the scratch files of a process that is gone. Blocks.
    ///
    /// # Errors
    /// When they cannot be removed.
    pub fn sweep_scratch(&self, instance: &str) -> io::Result<()> {
        gone(fs::remove_dir_all(self.root.join(SCRATCH).join(instance)))
    }

    /// Fails where the folders can be seen to take no file; writes none. A matter of microseconds.
    ///
    /// # Errors
    /// When they are no folders, or may not be written to.
    pub fn look(&self) -> io::Result<()> {
        rustix::fs::access(&self.root, Access::WRITE_OK | Access::EXEC_OK)?;
        let about = match fs::metadata(&self.scratch) {
            // It is made anew when it is needed.
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            about => about?,
        };
        if about.is_dir() { Ok(()) } else { Err(io::ErrorKind::NotADirectory.into()) }
    }

    /// Fails unless a file can be written and made durable.
    ///
    /// # Errors
    /// When it cannot.
    pub async fn check_writable(&self) -> io::Result<()> {
        let blobs = self.clone();
        on_own_thread(move || {
            let mut file = blobs.begin_probe()?;
            io::Write::write_all(&mut file, b"ready")?;
            file.as_file().sync_all()
        })
        .await
    }

    /// Room left for files, bytes. A matter of microseconds: it needs no thread of its own.
    ///
    /// # Errors
    /// When the file system does not say.
    pub fn room(&self) -> io::Result<Room> {
        room(&self.root)
    }

    /// A file beside the folders of jobs, where it is taken for nothing of theirs; it vanishes when dropped. Blocks.
    fn begin_probe(&self) -> io::Result<NamedTempFile> {
        tempfile::Builder::new().prefix(PROBE).tempfile_in(&self.root)
    }

    /// Keeps some room of the disk back, where there is enough: a file that [`Self::give_up_reserve`] removes. Blocks.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn keep_reserve(&self, min_free_bytes: u64) -> io::Result<()> {
        let path = self.root.join(RESERVE);
        if path.exists() || !self.room()?.has(min_free_bytes.saturating_add(2 * RESERVE_BYTES)) {
            return Ok(());
        }
        let file = self.begin_probe()?;
        // Written, not only asked for: some file systems promise the same room to others.
        let zeros = vec![0; usize::try_from(RESERVE_BYTES).map_err(io::Error::other)?];
        io::Write::write_all(&mut file.as_file(), &zeros)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    }

    /// Gives the room back for what must work on a full disk; `false` when that was done before. Blocks.
    #[must_use]
    pub fn give_up_reserve(&self) -> bool {
        fs::remove_file(self.root.join(RESERVE)).is_ok()
    }

    /// Keeps local files under these keys; on return they survive the loss of power.
    async fn put(&self, files: Vec<(PathBuf, Key)>) -> io::Result<()> {
        if self.is_local {
            let (root, links) = (self.root.clone(), files.clone());
            match on_own_thread(move || link_all(&root, &links)).await {
                // A file system without links.
                Err(error)
                    if error.kind() == io::ErrorKind::Unsupported
                        || error.kind() == io::ErrorKind::PermissionDenied => {}
                linked => return linked,
            }
        }
        let put = files.iter().map(|(path, key)| self.put_copy(path, key));
        futures_util::future::try_join_all(put).await?;
        Ok(())
    }

    async fn put_copy(&self, path: &Path, key: &Key) -> io::Result<()> {
        let file = File::open(path).await?;
        if file.metadata().await?.len() <= IN_MEMORY_BYTES {
            let content = tokio::fs::read(path).await?;
            self.store.put(key, content.into()).await.map_err(io_error)?;
            return Ok(());
        }
        let (to, runtime) = (BufWriter::new(Arc::clone(&self.store), key.clone()), Handle::current());
        // A store in a folder makes its files where it is called, and syncs their folders.
        on_own_thread(move || runtime.block_on(put_large(file, to))).await
    }

    async fn copy_to(&self, other: &Self, key: &Key) -> io::Result<bool> {
        let found = match self.store.get(key).await.map_err(io_error) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
            found => found?,
        };
        let mut to = BufWriter::new(Arc::clone(&other.store), key.clone());
        let mut chunks = found.into_stream();
        while let Some(chunk) = chunks.try_next().await.map_err(io_error)? {
            to.put(chunk).await.map_err(io_error)?;
        }
        to.shutdown().await.map_err(io_error)?;
        Ok(true)
    }

    async fn erase_under(&self, prefix: &Key) -> io::Result<()> {
        let objects: Vec<_> = self.store.list(Some(prefix)).try_collect().await.map_err(io_error)?;
        for object in objects {
            gone(self.store.delete(&object.location).await.map_err(io_error))?;
        }
        Ok(())
    }
}

async fn put_large(from: File, mut to: BufWriter) -> io::Result<()> {
    let mut from = BufReader::with_capacity(COPY_BUFFER_BYTES, from);
    // Dropped after an error, it removes what it wrote.
    tokio::io::copy_buf(&mut from, &mut to).await.map_err(io_error)?;
    to.shutdown().await.map_err(io_error)
}

/// Those of some keys that no job keeps. Takes long of many.
#[must_use]
pub fn without_kept(found: Vec<StoredKey>, kept: Vec<KeptFiles>) -> Vec<StoredKey> {
    let kept: BTreeMap<String, KeptFiles> = kept.into_iter().map(|files| (files.id.to_string(), files)).collect();
    found.into_iter().filter(|key| !key.is_kept(&kept)).collect()
}

/// Jobs that a log has, of which there are files, and that the database neither has nor has deleted: it has lost them.
#[must_use]
pub fn lost_jobs(
    found: &[StoredKey],
    (kept, erased): (&[KeptFiles], &[JobId]),
    by_log: &BTreeSet<String>,
) -> BTreeSet<String> {
    let known = kept.iter().map(|files| files.id).chain(erased.iter().copied());
    let known: BTreeSet<String> = known.map(|id| id.to_string()).collect();
    found.iter().filter_map(StoredKey::job).filter(|job| by_log.contains(job) && !known.contains(job)).collect()
}

/// Where something is stored.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StoredKey(Stored);

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Stored {
    Object(Key),
    /// What is no object: half-written (named like a key, then `#` and a number), of a name that no key has, or a link, which
    /// may lead anywhere.
    Other(PathBuf),
}

impl fmt::Display for StoredKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Stored::Object(key) => key.fmt(f),
            Stored::Other(path) => path.display().fmt(f),
        }
    }
}

impl StoredKey {
    /// That of something else than an object.
    #[cfg(test)]
    pub(crate) fn other(path: &str) -> Self {
        Self(Stored::Other(path.into()))
    }

    /// The job that it is of, by its name.
    #[must_use]
    pub fn job(&self) -> Option<String> {
        let Stored::Object(key) = &self.0 else { return None };
        key.parts().nth(1).map(|part| part.as_ref().to_owned())
    }

    fn is_kept(&self, kept: &BTreeMap<String, KeptFiles>) -> bool {
        let Stored::Object(key) = &self.0 else { return false };
        let parts: Vec<String> = key.parts().map(|part| part.as_ref().to_owned()).collect();
        let Some(job) = parts.get(1).and_then(|job| kept.get(job)) else { return false };
        match parts[0].as_str() {
            MASKS => job.mask,
            _ => parts.get(2).is_some_and(|token| job.tokens.contains(token)),
        }
    }
}

/// Room left in the file system of `folder` for an unprivileged user, bytes.
///
/// # Errors
/// When the file system does not say.
pub fn room(folder: &Path) -> io::Result<Room> {
    let found = rustix::fs::statvfs(folder)?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    // Some file systems do not count files.
    let free_files = if found.f_files == 0 { 1.0 } else { found.f_favail as f64 / found.f_files as f64 };
    Ok(Room { all_bytes: bytes(found.f_blocks), free_bytes: bytes(found.f_bavail), free_files })
}

/// What a file system has.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// In all.
    pub all_bytes: u64,
    /// Left for us.
    pub free_bytes: u64,
    /// Share of the files that it can have which are left.
    pub free_files: f64,
}

impl Room {
    /// Whether so many bytes are left, and a few files.
    #[must_use]
    pub fn has(&self, bytes: u64) -> bool {
        /// A job has a dozen files and folders; with none left nothing can be erased in an orderly way either.
        const FEW_FILES: f64 = 0.02;
        self.free_bytes >= bytes && self.free_files >= FEW_FILES
    }
}

/// Makes a folder of these files, and of no others, the folder `kept`, and syncs all of it; `false`, and nothing is
/// changed, where they have to be linked one by one. Blocks.
fn move_folder(folder: &Path, files: &[PathBuf], kept: &Path) -> io::Result<bool> {
    let Some(above) = kept.parent() else { return Ok(false) };
    if fs::read_dir(folder)?.count() != files.len() {
        return Ok(false);
    }
    for file in files {
        fs::File::open(file)?.sync_all()?;
    }
    fs::File::open(folder)?.sync_all()?;
    // It is there from a try before this one, or the folder that it goes into was removed while it was empty.
    if make_private(above).and_then(|()| fs::rename(folder, kept)).is_err() {
        return Ok(false);
    }
    for changed in [Some(above), above.parent()].into_iter().flatten() {
        fs::File::open(changed)?.sync_all()?;
    }
    Ok(true)
}

/// Gives files their kept names, by a link, and syncs them and the folders that they are named in. Blocks.
fn link_all(root: &Path, files: &[(PathBuf, Key)]) -> io::Result<()> {
    let mut folders = BTreeSet::new();
    for (path, key) in files {
        let kept = root.join(key.as_ref());
        let folder = kept.parent().unwrap_or(root);
        for above in folder.ancestors().take_while(|above| *above != root) {
            folders.insert(above.to_owned());
        }
        fs::File::open(path)?.sync_all()?;
        link(path, &kept, folder)?;
    }
    // The lowest first: what a folder holds is there before the folder is.
    for folder in folders.iter().rev() {
        fs::File::open(folder)?.sync_all()?;
    }
    Ok(())
}

/// Gives a file another name, in a folder that is made if need be.
fn link(path: &Path, kept: &Path, folder: &Path) -> io::Result<()> {
    /// Folders that became empty are removed, maybe between the making of one and its use.
    const TRIES: usize = 10;
    let mut linked = Ok(());
    for _ in 0..TRIES {
        linked = make_private(folder).and_then(|()| fs::hard_link(path, kept));
        match &linked {
            // A try before this one left it.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => gone(fs::remove_file(kept))?,
            Err(error) if error.kind() == io::ErrorKind::NotFound && path.exists() => {}
            _ => break,
        }
    }
    linked
}

fn mask_key(id: JobId) -> Key {
    Key::from_iter([MASKS, &id.to_string()])
}

fn result_key(id: JobId, token: &str, name: &str) -> Key {
    Key::from_iter([RESULTS, &id.to_string(), token, name])
}

/// All that lies among the files of jobs. No link is followed.
fn walk(root: &Path) -> io::Result<Vec<StoredKey>> {
    let mut found = Vec::new();
    for folder in [MASKS, RESULTS] {
        walk_folder(root, &root.join(folder), &mut found)?;
    }
    Ok(found)
}

/// Folders that are empty go.
fn walk_folder(root: &Path, folder: &Path, found: &mut Vec<StoredKey>) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        let (path, kind) = (entry.path(), entry.file_type()?);
        if kind.is_dir() {
            walk_folder(root, &path, found)?;
            // Goes when it is empty. Whoever is about to write into it makes it anew.
            let _ = fs::remove_dir(path);
            continue;
        }
        let key = if kind.is_file() { key_of(root, &path) } else { None };
        found.push(StoredKey(key.map_or(Stored::Other(path), Stored::Object)));
    }
    Ok(())
}

/// The key of a file, where its name can be one: drafts have another.
fn key_of(root: &Path, path: &Path) -> Option<Key> {
    let within = path.strip_prefix(root).ok()?.to_str()?;
    let key = Key::parse(within).ok()?;
    (!within.contains('#') && key.as_ref() == within).then_some(key)
}

/// With the kind of the system's error below, where there is one: whether the disk is full matters.
fn io_error<E: std::error::Error + Send + Sync + 'static>(error: E) -> io::Error {
    let mut kind = io::ErrorKind::Other;
    let mut cause: Option<&(dyn std::error::Error + 'static)> = Some(&error);
    while let Some(inner) = cause {
        if let Some(error) = inner.downcast_ref::<io::Error>().filter(|e| e.kind() != io::ErrorKind::Other) {
            kind = error.kind();
        }
        if matches!(inner.downcast_ref(), Some(object_store::Error::NotFound { .. })) {
            kind = io::ErrorKind::NotFound;
        }
        cause = inner.source();
    }
    io::Error::new(kind, error)
}

/// What is not there is as good as removed.
fn gone(removed: io::Result<()>) -> io::Result<()> {
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
