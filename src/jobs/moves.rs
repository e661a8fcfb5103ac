//! How a job moves from state to state: one table, which every statement of every store follows.
//!
//! | cause          | queued    | running   | succeeded | failed | canceled |
//! |----------------|-----------|-----------|-----------|--------|----------|
//! | `Claim`        | running   | -         | -         | -      | -        |
//! | `Reuse`        | succeeded | -         | -         | -      | -        |
//! | `Cancel`       | canceled  | running   | -         | -      | -        |
//! | `Succeed`      | -         | succeeded | -         | -      | -        |
//! | `Fail`         | -         | failed    | -         | -      | -        |
//! | `Stop`         | -         | canceled  | -         | -      | -        |
//! | `Release`      | -         | queued    | -         | -      | -        |
//! | `Lose`         | -         | queued    | -         | -      | -        |
//! | `LoseOften`    | -         | failed    | -         | -      | -        |
//! | `LoseUnwanted` | -         | canceled  | -         | -      | -        |
//! | `Retry`        | -         | -         | -         | queued | queued   |
//!
//! `-` is refused: nothing changes. A job begins as queued. To delete one is no move: that may be
//! done in every state, and no job is left.

use super::job::JobState;

/// Why a job moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// A worker takes it.
    Claim,
    /// An equal request left results: nothing is to be run.
    Reuse,
    /// Its client asks for its end. One that runs goes on until its worker hears of it.
    Cancel,
    /// Its worker has results.
    Succeed,
    /// Its worker has an error.
    Fail,
    /// Its worker has stopped it, as its client asked.
    Stop,
    /// Its worker gives it back unfinished.
    Release,
    /// Its worker is gone.
    Lose,
    /// Its worker is gone, and so were those before it.
    LoseOften,
    /// Its worker is gone, and its client had asked for its end.
    LoseUnwanted,
    /// Its client wants it run again.
    Retry,
}

impl Cause {
    /// All causes.
    pub const ALL: [Self; 11] = [
        Self::Claim,
        Self::Reuse,
        Self::Cancel,
        Self::Succeed,
        Self::Fail,
        Self::Stop,
        Self::Release,
        Self::Lose,
        Self::LoseOften,
        Self::LoseUnwanted,
        Self::Retry,
    ];

    /// The legal moves that it causes: the state left, and the one come to.
    pub fn moves(self) -> impl Iterator<Item = (JobState, JobState)> {
        JobState::ALL.into_iter().filter_map(move |from| Some((from, from.after(self)?)))
    }
}

impl JobState {
    /// The state of every new job.
    pub const FIRST: Self = Self::Queued;

    /// The state that a job in this one comes into; `None` when the move is not legal.
    #[must_use]
    pub fn after(self, cause: Cause) -> Option<Self> {
        use Cause::{Cancel, Claim, Fail, Lose, LoseOften, LoseUnwanted, Release, Retry, Reuse, Stop, Succeed};
        match (self, cause) {
            (Self::Queued, Claim) | (Self::Running, Cancel) => Some(Self::Running),
            (Self::Queued, Reuse) | (Self::Running, Succeed) => Some(Self::Succeeded),
            (Self::Queued, Cancel) | (Self::Running, Stop | LoseUnwanted) => Some(Self::Canceled),
            (Self::Running, Fail | LoseOften) => Some(Self::Failed),
            (Self::Running, Release | Lose) | (Self::Failed | Self::Canceled, Retry) => Some(Self::Queued),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table at the head of this file: cause, then a cell for each state.
    fn table() -> Vec<Vec<&'static str>> {
        let lines = include_str!("moves.rs").lines().filter_map(|line| line.strip_prefix("//! | "));
        lines.map(|line| line.split('|').map(str::trim).filter(|cell| !cell.is_empty()).collect()).collect()
    }

    #[test]
    fn every_move_is_as_the_table_says() {
        let table = table();
        assert_eq!(table[0][1..], JobState::ALL.map(JobState::name));
        let rows = &table[1..];
        assert_eq!(rows.len(), Cause::ALL.len());
        for (row, cause) in rows.iter().zip(Cause::ALL) {
            assert_eq!(row[0], format!("`{cause:?}`"));
            for (state, cell) in JobState::ALL.into_iter().zip(&row[1..]) {
                let after = state.after(cause).map_or("-", JobState::name);
                assert_eq!(after, *cell, "{cause:?} of a job that is {}", state.name());
            }
        }
    }

    #[test]
    fn what_succeeded_stays_and_what_ended_moves_only_to_be_run_again() {
        for cause in Cause::ALL {
            for (from, to) in cause.moves() {
                assert_ne!(from, JobState::Succeeded, "{cause:?}");
                assert!(!from.has_ended() || (cause, to) == (Cause::Retry, JobState::Queued), "{cause:?}");
            }
        }
    }
}
