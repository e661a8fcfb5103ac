//! The moves of a job as SQL: text made from the table in [`moves`](crate::jobs::moves), so that no
//! statement can say otherwise. Plain enough for every database. `$1` is the time of the move,
//! milliseconds.

use crate::jobs::job::JobState;
use crate::jobs::moves::Cause;

/// Nobody has the job any more.
pub(super) const WITHOUT_LEASE: &str = "lease_token = NULL, lease_until_ms = NULL, instance = NULL";

/// A statement's `SET` and `WHERE`.
pub(super) struct MoveSql {
    /// What every move writes: the state, the history, and what follows from the end of a job or from its
    /// going on.
    pub(super) set: String,
    /// Which jobs can be moved.
    pub(super) from: String,
}

/// The moves of one cause.
pub(super) fn moves(cause: Cause) -> MoveSql {
    MoveSql { set: set(&target(cause)), from: from(cause) }
}

/// What becomes of jobs whose worker is gone after `max_attempts` or fewer attempts.
pub(super) fn loss(max_attempts: u32) -> MoveSql {
    let target = format!(
        "CASE WHEN cancel_requested = 1 THEN {} WHEN attempt >= {max_attempts} THEN {} ELSE {} END",
        target(Cause::LoseUnwanted),
        target(Cause::LoseOften),
        target(Cause::Lose)
    );
    MoveSql { set: set(&target), from: from(Cause::Lose) }
}

fn from(cause: Cause) -> String {
    is_one_of("state", cause.moves().map(|(from, _)| from))
}

/// The state come to, from whichever is left.
fn target(cause: Cause) -> String {
    let moves: Vec<_> = cause.moves().collect();
    if let [(_, first), rest @ ..] = moves.as_slice()
        && rest.iter().all(|(_, to)| to == first)
    {
        return quoted(*first);
    }
    let mut cases = String::from("CASE state");
    for (from, to) in moves {
        cases.push_str(&format!(" WHEN {} THEN {}", quoted(from), quoted(to)));
    }
    cases + " END"
}

/// A statement's expressions all see the row as it was before.
fn set(target: &str) -> String {
    let has_ended = is_one_of(target, JobState::ALL.into_iter().filter(|state| state.has_ended()));
    let has_succeeded = is_one_of(target, [JobState::Succeeded].into_iter());
    format!(
        "state = {target},
         history = CASE WHEN state = {target} THEN history
                        ELSE history || ' ' || {target} || '@' || CAST(CAST($1 AS BIGINT) AS TEXT) END,
         ended_at_ms = CASE WHEN {has_ended} THEN CAST($1 AS BIGINT) END,
         callback_state = CASE WHEN callback_url IS NULL THEN NULL WHEN {has_ended} THEN 'due' ELSE 'waiting' END,
         callback_due_ms = CASE WHEN callback_url IS NOT NULL AND {has_ended} THEN CAST($1 AS BIGINT) END,
         delivery_state = CASE WHEN delivery_to IS NULL THEN NULL WHEN {has_succeeded} THEN 'due' ELSE 'waiting' END,
         delivery_due_ms = CASE WHEN delivery_to IS NOT NULL AND {has_succeeded} THEN CAST($1 AS BIGINT) END"
    )
}

fn is_one_of(what: &str, states: impl Iterator<Item = JobState>) -> String {
    let states: Vec<String> = states.map(quoted).collect();
    match states.as_slice() {
        [state] => format!("{what} = {state}"),
        states => format!("{what} IN ({})", states.join(", ")),
    }
}

fn quoted(state: JobState) -> String {
    format!("'{}'", state.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statements_name_the_states_that_they_leave() {
        assert_eq!(from(Cause::Claim), "state = 'queued'");
        assert_eq!(from(Cause::Retry), "state IN ('failed', 'canceled')");
        assert_eq!(target(Cause::Retry), "'queued'");
        assert_eq!(target(Cause::Cancel), "CASE state WHEN 'queued' THEN 'canceled' WHEN 'running' THEN 'running' END");
    }

    #[test]
    fn however_a_worker_is_lost_its_jobs_are_the_same() {
        assert_eq!(from(Cause::Lose), from(Cause::LoseOften));
        assert_eq!(from(Cause::Lose), from(Cause::LoseUnwanted));
    }
}
