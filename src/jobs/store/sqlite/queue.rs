//! Jobs from the view of workers.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::{Row, Sqlite, SqliteExecutor};
use uuid::Uuid;

use super::{SqliteStore, rows};
use crate::jobs::job::{JobId, JobState, JobWarning, ResultFile};
use crate::jobs::store::{Claim, Held, Lease, MAX_ATTEMPTS, Outcome, QueueLoad, QueueStore, Reclaim, StoreError};
use crate::problem::Problem;

#[async_trait]
impl QueueStore for SqliteStore {
    async fn load(&self, owner: &str) -> Result<QueueLoad, StoreError> {
        load(&self.reader, owner).await
    }

    async fn oldest_queued(&self) -> Result<Option<Timestamp>, StoreError> {
        let row = sqlx::query("SELECT min(created_at_ms) AS oldest FROM jobs WHERE state = 'queued'");
        rows::time(&row.fetch_one(&self.reader).await?, "oldest")
    }

    async fn count_queued_before(&self, id: JobId) -> Result<u64, StoreError> {
        let row = sqlx::query(
            "SELECT count(*) FROM jobs AS other JOIN jobs AS own ON own.id = $1 WHERE other.state = 'queued'
             AND (other.turn_ms < own.turn_ms OR (other.turn_ms = own.turn_ms AND other.id < own.id))",
        )
        .bind(id.to_string())
        .fetch_one(&self.reader)
        .await?;
        rows::count(&row, 0)
    }

    async fn claim(&self, instance: &str, now: Timestamp, until: Timestamp) -> Result<Option<Claim>, StoreError> {
        let token = Uuid::now_v7().hyphenated().to_string();
        let claimed = sqlx::query(
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease_token = $1, lease_until_ms = $2,
                started_at_ms = CAST($3 AS BIGINT), history = history || ' running@' || CAST($3 AS TEXT), instance = $4
             WHERE state = 'queued' AND id =
                (SELECT waiting.id FROM jobs AS waiting LEFT JOIN
                    (SELECT owner, count(*) AS jobs FROM jobs WHERE state = 'running' GROUP BY owner) AS busy
                    ON busy.owner = waiting.owner
                 WHERE waiting.state = 'queued'
                 ORDER BY coalesce(busy.jobs, 0), waiting.turn_ms, waiting.id LIMIT 1)
             RETURNING *",
        )
        .bind(&token)
        .bind(until.as_millisecond())
        .bind(now.as_millisecond())
        .bind(instance);
        let Some(row) = self.change(claimed).await? else { return Ok(None) };
        let job = rows::job(&row)?;
        Ok(Some(Claim { lease: Lease { id: job.id, token }, job }))
    }

    async fn extend(&self, lease: &Lease, until: Timestamp) -> Result<(), StoreError> {
        let extended =
            sqlx::query("UPDATE jobs SET lease_until_ms = $1 WHERE id = $2 AND lease_token = $3 AND state = 'running'")
                .bind(until.as_millisecond())
                .bind(lease.id.to_string())
                .bind(&lease.token)
                .execute(&self.writer)
                .await?;
        is_held(extended.rows_affected())
    }

    async fn held_by(&self, instance: &str) -> Result<Vec<Held>, StoreError> {
        let rows =
            sqlx::query("SELECT id, lease_token, cancel_requested FROM jobs WHERE state = 'running' AND instance = $1")
                .bind(instance)
                .fetch_all(&self.reader)
                .await?;
        let held = |row| {
            let lease = Lease { id: rows::id(row)?, token: row.try_get("lease_token")? };
            Ok(Held { lease, cancel_requested: rows::flag(row, "cancel_requested")? })
        };
        rows.iter().map(held).collect()
    }

    async fn finish(&self, lease: &Lease, outcome: &Outcome, now: Timestamp) -> Result<(), StoreError> {
        let ended = Ended::from(outcome);
        let written = sqlx::query(
            "UPDATE jobs SET state = $1, error = $2, warnings = $3, results = $4, results_token = $5, program = $6,
                ended_at_ms = CAST($7 AS BIGINT), history = history || ' ' || $1 || '@' || CAST($7 AS TEXT),
                callback_state = CASE WHEN callback_url IS NULL THEN NULL ELSE 'due' END,
                callback_due_ms = CASE WHEN callback_url IS NULL THEN NULL ELSE CAST($7 AS BIGINT) END,
                lease_token = NULL, lease_until_ms = NULL, instance = NULL
             WHERE id = $8 AND lease_token = $9 AND state = 'running'",
        )
        .bind(ended.state.name())
        .bind(ended.error.map(rows::to_json))
        .bind(rows::to_json(&ended.warnings))
        .bind(rows::to_json(&ended.results))
        .bind((ended.state == JobState::Succeeded).then_some(&lease.token))
        .bind(ended.program)
        .bind(now.as_millisecond())
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .execute(&self.writer)
        .await?;
        is_held(written.rows_affected())
    }

    async fn release(&self, lease: &Lease, now: Timestamp) -> Result<(), StoreError> {
        let written = sqlx::query(
            "UPDATE jobs SET state = 'queued', attempt = attempt - 1, started_at_ms = NULL, lease_token = NULL,
                lease_until_ms = NULL, instance = NULL, history = history || ' queued@' || CAST($1 AS TEXT)
             WHERE id = $2 AND lease_token = $3 AND state = 'running'",
        )
        .bind(now.as_millisecond())
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .execute(&self.writer)
        .await?;
        is_held(written.rows_affected())
    }

    async fn reclaim(&self, which: Reclaim<'_>, now: Timestamp) -> Result<Vec<(JobId, JobState)>, StoreError> {
        let (instance, before) = match which {
            Reclaim::Instance(instance) => (Some(instance), None),
            Reclaim::LeaseBefore(time) => (None, Some(time.as_millisecond())),
        };
        // One statement: a job is either ended or queued again, whatever happens to this process.
        let rows = sqlx::query(
            "UPDATE jobs SET
                state = CASE WHEN cancel_requested = 1 THEN 'canceled' WHEN attempt >= $1 THEN 'failed' ELSE 'queued' END,
                error = CASE WHEN cancel_requested = 0 AND attempt >= $1 THEN $2 ELSE NULL END,
                ended_at_ms = CASE WHEN cancel_requested = 1 OR attempt >= $1 THEN CAST($3 AS BIGINT) ELSE NULL END,
                history = history || CASE WHEN cancel_requested = 1 THEN ' canceled@' WHEN attempt >= $1 THEN ' failed@'
                                          ELSE ' queued@' END || CAST($3 AS TEXT),
                callback_state = CASE WHEN callback_url IS NULL THEN NULL
                                      WHEN cancel_requested = 1 OR attempt >= $1 THEN 'due' ELSE 'waiting' END,
                callback_due_ms = CASE WHEN cancel_requested = 1 OR attempt >= $1 THEN CAST($3 AS BIGINT) ELSE NULL END,
                lease_token = NULL, lease_until_ms = NULL, instance = NULL
             WHERE state = 'running' AND (instance = $4 OR lease_until_ms < $5) RETURNING id, state",
        )
        .bind(i64::from(MAX_ATTEMPTS))
        .bind(rows::to_json(&too_many_attempts()))
        .bind(now.as_millisecond())
        .bind(instance)
        .bind(before)
        .fetch_all(&self.writer)
        .await?;
        rows.iter().map(|row| Ok((rows::id(row)?, rows::state(row)?))).collect()
    }
}

/// What waits, read from whatever connection or transaction is given.
pub(super) async fn load<'a>(
    executor: impl SqliteExecutor<'a, Database = Sqlite>,
    owner: &str,
) -> Result<QueueLoad, StoreError> {
    let row = sqlx::query(
        "SELECT count(*), coalesce(sum(mask_bytes), 0), count(CASE WHEN owner = $1 THEN 1 END),
                coalesce(sum(CASE WHEN owner = $1 THEN mask_bytes END), 0)
         FROM jobs WHERE state = 'queued'",
    )
    .bind(owner)
    .fetch_one(executor)
    .await?;
    Ok(QueueLoad {
        jobs: rows::count(&row, 0)?,
        bytes: rows::count(&row, 1)?,
        own_jobs: rows::count(&row, 2)?,
        own_bytes: rows::count(&row, 3)?,
    })
}

fn is_held(rows_written: u64) -> Result<(), StoreError> {
    if rows_written == 0 { Err(StoreError::StaleLease) } else { Ok(()) }
}

/// An outcome in columns.
struct Ended<'a> {
    state: JobState,
    error: Option<&'a Problem>,
    warnings: &'a [JobWarning],
    results: &'a [ResultFile],
    program: Option<&'a str>,
}

impl<'a> From<&'a Outcome> for Ended<'a> {
    fn from(outcome: &'a Outcome) -> Self {
        let without = |state| Self { state, error: None, warnings: &[], results: &[], program: None };
        match outcome {
            Outcome::Succeeded { results, warnings, program } => {
                Self { warnings, results, program: Some(program), ..without(JobState::Succeeded) }
            }
            Outcome::Failed(problem) => Self { error: Some(problem), ..without(JobState::Failed) },
            Outcome::Canceled => without(JobState::Canceled),
        }
    }
}

fn too_many_attempts() -> Problem {
    let detail = format!("the job was begun {MAX_ATTEMPTS} times and the server stopped each time");
    Problem::new(500, "too_many_attempts", detail)
        .hint("send it once more on its own; if it fails again, the mask is more than this server can take")
}
