//! `medialrep serve`: the service.

use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use clap::ValueEnum;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tracing_subscriber::EnvFilter;

use super::exit;
use crate::config::{ServeConfig, default_workers};
use crate::http::server;
use crate::jobs::process::{InputLimits, process};
use crate::jobs::queue::JobLimits;
use crate::jobs::upload::UploadLimits;
use crate::jobs::worker::Processor;

/// Arguments of `medialrep serve`. Each can be given as an environment variable instead.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {
    /// Where to listen.
    #[arg(long, env = "MEDIALREP_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDRESS:PORT")]
    listen: SocketAddr,

    /// Listen beyond the loopback though anybody who reaches the port can read and delete all jobs. Only behind
    /// something that keeps strangers out: a container's own network, a proxy that asks who is there.
    #[arg(long, env = "MEDIALREP_ALLOW_UNAUTHENTICATED")]
    allow_unauthenticated: bool,

    /// Where jobs, masks and results are kept.
    #[arg(long, env = "MEDIALREP_DATA_DIR", default_value = "data", value_name = "DIR")]
    data_dir: PathBuf,

    /// Jobs run at the same time [default: the cores].
    #[arg(long, env = "MEDIALREP_WORKERS", value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=1024))]
    workers: Option<u16>,

    /// Jobs that may wait; more are answered with 503.
    #[arg(long, env = "MEDIALREP_MAX_QUEUED", default_value_t = 1000, value_name = "COUNT")]
    max_queued: u64,

    /// Largest upload, MiB as sent.
    #[arg(long, env = "MEDIALREP_MAX_UPLOAD_MIB", default_value_t = 512, value_name = "MIB",
          value_parser = clap::value_parser!(u64).range(1..=65536))]
    max_upload_mib: u64,

    /// Largest volume, voxels.
    #[arg(long, env = "MEDIALREP_MAX_VOXELS", default_value_t = InputLimits::default().max_voxels, value_name = "COUNT")]
    max_voxels: u64,

    /// How long running jobs may take to end when the service is told to stop; then they go back to the queue.
    #[arg(long, env = "MEDIALREP_DRAIN_SECONDS", default_value_t = 30, value_name = "SECONDS")]
    drain_seconds: u64,

    /// How the log is written. What is logged is set by RUST_LOG [default: info].
    #[arg(long, env = "MEDIALREP_LOG_FORMAT", default_value = "text", value_name = "FORMAT")]
    log_format: LogFormat,
}

/// How the log is written, to stderr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LogFormat {
    /// A line of text per event.
    Text,
    /// A JSON object per event.
    Json,
}

impl ServeArgs {
    /// The same, checked by type, with the program's own values for what is not set.
    fn config(&self) -> ServeConfig {
        let defaults = ServeConfig::default();
        ServeConfig {
            listen: self.listen,
            data_dir: self.data_dir.clone(),
            workers: self.workers.map_or_else(default_workers, usize::from),
            drain: Duration::from_secs(self.drain_seconds),
            jobs: JobLimits {
                max_queued: self.max_queued,
                upload: UploadLimits { max_bytes: self.max_upload_mib << 20, ..defaults.jobs.upload },
                input: InputLimits { max_voxels: self.max_voxels, ..defaults.jobs.input },
            },
            connections: defaults.connections,
        }
    }
}

/// Runs the service until SIGTERM or SIGINT.
///
/// # Errors
/// When the port or the data directory cannot be used.
#[expect(clippy::print_stderr, reason = "wrong usage is told before there is a log")]
pub fn serve(args: &ServeArgs) -> anyhow::Result<ExitCode> {
    if !args.listen.ip().is_loopback() && !args.allow_unauthenticated {
        eprintln!(
            "error: {} can be reached from other machines, and this service does not ask who is there\n\
             hint: listen on 127.0.0.1, or say --allow-unauthenticated where something else keeps strangers out",
            args.listen
        );
        return Ok(ExitCode::from(exit::USAGE));
    }
    start_log(args.log_format);
    let runtime = tokio::runtime::Runtime::new().context("the runtime cannot start")?;
    let served = runtime.block_on(listen(&args.config()));
    // A run that did not stop in time is in the queue again; nobody waits for its thread.
    runtime.shutdown_background();
    served.map(|()| ExitCode::SUCCESS)
}

async fn listen(config: &ServeConfig) -> anyhow::Result<()> {
    let stop = stop_signal().context("signals cannot be heard")?;
    let listener =
        TcpListener::bind(config.listen).await.with_context(|| format!("cannot listen on {}", config.listen))?;
    let address = listener.local_addr()?;
    tracing::info!(%address, workers = config.workers, "listening");
    let processor: Processor = Arc::new(process);
    server::run(listener, config, &processor, stop)
        .await
        .with_context(|| format!("data directory {}", config.data_dir.display()))
}

/// Ready once somebody wants the process to end. Listens from the call on, so that a signal
/// during the start is not lost.
fn stop_signal() -> std::io::Result<impl Future<Output = ()>> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

fn start_log(format: LogFormat) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    match format {
        LogFormat::Text => log.with_ansi(std::io::stderr().is_terminal()).init(),
        LogFormat::Json => log.json().flatten_event(true).init(),
    }
    // A panic's message may quote the file it choked on: its place is enough.
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string);
        tracing::error!(place, "panic");
    }));
}
