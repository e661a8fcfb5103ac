//! `medialrep serve`: the service.

use std::fs;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use clap::ValueEnum;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use tracing_subscriber::EnvFilter;

use super::exit;
use super::pacs::PacsArgs;
use crate::config::{ConnectionLimits, ServeConfig, default_workers};
use crate::http::server;
use crate::isolation::{Isolation, IsolationLimits};
use crate::jobs::limits::{JobLimits, Retention};
use crate::jobs::process::{InputLimits, Kept};
use crate::jobs::store::QueueLimits;
use crate::jobs::upload::UploadLimits;
use crate::jobs::worker::Processor;
use crate::webhook::{Secret, Targets, WebhookConfig};

/// Arguments of `medialrep serve`. Each can be given as an environment variable instead.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {
    /// Where to listen. Beyond the loopback only once there is a token: see medialrep token.
    #[arg(long, env = "MEDIALREP_LISTEN", default_value = "127.0.0.1:8080", value_name = "ADDRESS:PORT")]
    pub(super) listen: SocketAddr,

    /// Listen beyond the loopback though there is no token, and anybody who reaches the port can read and delete all
    /// jobs. Only behind something that keeps strangers out: a container's own network, a proxy that asks who is there.
    #[arg(long, env = "MEDIALREP_ALLOW_UNAUTHENTICATED")]
    pub(super) allow_unauthenticated: bool,

    /// Where jobs, masks and results are kept. Several servers on one machine may share it.
    #[arg(long, env = "MEDIALREP_DATA_DIR", default_value = "data", value_name = "DIR")]
    pub(super) data_dir: PathBuf,

    /// Jobs run at the same time [default: the cores].
    #[arg(long, env = "MEDIALREP_WORKERS", value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..=1024))]
    workers: Option<u16>,

    #[allow(rustdoc::bare_urls, reason = "the same text is that of --help")]
    /// Origins whose web pages may use the service, separated by commas: https://viewer.example.org
    #[arg(long, env = "MEDIALREP_CORS_ORIGINS", value_delimiter = ',', value_name = "ORIGINS", value_parser = origin)]
    cors_origins: Vec<String>,

    #[command(flatten)]
    limits: LimitArgs,

    #[command(flatten)]
    retention: RetentionArgs,

    #[command(flatten)]
    webhooks: WebhookArgs,

    #[command(flatten)]
    pacs: PacsArgs,

    /// How long running jobs may take to end when the service is told to stop; then they go back to the queue.
    #[arg(long, env = "MEDIALREP_DRAIN_SECONDS", default_value_t = 20, value_name = "SECONDS")]
    drain_seconds: u64,

    /// How the log is written. What is logged is set by RUST_LOG [default: info].
    #[arg(long, env = "MEDIALREP_LOG_FORMAT", default_value = "text", value_name = "FORMAT")]
    log_format: LogFormat,
}

/// What is taken in.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Limits")]
struct LimitArgs {
    /// Jobs that may wait; more are answered with 503.
    #[arg(long, env = "MEDIALREP_MAX_QUEUED", default_value_t = 1000, value_name = "COUNT")]
    max_queued: u64,

    /// Masks that may wait, MiB together; more are answered with 503.
    #[arg(long, env = "MEDIALREP_MAX_QUEUED_MIB", default_value_t = 8192, value_name = "MIB")]
    max_queued_mib: u64,

    /// How much of the queue one tenant may fill; more is answered with 429. 100 without tokens.
    #[arg(long, env = "MEDIALREP_TENANT_SHARE_PERCENT", default_value_t = 50, value_name = "PERCENT",
          value_parser = clap::value_parser!(u8).range(1..=100))]
    tenant_share_percent: u8,

    /// How much of the disk the masks and results of one tenant may take; more is answered with 507. 100 without tokens. Results
    /// that are used again count once more.
    #[arg(long, env = "MEDIALREP_TENANT_STORAGE_PERCENT", default_value_t = 50, value_name = "PERCENT",
          value_parser = clap::value_parser!(u8).range(1..=100))]
    tenant_storage_percent: u8,

    /// Requests that one tenant may have open at the same time, waiting ones included.
    #[arg(long, env = "MEDIALREP_MAX_OPEN_REQUESTS", default_value_t = 512, value_name = "COUNT")]
    max_open_requests: usize,

    /// Connections that may be open at the same time.
    #[arg(long, env = "MEDIALREP_MAX_CONNECTIONS", default_value_t = 4096, value_name = "COUNT")]
    max_connections: usize,

    /// Largest upload, MiB as sent.
    #[arg(long, env = "MEDIALREP_MAX_UPLOAD_MIB", default_value_t = 512, value_name = "MIB",
          value_parser = clap::value_parser!(u64).range(1..=65536))]
    max_upload_mib: u64,

    /// Longest silence during an upload, seconds; then it is refused.
    #[arg(long, env = "MEDIALREP_UPLOAD_IDLE_SECONDS", default_value_t = 30, value_name = "SECONDS")]
    upload_idle_seconds: u64,

    /// Longest upload, seconds.
    #[arg(long, env = "MEDIALREP_UPLOAD_SECONDS", default_value_t = 900, value_name = "SECONDS")]
    upload_seconds: u64,

    /// Slowest upload, bytes a second, told from its first ten seconds on: who drips holds a place for no longer.
    #[arg(long, env = "MEDIALREP_UPLOAD_BYTES_PER_SECOND", default_value_t = 1024, value_name = "COUNT")]
    upload_bytes_per_second: u64,

    /// Longest time for the headers of a request, and for silence between two, seconds; then the connection is closed.
    #[arg(long, env = "MEDIALREP_HEADER_SECONDS", default_value_t = 15, value_name = "SECONDS")]
    header_seconds: u64,

    /// Largest volume, voxels.
    #[arg(long, env = "MEDIALREP_MAX_VOXELS", default_value_t = InputLimits::default().max_voxels, value_name = "COUNT")]
    max_voxels: u64,

    /// Memory for all runs together, MiB. A run waits for its share; one that needs more than all is refused [default: 70 % of the
    /// machine's, or of the container's]
    #[arg(long, env = "MEDIALREP_MEMORY", value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..=16_777_216))]
    memory: Option<u64>,

    /// Longest run of a job; then it fails.
    #[arg(long, env = "MEDIALREP_MAX_RUN_SECONDS", default_value_t = 1800, value_name = "SECONDS")]
    max_run_seconds: u64,

    /// Room to be left on the disk, MiB; below it masks are answered with 507.
    #[arg(long, env = "MEDIALREP_MIN_FREE_MIB", default_value_t = 512, value_name = "MIB")]
    min_free_mib: u64,
}

/// How long what is kept after the end of a job: 0, 90s, 12h, 30days, or forever.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Retention")]
struct RetentionArgs {
    /// Jobs, with all that is left of them.
    #[arg(long, env = "MEDIALREP_KEEP_JOBS", default_value = "30days", value_name = "TIME")]
    keep_jobs: Keep,

    /// Masks; 0 erases a mask as soon as its job has ended.
    #[arg(long, env = "MEDIALREP_KEEP_MASKS", default_value = "1day", value_name = "TIME")]
    keep_masks: Keep,

    /// Results.
    #[arg(long, env = "MEDIALREP_KEEP_RESULTS", default_value = "7days", value_name = "TIME")]
    keep_results: Keep,
}

/// Where webhooks may go.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Webhooks")]
struct WebhookArgs {
    /// Beginnings of URLs that webhooks may be sent to, separated by commas: https://pacs.example.org/hooks/
    #[arg(long, env = "MEDIALREP_WEBHOOK_TARGETS", value_delimiter = ',', value_name = "URLS")]
    webhook_targets: Vec<String>,

    /// Private networks that webhooks may be sent into, separated by commas: 10.20.0.0/16
    #[arg(long, env = "MEDIALREP_WEBHOOK_NETWORKS", value_delimiter = ',', value_name = "NETWORKS")]
    webhook_networks: Vec<String>,

    /// File with the secret that webhooks are signed with: whsec_ and 24 to 64 bytes in base64.
    #[arg(long, env = "MEDIALREP_WEBHOOK_SECRET_FILE", value_name = "FILE")]
    webhook_secret_file: Option<PathBuf>,

    /// File with certificates (PEM) that are trusted beside the public ones: those of the hospital.
    #[arg(long, env = "MEDIALREP_WEBHOOK_CA_FILE", value_name = "FILE")]
    webhook_ca_file: Option<PathBuf>,
}

/// A time to keep something; `None` is for ever.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Keep(Option<Duration>);

impl FromStr for Keep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "forever" => Ok(Self(None)),
            "0" => Ok(Self(Some(Duration::ZERO))),
            _ => humantime::parse_duration(text)
                .map(|time| Self(Some(time)))
                .map_err(|_| "write 0, forever, or a number with a unit: 90s, 12h, 30days".to_owned()),
        }
    }
}

fn origin(text: &str) -> Result<String, String> {
    let is_bare = |authority: &str| !authority.is_empty() && !authority.contains(['/', '?', '#', '@', ' ', '*']);
    match text.split_once("://") {
        Some(("http" | "https", authority)) if is_bare(authority) => Ok(text.to_ascii_lowercase()),
        _ => Err("an origin is a scheme and a host, without a path: https://viewer.example.org".to_owned()),
    }
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
    /// The same, checked, with the program's own values for what is not set.
    ///
    /// # Errors
    /// When a value contradicts another or a file cannot be read.
    pub(super) fn config(&self) -> anyhow::Result<ServeConfig> {
        let (defaults, limits, keep) = (ServeConfig::default(), &self.limits, &self.retention);
        let mib = |count: u64| count.saturating_mul(1 << 20);
        Ok(ServeConfig {
            listen: self.listen,
            data_dir: self.data_dir.clone(),
            workers: self.workers.map_or_else(default_workers, usize::from),
            drain: Duration::from_secs(self.drain_seconds),
            jobs: JobLimits {
                queue: QueueLimits {
                    jobs: limits.max_queued,
                    bytes: mib(limits.max_queued_mib),
                    share_percent: limits.tenant_share_percent,
                    ..defaults.jobs.queue
                },
                min_free_bytes: mib(limits.min_free_mib),
                storage_percent: limits.tenant_storage_percent,
                max_requests: limits.max_open_requests,
                max_run: Duration::from_secs(limits.max_run_seconds),
                run_memory_bytes: limits.memory.map_or(defaults.jobs.run_memory_bytes, mib),
                run_cpu: defaults.jobs.run_cpu,
                upload: UploadLimits {
                    max_bytes: mib(limits.max_upload_mib),
                    idle: Duration::from_secs(limits.upload_idle_seconds),
                    total: Duration::from_secs(limits.upload_seconds),
                    bytes_per_second: limits.upload_bytes_per_second,
                },
                input: InputLimits { max_voxels: limits.max_voxels, ..defaults.jobs.input },
                keep: Retention { jobs: keep.keep_jobs.0, masks: keep.keep_masks.0, results: keep.keep_results.0 },
            },
            connections: ConnectionLimits {
                max_connections: limits.max_connections,
                header_read: Duration::from_secs(limits.header_seconds),
                ..defaults.connections
            },
            cors_origins: self.cors_origins.clone(),
            webhooks: self.webhooks.config()?,
            pacs: self.pacs.config(Duration::from_secs(limits.upload_idle_seconds))?,
        })
    }

    /// What is said when the service would let strangers in.
    pub(super) fn open_to_strangers(&self, has_tokens: bool) -> Option<String> {
        let is_open = !self.listen.ip().is_loopback() && !self.allow_unauthenticated && !has_tokens;
        is_open.then(|| {
            format!(
                "{} can be reached from other machines, and there is no token to ask for\n\
                 hint: make one with medialrep token create, or listen on 127.0.0.1, or say --allow-unauthenticated \
                 where something else keeps strangers out",
                self.listen
            )
        })
    }
}

impl WebhookArgs {
    fn config(&self) -> anyhow::Result<Option<WebhookConfig>> {
        if self.webhook_targets.is_empty() {
            return Ok(None);
        }
        let targets = Targets::parse(&self.webhook_targets, &self.webhook_networks)?;
        let file = self.webhook_secret_file.as_ref().context("webhooks need --webhook-secret-file")?;
        // The secret itself may stand in the place of the file.
        let secret = fs::read_to_string(file).context("cannot read the file of --webhook-secret-file")?;
        let secret: Secret = secret.trim().parse().context("in the file of --webhook-secret-file")?;
        let mut config = WebhookConfig::new(targets, secret);
        if let Some(file) = &self.webhook_ca_file {
            config.extra_roots = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
        }
        Ok(Some(config))
    }
}

/// Runs the service until SIGTERM or SIGINT.
///
/// # Errors
/// When the port or the data directory cannot be used.
pub fn serve(args: &ServeArgs) -> anyhow::Result<ExitCode> {
    let config = match args.config() {
        Ok(config) => config,
        Err(error) => return Ok(wrong_usage(&format!("{error:#}"))),
    };
    let runtime = tokio::runtime::Runtime::new().context("the runtime cannot start")?;
    if !args.listen.ip().is_loopback()
        && let Some(told) = args.open_to_strangers(runtime.block_on(super::token::has_tokens(&args.data_dir))?)
    {
        return Ok(wrong_usage(&told));
    }
    start_log(args.log_format);
    let served = runtime.block_on(listen(&config));
    // A run that did not stop in time is in the queue again; nobody waits for its thread.
    runtime.shutdown_background();
    served.map(|()| ExitCode::SUCCESS)
}

#[expect(clippy::print_stderr, reason = "wrong usage is told before there is a log")]
fn wrong_usage(told: &str) -> ExitCode {
    eprintln!("error: {told}");
    ExitCode::from(exit::USAGE)
}

async fn listen(config: &ServeConfig) -> anyhow::Result<()> {
    let stop = stop_signal().context("signals cannot be heard")?;
    let listener =
        TcpListener::bind(config.listen).await.with_context(|| format!("cannot listen on {}", config.listen))?;
    let address = listener.local_addr()?;
    tracing::info!(%address, workers = config.workers, "listening");
    let JobLimits { run_memory_bytes: memory_bytes, run_cpu: cpu, .. } = config.jobs;
    let isolation = Isolation::new(IsolationLimits { memory_bytes, threads: None, cpu });
    let processor: Processor = Arc::new(move |mask, params, limits, out, observer| {
        isolation.process(mask, params, limits, (out, Kept::Record), observer)
    });
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
        LogFormat::Json => log.json().flatten_event(true).with_current_span(true).with_span_list(false).init(),
    }
    // A panic's message may quote the file it choked on: its place is enough.
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map(ToString::to_string);
        tracing::error!(place, "panic");
    }));
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        serve: ServeArgs,
    }

    #[test]
    fn what_is_not_set_is_as_the_configuration_has_it() {
        let Command { serve } = Command::try_parse_from(["medialrep"]).unwrap();
        assert_eq!(serve.config().unwrap(), ServeConfig::default());
    }

    #[test]
    fn a_secret_in_the_place_of_its_file_is_not_repeated() {
        let target = "https://pacs.example.org/hooks/";
        let arguments = ["medialrep", "--webhook-targets", target, "--webhook-secret-file", "whsec_abc"];
        let Command { serve } = Command::try_parse_from(arguments).unwrap();
        let told = format!("{:#}", serve.config().unwrap_err());
        assert!(told.contains("--webhook-secret-file") && !told.contains("whsec_"), "{told}");
    }
}
