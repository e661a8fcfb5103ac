//! What can be set about the service, with the values it has when nothing is set.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::thread::available_parallelism;
use std::time::Duration;

use crate::dicomweb::PacsConfig;
use crate::isolation::budget::default_memory_bytes;
use crate::jobs::limits::{CpuLimits, JobLimits, Retention};
use crate::jobs::process::InputLimits;
use crate::jobs::store::QueueLimits;
use crate::jobs::upload::UploadLimits;
use crate::webhook::WebhookConfig;

/// The service.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServeConfig {
    /// Where it listens.
    pub listen: SocketAddr,
    /// Where jobs are kept.
    pub data_dir: PathBuf,
    /// Jobs run at the same time.
    pub workers: usize,
    /// How long running jobs may take to end when the service is told to stop.
    pub drain: Duration,
    /// What bounds the jobs.
    pub jobs: JobLimits,
    /// What bounds the connections.
    pub connections: ConnectionLimits,
    /// Origins whose pages may use the service.
    pub cors_origins: Vec<String>,
    /// Where webhooks may go and how they are signed; `None` sends none.
    pub webhooks: Option<WebhookConfig>,
    /// Archives that masks may be fetched from; `None` asks none.
    pub pacs: Option<PacsConfig>,
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: (Ipv4Addr::LOCALHOST, 8080).into(),
            data_dir: PathBuf::from("data"),
            workers: default_workers(),
            drain: Duration::from_secs(20),
            jobs: JobLimits {
                queue: QueueLimits { jobs: 1000, bytes: 8 << 30, share_percent: 50, storage_bytes: u64::MAX },
                storage_percent: 50,
                min_free_bytes: 512 << 20,
                max_requests: 512,
                max_run: Duration::from_secs(1800),
                run_memory_bytes: default_memory_bytes(),
                run_cpu: CpuLimits::default(),
                upload: UploadLimits {
                    max_bytes: 512 << 20,
                    idle: Duration::from_secs(30),
                    total: Duration::from_secs(900),
                    bytes_per_second: 1024,
                },
                input: InputLimits::default(),
                keep: Retention { jobs: days(30), masks: days(1), results: days(7) },
            },
            connections: ConnectionLimits::default(),
            cors_origins: Vec::new(),
            webhooks: None,
            pacs: None,
        }
    }
}

/// What bounds the connections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Connections open at the same time; more wait to be accepted.
    pub max_connections: usize,
    /// Longest time for the headers of a request, and for silence between two.
    pub header_read: Duration,
    /// Bytes of buffered input per connection; bounds the headers too.
    pub buffer_bytes: usize,
    /// Bytes that may have been written to a connection and not been read on the other side; the system makes twice as many of it.
    /// With fewer, distant clients are slower: they get as many in the time of a way there and back. It takes more only once a third
    /// of them is free again, so that the slowest pace is 85 kB in [`Self::write_idle`] whatever is set below that.
    pub unread_bytes: usize,
    /// Time in all in which a client takes nothing of what it is sent, after which it is judged by its pace.
    pub write_idle: Duration,
    /// Slowest pace at which answers are read; who is slower is cut off.
    pub write_bytes_per_second: u64,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            max_connections: 4096,
            header_read: Duration::from_secs(15),
            buffer_bytes: 64 << 10,
            unread_bytes: 128 << 10,
            write_idle: Duration::from_secs(30),
            write_bytes_per_second: 1024,
        }
    }
}

fn days(count: u64) -> Option<Duration> {
    Some(Duration::from_secs(count * 24 * 3600))
}

/// One worker per core.
#[must_use]
pub fn default_workers() -> usize {
    available_parallelism().map_or(1, usize::from)
}
