//! Who did what, kept apart from the log that operators read: one JSON line per action in a file
//! that only grows, each line holding the hash of the one before.
//!
//! [`verify`] finds a line that was changed, removed, added or moved. What the chain alone cannot
//! show is a tail cut off, or a file written anew from some line on: whoever needs that keeps
//! [`Verified::last_hash`] elsewhere and looks for it later.
//!
//! Several processes may write to one file; each append holds a lock on it. A file is rotated by
//! renaming it. Whoever has the log open follows at its next append, and the chain goes on in the
//! new file. It does not when the first to write there never had the file before it open: a process
//! started in between begins a new chain, one idle for two rotations goes on from the older file.

use std::collections::BTreeSet;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{DirBuilderExt, FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::formats::hex;

/// Stands for the hash of the line before the first one.
const NO_HASH: &str = "0000000000000000000000000000000000000000000000000000000000000000";
/// Bytes of the longest line, and of a block when the last line is searched for.
const MAX_LINE: usize = 4096;
/// The one action that may follow a line which is no entry.
const RECOVERED: &str = "recovered";

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// A mask was sent.
    Submit,
    /// A result was handed out.
    ReadResult,
    /// Results were stored in an archive, or are no longer tried to be.
    Deliver,
    /// DICOM results were searched.
    Search,
    /// A job was to be stopped.
    Cancel,
    /// A job was to run again.
    Retry,
    /// A job was removed for its client.
    Delete,
    /// A job was removed because its time was over.
    Expire,
    /// A token was made.
    TokenCreated,
    /// A token was taken back.
    TokenRevoked,
    /// Jobs that nobody owned were given to a tenant.
    Adopted,
    /// Someone was turned away.
    Denied,
    /// The service started.
    Started,
    /// The service stopped.
    Stopped,
    /// The log found its last line torn. It writes this itself.
    Recovered,
}

/// What a line says. Nothing in it may be text that a client chose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry<'a> {
    /// Whose data; nobody's when the service acts for itself or does not know who asks.
    pub tenant: Option<&'a str>,
    /// Id of the token that was shown, never the token.
    pub token: Option<&'a str>,
    /// What was done.
    pub action: Action,
    /// Id of the job.
    pub job: Option<&'a str>,
    /// How it ended: a stable code, that of the problem when there was one.
    pub outcome: &'a str,
    /// Leads to the lines of the operators' log.
    pub trace_id: Option<&'a str>,
}

#[derive(Serialize)]
struct Line<'a> {
    seq: u64,
    at: String,
    tenant: Option<&'a str>,
    token: Option<&'a str>,
    action: Action,
    job: Option<&'a str>,
    outcome: &'a str,
    trace_id: Option<&'a str>,
    prev: &'a str,
    /// Of a recovery: the hash of the last entry before it. What is torn holds no hash, so nothing
    /// else would vouch for that entry.
    #[serde(skip_serializing_if = "Option::is_none")]
    after: Option<&'a str>,
}

/// What the chain needs of a line. The action is any text: another version may know more of them.
#[derive(Deserialize)]
struct Link {
    seq: u64,
    action: String,
    prev: String,
    after: Option<String>,
}

/// An entry, by its number and its hash; 0 and zeros for none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Its number.
    pub seq: u64,
    /// Its hash.
    pub hash: String,
}

/// What a line says of a job.
#[derive(Deserialize)]
struct OfJob {
    action: String,
    job: Option<String>,
    outcome: String,
}

/// Jobs that were taken in and not removed since, as far as one file tells. Lines that are no entries tell nothing.
///
/// # Errors
/// When the file cannot be read; none is as good as an empty one.
pub fn jobs_left(path: &Path) -> io::Result<BTreeSet<String>> {
    let mut left = BTreeSet::new();
    let file = match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(left),
        file => file?,
    };
    for line in BufReader::new(file).split(b'\n') {
        let Ok(OfJob { action, job: Some(job), outcome }) = serde_json::from_slice(&line?) else { continue };
        match (action.as_str(), outcome.as_str()) {
            ("submit", "accepted" | "reused") => drop(left.insert(job)),
            ("delete", _) | ("expire", "jobs") => drop(left.remove(&job)),
            _ => {}
        }
    }
    Ok(left)
}

/// Where a log begins and ends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ends {
    /// The entry before its first one.
    pub head: Mark,
    /// Its last entry.
    pub tip: Mark,
    /// Whether what was before it is known to be whole: this process saw the file renamed, or one beside it ends there.
    pub is_continued: bool,
}

/// An audit log that is open for appending.
#[derive(Debug)]
pub struct Audit {
    path: PathBuf,
    chain: Mutex<Chain>,
}

impl Audit {
    /// Opens the log; makes it and its folder, readable by nobody else, when they are missing. A
    /// last line that a power loss tore is kept, ended, and followed by a recovery.
    ///
    /// # Errors
    /// When the file cannot be made, locked, read or written.
    pub fn open(path: &Path) -> io::Result<Self> {
        let chain = Chain { file: open_file(path)?, len: 0, tip: Tip::default(), follows: None };
        let chain = Mutex::new(chain);
        let audit = Self { path: path.to_owned(), chain };
        audit.locked(|_| Ok(()))?;
        Ok(audit)
    }

    /// Adds an entry; on return it survives the end of this process. Not synced: a power loss may
    /// take the last seconds, and a sync per entry would make every request wait for the disk.
    /// Blocks while another process writes.
    ///
    /// # Errors
    /// When the line would be longer than 4 KiB, or the file cannot be locked, read or written;
    /// nothing of the entry is in the file then.
    pub fn append(&self, entry: &Entry<'_>) -> io::Result<()> {
        self.locked(|chain| chain.put(chain.len, "", entry))
    }

    /// Where the log begins and ends. Blocks while another process writes.
    ///
    /// # Errors
    /// When the file cannot be locked or read.
    pub fn ends(&self) -> io::Result<Ends> {
        let mut ends = None;
        self.locked(|chain| {
            let tip = Mark { seq: chain.tip.seq, hash: chain.tip.hash.clone() };
            let first = first_link(&chain.file, chain.len)?;
            // In an emptied file nothing is left of what the chain goes on from.
            let (head, tip) = match first {
                Some(link) => (Mark { seq: link.seq.saturating_sub(1), hash: link.prev }, tip),
                None => (Mark::none(), Mark::none()),
            };
            let was_followed = chain.follows.as_ref() == Some(&head.hash);
            ends = Some((head, tip, was_followed));
            Ok(())
        })?;
        let (head, tip, was_followed) = ends.ok_or_else(|| io::Error::other("the log was not read"))?;
        let is_continued = was_followed || ends_beside(&self.path, &head.hash)?;
        Ok(Ends { head, tip, is_continued })
    }

    /// Lets the chain of a new file go on after an entry of another.
    pub fn go_on_after(&self, tip: &Mark) {
        let mut chain = self.chain();
        if chain.len == 0 && chain.tip.seq == 0 {
            chain.tip = Tip { seq: tip.seq, hash: tip.hash.clone(), entry_hash: tip.hash.clone() };
        }
    }

    /// Jobs that were taken in and not removed since. Blocks.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn jobs_left(&self) -> io::Result<BTreeSet<String>> {
        jobs_left(&self.path)
    }

    /// Makes durable what was appended.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn sync(&self) -> io::Result<()> {
        self.chain().file.sync_all()?;
        // A new name in a folder is on disk only once the folder is.
        folder_of(&self.path).map_or(Ok(()), |folder| File::open(folder)?.sync_all())
    }

    /// Does something with the end of the chain, which no other process moves meanwhile.
    fn locked(&self, act: impl FnOnce(&mut Chain) -> io::Result<()>) -> io::Result<()> {
        let mut chain = self.chain();
        chain.lock(&self.path)?;
        let acted = chain.settle().and_then(|()| act(&mut chain));
        acted.and(chain.file.unlock())
    }

    /// A panic leaves the chain as the last whole append left it.
    fn chain(&self) -> MutexGuard<'_, Chain> {
        self.chain.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The end of the log, as this handle last saw it.
#[derive(Debug)]
struct Chain {
    file: File,
    len: u64,
    tip: Tip,
    /// The last line of the file before this one, where that was seen to be renamed, not removed.
    follows: Option<String>,
}

/// What the next line is chained to.
#[derive(Debug)]
struct Tip {
    /// Number of the last line; a torn one has the number that it would have had.
    seq: u64,
    /// Hash of the last line.
    hash: String,
    /// Hash of the last line that is an entry.
    entry_hash: String,
}

impl Default for Tip {
    fn default() -> Self {
        Self { seq: 0, hash: NO_HASH.to_owned(), entry_hash: NO_HASH.to_owned() }
    }
}

impl Chain {
    /// Locks the file that is at `path` now. Every writer looks for a rename while it holds the
    /// lock of the old file, so none writes there after another one has left it.
    fn lock(&mut self, path: &Path) -> io::Result<()> {
        loop {
            self.file.lock()?;
            let next = self.successor(path);
            if !matches!(next, Ok(None)) {
                self.file.unlock()?;
            }
            match next? {
                Some(file) => {
                    self.follows = (self.file.metadata()?.nlink() > 0).then(|| self.tip.hash.clone());
                    (self.file, self.len) = (file, 0);
                }
                None => return Ok(()),
            }
        }
    }

    /// The file at `path` when it is another than the one open, whose end is taken in first.
    fn successor(&mut self, path: &Path) -> io::Result<Option<File>> {
        let open = self.file.metadata()?;
        match fs::metadata(path) {
            Ok(there) if (there.dev(), there.ino()) == (open.dev(), open.ino()) => return Ok(None),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        self.settle()?;
        open_file(path).map(Some)
    }

    /// Takes in what others appended and mends a torn end. A file that became shorter, which no
    /// writer does, leaves the tip as it was: the next line then shows that some are missing.
    fn settle(&mut self) -> io::Result<()> {
        let len = self.file.metadata()?.len();
        if len == self.len {
            return Ok(());
        }
        let end = read_end(&self.file, len)?;
        if let Some(tip) = end.tip
            && len > self.len
        {
            self.tip = tip;
        }
        if end.is_torn {
            let lead = if end.is_ended { "" } else { "\n" };
            return self.put(len, lead, &RECOVERY);
        }
        self.len = len;
        Ok(())
    }

    /// Writes a line at `len`, the end of the file; a part of one is taken back.
    fn put(&mut self, len: u64, lead: &str, entry: &Entry<'_>) -> io::Result<()> {
        let seq = self.tip.seq.saturating_add(1);
        let line = serde_json::to_string(&Line {
            seq,
            at: format!("{:.3}", Timestamp::now()),
            tenant: entry.tenant,
            token: entry.token,
            action: entry.action,
            job: entry.job,
            outcome: entry.outcome,
            trace_id: entry.trace_id,
            prev: &self.tip.hash,
            after: (entry.action == Action::Recovered).then_some(&self.tip.entry_hash),
        })?;
        if line.len() >= MAX_LINE {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "the audit entry is too long"));
        }
        let bytes = format!("{lead}{line}\n");
        if let Err(error) = self.file.write_all(bytes.as_bytes()) {
            // Should this fail too, the next append finds a torn line and mends it.
            let _ = self.file.set_len(len);
            return Err(error);
        }
        let hash = hex(&Sha256::digest(&line));
        self.tip = Tip { seq, entry_hash: hash.clone(), hash };
        self.len = len + bytes.len() as u64;
        Ok(())
    }
}

impl Mark {
    /// No entry.
    #[must_use]
    pub fn none() -> Self {
        Self { seq: 0, hash: NO_HASH.to_owned() }
    }
}

/// The first entry of a file; `None` when it has none, or begins with something else.
fn first_link(file: &File, len: u64) -> io::Result<Option<Link>> {
    let mut reader = file;
    reader.seek(SeekFrom::Start(0))?;
    Ok(next_line(&mut BufReader::new(reader.take(len)))?.and_then(|line| line.link()))
}

/// Whether a file beside the log, whose name begins with its own, ends with the line of this hash. Packed ones cannot be read.
fn ends_beside(path: &Path, hash: &str) -> io::Result<bool> {
    let (Some(folder), Some(name)) = (folder_of(path), path.file_name()) else { return Ok(false) };
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let other = entry.file_name();
        let is_beside = other != name && other.as_encoded_bytes().starts_with(name.as_encoded_bytes());
        if !is_beside || !entry.file_type()?.is_file() {
            continue;
        }
        let file = File::open(entry.path())?;
        let len = file.metadata()?.len();
        if read_end(&file, len)?.tip.is_some_and(|tip| tip.hash == hash) {
            return Ok(true);
        }
    }
    Ok(false)
}

const RECOVERY: Entry<'static> =
    Entry { tenant: None, token: None, action: Action::Recovered, job: None, outcome: "torn_line", trace_id: None };

fn open_file(path: &Path) -> io::Result<File> {
    if let Some(folder) = folder_of(path) {
        DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    }
    OpenOptions::new().read(true).append(true).create(true).mode(0o600).open(path)
}

fn folder_of(path: &Path) -> Option<&Path> {
    let folder = path.parent()?;
    Some(if folder.as_os_str().is_empty() { Path::new(".") } else { folder })
}

/// How a file ends.
struct End {
    /// Nothing when the file is empty.
    tip: Option<Tip>,
    /// Whether its last line is no entry, or has no newline.
    is_torn: bool,
    /// Whether its last line has a newline.
    is_ended: bool,
}

/// Reads from the end back to the last entry.
fn read_end(file: &File, len: u64) -> io::Result<End> {
    let mut end = End { tip: None, is_torn: false, is_ended: true };
    let mut torn = 0;
    let mut at = len;
    while at > 0 {
        let start = line_start(file, at)?;
        let mut reader = file;
        reader.seek(SeekFrom::Start(start))?;
        let Some(line) = next_line(&mut BufReader::new(reader.take(at - start)))? else { break };
        let link = line.link();
        if at == len {
            end.is_ended = line.is_ended;
            end.is_torn = link.is_none() || !line.is_ended;
        }
        let tip = end.tip.get_or_insert_with(|| Tip { hash: line.hash.clone(), ..Tip::default() });
        if let Some(link) = link {
            tip.seq = link.seq;
            tip.entry_hash = line.hash;
            break;
        }
        torn += 1;
        at = start;
    }
    if let Some(tip) = &mut end.tip {
        tip.seq = tip.seq.saturating_add(torn);
    }
    Ok(end)
}

/// Where the line begins that ends at `end`, its newline included.
fn line_start(file: &File, end: u64) -> io::Result<u64> {
    let mut block = [0; MAX_LINE];
    let mut at = end.saturating_sub(1);
    while at > 0 {
        let size = block.len().min(usize::try_from(at).unwrap_or(usize::MAX));
        at -= size as u64;
        file.read_exact_at(&mut block[..size], at)?;
        if let Some(newline) = block[..size].iter().rposition(|&byte| byte == b'\n') {
            return Ok(at + newline as u64 + 1);
        }
    }
    Ok(0)
}

/// A line of the file, which may be anything.
struct RawLine {
    /// Its first bytes: all of them when it is an entry.
    head: Vec<u8>,
    /// Over all of its bytes but the newline.
    hash: String,
    /// Whether it has a newline.
    is_ended: bool,
}

impl RawLine {
    fn link(&self) -> Option<Link> {
        serde_json::from_slice(&self.head).ok()
    }
}

/// Reads a line in bounded memory: a power loss may leave many zeros without a newline.
fn next_line(reader: &mut impl BufRead) -> io::Result<Option<RawLine>> {
    let (mut head, mut hash) = (Vec::new(), Sha256::new());
    let mut is_ended = false;
    let mut is_empty = true;
    while !is_ended {
        let block = reader.fill_buf()?;
        if block.is_empty() {
            break;
        }
        let newline = block.iter().position(|&byte| byte == b'\n');
        let part = &block[..newline.unwrap_or(block.len())];
        hash.update(part);
        head.extend_from_slice(&part[..part.len().min(MAX_LINE - head.len())]);
        let used = part.len() + usize::from(newline.is_some());
        reader.consume(used);
        is_ended = newline.is_some();
        is_empty = false;
    }
    Ok((!is_empty).then(|| RawLine { head, hash: hex(&hash.finalize()), is_ended }))
}

/// What a file holds whose chain is whole.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Entries.
    pub entries: u64,
    /// Lines that a power loss tore, each of them followed by a recovery.
    pub torn: u64,
    /// Number of the first entry; 0 when there is none.
    pub first_seq: u64,
    /// Number of the last entry; 0 when there is none.
    pub last_seq: u64,
    /// What the file says of the one before it, when it goes on from a rotated one: that file's
    /// `last_hash`.
    pub begins_with: Option<String>,
    /// Hash of the last line; zeros when there is none.
    pub last_hash: String,
}

/// What is wrong with a log, and in which line, counted from 1.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// It cannot be read.
    #[error("the audit log cannot be read: {0}")]
    Io(#[from] io::Error),
    /// A line is no entry, and no recovery follows.
    #[error("line {line} is not an audit entry")]
    NotAnEntry {
        /// Which.
        line: u64,
    },
    /// Lines are missing, or not in order.
    #[error("line {line} has the number {found} instead of {expected}")]
    Gap {
        /// Which.
        line: u64,
        /// The number that follows from the line before.
        expected: u64,
        /// Its number.
        found: u64,
    },
    /// A line does not go on from the one before: that one was changed, or this one put there.
    #[error("line {line} does not hold the hash of the line before it")]
    BrokenChain {
        /// Which.
        line: u64,
    },
    /// It is not the log that is remembered: something of it is missing.
    #[error("this is not the log that was written: {0}")]
    NotTheKnown(String),
    /// The last line has no newline. Opening the log mends that.
    #[error("line {line}, the last, is torn")]
    TornEnd {
        /// Which.
        line: u64,
    },
}

/// Reads a log and follows its chain, up to where the file ends at the moment of the call; nobody
/// has to stop writing.
///
/// # Errors
/// As [`AuditError`], for the first line where the chain does not hold.
pub fn verify(path: &Path) -> Result<Verified, AuditError> {
    verify_with(path, 0).map(|(verified, _)| verified)
}

/// The same, with the hash of the entry of this number, if it is there.
///
/// # Errors
/// As [`verify`].
pub fn verify_with(path: &Path, wanted: u64) -> Result<(Verified, Option<String>), AuditError> {
    let file = File::open(path)?;
    file.lock_shared()?;
    let len = file.metadata().map(|facts| facts.len());
    file.unlock()?;
    let mut reader = BufReader::new(file.take(len?));
    let mut walk = Walk { wanted, ..Walk::default() };
    while let Some(line) = next_line(&mut reader)? {
        walk.take(line)?;
    }
    let found = walk.found.take();
    Ok((walk.finish()?, found))
}

/// Where a log begins and ends that was verified.
///
/// # Errors
/// When the files beside it cannot be read.
pub fn ends_of(path: &Path, verified: &Verified) -> io::Result<Ends> {
    let head = match &verified.begins_with {
        Some(hash) => Mark { seq: verified.first_seq.saturating_sub(1), hash: hash.clone() },
        None => Mark::none(),
    };
    let tip = Mark { seq: verified.last_seq, hash: verified.last_hash.clone() };
    let is_continued = ends_beside(path, &head.hash)?;
    Ok(Ends { head, tip, is_continued })
}

/// A chain, followed up to some line.
#[derive(Default)]
struct Walk {
    line: u64,
    tip: Tip,
    /// Lines since the last entry.
    torn: u64,
    seen: Verified,
    /// Number of an entry whose hash is looked for.
    wanted: u64,
    found: Option<String>,
}

impl Walk {
    fn take(&mut self, line: RawLine) -> Result<(), AuditError> {
        self.line += 1;
        if !line.is_ended {
            return Err(AuditError::TornEnd { line: self.line });
        }
        match line.link() {
            Some(link) => self.take_entry(link, &line.hash)?,
            None => {
                self.torn += 1;
                self.tip.seq = self.tip.seq.saturating_add(1);
            }
        }
        self.tip.hash = line.hash;
        Ok(())
    }

    fn take_entry(&mut self, link: Link, hash: &str) -> Result<(), AuditError> {
        let is_recovery = link.action == RECOVERED;
        if self.torn > 0 && !is_recovery {
            return Err(AuditError::NotAnEntry { line: self.line - self.torn });
        }
        if self.line == 1 && link.seq > 1 {
            self.seen.begins_with = Some(link.prev);
        } else {
            self.check_link(&link, is_recovery)?;
        }
        if self.seen.entries == 0 {
            self.seen.first_seq = link.seq;
        }
        self.seen.entries += 1;
        self.seen.torn += std::mem::take(&mut self.torn);
        self.seen.last_seq = link.seq;
        self.tip.seq = link.seq;
        hash.clone_into(&mut self.tip.entry_hash);
        if link.seq == self.wanted {
            self.found = Some(hash.to_owned());
        }
        Ok(())
    }

    fn check_link(&self, link: &Link, is_recovery: bool) -> Result<(), AuditError> {
        let expected = self.tip.seq.saturating_add(1);
        if link.seq != expected {
            return Err(AuditError::Gap { line: self.line, expected, found: link.seq });
        }
        let is_after = !is_recovery || link.after.as_ref() == Some(&self.tip.entry_hash);
        if link.prev != self.tip.hash || !is_after {
            return Err(AuditError::BrokenChain { line: self.line });
        }
        Ok(())
    }

    fn finish(self) -> Result<Verified, AuditError> {
        if self.torn > 0 {
            return Err(AuditError::NotAnEntry { line: self.line + 1 - self.torn });
        }
        Ok(Verified { last_hash: self.tip.hash, ..self.seen })
    }
}
