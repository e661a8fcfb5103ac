//! A run that is to stop does so at once, wherever it is: from the file to the artifacts.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use medialrep::cancel::Cancel;
use medialrep::formats::{InputLimits, write};
use medialrep::jobs::process::{Kept, ProcessError, process};
use medialrep::model::Stage;
use medialrep::params::Params;
use medialrep::pipeline::observer::Observer;
use medialrep::samples::by_name;
use nalgebra::Rotation3;
use tempfile::TempDir;

use crate::help::left_out::left_out;

/// A folder with the mask of a sample.
fn folder_with(sample: &str, spacing_mm: f64) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let volume = by_name(sample).unwrap().voxelise([spacing_mm; 3], Rotation3::identity()).unwrap();
    write::nifti::write(&volume, std::fs::File::create(folder.path().join("mask.nii.gz")).unwrap()).unwrap();
    folder
}

/// The whole way from file to files; whether it was cancelled.
fn is_cancelled(folder: &Path, observer: &dyn Observer) -> bool {
    let params = Params::default().check().unwrap();
    match process(&folder.join("mask.nii.gz"), &params, InputLimits::default(), (folder, Kept::Artifacts), observer) {
        Ok(_) => false,
        Err(ProcessError::Cancelled) => true,
        Err(error) => panic!("{error:?}"),
    }
}

/// What a run says and asks, as it goes on.
#[derive(Default)]
struct Heard {
    /// Looks so far, and the look at which the run is told to stop.
    looks: usize,
    stop_at: Option<usize>,
    /// Looks in a stage and after it, until the next begins; reading comes before all.
    phases: Vec<(Option<(Stage, bool)>, usize)>,
    is_stopped: bool,
    said_after: Vec<(Stage, f64)>,
}

struct Counting(Mutex<Heard>);

impl Counting {
    fn new(stop_at: Option<usize>) -> Self {
        Self(Mutex::new(Heard { stop_at, phases: vec![(None, 0)], ..Heard::default() }))
    }
}

impl Observer for Counting {
    fn progress(&self, _: usize, _: usize, stage: Stage, fraction: f64) {
        let mut heard = self.0.lock().unwrap();
        if heard.is_stopped {
            heard.said_after.push((stage, fraction));
        }
        let phase = Some((stage, fraction == 1.0));
        if heard.phases.last().is_none_or(|(last, _)| *last != phase) {
            heard.phases.push((phase, 0));
        }
    }
}

impl Cancel for Counting {
    fn is_cancelled(&self) -> bool {
        let mut heard = self.0.lock().unwrap();
        heard.looks += 1;
        heard.phases.last_mut().unwrap().1 += 1;
        heard.is_stopped |= heard.stop_at.is_some_and(|at| heard.looks >= at);
        heard.is_stopped
    }
}

#[test]
fn a_run_looks_often_at_every_stage_and_stops_in_the_middle_of_any() {
    /// Looks in each stage at the least: the sample is some 100 voxels long and has 6 × 8 nodes.
    const LOOKS: usize = 100;
    let folder = folder_with("bent", 0.7);
    let whole = Counting::new(None);
    assert!(!is_cancelled(folder.path(), &whole));
    let phases = whole.0.into_inner().unwrap().phases;
    let mut before = 0;
    for (said, looks) in phases {
        let in_stage = said.is_some_and(|(_, is_over)| !is_over);
        assert!(!in_stage || looks >= LOOKS, "{said:?}: {looks} looks");
        let counting = Counting::new(Some(before + looks.div_ceil(2)));
        if looks > 0 {
            assert!(is_cancelled(folder.path(), &counting), "{said:?}");
            let heard = counting.0.into_inner().unwrap();
            assert!(heard.said_after.is_empty(), "{said:?}, then {:?}", heard.said_after);
            let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
            assert_eq!(left, [folder.path().join("mask.nii.gz")], "{said:?}");
        }
        before += looks;
    }
}

/// Is told to stop by a clock.
#[derive(Default)]
struct Told {
    stop: AtomicBool,
    stage: Mutex<Option<Stage>>,
}

impl Observer for Told {
    fn progress(&self, _: usize, _: usize, stage: Stage, _: f64) {
        *self.stage.lock().unwrap() = Some(stage);
    }
}

impl Cancel for Told {
    fn is_cancelled(&self) -> bool {
        self.stop.load(Relaxed)
    }
}

/// How long after the moment a run is told to stop it ends, and the stage it was in; `None` when it was
/// over before.
fn latency(folder: &Path, after: Duration) -> Option<(Duration, Option<Stage>)> {
    let told = Told::default();
    std::thread::scope(|scope| {
        let teller = scope.spawn(|| {
            std::thread::sleep(after);
            told.stop.store(true, Relaxed);
            (Instant::now(), *told.stage.lock().unwrap())
        });
        let was_cancelled = is_cancelled(folder, &told);
        let end = Instant::now();
        let (moment, stage) = teller.join().unwrap();
        was_cancelled.then(|| (end - moment, stage))
    })
}

/// The long form: with `MEDIALREP_SOAK=1`, on a volume of 583 × 423 × 289 voxels. It takes some minutes, and
/// means something in a release build only.
#[test]
fn a_large_run_ends_within_a_second_of_being_told_to() {
    const TIMES: u32 = 30;
    const LIMIT: Duration = Duration::from_secs(1);
    if std::env::var_os("MEDIALREP_SOAK").is_none_or(|value| value != "1") {
        return left_out("takes minutes, see `make soak`; a small run is cancelled in every stage above");
    }
    let folder = folder_with("bent", 0.125);
    let start = Instant::now();
    assert!(!is_cancelled(folder.path(), &Told::default()));
    let whole = start.elapsed();
    let mut worst = (Duration::ZERO, None);
    for n in 0..TIMES {
        let after = whole * (2 * n + 1) / (2 * TIMES);
        let Some((latency, stage)) = latency(folder.path(), after) else { continue };
        println!("told after {after:.2?} in {stage:?}: {latency:.3?}");
        worst = worst.max((latency, stage));
    }
    println!(
        "the whole run takes {whole:.1?}; at worst it ended {:.3?} after it was told to, in {:?}",
        worst.0, worst.1
    );
    assert!(worst.0 <= LIMIT, "{:.3?} in {:?}", worst.0, worst.1);
}
