//! What every stage is handed beside its input: the parameters, who listens, and where its warnings and its
//! time are noted.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::observer::Observer;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, Stage, StageTimings, Warning};
use crate::params::CheckedParams;

/// One repeat of a structure for its uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct Repeat<'a> {
    /// Which one, from 1.
    pub number: u64,
    /// Lattice sizes of the figures that it repeats, for each part of the label.
    pub sizes: &'a [Vec<LatticeSize>],
}

/// The context of one structure's stages.
pub struct Context<'a> {
    /// What is asked for.
    pub params: &'a CheckedParams,
    /// Which repeat this is; none for the result itself.
    pub repeat: Option<Repeat<'a>>,
    pub(super) observer: &'a dyn Observer,
    /// Which structure this is, from 0.
    pub(super) structure: usize,
    /// Of how many.
    pub(super) structures: usize,
    /// Which part of the label is worked on, from 0.
    part: usize,
    /// How many figures of the part are before those that are worked on.
    before: usize,
    notes: Mutex<Notes>,
}

/// What the stages leave beside their output.
#[derive(Clone, Debug, Default)]
pub struct Notes {
    /// Warnings, in the order in which they were given.
    pub warnings: Vec<Warning>,
    /// Time of each stage.
    pub timings: StageTimings,
    /// The stage that runs, and which part of it of how many.
    running: Option<(Stage, Part)>,
}

impl Notes {
    /// Warnings of what is used in the end, whose time is counted already.
    pub(super) fn of_warnings(warnings: Vec<Warning>) -> Self {
        Self { warnings, ..Self::default() }
    }

    /// Whether a warning was given.
    pub(super) fn tell_of(&self, code: &str) -> bool {
        self.warnings.iter().any(|warning| warning.code == code)
    }

    /// The time alone, of what was not used.
    pub(super) fn without_warnings(self) -> Self {
        Self { warnings: Vec::new(), ..self }
    }
}

/// A stage that is gone through once for each of several sheets is done in parts.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Which part, from 0.
    pub number: usize,
    /// Of how many.
    pub of: usize,
}

impl Part {
    /// A stage that is done in one go.
    pub(crate) const WHOLE: Self = Self { number: 0, of: 1 };

    /// Share of the stage when this share of the part is done.
    fn share(self, done: f64) -> f64 {
        (self.number as f64 + done.clamp(0.0, 1.0)) / self.of.max(1) as f64
    }
}

impl<'a> Context<'a> {
    /// The context of structure `structure` of `structures`.
    #[must_use]
    pub fn new(params: &'a CheckedParams, observer: &'a dyn Observer, structure: usize, structures: usize) -> Self {
        Self { params, repeat: None, observer, structure, structures, part: 0, before: 0, notes: Mutex::default() }
    }

    /// The context of a repeat of the same structure, whose progress nobody hears.
    pub(super) fn of_repeat<'b>(&self, repeat: Repeat<'b>, muted: &'b dyn Observer) -> Context<'b>
    where
        'a: 'b,
    {
        Context { repeat: Some(repeat), ..Context::new(self.params, muted, self.structure, self.structures) }
    }

    /// The context of one part of the structure's label; what is noted there is taken in with [`Self::take_in`].
    pub(super) fn of_part(&self, part: usize) -> Context<'a> {
        let own = Context::new(self.params, self.observer, self.structure, self.structures);
        Context { repeat: self.repeat, part, ..own }
    }

    /// The context of an attempt; what is noted there is taken in with [`Self::take_in`], if it is wanted.
    pub(super) fn apart(&self) -> Context<'a> {
        Context { before: self.before, ..self.of_part(self.part) }
    }

    /// The parameters to choose figures by, where those of the lattice are not: in a repeat its size is given.
    pub(super) fn params_of_shape(&self) -> Option<CheckedParams> {
        if self.repeat.is_some() { None } else { self.params.following_shape() }
    }

    /// The context of an attempt with other parameters.
    pub(super) fn with_params<'b>(&self, params: &'b CheckedParams) -> Context<'b>
    where
        'a: 'b,
    {
        Context { params, ..self.apart() }
    }

    /// The context of an attempt at what repeats have in common.
    pub(super) fn unperturbed(&self) -> Context<'a> {
        Context { repeat: None, ..self.apart() }
    }

    /// The context of what so many figures leave over.
    pub(super) fn of_rest(&self, before: usize) -> Context<'a> {
        Context { before, ..self.of_part(self.part) }
    }

    /// In a repeat, the lattice size of the figure of this number that it repeats.
    pub(crate) fn repeated_size(&self, number: usize) -> Option<LatticeSize> {
        self.repeat?.sizes.get(self.part)?.get(self.before + number).copied()
    }

    /// Takes in what was noted of a part, under its name if it has one.
    pub(super) fn take_in(&self, part: Notes, name: Option<&str>) {
        let mut notes = self.notes();
        for mut warning in part.warnings {
            if let Some(name) = name {
                warning.message = format!("{name}: {}", warning.message);
            }
            notes.warnings.push(warning);
        }
        notes.timings.add_all(&part.timings);
    }

    /// Memory that the run may take.
    pub(super) fn memory_bytes(&self) -> u64 {
        self.observer.memory_bytes()
    }

    /// Runs `work` as a stage: looks whether to stop, reports, and takes the time. Of one that is stopped or refused
    /// no end is reported.
    ///
    /// # Errors
    /// Those of `work`; when it is cancelled.
    pub fn stage<T, E: From<Cancelled>>(&self, stage: Stage, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        self.part_of_stage(stage, Part::WHOLE, work)
    }

    /// Runs `work` as a part of a stage.
    ///
    /// # Errors
    /// Those of `work`; when it is cancelled.
    pub(crate) fn part_of_stage<T, E: From<Cancelled>>(
        &self,
        stage: Stage,
        part: Part,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        self.check()?;
        self.notes().running = Some((stage, part));
        self.tell(0.0);
        let start = Instant::now();
        let result = work();
        self.notes().timings.add(stage, start.elapsed());
        let done = result?;
        self.check()?;
        self.tell(1.0);
        Ok(done)
    }

    /// Reports that this share of the stage, or of the part of it, is done; nothing once the run is to stop.
    pub(crate) fn advance(&self, share: f64) {
        if !self.is_cancelled() {
            self.tell(share);
        }
    }

    fn tell(&self, share: f64) {
        let running = self.notes().running;
        if let Some((stage, part)) = running {
            self.observer.progress(self.structure, self.structures, stage, part.share(share));
        }
    }

    /// Notes something that the reader of the result should know.
    pub fn warn(&self, code: &'static str, message: String) {
        self.notes().warnings.push(Warning { code: code.into(), message });
    }

    /// What the stages have left.
    #[must_use]
    pub(crate) fn into_notes(self) -> Notes {
        self.notes.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn notes(&self) -> MutexGuard<'_, Notes> {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Cancel for Context<'_> {
    fn is_cancelled(&self) -> bool {
        self.observer.is_cancelled()
    }
}
