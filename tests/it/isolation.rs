//! Runs in processes of their own.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use medialrep::cancel::Cancel;
use medialrep::isolation::{Isolation, IsolationLimits};
use medialrep::jobs::limits::CpuLimits;
use medialrep::jobs::process::{InputLimits, Kept, ProcessError, process};
use medialrep::jobs::processed::Processed;
use medialrep::model::Stage;
use medialrep::params::{CheckedParams, Params};
use medialrep::pipeline::observer::{Observer, Silent};
use tempfile::TempDir;

use crate::help::process::{PROGRAM, Service, sample_of};

fn sample(arguments: &[&str]) -> Vec<u8> {
    sample_of(tempfile::tempdir().unwrap().path(), arguments)
}

fn wait_until(is_so: impl Fn() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(10);
    while !is_so() {
        assert!(Instant::now() < deadline, "waited in vain");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A sample and a folder for its results.
struct Case {
    dir: TempDir,
    mask: PathBuf,
}

impl Case {
    fn new(arguments: &[&str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let mask = dir.path().join("mask.nii.gz");
        std::fs::write(&mask, sample(arguments)).unwrap();
        std::fs::create_dir(dir.path().join("out")).unwrap();
        Self { dir, mask }
    }

    fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    fn run(&self, isolation: &Isolation, observer: &dyn Observer) -> Result<Processed, ProcessError> {
        let params = CheckedParams::default();
        isolation.process(&self.mask, &params, InputLimits::default(), (&self.out(), Kept::Record), observer)
    }

    fn is_empty(&self) -> bool {
        std::fs::read_dir(self.out()).unwrap().next().is_none()
    }
}

fn limits() -> IsolationLimits {
    IsolationLimits { memory_bytes: 1 << 30, ..IsolationLimits::default() }
}

fn isolation(limits: IsolationLimits) -> Isolation {
    Isolation::of_program(PROGRAM.into(), limits)
}

fn code(result: Result<Processed, ProcessError>) -> String {
    match result {
        Err(ProcessError::Problem(problem)) => problem.code,
        other => panic!("{other:?}"),
    }
}

/// Counts what it hears of progress, and wants to stop after so much of it.
struct StopAfter(usize, AtomicUsize);

impl Cancel for StopAfter {
    fn is_cancelled(&self) -> bool {
        self.1.load(Ordering::SeqCst) >= self.0
    }
}

impl Observer for StopAfter {
    fn progress(&self, _: usize, _: usize, _: Stage, _: f64) {
        self.1.fetch_add(1, Ordering::SeqCst);
    }
}

#[test]
fn a_run_leaves_what_it_leaves_in_this_process_and_tells_its_progress() {
    let (case, here) = (Case::new(&["bent"]), tempfile::tempdir().unwrap());
    let heard = StopAfter(usize::MAX, AtomicUsize::new(0));
    let isolation = isolation(limits());
    for _ in 0..2 {
        let there = case.run(&isolation, &heard).unwrap();
        let params = Params::default().check().unwrap();
        let own = process(&case.mask, &params, InputLimits::default(), (here.path(), Kept::Record), &Silent).unwrap();
        assert_eq!(there.structures, own.structures);
        let names = |processed: &Processed| processed.files.iter().map(|file| file.name).collect::<Vec<_>>();
        assert_eq!(names(&there), names(&own));
        let glb = |folder: &Path| std::fs::read(folder.join("model.glb")).unwrap();
        assert_eq!(glb(&case.out()), glb(here.path()));
    }
    assert!(heard.1.into_inner() > 10);
}

#[test]
fn a_run_that_is_to_stop_leaves_nothing_and_the_next_one_works() {
    let (case, isolation) = (Case::new(&["tee"]), isolation(limits()));
    let stopped = case.run(&isolation, &StopAfter(3, AtomicUsize::new(0)));
    assert!(matches!(stopped, Err(ProcessError::Cancelled)), "{stopped:?}");
    assert!(case.is_empty());
    case.run(&isolation, &Silent).unwrap();
}

#[test]
fn a_run_that_outgrows_the_memory_is_refused_with_the_figure_and_leaves_nothing() {
    let case = Case::new(&["cross", "--spacing", "0.5"]);
    let small = isolation(IsolationLimits { memory_bytes: 64 << 20, ..limits() });
    let outgrown = case.run(&small, &Silent);
    let Err(ProcessError::Problem(problem)) = outgrown else { panic!("{outgrown:?}") };
    assert_eq!((&*problem.code, problem.status), ("needs_too_much_memory", 422));
    assert!(problem.detail.contains("64 MiB"), "{}", problem.detail);
    assert!(case.is_empty());
    // Who comes after has its own.
    Case::new(&["slab"]).run(&small, &Silent).unwrap();
}

#[test]
fn a_run_that_outgrows_its_time_is_refused_with_the_figure_and_leaves_nothing() {
    let case = Case::new(&["cross", "--spacing", "0.5"]);
    let cpu = CpuLimits { least: Duration::from_millis(200), per_kb: Duration::ZERO };
    let begun = Instant::now();
    assert_eq!(code(case.run(&isolation(IsolationLimits { cpu, ..limits() }), &Silent)), "needs_too_much_time");
    assert!(begun.elapsed() < Duration::from_secs(10));
    assert!(case.is_empty());
}

/// A program that does something the first so many times, and is ours after that.
fn first_times(folder: &Path, count: u32, what: &str) -> PathBuf {
    let (script, times) = (folder.join("program"), folder.join("times"));
    let text = format!(
        "#!/bin/sh\nif [ $(wc -c < {times} 2>/dev/null || echo 0) -lt {count} ]; then printf x >> {times}; {what}; fi\nexec {PROGRAM} \"$@\"\n",
        times = times.display()
    );
    std::fs::write(&script, text).unwrap();
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    script
}

#[test]
fn a_crash_is_tried_once_more_and_two_are_told() {
    let case = Case::new(&["slab"]);
    let of = |count, what| {
        let folder = tempfile::tempdir().unwrap();
        let isolation = Isolation::of_program(first_times(folder.path(), count, what), limits());
        case.run(&isolation, &Silent)
    };
    assert!(of(1, "kill -SEGV $$").is_ok());
    match of(2, "echo 'thread has overflowed its stack' >&2; kill -ABRT $$") {
        Err(ProcessError::Crashed { how }) => assert!(how.contains("overflowed") && how.contains('6'), "{how}"),
        other => panic!("{other:?}"),
    }
    // The system kills what takes the memory that others need: it is run again with all, and refused then.
    assert!(of(1, "kill -KILL $$").is_ok());
    assert_eq!(code(of(2, "kill -KILL $$")), "needs_too_much_memory");
}

/// Processes that a process has started.
fn children(parent: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let id = entry.file_name().into_string().unwrap_or_default();
        let Ok(stat) = std::fs::read_to_string(format!("/proc/{id}/stat")) else { continue };
        if stat.rsplit(')').next().unwrap_or_default().split_whitespace().nth(1) == Some(parent) {
            found.push(id);
        }
    }
    found
}

#[test]
fn a_job_that_needs_too_much_fails_alone_and_the_service_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let service = Service::start(dir.path(), &["--memory", "64", "--workers", "2"]);
    let bomb = service.submit(&sample(&["cross", "--spacing", "0.5"]));
    let neighbour = service.submit(&sample(&["slab"]));
    let (bomb, neighbour) = (service.ended(&bomb), service.ended(&neighbour));
    assert_eq!((&bomb["state"], &bomb["error"]["code"]), (&"failed".into(), &"needs_too_much_memory".into()));
    assert_eq!((&neighbour["state"], &neighbour["attempt"]), (&"succeeded".into(), &1.into()));
}

#[test]
fn processes_know_no_credentials_of_the_service() {
    let dir = tempfile::tempdir().unwrap();
    let pacs = ["--pacs", "main=http://127.0.0.1:1/dicom-web"];
    let secret = [("MEDIALREP_PACS_CREDENTIALS_MAIN", "peer:password"), ("MEDIALREP_PACS_CREDENTIALS_X", "password")];
    let service = Service::start_with(dir.path(), &pacs, &secret);
    let id = service.submit(&sample(&["cross", "--spacing", "0.6"]));
    service.job_when(&id, Duration::from_secs(30), |now| now["progress"]["fraction"].as_f64() > Some(0.0));
    let environment = |id: &str| {
        let bytes = std::fs::read(format!("/proc/{id}/environ")).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    assert!(environment(&service.pid()).contains("password"));
    let started = children(&service.pid());
    assert!(!started.is_empty());
    for id in started {
        let told = environment(&id);
        assert!(told.contains("RUST_LOG=info") && !told.contains("password"), "{told}");
    }
}

#[test]
fn processes_end_with_the_service_and_not_by_a_signal_to_all() {
    let dir = tempfile::tempdir().unwrap();
    let service = Service::start(dir.path(), &[]);
    let parent = service.pid();
    // Once it tells how far it is, its process is ready for signals too.
    let begun = || {
        let id = service.submit(&sample(&["cross", "--spacing", "0.6"]));
        service.job_when(&id, Duration::from_secs(30), |now| now["progress"]["fraction"].as_f64() > Some(0.0));
        let started = children(&parent);
        assert!(!started.is_empty());
        (id, started)
    };
    let (id, started) = begun();
    for signal in ["-TERM", "-INT"] {
        assert!(Command::new("kill").arg(signal).args(&started).status().unwrap().success());
    }
    let ended = service.ended(&id);
    assert_eq!((&ended["state"], &ended["attempt"]), (&"succeeded".into(), &1.into()));
    assert!(!service.log().contains("crashed"), "{}", service.log());
    // Under way when the service goes, of which nothing is asked.
    let (_, started) = begun();
    drop(service);
    wait_until(|| started.iter().all(|id| !Path::new(&format!("/proc/{id}/exe")).exists()));
}
