//! The store in one SQLite file.
//!
//! WAL with `synchronous=FULL`: a commit is on disk when the call returns. One connection writes,
//! so that writers queue in this process instead of failing with "database is locked"; reads have
//! connections of their own. Every change is one statement or one transaction.

use std::path::Path;
use std::time::Duration;

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteRow, SqliteSynchronous,
};
use sqlx::{Row, SqlSafeStr};
use uuid::Uuid;

use super::job::{Job, JobId, JobState, MaskInfo};
use super::store::{
    CancelAnswer, Claim, JobStore, Lease, ListQuery, MAX_ATTEMPTS, NewJob, Outcome, Reclaim, StoreError,
};
use crate::problem::Problem;

/// Status polls are short reads; a few connections serve thousands a second.
const READ_CONNECTIONS: u32 = 4;
/// How long a connection waits for a lock that a backup or a checkpoint holds.
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

/// Jobs in a SQLite file.
#[derive(Clone, Debug)]
pub struct SqliteStore {
    writer: SqlitePool,
    reader: SqlitePool,
}

impl SqliteStore {
    /// Opens the file, making it when it is missing, and brings its tables up to date.
    ///
    /// # Errors
    /// When the file cannot be opened or is of a later version of this program.
    pub async fn open(path: &Path) -> Result<Self, StoreError> {
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .busy_timeout(BUSY_TIMEOUT)
            // The file system may be read-only outside of the data directory.
            .pragma("temp_store", "memory");
        let writer = SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        migrator().run(&writer).await?;
        let reader = SqlitePoolOptions::new().max_connections(READ_CONNECTIONS).connect_with(options).await?;
        Ok(Self { writer, reader })
    }
}

fn migrator() -> Migrator {
    let migration = |version, name: &'static str, sql: &'static str| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(vec![
        migration(1, "jobs", include_str!("../../migrations/sqlite/0001_jobs.sql")),
        migration(2, "turns", include_str!("../../migrations/sqlite/0002_turns.sql")),
    ])
}

#[async_trait]
impl JobStore for SqliteStore {
    async fn insert(&self, job: &NewJob, max_queued: u64) -> Result<(), StoreError> {
        let inserted = sqlx::query(
            "INSERT INTO jobs (id, state, owner, labels, mask_sha256, mask_bytes, params, attempt, cancel_requested,
                               created_at_ms, turn_ms, warnings, results)
             SELECT $1, 'queued', '', '{}', $2, CAST($3 AS BIGINT), $4, 0, 0, CAST($5 AS BIGINT), CAST($6 AS BIGINT),
                    '[]', '[]'
             WHERE (SELECT count(*) FROM jobs WHERE state = 'queued') < $7",
        )
        .bind(job.id.to_string())
        .bind(&job.mask.sha256)
        .bind(clamped(job.mask.bytes))
        .bind(&job.params_json)
        .bind(job.created_at.as_millisecond())
        .bind(job.turn_ms())
        .bind(clamped(max_queued))
        .execute(&self.writer)
        .await?;
        if inserted.rows_affected() == 0 { Err(StoreError::QueueFull) } else { Ok(()) }
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>, StoreError> {
        let row =
            sqlx::query("SELECT * FROM jobs WHERE id = $1").bind(id.to_string()).fetch_optional(&self.reader).await?;
        row.as_ref().map(job_from_row).transpose()
    }

    async fn list(&self, query: ListQuery) -> Result<Vec<Job>, StoreError> {
        let rows = sqlx::query(
            "SELECT * FROM jobs
             WHERE (CAST($1 AS TEXT) IS NULL OR state = $1) AND (CAST($2 AS TEXT) IS NULL OR id < $2)
             ORDER BY id DESC LIMIT $3",
        )
        .bind(query.state.map(JobState::name))
        .bind(query.before.map(|id| id.to_string()))
        .bind(i64::from(query.limit))
        .fetch_all(&self.reader)
        .await?;
        rows.iter().map(job_from_row).collect()
    }

    async fn count_queued(&self) -> Result<u64, StoreError> {
        let row = sqlx::query("SELECT count(*) FROM jobs WHERE state = 'queued'").fetch_one(&self.reader).await?;
        Ok(row.try_get::<i64, _>(0)?.unsigned_abs())
    }

    async fn count_queued_before(&self, id: JobId) -> Result<u64, StoreError> {
        let row = sqlx::query(
            "SELECT count(*) FROM jobs AS other JOIN jobs AS own ON own.id = $1 WHERE other.state = 'queued'
             AND (other.turn_ms < own.turn_ms OR (other.turn_ms = own.turn_ms AND other.id < own.id))",
        )
        .bind(id.to_string())
        .fetch_one(&self.reader)
        .await?;
        Ok(row.try_get::<i64, _>(0)?.unsigned_abs())
    }

    async fn claim(&self, now: Timestamp, until: Timestamp) -> Result<Option<Claim>, StoreError> {
        let token = Uuid::now_v7().hyphenated().to_string();
        let row = sqlx::query(
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease_token = $1, lease_until_ms = $2,
                             started_at_ms = $3
             WHERE state = 'queued' AND id = (SELECT id FROM jobs WHERE state = 'queued' ORDER BY turn_ms, id
                                              LIMIT 1)
             RETURNING *",
        )
        .bind(&token)
        .bind(until.as_millisecond())
        .bind(now.as_millisecond())
        .fetch_optional(&self.writer)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let job = job_from_row(&row)?;
        Ok(Some(Claim { lease: Lease { id: job.id, token }, job }))
    }

    async fn extend(&self, lease: &Lease, until: Timestamp) -> Result<bool, StoreError> {
        let row = sqlx::query(
            "UPDATE jobs SET lease_until_ms = $1 WHERE id = $2 AND lease_token = $3 AND state = 'running'
             RETURNING cancel_requested",
        )
        .bind(until.as_millisecond())
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .fetch_optional(&self.writer)
        .await?
        .ok_or(StoreError::StaleLease)?;
        Ok(row.try_get::<i64, _>(0)? != 0)
    }

    async fn finish(&self, lease: &Lease, outcome: &Outcome, now: Timestamp) -> Result<(), StoreError> {
        let ended = Ended::from(outcome);
        let written = sqlx::query(
            "UPDATE jobs SET state = $1, error = $2, warnings = $3, results = $4, results_token = $5,
                             ended_at_ms = $6, lease_token = NULL, lease_until_ms = NULL
             WHERE id = $7 AND lease_token = $8 AND state = 'running'",
        )
        .bind(ended.state.name())
        .bind(ended.error_json)
        .bind(ended.warnings_json)
        .bind(ended.results_json)
        .bind((ended.state == JobState::Succeeded).then_some(&lease.token))
        .bind(now.as_millisecond())
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .execute(&self.writer)
        .await?;
        if written.rows_affected() == 0 { Err(StoreError::StaleLease) } else { Ok(()) }
    }

    async fn release(&self, lease: &Lease) -> Result<(), StoreError> {
        let written = sqlx::query(
            "UPDATE jobs SET state = 'queued', attempt = attempt - 1, started_at_ms = NULL, lease_token = NULL,
                             lease_until_ms = NULL
             WHERE id = $1 AND lease_token = $2 AND state = 'running'",
        )
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .execute(&self.writer)
        .await?;
        if written.rows_affected() == 0 { Err(StoreError::StaleLease) } else { Ok(()) }
    }

    async fn reclaim(&self, which: Reclaim, now: Timestamp) -> Result<u64, StoreError> {
        let before = match which {
            Reclaim::All => i64::MAX,
            Reclaim::LeaseBefore(time) => time.as_millisecond(),
        };
        // One statement: a job is either ended or queued again, whatever happens to this process.
        let written = sqlx::query(
            "UPDATE jobs SET
                state = CASE WHEN cancel_requested = 1 THEN 'canceled' WHEN attempt >= $1 THEN 'failed' ELSE 'queued' END,
                error = CASE WHEN cancel_requested = 0 AND attempt >= $1 THEN $2 ELSE NULL END,
                ended_at_ms = CASE WHEN cancel_requested = 1 OR attempt >= $1 THEN CAST($3 AS BIGINT) ELSE NULL END,
                lease_token = NULL, lease_until_ms = NULL
             WHERE state = 'running' AND lease_until_ms < $4",
        )
        .bind(i64::from(MAX_ATTEMPTS))
        .bind(json(&too_many_attempts()))
        .bind(now.as_millisecond())
        .bind(before)
        .execute(&self.writer)
        .await?;
        Ok(written.rows_affected())
    }

    async fn cancel(&self, id: JobId, now: Timestamp) -> Result<CancelAnswer, StoreError> {
        let row = sqlx::query(
            "UPDATE jobs SET cancel_requested = 1,
                             ended_at_ms = CASE WHEN state = 'queued' THEN CAST($1 AS BIGINT) ELSE NULL END,
                             state = CASE WHEN state = 'queued' THEN 'canceled' ELSE state END
             WHERE id = $2 AND state IN ('queued', 'running') RETURNING state",
        )
        .bind(now.as_millisecond())
        .bind(id.to_string())
        .fetch_optional(&self.writer)
        .await?;
        match row {
            Some(row) if state_from_row(&row)? == JobState::Running => Ok(CancelAnswer::Requested),
            Some(_) => Ok(CancelAnswer::Canceled),
            None => Ok(self.get(id).await?.map_or(CancelAnswer::NotFound, |job| CancelAnswer::AlreadyEnded(job.state))),
        }
    }

    async fn delete(&self, id: JobId) -> Result<bool, StoreError> {
        let deleted = sqlx::query("DELETE FROM jobs WHERE id = $1").bind(id.to_string()).execute(&self.writer).await?;
        Ok(deleted.rows_affected() > 0)
    }

    async fn kept_files(&self) -> Result<Vec<(JobId, Option<String>)>, StoreError> {
        let rows = sqlx::query("SELECT id, results_token FROM jobs").fetch_all(&self.reader).await?;
        rows.iter().map(|row| Ok((id_from_row(row)?, row.try_get("results_token")?))).collect()
    }

    async fn check_writable(&self) -> Result<(), StoreError> {
        sqlx::query(
            "INSERT INTO write_checks (id, checked_at_ms) VALUES ('ready', $1)
             ON CONFLICT (id) DO UPDATE SET checked_at_ms = excluded.checked_at_ms",
        )
        .bind(Timestamp::now().as_millisecond())
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn close(&self) {
        self.reader.close().await;
        self.writer.close().await;
    }
}

/// An outcome in columns.
struct Ended {
    state: JobState,
    error_json: Option<String>,
    warnings_json: String,
    results_json: String,
}

impl From<&Outcome> for Ended {
    fn from(outcome: &Outcome) -> Self {
        let empty = || "[]".to_owned();
        match outcome {
            Outcome::Succeeded { results, warnings } => Self {
                state: JobState::Succeeded,
                error_json: None,
                warnings_json: json(warnings),
                results_json: json(results),
            },
            Outcome::Failed(problem) => Self {
                state: JobState::Failed,
                error_json: Some(json(problem)),
                warnings_json: empty(),
                results_json: empty(),
            },
            Outcome::Canceled => {
                Self { state: JobState::Canceled, error_json: None, warnings_json: empty(), results_json: empty() }
            }
        }
    }
}

fn too_many_attempts() -> Problem {
    let detail = format!("the job was begun {MAX_ATTEMPTS} times and the server stopped each time");
    Problem::new(500, "too_many_attempts", detail)
        .hint("send it once more on its own; if it fails again, the mask is more than this server can take")
}

fn job_from_row(row: &SqliteRow) -> Result<Job, StoreError> {
    let error: Option<String> = row.try_get("error")?;
    Ok(Job {
        id: id_from_row(row)?,
        state: state_from_row(row)?,
        attempt: u32::try_from(row.try_get::<i64, _>("attempt")?).map_err(|_| corrupt("attempt"))?,
        cancel_requested: row.try_get::<i64, _>("cancel_requested")? != 0,
        mask: MaskInfo {
            sha256: row.try_get("mask_sha256")?,
            bytes: row.try_get::<i64, _>("mask_bytes")?.unsigned_abs(),
        },
        params_json: row.try_get("params")?,
        created_at: time_from_row(row, "created_at_ms")?.ok_or_else(|| corrupt("created_at_ms"))?,
        started_at: time_from_row(row, "started_at_ms")?,
        ended_at: time_from_row(row, "ended_at_ms")?,
        error: error.map(|text| serde_json::from_str(&text).map_err(|_| corrupt("error"))).transpose()?,
        warnings: json_from_row(row, "warnings")?,
        results: json_from_row(row, "results")?,
        results_token: row.try_get("results_token")?,
    })
}

fn id_from_row(row: &SqliteRow) -> Result<JobId, StoreError> {
    JobId::parse(row.try_get("id")?).ok_or_else(|| corrupt("id"))
}

fn state_from_row(row: &SqliteRow) -> Result<JobState, StoreError> {
    JobState::from_name(row.try_get("state")?).ok_or_else(|| corrupt("state"))
}

fn time_from_row(row: &SqliteRow, column: &'static str) -> Result<Option<Timestamp>, StoreError> {
    let ms: Option<i64> = row.try_get(column)?;
    ms.map(|ms| Timestamp::from_millisecond(ms).map_err(|_| corrupt(column))).transpose()
}

fn json_from_row<T: serde::de::DeserializeOwned>(row: &SqliteRow, column: &'static str) -> Result<T, StoreError> {
    serde_json::from_str(row.try_get(column)?).map_err(|_| corrupt(column))
}

fn corrupt(column: &'static str) -> StoreError {
    StoreError::Corrupt { column }
}

/// JSON of plain data.
fn json<T: serde::Serialize>(value: &T) -> String {
    serde_json::to_string(value).expect("plain structs with string keys are JSON")
}

/// SQL has signed integers only; no size or count comes near their end.
fn clamped(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
