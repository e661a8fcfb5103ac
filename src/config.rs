//! What can be set about the service, with the values it has when nothing is set.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::thread::available_parallelism;
use std::time::Duration;

use crate::jobs::process::InputLimits;
use crate::jobs::queue::JobLimits;
use crate::jobs::upload::UploadLimits;

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
}

impl Default for ServeConfig {
    fn default() -> Self {
        Self {
            listen: (Ipv4Addr::LOCALHOST, 8080).into(),
            data_dir: PathBuf::from("data"),
            workers: default_workers(),
            drain: Duration::from_secs(30),
            jobs: JobLimits {
                max_queued: 1000,
                upload: UploadLimits {
                    max_bytes: 512 << 20,
                    idle: Duration::from_secs(30),
                    total: Duration::from_secs(900),
                },
                input: InputLimits::default(),
            },
            connections: ConnectionLimits::default(),
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
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self { max_connections: 2048, header_read: Duration::from_secs(15), buffer_bytes: 64 << 10 }
    }
}

/// One worker per core.
#[must_use]
pub fn default_workers() -> usize {
    available_parallelism().map_or(1, usize::from)
}
