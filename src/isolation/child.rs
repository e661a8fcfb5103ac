//! The child: takes runs from its stdin one after the other, says on its stdout how they go, and ends with its stdin.

use std::io::{self, Stdout};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use rustix::time::{ClockId, clock_gettime};
use tokio::signal::unix::{SignalKind, signal};

use super::budget::kilobytes;
use super::wire::{Outcome, Request, Told, receive, send};
use crate::cancel::Cancel;
use crate::formats::params_json;
use crate::jobs::process::{ProcessError, process};
use crate::model::Stage;
use crate::pipeline::observer::Observer;

/// Stack of the thread that runs.
const STACK_BYTES: usize = 8 << 20;
/// How often it is looked whether a run has used its processor time up.
const LOOK: Duration = Duration::from_millis(50);
/// Progress within a stage is said as often at the most.
const PROGRESS: Duration = Duration::from_millis(20);
/// No run, or none that is bounded.
const NO_LIMIT: u64 = u64::MAX;

/// Serves the process that started this one, until it closes this one's stdin.
///
/// # Errors
/// When it cannot start.
pub fn main(threads: Option<u16>) -> anyhow::Result<ExitCode> {
    // Where memory runs out all the same, the system is to end this process and not the one that started it.
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().context("no runtime")?;
    let _entered = runtime.enter();
    // Whoever stops a service may signal all its processes: this one ends when the service lets it.
    let _signals = [SignalKind::terminate(), SignalKind::interrupt()].map(signal);
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global().context("no threads")?;
    }
    let place = Arc::new(Mutex::new(None));
    let noted = Arc::clone(&place);
    std::panic::set_hook(Box::new(move |panic| {
        // A panic's message may quote the file it choked on: its place is enough.
        *noted.lock().unwrap_or_else(PoisonError::into_inner) = panic.location().map(ToString::to_string);
    }));
    let (hand_over, requests) = mpsc::channel::<Request>();
    let runs = move || {
        let child = Child { reporter: Reporter::default(), place, data_at_start: data_bytes() };
        for request in requests {
            if child.serve(&request).is_err() {
                // Nobody listens any more.
                std::process::exit(0);
            }
        }
    };
    thread::Builder::new().stack_size(STACK_BYTES).spawn(runs).context("no thread")?;
    while let Some(request) = receive(io::stdin().lock()).context("what was asked cannot be read")? {
        hand_over.send(request).context("the thread that runs is gone")?;
    }
    std::process::exit(0)
}

struct Child {
    reporter: Reporter,
    place: Arc<Mutex<Option<String>>>,
    data_at_start: u64,
}

impl Child {
    fn serve(&self, request: &Request) -> io::Result<()> {
        limit_memory(request.share_bytes);
        let outcome = thread::scope(|scope| {
            let used = processor_time();
            self.reporter.allow(request, used);
            let watch = scope.spawn(|| self.reporter.watch());
            let outcome = self.run(request);
            self.reporter.limit_ns.store(NO_LIMIT, Ordering::Relaxed);
            watch.thread().unpark();
            outcome
        });
        let kept_bytes = data_bytes().saturating_sub(self.data_at_start);
        self.reporter.say(&Told::Done { outcome, kept_bytes })
    }

    fn run(&self, request: &Request) -> Outcome {
        let run = || {
            let params = params_json::parse(request.params.as_bytes())
                .map_err(|error| ProcessError::from(crate::problem::Problem::from(&error)))?;
            process(&request.mask, &params, request.limits, (&request.out, request.keep), &self.reporter)
        };
        match catch_unwind(AssertUnwindSafe(run)) {
            Ok(result) => Outcome::of(result),
            Err(_) => Outcome::Panicked(self.place.lock().unwrap_or_else(PoisonError::into_inner).take()),
        }
    }
}

/// Holds this process to what it has and so many bytes more. What is beyond is not there: the process ends.
fn limit_memory(more_bytes: u64) {
    let limit = getrlimit(Resource::Data);
    let current = Some(data_bytes().saturating_add(more_bytes));
    // A system that cannot do this does not; the memory is then not bounded here.
    let _ = setrlimit(Resource::Data, Rlimit { current, maximum: limit.maximum });
}

/// The memory of this process that can be written, as the limit counts it.
fn data_bytes() -> u64 {
    let told = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    kilobytes(&told, "VmData:").unwrap_or(0) << 10
}

/// Processor time that this process has used.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(time.tv_sec.unsigned_abs(), u32::try_from(time.tv_nsec).unwrap_or(0))
}

/// Says how a run goes, and stops it when its time is used up.
struct Reporter {
    out: Mutex<(Stdout, Instant)>,
    /// Processor time of this process at which the run is to stop, ns.
    limit_ns: AtomicU64,
    memory_bytes: AtomicU64,
    is_over: std::sync::atomic::AtomicBool,
}

impl Default for Reporter {
    fn default() -> Self {
        Self {
            out: Mutex::new((io::stdout(), Instant::now())),
            limit_ns: AtomicU64::new(NO_LIMIT),
            memory_bytes: AtomicU64::new(u64::MAX),
            is_over: false.into(),
        }
    }
}

impl Reporter {
    fn allow(&self, request: &Request, used: Duration) {
        let limit = used.saturating_add(request.cpu).as_nanos();
        self.is_over.store(false, Ordering::Relaxed);
        self.memory_bytes.store(request.memory_bytes, Ordering::Relaxed);
        self.limit_ns.store(u64::try_from(limit).unwrap_or(NO_LIMIT - 1), Ordering::Relaxed);
    }

    /// Until the run is over.
    fn watch(&self) {
        loop {
            let limit = self.limit_ns.load(Ordering::Relaxed);
            if limit == NO_LIMIT {
                return;
            }
            if processor_time().as_nanos() > limit.into() {
                self.is_over.store(true, Ordering::Relaxed);
            }
            thread::park_timeout(LOOK);
        }
    }

    fn say(&self, told: &Told) -> io::Result<()> {
        send(&mut self.out().0, told)
    }

    /// What need not arrive.
    fn mention(&self, told: &Told) {
        let _ = self.say(told);
    }

    fn out(&self) -> MutexGuard<'_, (Stdout, Instant)> {
        self.out.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Cancel for Reporter {
    fn is_cancelled(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }
}

impl Observer for Reporter {
    fn memory_bytes(&self) -> u64 {
        self.memory_bytes.load(Ordering::Relaxed)
    }

    fn begun(&self, voxels: &[u64]) {
        self.mention(&Told::Begun(voxels.to_vec()));
    }

    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        let mut out = self.out();
        let now = Instant::now();
        // That a stage begins tells that the one before has ended.
        if fraction > 0.0 && now.duration_since(out.1) < PROGRESS {
            return;
        }
        out.1 = now;
        let _ = send(&mut out.0, &Told::Progress { structure, structures, stage, fraction });
    }

    fn repeated(&self, structure: usize, structures: usize, done: usize, repeats: usize) {
        self.mention(&Told::Repeated { structure, structures, done, repeats });
    }

    fn ended(&self, structure: usize, structures: usize) {
        self.mention(&Told::Ended { structure, structures });
    }
}
