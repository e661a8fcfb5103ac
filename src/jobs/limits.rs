//! What bounds the jobs, and how long what is kept of them.

use std::time::Duration;

use super::process::InputLimits;
use super::store::QueueLimits;
use super::upload::UploadLimits;

/// What bounds the jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobLimits {
    /// What may wait.
    pub queue: QueueLimits,
    /// Room on the disk below which nothing is taken in, bytes.
    pub min_free_bytes: u64,
    /// How much of the disk the files of one tenant may take, percent.
    pub storage_percent: u8,
    /// Requests of one tenant at the same time; who is not known is many.
    pub max_requests: usize,
    /// Longest run of a job.
    pub max_run: Duration,
    /// Memory of all runs together, bytes.
    pub run_memory_bytes: u64,
    /// Processor time of each run.
    pub run_cpu: CpuLimits,
    /// Bounds on an upload.
    pub upload: UploadLimits,
    /// Bounds on what a file may unpack to.
    pub input: InputLimits,
    /// How long what is kept.
    pub keep: Retention,
}

/// How long after the end of a job what is kept of it; `None` is for ever.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// The job itself, and all else of it.
    pub jobs: Option<Duration>,
    /// Its mask.
    pub masks: Option<Duration>,
    /// Its results.
    pub results: Option<Duration>,
}

/// Processor time that a run may take: it follows the size of its file, so that who sends little cannot ask for much.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuLimits {
    /// Whatever the size.
    pub least: Duration,
    /// For each kilobyte of a compressed file. A torso of 59 labels and a vertebra take 0.3 s, single organs 0.1 s and less; as many
    /// times as much with `uncertainty`.
    pub per_kb: Duration,
}

impl Default for CpuLimits {
    fn default() -> Self {
        Self { least: Duration::from_secs(10), per_kb: Duration::from_secs(18) }
    }
}

impl CpuLimits {
    /// Time for a file of so many bytes.
    #[must_use]
    pub fn of(self, bytes: u64, is_compressed: bool) -> Duration {
        self.least + self.per_kb.mul_f64(compressed_bytes(bytes, is_compressed) / 1024.0)
    }
}

/// What a file of so many bytes has, or would have, once it is compressed.
pub(super) fn compressed_bytes(bytes: u64, is_compressed: bool) -> f64 {
    /// How much of a plain file is surface: what gzip leaves of label maps.
    const COMPRESSED_SHARE: f64 = 0.005;
    if is_compressed { bytes as f64 } else { bytes as f64 * COMPRESSED_SHARE }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_follows_the_size_of_the_file() {
        let limits = CpuLimits::default();
        assert_eq!(limits.of(0, true), Duration::from_secs(10));
        assert_eq!(limits.of(2048, true), Duration::from_secs(46));
        assert_eq!(limits.of(2048 * 200, false), Duration::from_secs(46));
    }
}
