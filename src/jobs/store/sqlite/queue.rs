//! Jobs from the view of workers.

use std::collections::BTreeMap;

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::{AssertSqlSafe, Row, Sqlite, SqliteExecutor};

use super::{SqliteStore, rows, statements};
use crate::jobs::job::{JobId, JobState, JobWarning, ResultFile};
use crate::jobs::moves::Cause;
use crate::jobs::store::sql::{self, MoveSql, WITHOUT_LEASE};
use crate::jobs::store::{
    Claim, Held, Lease, MAX_ATTEMPTS, Outcome, QueueLoad, QueueStore, Reclaim, StoreError, new_token, too_many_attempts,
};
use crate::problem::Problem;

#[async_trait]
impl QueueStore for SqliteStore {
    async fn load(&self, owner: &str) -> Result<QueueLoad, StoreError> {
        load(&self.reader, owner).await
    }

    async fn oldest_queued(&self) -> Result<Option<Timestamp>, StoreError> {
        let row = sqlx::query(statements::OLDEST).fetch_optional(&self.reader).await?;
        row.map_or(Ok(None), |row| rows::time(&row, "created_at_ms"))
    }

    async fn positions(&self, ids: &[JobId]) -> Result<BTreeMap<JobId, u64>, StoreError> {
        let mut reads = self.reader.begin().await?;
        let mut turns = Vec::new();
        for id in ids {
            let row = sqlx::query(statements::TURN).bind(id.to_string()).fetch_optional(&mut *reads).await?;
            if let Some(row) = row {
                turns.push((row.try_get::<i64, _>("turn_ms")?, *id));
            }
        }
        // Counted from one to the next: the queue is gone through once, however many are asked for.
        turns.sort_unstable_by_key(|(turn, id)| (*turn, id.to_string()));
        let (mut places, mut place, mut after) = (BTreeMap::new(), 0, (i64::MIN, String::new()));
        for (turn, id) in turns {
            let until = (turn, id.to_string());
            let passed = sqlx::query(statements::PASSED)
                .bind(after.0)
                .bind(after.1)
                .bind(until.0)
                .bind(&until.1)
                .fetch_one(&mut *reads)
                .await?;
            place += rows::count(&passed, 0)?;
            places.insert(id, place);
            after = until;
        }
        Ok(places)
    }

    async fn claim(&self, instance: &str, now: Timestamp, until: Timestamp) -> Result<Option<Claim>, StoreError> {
        let token = new_token();
        let MoveSql { set, from } = sql::moves(Cause::Claim);
        let first = statements::FIRST;
        let claimed = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, attempt = attempt + 1, lease_token = $2, lease_until_ms = $3,
                started_at_ms = CAST($1 AS BIGINT), instance = $4
             WHERE {from} AND id =
                ({first})
             AND NOT EXISTS
                (SELECT 1 FROM jobs AS beside
                 WHERE beside.instance = $4 AND beside.state = 'running' AND (beside.suspect = 1 OR jobs.suspect = 1))
             RETURNING *"
        )))
        .bind(now.as_millisecond())
        .bind(&token)
        .bind(until.as_millisecond())
        .bind(instance);
        let Some(row) = self.change_hastily(claimed).await? else { return Ok(None) };
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
        let MoveSql { set, from } = sql::moves(outcome.cause());
        let written = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, error = $4, warnings = $5, results = $6, program = $7, results_token = $8, results_bytes = $9,
                {WITHOUT_LEASE}
             WHERE id = $2 AND lease_token = $3 AND {from}"
        )))
        .bind(now.as_millisecond())
        .bind(lease.id.to_string())
        .bind(&lease.token)
        .bind(ended.error.map(rows::to_json))
        .bind(rows::to_json(&ended.warnings))
        .bind(rows::to_json(&ended.results))
        .bind(ended.program)
        .bind(matches!(outcome, Outcome::Succeeded { .. }).then_some(&lease.token))
        .bind(rows::bytes_of(ended.results))
        .execute(&self.writer)
        .await?;
        is_held(written.rows_affected())
    }

    async fn release(&self, lease: &Lease, now: Timestamp) -> Result<(), StoreError> {
        let MoveSql { set, from } = sql::moves(Cause::Release);
        let written = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, attempt = attempt - 1, started_at_ms = NULL, {WITHOUT_LEASE}
             WHERE id = $2 AND lease_token = $3 AND {from}"
        )))
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
        // Nobody begins a run in a process that is gone: what is counted stays so.
        let ran = sqlx::query("SELECT count(*) FROM jobs WHERE instance = $1 AND state = 'running'").bind(instance);
        let are_suspects = rows::count(&ran.fetch_one(&self.reader).await?, 0)? > 1;
        // Of several, nobody knows which took the process down: none is charged, and each runs alone next.
        let (max_attempts, uncharged) = if are_suspects { (u32::MAX, 1) } else { (MAX_ATTEMPTS, 0) };
        // One statement: a job is either ended or queued again, whatever happens to this process.
        let MoveSql { set, from } = sql::loss(max_attempts);
        let rows = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, {WITHOUT_LEASE},
                error = CASE WHEN cancel_requested = 0 AND attempt >= {max_attempts} THEN $2 END,
                attempt = attempt - {uncharged}, suspect = CASE WHEN {uncharged} = 1 THEN 1 ELSE suspect END
             WHERE {from} AND (instance = $3 OR lease_until_ms < $4) RETURNING id, state"
        )))
        .bind(now.as_millisecond())
        .bind(rows::to_json(&too_many_attempts()))
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
    let row = sqlx::query(statements::LOAD).bind(owner).fetch_one(executor).await?;
    Ok(QueueLoad {
        jobs: rows::count(&row, 0)?,
        bytes: rows::count(&row, 1)?,
        own_jobs: rows::count(&row, 2)?,
        own_bytes: rows::count(&row, 3)?,
        kept_bytes: rows::count(&row, 4)?,
    })
}

fn is_held(rows_written: u64) -> Result<(), StoreError> {
    if rows_written == 0 { Err(StoreError::StaleLease) } else { Ok(()) }
}

/// An outcome in columns.
struct Ended<'a> {
    error: Option<&'a Problem>,
    warnings: &'a [JobWarning],
    results: &'a [ResultFile],
    program: Option<&'a str>,
}

impl<'a> From<&'a Outcome> for Ended<'a> {
    fn from(outcome: &'a Outcome) -> Self {
        let nothing = Self { error: None, warnings: &[], results: &[], program: None };
        match outcome {
            Outcome::Succeeded { results, warnings, program } => {
                Self { warnings, results, program: Some(program), ..nothing }
            }
            Outcome::Failed(problem) => Self { error: Some(problem), ..nothing },
            Outcome::Canceled => nothing,
        }
    }
}
