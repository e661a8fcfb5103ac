//! Starts children, hands them runs, and tells what became of those.

use std::ffi::OsString;
use std::io::{self, BufReader, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::budget::{Memory, default_memory_bytes, first_share};
use super::wire::{Outcome, Request, Told, receive, send, written};
use crate::dicomweb::CREDENTIALS_ENV;
use crate::formats::params_json::params_to_json;
use crate::formats::readers::check_header;
use crate::formats::{HeaderFacts, InputLimits};
use crate::jobs::limits::CpuLimits;
use crate::jobs::process::{Kept, ProcessError, READING, remove_files};
use crate::jobs::processed::Processed;
use crate::params::CheckedParams;
use crate::pipeline::observer::Observer;
use crate::problem::Problem;

/// The signal that cannot be refused.
const SIGKILL: i32 = 9;
/// The argument with which the program is a child.
pub const ARGUMENT: &str = "isolated";
/// How often it is looked whether a run is to stop.
const LOOK: Timespec = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
/// Memory that a child may keep after a run; one that keeps more ends, and the next run has another.
const MAY_KEEP_BYTES: u64 = 64 << 20;
/// Crashes of one run after which it is given up: a second one is no accident.
const MOST_CRASHES: u32 = 2;
/// Where the system has the program that runs, even if its file was replaced since.
const OWN_PROGRAM: &str = "/proc/self/exe";

/// What children may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IsolationLimits {
    /// Memory of all runs together.
    pub memory_bytes: u64,
    /// Threads of each; none for as many as there are cores.
    pub threads: Option<u16>,
    /// Processor time of each run.
    pub cpu: CpuLimits,
}

impl Default for IsolationLimits {
    fn default() -> Self {
        Self { memory_bytes: default_memory_bytes(), threads: None, cpu: CpuLimits::default() }
    }
}

/// Runs masks in children.
#[derive(Debug)]
pub struct Isolation {
    program: PathBuf,
    threads: Option<u16>,
    memory: Memory,
    cpu: CpuLimits,
    idle: Mutex<Vec<Worker>>,
}

/// A child that waits for a run.
#[derive(Debug)]
struct Worker {
    child: Child,
    requests: ChildStdin,
    told: BufReader<ChildStdout>,
}

/// How a run in a child ended.
enum Ran {
    Ended(Result<Processed, ProcessError>),
    /// The child is gone.
    Died(Death),
}

/// How a child ended.
struct Death {
    /// Processor time that it had used.
    used: Duration,
    cause: Cause,
}

/// Why a child ended.
enum Cause {
    NoMemory,
    /// With what is known of it.
    Crash(String),
}

impl Isolation {
    /// With children of the program that this is.
    #[must_use]
    pub fn new(limits: IsolationLimits) -> Self {
        let own = Path::new(OWN_PROGRAM);
        let program = if own.exists() { own.to_owned() } else { std::env::current_exe().unwrap_or_default() };
        Self::of_program(program, limits)
    }

    /// With children of another program.
    #[must_use]
    pub fn of_program(program: PathBuf, limits: IsolationLimits) -> Self {
        let IsolationLimits { memory_bytes, threads, cpu } = limits;
        Self { program, threads, memory: Memory::of(memory_bytes), cpu, idle: Mutex::default() }
    }

    /// As [`process`](crate::jobs::process::process), in a child. Waits until there is memory for it.
    ///
    /// # Errors
    /// As there; when it takes more memory or time than it may, or crashes.
    pub fn process(
        &self,
        mask: &Path,
        params: &CheckedParams,
        limits: InputLimits,
        (out, keep): (&Path, Kept),
        observer: &dyn Observer,
    ) -> Result<Processed, ProcessError> {
        remove_files(out);
        let header = check_header(mask, limits)?;
        let bytes = std::fs::metadata(mask).map_err(|error| ProcessError::Io { doing: READING, error })?.len();
        let cpu = self.cpu.of(bytes, header.is_compressed);
        let mut request = Request {
            mask: mask.to_owned(),
            params: params_to_json(params).to_string(),
            limits,
            out: out.to_owned(),
            keep,
            share_bytes: first_share(&header),
            memory_bytes: self.memory.bytes(),
            cpu,
            cpu_of_size: cpu,
        };
        let mut crashes = 0;
        loop {
            let share = self.memory.take(request.share_bytes, observer)?;
            request.share_bytes = share.bytes;
            let ran = self.run(&request, observer);
            drop(share);
            if !matches!(ran, Ok(Ran::Ended(Ok(_)))) {
                remove_files(out);
            }
            let Death { used, cause } =
                match ran.map_err(|error| ProcessError::Io { doing: "starting a process", error })? {
                    Ran::Ended(result) => return result,
                    Ran::Died(death) => death,
                };
            // All tries together have the time of one.
            request.cpu = request.cpu.saturating_sub(used);
            match cause {
                Cause::NoMemory if request.share_bytes < self.memory.bytes() => {
                    request.share_bytes = self.memory.bytes();
                }
                Cause::NoMemory => return Err(needs_too_much(self.memory.bytes(), &header).into()),
                Cause::Crash(how) => {
                    crashes += 1;
                    if crashes == MOST_CRASHES {
                        return Err(ProcessError::Crashed { how });
                    }
                    tracing::warn!(how, "the run crashed; it is tried once more");
                }
            }
        }
    }

    fn run(&self, request: &Request, observer: &dyn Observer) -> io::Result<Ran> {
        let mut worker = self.worker()?;
        let sent = send(&mut worker.requests, request);
        let told = sent.and_then(|()| worker.listen(observer));
        match told {
            Ok(Some((outcome, kept_bytes))) => {
                if kept_bytes <= MAY_KEEP_BYTES {
                    self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(worker);
                }
                outcome_of(outcome, request).map(Ran::Ended)
            }
            Ok(None) if observer.is_cancelled() => Ok(Ran::Ended(Err(ProcessError::Cancelled))),
            Ok(None) => Ok(Ran::Died(worker.death())),
            // It was gone before it could be asked.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(Ran::Died(worker.death())),
            Err(error) => {
                let used = processor_time(worker.child.id());
                Ok(Ran::Died(Death { used, cause: Cause::Crash(error.to_string()) }))
            }
        }
    }

    /// A child that is idle, or a new one.
    fn worker(&self) -> io::Result<Worker> {
        loop {
            let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
            let Some(mut worker) = idle else { return self.start() };
            if worker.child.try_wait()?.is_none() {
                return Ok(worker);
            }
        }
    }

    fn start(&self) -> io::Result<Worker> {
        let mut command = Command::new(&self.program);
        // What lists of processes show.
        command.arg0(env!("CARGO_PKG_NAME")).arg(ARGUMENT);
        if let Some(threads) = self.threads {
            command.args(["--threads", &threads.to_string()]);
        }
        for secret in secrets(std::env::vars_os().map(|(name, _)| name)) {
            command.env_remove(secret);
        }
        // A group of its own: what is typed at a terminal is for the process that started it.
        command.process_group(0).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn()?;
        let pipes = child.stdin.take().zip(child.stdout.take());
        let (requests, told) = pipes.ok_or_else(|| io::Error::other("a process has no pipes"))?;
        Ok(Worker { child, requests, told: BufReader::new(told) })
    }
}

/// Which variables hold what a child, which reads what strangers send, is not to know. The secret of webhooks is in a file.
fn secrets(names: impl Iterator<Item = OsString>) -> impl Iterator<Item = OsString> {
    names.filter(|name| name.as_encoded_bytes().starts_with(CREDENTIALS_ENV.as_bytes()))
}

impl Worker {
    /// Hands on what the child says until its run is over; `None` when it is gone, or was killed because the run is to stop.
    fn listen(&mut self, observer: &dyn Observer) -> io::Result<Option<(Outcome, u64)>> {
        loop {
            let is_silent = self.told.buffer().is_empty() && is_silent(self.told.get_ref())?;
            if observer.is_cancelled() {
                let _ = self.child.kill();
                return Ok(None);
            }
            if is_silent {
                continue;
            }
            match receive(&mut self.told)? {
                None => return Ok(None),
                Some(Told::Done { outcome, kept_bytes }) => return Ok(Some((outcome, kept_bytes))),
                Some(Told::Begun(voxels)) => observer.begun(&voxels),
                Some(Told::Progress { structure, structures, stage, fraction }) => {
                    observer.progress(structure, structures, stage, fraction);
                }
                Some(Told::Repeated { structure, structures, done, repeats }) => {
                    observer.repeated(structure, structures, done, repeats);
                }
                Some(Told::Ended { structure, structures }) => observer.ended(structure, structures),
            }
        }
    }

    /// Why the child is gone.
    fn death(mut self) -> Death {
        /// What it says at its end, bytes at the most.
        const LAST_WORDS: u64 = 4096;
        let mut words = String::new();
        if let Some(stderr) = self.child.stderr.take() {
            let _ = stderr.take(LAST_WORDS).read_to_string(&mut words);
        }
        let used = processor_time(self.child.id());
        let cause = match self.child.wait() {
            // Nobody else kills a child than the system when memory runs out.
            Ok(status) if words.contains("memory allocation of") || status.signal() == Some(SIGKILL) => Cause::NoMemory,
            Ok(status) => Cause::Crash(told(status, &words)),
            Err(error) => Cause::Crash(error.to_string()),
        };
        Death { used, cause }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits a moment for something to be said.
fn is_silent(told: &ChildStdout) -> io::Result<bool> {
    let mut ready = [PollFd::new(told, PollFlags::IN)];
    match poll(&mut ready, Some(&LOOK)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(ready[0].revents().is_empty()),
        Err(error) => Err(error.into()),
    }
}

/// Processor time that a process has used that is not yet waited for; none where the system does not say.
fn processor_time(process: u32) -> Duration {
    let told = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // Its name, which stands in brackets, may hold anything.
    let fields = told.rsplit(')').next().unwrap_or_default();
    let ticks: u64 = fields.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_secs_f64(ticks as f64 / rustix::param::clock_ticks_per_second() as f64)
}

/// How a child ended, in a line: its status, and what it said first.
fn told(status: ExitStatus, words: &str) -> String {
    let first = words.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    format!("{status}: {}", first.trim())
}

/// What a child made of a run.
fn outcome_of(outcome: Outcome, request: &Request) -> io::Result<Result<Processed, ProcessError>> {
    Ok(match outcome {
        Outcome::Processed { files, warnings, stages, structures } => {
            Ok(Processed { files: written(files)?, warnings, stage_seconds: stages, structures })
        }
        Outcome::Problem(problem) => Err(ProcessError::Problem(problem)),
        Outcome::Io { doing, os_error, message } => {
            let error = os_error.map_or_else(|| io::Error::other(message), io::Error::from_raw_os_error);
            Err(ProcessError::Io { doing: doing.known(), error })
        }
        Outcome::OutOfTime => Err(needs_too_long(request.cpu_of_size).into()),
        Outcome::Panicked(place) => {
            Err(ProcessError::Crashed { how: format!("panic at {}", place.as_deref().unwrap_or("an unknown place")) })
        }
    })
}

fn needs_too_long(allowed: Duration) -> Problem {
    let detail = format!(
        "the run needs more than the {} s of processor time that a file of this size may take",
        allowed.as_secs()
    );
    Problem::new(422, "needs_too_much_time", detail)
        .hint("crop the mask, raise resolution_mm, or lower uncertainty, neighbors and grid")
}

fn needs_too_much(memory_bytes: u64, header: &HeaderFacts) -> Problem {
    let detail = format!(
        "the run needs more than the {} MiB of memory that there are for runs; the volume has {} voxels",
        memory_bytes >> 20,
        header.voxels
    );
    Problem::new(422, "needs_too_much_memory", detail).hint("crop the mask, raise resolution_mm, or lower neighbors")
}
