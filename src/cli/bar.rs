//! How far a run is, on a terminal: one line for all structures.

use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::cancel::Cancel;
use crate::model::Stage;
use crate::pipeline::observer::Observer;
use crate::pipeline::progress::Overall;

/// Steps of the bar.
const STEPS: u32 = 10_000;
/// Redraws a second: structures that are worked on side by side would make it flicker.
const REDRAWS: u8 = 4;
/// How often the time left is told anew during a long stage.
const TICK: Duration = Duration::from_millis(500);
/// Before this, and below this share, the time left would be a guess.
const SURE_AFTER: Duration = Duration::from_secs(2);
/// See [`SURE_AFTER`].
const SURE_FROM: f32 = 0.02;

/// Shows a run; hidden, it shows nothing.
pub(super) struct Bar(Option<Mutex<Shown>>);

struct Shown {
    overall: Overall,
    bar: ProgressBar,
}

impl Bar {
    /// A bar on stderr, while the file is read.
    pub(super) fn on_stderr() -> Self {
        let bar = ProgressBar::with_draw_target(Some(u64::from(STEPS)), ProgressDrawTarget::stderr_with_hz(REDRAWS));
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} %{left}") {
            bar.set_style(style.with_key("left", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                // A bar that cannot be written is no reason to end the run.
                let _ = out.write_str(&left(state));
            }));
        }
        bar.set_message("reading");
        bar.enable_steady_tick(TICK);
        Self(Some(Mutex::new(Shown { overall: Overall::default(), bar })))
    }

    /// No bar.
    pub(super) fn hidden() -> Self {
        Self(None)
    }

    /// Takes it off the screen.
    pub(super) fn clear(&self) {
        if let Some(shown) = self.shown() {
            shown.bar.finish_and_clear();
        }
    }

    fn shown(&self) -> Option<MutexGuard<'_, Shown>> {
        self.0.as_ref()?.lock().ok()
    }
}

impl Cancel for Bar {}

impl Observer for Bar {
    fn begun(&self, voxels: &[u64]) {
        if let Some(mut shown) = self.shown() {
            shown.overall.tell_sizes(voxels);
        }
    }

    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        if let Some(mut shown) = self.shown() {
            shown.overall.tell(structure, structures, stage, fraction);
            shown.draw();
        }
    }

    fn repeated(&self, structure: usize, structures: usize, done: usize, repeats: usize) {
        if let Some(mut shown) = self.shown() {
            shown.overall.tell_repeat(structure, structures, done, repeats);
            shown.draw();
        }
    }

    fn ended(&self, structure: usize, structures: usize) {
        if let Some(mut shown) = self.shown() {
            shown.overall.tell_end(structure, structures);
            shown.draw();
        }
    }
}

impl Shown {
    fn draw(&self) {
        self.bar.set_message(words(&self.overall));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the steps")]
        self.bar.set_position((self.overall.progress().fraction.clamp(0.0, 1.0) * f64::from(STEPS)) as u64);
    }
}

/// The stage, and which structure it is in the order in which they get done.
fn words(overall: &Overall) -> String {
    let (progress, ended) = (overall.progress(), overall.ended());
    if ended > 0 && ended == progress.structures {
        return "writing".to_owned();
    }
    let stage = progress.stage.map_or("reading", Stage::name);
    match progress.structures {
        0 | 1 => format!("{stage:9}"),
        structures => format!("{stage:9} structure {} of {structures}", ended + 1),
    }
}

/// The time left, if what follows takes as long for its share as what was.
fn left(state: &ProgressState) -> String {
    let (fraction, elapsed) = (state.fraction(), state.elapsed());
    if !(SURE_FROM..1.0).contains(&fraction) || elapsed < SURE_AFTER {
        return String::new();
    }
    format!(", {} left", about(elapsed.mul_f32((1.0 - fraction) / fraction)))
}

/// A time as one says it.
fn about(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..60 => format!("{} s", seconds.max(1)),
        60..3600 => format!("{} min", seconds.div_ceil(60)),
        _ => format!("{} h {} min", seconds / 3600, seconds % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_one_row_of_structures() {
        let mut overall = Overall::default();
        assert_eq!(words(&overall).trim_end(), "reading");
        overall.tell(1, 3, Stage::Mask, 0.0);
        assert_eq!(words(&overall), "mask      structure 1 of 3");
        // Which one is done first does not matter.
        overall.tell_end(2, 3);
        overall.tell(1, 3, Stage::Distance, 0.0);
        assert_eq!(words(&overall), "distance  structure 2 of 3");
        overall.tell_end(0, 3);
        overall.tell_end(1, 3);
        assert_eq!(words(&overall), "writing");
    }

    #[test]
    fn a_single_structure_is_not_counted() {
        let mut overall = Overall::default();
        overall.tell(0, 1, Stage::Isomap, 0.5);
        assert_eq!(words(&overall), "isomap   ");
    }

    #[test]
    fn times_are_told_in_the_unit_that_fits() {
        for (seconds, told) in [(0, "1 s"), (59, "59 s"), (61, "2 min"), (3599, "60 min"), (3700, "1 h 1 min")] {
            assert_eq!(about(Duration::from_secs(seconds)), told);
        }
    }
}
