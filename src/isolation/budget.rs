//! What a run may take: memory and processor time.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::cancel::{Cancel, Cancelled};
use crate::formats::HeaderFacts;

/// Share of the machine's memory, or of the group of processes that this one is in, that runs may take together when nothing
/// is said: the rest is the server's own and the system's, whose cache of files makes results fast.
const MEMORY_SHARE: f64 = 0.7;
/// Memory that is taken for that of the machine where it cannot be found out.
const UNKNOWN_MACHINE_BYTES: u64 = 4 << 30;
/// Memory that a run gets at first, beside that for its volume: whole torsos of 59 labels at 3 mm take 190 MiB, a whole brain
/// 116 MiB, single organs up to 40 MiB. One that needs more runs again with all that there is.
const FIRST_SHARE_BYTES: u64 = 256 << 20;
/// Bytes for each voxel of a volume: a brain of 37 million takes 3.
const BYTES_PER_VOXEL: u64 = 4;

/// Memory that a run gets at first.
#[must_use]
pub fn first_share(header: &HeaderFacts) -> u64 {
    FIRST_SHARE_BYTES + header.voxels.saturating_mul(BYTES_PER_VOXEL)
}

/// Memory for all runs together when nothing is said.
#[must_use]
pub fn default_memory_bytes() -> u64 {
    let limits = [machine_bytes(), group_bytes()];
    let least = limits.into_iter().flatten().min().unwrap_or(UNKNOWN_MACHINE_BYTES);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a count")]
    let share = (least as f64 * MEMORY_SHARE) as u64;
    share
}

/// The machine's memory.
fn machine_bytes() -> Option<u64> {
    let told = std::fs::read_to_string("/proc/meminfo").ok()?;
    kilobytes(&told, "MemTotal:").map(|kilobytes| kilobytes << 10)
}

/// The memory of the group of processes that this one is in (a container), where one is set: of the group or one above it.
fn group_bytes() -> Option<u64> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let mut least: Option<u64> = None;
    for line in groups.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, path) = (fields.next()?, fields.next()?);
        let (root, file) = match controllers {
            "" => ("/sys/fs/cgroup", "memory.max"),
            "memory" => ("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
            _ => continue,
        };
        let mut path = path;
        loop {
            let told = std::fs::read_to_string(format!("{root}{}/{file}", path.trim_end_matches('/')));
            if let Some(bytes) = told.ok().and_then(|told| told.trim().parse().ok()) {
                least = Some(least.map_or(bytes, |least| least.min(bytes)));
            }
            match path.rsplit_once('/') {
                Some((above, last)) if !last.is_empty() => path = above,
                _ => break,
            }
        }
    }
    least
}

/// A field of a file of the system that counts kilobytes.
pub(super) fn kilobytes(told: &str, field: &str) -> Option<u64> {
    told.lines().find_map(|line| line.strip_prefix(field))?.trim().trim_end_matches("kB").trim().parse().ok()
}

/// The memory that all runs have together. Who asks for a share waits until it is there; those who wait are served in the order in
/// which they came, so that one that needs much gets it.
#[derive(Debug)]
pub(super) struct Memory {
    bytes: u64,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug)]
struct State {
    free: u64,
    waiting: VecDeque<u64>,
    next: u64,
}

/// A share, given back when it is dropped.
#[derive(Debug)]
pub(super) struct Share<'a> {
    memory: &'a Memory,
    pub bytes: u64,
}

impl Memory {
    pub fn of(bytes: u64) -> Self {
        let state = State { free: bytes, waiting: VecDeque::new(), next: 0 };
        Self { bytes, state: Mutex::new(state), changed: Condvar::new() }
    }

    /// All that there is.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A share, or all that there is where it asks for more.
    ///
    /// # Errors
    /// When it is cancelled while it waits.
    pub fn take(&self, bytes: u64, cancel: &dyn Cancel) -> Result<Share<'_>, Cancelled> {
        /// How often one who waits looks whether it is to stop.
        const LOOK: Duration = Duration::from_millis(100);
        let bytes = bytes.min(self.bytes);
        let mut state = self.state();
        let own = state.next;
        state.next += 1;
        state.waiting.push_back(own);
        while state.waiting.front() != Some(&own) || state.free < bytes {
            if let Err(stop) = cancel.check() {
                state.waiting.retain(|other| *other != own);
                self.changed.notify_all();
                return Err(stop);
            }
            state = self.changed.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
        state.waiting.pop_front();
        state.free -= bytes;
        self.changed.notify_all();
        Ok(Share { memory: self, bytes })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Nothing panics while it is held.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.memory.state().free += self.bytes;
        self.memory.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread::{scope, sleep};

    use super::*;
    use crate::cancel::{Never, Stopped};

    #[test]
    fn who_needs_much_is_served_before_those_who_came_later() {
        let memory = Memory::of(100);
        let first = memory.take(60, &Never).unwrap();
        let (is_large_served, is_small_served) = (AtomicBool::new(false), AtomicBool::new(false));
        scope(|scope| {
            scope.spawn(|| {
                let _all = memory.take(1000, &Never).unwrap();
                assert!(!is_small_served.load(Ordering::SeqCst));
                is_large_served.store(true, Ordering::SeqCst);
            });
            while memory.state().waiting.is_empty() {
                sleep(Duration::from_millis(1));
            }
            scope.spawn(|| {
                let _small = memory.take(10, &Never).unwrap();
                assert!(is_large_served.load(Ordering::SeqCst));
                is_small_served.store(true, Ordering::SeqCst);
            });
            while memory.state().waiting.len() < 2 {
                sleep(Duration::from_millis(1));
            }
            drop(first);
        });
        assert_eq!(memory.state().free, 100);
    }

    #[test]
    fn who_stops_waiting_holds_nobody_up() {
        let memory = Memory::of(100);
        let held = memory.take(100, &Never).unwrap();
        assert!(memory.take(10, &Stopped).is_err());
        drop(held);
        assert_eq!(memory.take(100, &Never).unwrap().bytes, 100);
    }

    #[test]
    fn some_memory_is_found() {
        assert!(default_memory_bytes() > 64 << 20);
        assert_eq!(kilobytes("VmRSS:\t  12 kB\nVmData:\t 34 kB\n", "VmData:"), Some(34));
    }
}
