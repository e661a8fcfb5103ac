//! What operators alarm on, in the text format of OpenMetrics. Labels are routes, states and codes
//! of ours, never anything a client wrote.

use std::fmt;
use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

/// From a status read to a job of minutes.
const SECONDS: [f64; 12] = [0.001, 0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 60.0, 600.0];

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Request {
    method: &'static str,
    route: String,
    status: u16,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Route {
    route: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Ended {
    state: String,
    code: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct StageLabel {
    stage: &'static str,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct OutcomeLabel {
    outcome: String,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Build {
    version: &'static str,
}

/// A gauge of a number with a fraction.
type Fraction = Gauge<f64, AtomicU64>;

/// How the service is at this moment, looked up when metrics are read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Now {
    /// Jobs that wait.
    pub queued: u64,
    /// Bytes of their masks.
    pub queued_bytes: u64,
    /// How long the job has waited that came first, seconds.
    pub oldest_queued_seconds: f64,
    /// Jobs that run in this process.
    pub running: u64,
    /// Workers of this process.
    pub workers: u64,
    /// Room left on the disk, bytes.
    pub disk_free_bytes: u64,
    /// Room below which nothing is taken in, bytes.
    pub disk_min_free_bytes: u64,
}

/// Counts and times of one process.
pub struct Metrics {
    registry: Registry,
    requests: Family<Request, Counter>,
    request_seconds: Family<Route, Histogram, fn() -> Histogram>,
    accepted: Family<OutcomeLabel, Counter>,
    ended: Family<Ended, Counter>,
    run_seconds: Histogram,
    wait_seconds: Histogram,
    stage_seconds: Family<StageLabel, Histogram, fn() -> Histogram>,
    reclaimed: Counter,
    expired: Family<OutcomeLabel, Counter>,
    callbacks: Family<OutcomeLabel, Counter>,
    deliveries: Family<OutcomeLabel, Counter>,
    audit_failures: Counter,
    damaged: Counter,
    queued: Gauge,
    queued_bytes: Gauge,
    oldest_queued: Fraction,
    running: Gauge,
    workers: Gauge,
    disk_free: Gauge,
    disk_min_free: Gauge,
}

impl Metrics {
    /// All at nought.
    #[must_use]
    pub fn new() -> Self {
        let metrics = Self {
            registry: Registry::with_prefix("medialrep"),
            requests: Family::default(),
            request_seconds: Family::new_with_constructor(seconds),
            accepted: Family::default(),
            ended: Family::default(),
            run_seconds: seconds(),
            wait_seconds: seconds(),
            stage_seconds: Family::new_with_constructor(seconds),
            reclaimed: Counter::default(),
            expired: Family::default(),
            callbacks: Family::default(),
            deliveries: Family::default(),
            audit_failures: Counter::default(),
            damaged: Counter::default(),
            queued: Gauge::default(),
            queued_bytes: Gauge::default(),
            oldest_queued: Fraction::default(),
            running: Gauge::default(),
            workers: Gauge::default(),
            disk_free: Gauge::default(),
            disk_min_free: Gauge::default(),
        };
        metrics.registered()
    }

    fn registered(mut self) -> Self {
        let all = &mut self.registry;
        all.register("http_requests", "Requests answered", self.requests.clone());
        let (requests, runs, waits, stages) = (
            self.request_seconds.clone(),
            self.run_seconds.clone(),
            self.wait_seconds.clone(),
            self.stage_seconds.clone(),
        );
        all.register_with_unit("http_request", "Time to the head of the answer", Unit::Seconds, requests);
        all.register("jobs_accepted", "Jobs accepted: run, or answered from an equal one", self.accepted.clone());
        all.register("jobs_ended", "Jobs ended, by state and by code of the problem", self.ended.clone());
        all.register_with_unit("job_run", "Time of one run", Unit::Seconds, runs);
        all.register_with_unit("job_wait", "Time from acceptance to the first run", Unit::Seconds, waits);
        all.register_with_unit("stage", "Time of a stage, all structures of a job together", Unit::Seconds, stages);
        all.register("jobs_reclaimed", "Jobs taken from workers that were gone", self.reclaimed.clone());
        all.register("expired", "What retention erased", self.expired.clone());
        all.register("webhooks", "Tries at sending a webhook, by outcome", self.callbacks.clone());
        all.register("deliveries", "Tries at storing results in a PACS, by outcome", self.deliveries.clone());
        all.register("audit_failures", "Entries that the audit log lacks", self.audit_failures.clone());
        all.register("damaged_files", "Files that are not what was stored", self.damaged.clone());
        all.register("jobs_queued", "Jobs that wait", self.queued.clone());
        all.register_with_unit("jobs_queued", "Masks of jobs that wait", Unit::Bytes, self.queued_bytes.clone());
        let oldest = "How long the job has waited that came first";
        all.register_with_unit("jobs_queued_oldest", oldest, Unit::Seconds, self.oldest_queued.clone());
        all.register("jobs_running", "Jobs that run in this process", self.running.clone());
        all.register("workers", "Workers alive in this process", self.workers.clone());
        all.register_with_unit("disk_free", "Room left for files", Unit::Bytes, self.disk_free.clone());
        let low = "Room below which nothing is taken in";
        all.register_with_unit("disk_min_free", low, Unit::Bytes, self.disk_min_free.clone());
        let build = Family::<Build, Gauge>::default();
        build.get_or_create(&Build { version: env!("CARGO_PKG_VERSION") }).set(1);
        all.register("build", "This program", build);
        self
    }

    /// A request was answered.
    pub fn request(&self, method: &'static str, route: &str, status: u16, seconds: f64) {
        let route = route.to_owned();
        self.request_seconds.get_or_create(&Route { route: route.clone() }).observe(seconds);
        self.requests.get_or_create(&Request { method, route, status }).inc();
    }

    /// A job was accepted.
    pub fn accepted(&self, is_reused: bool) {
        self.accepted.get_or_create(&outcome(if is_reused { "reused" } else { "queued" })).inc();
    }

    /// A job's first run began after this time.
    pub fn waited(&self, seconds: f64) {
        self.wait_seconds.observe(seconds);
    }

    /// A run took this time, whatever came of it.
    pub fn ran(&self, seconds: f64) {
        self.run_seconds.observe(seconds);
    }

    /// A stage took this time.
    pub fn stage(&self, stage: &'static str, seconds: f64) {
        self.stage_seconds.get_or_create(&StageLabel { stage }).observe(seconds);
    }

    /// A job ended; `code` is that of its problem, or nothing.
    pub fn ended(&self, state: &str, code: &str) {
        self.ended.get_or_create(&Ended { state: state.to_owned(), code: code.to_owned() }).inc();
    }

    /// A job was taken from a worker that was gone.
    pub fn reclaimed(&self) {
        self.reclaimed.inc();
    }

    /// Retention erased `count` of `what`.
    pub fn expired(&self, what: &str, count: usize) {
        self.expired.get_or_create(&outcome(what)).inc_by(count as u64);
    }

    /// A webhook was tried.
    pub fn callback(&self, code: &str) {
        self.callbacks.get_or_create(&outcome(code)).inc();
    }

    /// A delivery was tried.
    pub fn delivery(&self, code: &str) {
        self.deliveries.get_or_create(&outcome(code)).inc();
    }

    /// An entry is missing from the audit log.
    pub fn audit_failed(&self) {
        self.audit_failures.inc();
    }

    /// A file is not what was stored.
    pub fn damaged(&self) {
        self.damaged.inc();
    }

    /// All of it as text.
    ///
    /// # Errors
    /// Never: a string takes everything.
    pub fn render(&self, now: &Now) -> Result<String, fmt::Error> {
        let set = |gauge: &Gauge, value: u64| gauge.set(i64::try_from(value).unwrap_or(i64::MAX));
        set(&self.queued, now.queued);
        set(&self.queued_bytes, now.queued_bytes);
        self.oldest_queued.set(now.oldest_queued_seconds);
        set(&self.running, now.running);
        set(&self.workers, now.workers);
        set(&self.disk_free, now.disk_free_bytes);
        set(&self.disk_min_free, now.disk_min_free_bytes);
        let mut text = String::new();
        encode(&mut text, &self.registry)?;
        Ok(text)
    }
}

impl Default for Metrics {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for Metrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Metrics").finish_non_exhaustive()
    }
}

fn seconds() -> Histogram {
    Histogram::new(SECONDS)
}

fn outcome(name: &str) -> OutcomeLabel {
    OutcomeLabel { outcome: name.to_owned() }
}
