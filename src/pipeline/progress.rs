//! How far a whole run is, from what its stages tell. Structures are worked on side by side and some
//! stages are gone through again; told as one share, it never goes back.

use crate::model::Stage;

/// How far a run is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// The stage, `None` while the file is read.
    pub stage: Option<Stage>,
    /// Structures, 0 while the file is read.
    pub structures: usize,
    /// The structure worked on, from 0.
    pub structure: usize,
    /// Share of the whole run, 0 to 1.
    pub fraction: f64,
}

/// What a run has told of itself.
#[derive(Debug, Default)]
pub struct Overall {
    last: Progress,
    /// What each structure weighs in the whole; without it all weigh the same.
    weights: Vec<f64>,
    /// What is done of each structure.
    done: Vec<Done>,
}

/// What is done of a structure.
#[derive(Clone, Debug, Default)]
struct Done {
    /// Share of its stages.
    stages: f64,
    /// Repeats that follow them, each of which takes as long.
    repeats: usize,
    repeated: usize,
    /// Nothing follows: a structure that is refused has no further stages.
    is_ended: bool,
}

#[expect(clippy::cast_precision_loss, reason = "a few stages and repeats of a few structures")]
impl Done {
    fn share(&self) -> f64 {
        if self.is_ended {
            return 1.0;
        }
        (self.stages + self.repeated as f64) / (1 + self.repeats) as f64
    }
}

#[expect(clippy::cast_precision_loss, reason = "a few stages of a few structures, and their voxels")]
impl Overall {
    /// Structures of so many voxels will be worked on. Each weighs as its surface does, which grows with
    /// the power 2/3: of a body and a brain with 20 to 60 labels the time left is then foretold within a
    /// half for most of the run. Weighing the same, the large ones, which come first, would make it four
    /// times too long; weighing as their voxels, half of it.
    pub fn tell_sizes(&mut self, voxels: &[u64]) {
        self.weights.clear();
        for &voxels in voxels {
            self.weights.push((voxels as f64).powf(2.0 / 3.0));
        }
        self.done.resize(voxels.len(), Done::default());
    }

    /// `stage` of a structure has reached `fraction` (0 to 1).
    pub fn tell(&mut self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        let stages_done = Stage::ALL.iter().take_while(|s| **s < stage).count() as f64 + fraction.clamp(0.0, 1.0);
        let done = self.done_of(structure, structures);
        // A structure whose sheets are cut goes through some stages again: what was done stays done.
        done.stages = done.stages.max(stages_done / Stage::ALL.len() as f64);
        self.last = Progress { stage: Some(stage), structures, structure, fraction: self.fraction() };
    }

    /// `repeated` of the `repeats` that follow the stages of a structure are done.
    pub fn tell_repeat(&mut self, structure: usize, structures: usize, repeated: usize, repeats: usize) {
        let done = self.done_of(structure, structures);
        done.repeats = repeats;
        done.repeated = done.repeated.max(repeated);
        self.last = Progress { structures, structure, fraction: self.fraction(), ..self.last };
    }

    /// All is done of a structure.
    pub fn tell_end(&mut self, structure: usize, structures: usize) {
        self.done_of(structure, structures).is_ended = true;
        self.last = Progress { structures, structure, fraction: self.fraction(), ..self.last };
    }

    /// How far the run is, as told last.
    #[must_use]
    pub fn progress(&self) -> Progress {
        self.last
    }

    /// Structures of which all is done.
    #[must_use]
    pub fn ended(&self) -> usize {
        self.done.iter().filter(|done| done.is_ended).count()
    }

    fn done_of(&mut self, structure: usize, structures: usize) -> &mut Done {
        self.done.resize(structures.max(structure + 1), Done::default());
        &mut self.done[structure]
    }

    fn fraction(&self) -> f64 {
        let (mut done, mut all) = (0.0, 0.0);
        for (structure, part) in self.done.iter().enumerate() {
            let weight = self.weights.get(structure).map_or(1.0, |weight| weight.max(1.0));
            done += weight * part.share();
            all += weight;
        }
        done / all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_side_by_side_never_take_progress_back() {
        let mut overall = Overall::default();
        let mut before = 0.0;
        let begun = [(2, Stage::Quality, 0.5), (0, Stage::Mask, 0.1), (1, Stage::Isomap, 1.0)];
        let again = [(1, Stage::Lattice, 0.2), (1, Stage::Isomap, 0.5), (2, Stage::Quality, 1.0)];
        for (structure, stage, fraction) in begun.into_iter().chain(again) {
            overall.tell(structure, 3, stage, fraction);
            let told = overall.progress();
            assert!(told.fraction >= before, "{structure} {stage:?} {fraction}");
            assert_eq!((told.structure, told.stage), (structure, Some(stage)));
            before = told.fraction;
        }
        for structure in 0..3 {
            overall.tell(structure, 3, Stage::Quality, 1.0);
        }
        assert!((overall.progress().fraction - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_large_structure_weighs_more_than_a_small_one() {
        let mut overall = Overall::default();
        overall.tell_sizes(&[8000, 1000, 0]);
        overall.tell(0, 3, Stage::Quality, 1.0);
        assert!((overall.progress().fraction - 400.0 / 501.0).abs() < 1e-9);
        overall.tell_end(1, 3);
        overall.tell_end(2, 3);
        assert!((overall.progress().fraction - 1.0).abs() < 1e-12);
    }

    #[test]
    fn all_is_done_of_a_structure_that_is_refused() {
        let mut overall = Overall::default();
        overall.tell(0, 2, Stage::Quality, 1.0);
        overall.tell_repeat(1, 2, 0, 3);
        overall.tell(1, 2, Stage::Sheets, 0.0);
        assert!(overall.progress().fraction < 0.6);
        overall.tell_end(1, 2);
        assert!((overall.progress().fraction - 1.0).abs() < 1e-12);
        assert_eq!(overall.ended(), 1);
    }

    #[test]
    fn repeats_count_as_much_as_the_run_that_they_repeat() {
        let mut overall = Overall::default();
        overall.tell_repeat(0, 1, 0, 3);
        overall.tell(0, 1, Stage::Quality, 1.0);
        assert!((overall.progress().fraction - 0.25).abs() < 1e-12);
        // They end in any order.
        for (done, fraction) in [(2, 0.75), (1, 0.75), (3, 1.0)] {
            overall.tell_repeat(0, 1, done, 3);
            assert!((overall.progress().fraction - fraction).abs() < 1e-12, "{done}");
        }
        assert_eq!(overall.progress().stage, Some(Stage::Quality));
    }
}
