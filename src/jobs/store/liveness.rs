//! Processes that share a data directory. Each holds a lock on a file of its own as long as it
//! lives; the system frees it with the process, however that ends. So the others know within a
//! second that it is gone, and a server that starts takes up what its dead predecessor left.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::new_token;
use crate::jobs::make_private;

const INSTANCES: &str = "instances";
/// A file that is locked while a process enters, and while one is alone.
const DOOR: &str = ".door";

/// This process, alive as long as this value.
#[derive(Debug)]
pub struct Instance {
    id: String,
    folder: PathBuf,
    /// Held, never read.
    _lock: File,
}

impl Instance {
    /// Says to the others that this process lives; waits while one of them is [`Alone`]. Blocks.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn begin(data_dir: &Path) -> io::Result<Self> {
        let folder = data_dir.join(INSTANCES);
        make_private(&folder)?;
        let door = File::create(folder.join(DOOR))?;
        door.lock_shared()?;
        let id = new_token();
        // Locked before it has its name, so that nobody finds it without its lock.
        let draft = folder.join(format!(".{id}"));
        let lock = File::create(&draft)?;
        lock.lock()?;
        fs::rename(draft, folder.join(&id))?;
        Ok(Self { id, folder, _lock: lock })
    }

    /// Its name, unique for every start.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The other processes.
    #[must_use]
    pub fn peers(&self) -> Peers {
        Peers { own: self.id.clone(), folder: self.folder.clone() }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        self.peers().bury(&self.id);
    }
}

/// The other processes that share the data directory. All that it does blocks.
#[derive(Clone, Debug)]
pub struct Peers {
    own: String,
    folder: PathBuf,
}

impl Peers {
    /// Those that are gone. They stay on this list until [`Self::bury`].
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn dead(&self) -> io::Result<Vec<String>> {
        let mut dead = Vec::new();
        for name in self.others()? {
            if is_free(&self.folder.join(&name))? {
                dead.push(name);
            }
        }
        Ok(dead)
    }

    fn others(&self) -> io::Result<Vec<String>> {
        let mut others = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if name != self.own && !name.starts_with('.') {
                others.push(name);
            }
        }
        Ok(others)
    }

    /// Keeps others out, if there are none: as long as the answer is held, whoever begins waits.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn alone(&self) -> io::Result<Option<Alone>> {
        let door = File::create(self.folder.join(DOOR))?;
        door.lock()?;
        if self.has_company()? {
            return Ok(None);
        }
        self.clear_drafts();
        Ok(Some(Alone { _door: door }))
    }

    /// Removes the files of processes that were gone before these had their names. Others begin behind the door.
    fn clear_drafts(&self) {
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name();
            if name != DOOR && name.as_encoded_bytes().starts_with(b".") {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// Whether another process uses the data directory.
    fn has_company(&self) -> io::Result<bool> {
        Ok(self.others()?.len() > self.dead()?.len())
    }

    /// Forgets one that is gone, once what it left is taken up.
    pub fn bury(&self, dead: &str) {
        // Another process may have done so.
        let _ = fs::remove_file(self.folder.join(dead));
    }
}

/// Nobody else uses the data directory, nor begins to, as long as this value lives.
#[derive(Debug)]
pub struct Alone {
    /// Held, never read.
    _door: File,
}

fn is_free(path: &Path) -> io::Result<bool> {
    let file = match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        file => file?,
    };
    match file.try_lock_shared() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instance_is_dead_once_its_lock_is_free() {
        let dir = tempfile::TempDir::new().expect("a folder");
        let (one, two) = (Instance::begin(dir.path()), Instance::begin(dir.path()));
        let (one, two) = (one.expect("first"), two.expect("second"));
        let peers = one.peers();
        assert!(peers.dead().expect("list").is_empty() && peers.has_company().expect("list"));
        // As after a kill: the lock is free, the file is there.
        let left = dir.path().join(INSTANCES).join("killed");
        File::create(&left).expect("file");
        assert_eq!(peers.dead().expect("list"), ["killed"]);
        peers.bury("killed");
        drop(two);
        assert!(!left.exists() && !peers.has_company().expect("list"));
    }

    #[test]
    fn whoever_begins_waits_for_one_who_is_alone() {
        let dir = tempfile::TempDir::new().expect("a folder");
        let one = Instance::begin(dir.path()).expect("first");
        let alone = one.peers().alone().expect("asked").expect("nobody else is there");
        let (path, (began, has_begun)) = (dir.path().to_owned(), std::sync::mpsc::channel());
        let other = std::thread::spawn(move || {
            let two = Instance::begin(&path).expect("second");
            began.send(()).expect("heard");
            two
        });
        assert!(has_begun.recv_timeout(std::time::Duration::from_millis(200)).is_err(), "it waits");
        drop(alone);
        let two = other.join().expect("it has begun");
        assert!(one.peers().alone().expect("asked").is_none() && two.peers().alone().expect("asked").is_none());
    }
}
