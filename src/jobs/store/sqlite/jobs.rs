//! Jobs from the view of clients.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::{AssertSqlSafe, Row, Sqlite, SqliteExecutor, Transaction};

use super::queue::load;
use super::{SqliteStore, rows, statements};
use crate::jobs::job::{Job, JobId, JobState, ResultFile};
use crate::jobs::moves::Cause;
use crate::jobs::store::sql::{self, MoveSql};
use crate::jobs::store::{
    CancelAnswer, Inserted, JobStore, ListQuery, NewJob, QueueLimits, RetryAnswer, Reused, StoreError, host_of, turn_ms,
};

#[async_trait]
impl JobStore for SqliteStore {
    async fn insert(&self, job: &NewJob, limits: QueueLimits) -> Result<Inserted, StoreError> {
        let mut transaction = self.write().await?;
        if let Some(known) = known(&mut transaction, job).await? {
            return Ok(Inserted::Known(known));
        }
        let load = load(&mut *transaction, &job.owner).await?;
        let reused_bytes = job.reused.iter().flat_map(|reused| &reused.results).map(|file| file.bytes).sum();
        limits.check_storage(&load, job.mask.bytes.saturating_add(reused_bytes))?;
        match &job.reused {
            None => {
                limits.check(&load, job.mask.bytes)?;
                insert_queued(&mut transaction, job).await?;
            }
            Some(reused) => insert_succeeded(&mut transaction, job, reused).await?,
        }
        for (name, value) in &job.labels {
            sqlx::query("INSERT INTO job_labels (job_id, name, value) VALUES ($1, $2, $3)")
                .bind(job.id.to_string())
                .bind(name)
                .bind(value)
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(Inserted::New)
    }

    async fn get(&self, id: JobId) -> Result<Option<Job>, StoreError> {
        find(&self.reader, id).await
    }

    async fn list(&self, query: &ListQuery) -> Result<Vec<Job>, StoreError> {
        let (name, value) = query.label.clone().unzip();
        let rows = sqlx::query(AssertSqlSafe(statements::list(query.label.is_some(), query.state.is_some())))
            .bind(&query.owner)
            .bind(query.state.map(JobState::name))
            // Ids begin with a digit or a letter from a to f.
            .bind(query.before.map_or_else(|| "~".to_owned(), |id| id.to_string()))
            .bind(name)
            .bind(value)
            .bind(i64::from(query.limit))
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(rows::job).collect()
    }

    async fn find_key(&self, owner: &str, key: &str) -> Result<Option<JobId>, StoreError> {
        let row = sqlx::query("SELECT id FROM jobs WHERE owner = $1 AND idempotency_key = $2")
            .bind(owner)
            .bind(key)
            .fetch_optional(&self.reader)
            .await?;
        row.as_ref().map(rows::id).transpose()
    }

    async fn find_equal(&self, owner: &str, work_sha256: &str, program: &str) -> Result<Option<Job>, StoreError> {
        let row = sqlx::query(statements::EQUAL)
            .bind(owner)
            .bind(work_sha256)
            .bind(program)
            .fetch_optional(&self.reader)
            .await?;
        row.as_ref().map(rows::job).transpose()
    }

    async fn cancel(&self, id: JobId, now: Timestamp) -> Result<CancelAnswer, StoreError> {
        let MoveSql { set, from } = sql::moves(Cause::Cancel);
        let canceled = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, cancel_requested = 1 WHERE id = $2 AND {from} RETURNING state"
        )))
        .bind(now.as_millisecond())
        .bind(id.to_string());
        match self.change(canceled).await? {
            Some(row) if rows::state(&row)? == JobState::Running => Ok(CancelAnswer::Requested),
            Some(_) => Ok(CancelAnswer::Canceled),
            None => Ok(self.get(id).await?.map_or(CancelAnswer::NotFound, |job| CancelAnswer::AlreadyEnded(job.state))),
        }
    }

    async fn retry(&self, id: JobId, now: Timestamp, limits: QueueLimits) -> Result<RetryAnswer, StoreError> {
        let mut transaction = self.write().await?;
        let MoveSql { set, from } = sql::moves(Cause::Retry);
        let retried = sqlx::query(AssertSqlSafe(format!(
            "UPDATE jobs SET {set}, attempt = 0, cancel_requested = 0, error = NULL, started_at_ms = NULL,
                turn_ms = CAST($1 AS BIGINT)
             WHERE id = $2 AND {from} AND mask_kept = 1 RETURNING owner, mask_bytes, lane, expected_ms"
        )))
        .bind(now.as_millisecond())
        .bind(id.to_string());
        let Some(row) = retried.fetch_all(&mut *transaction).await?.pop() else {
            return Ok(not_retried(find(&mut *transaction, id).await?));
        };
        let (owner, bytes) = (row.try_get::<String, _>("owner")?, rows::bytes(&row, "mask_bytes")?);
        // It waits already, and goes back to where it was when there is no room.
        limits.check(&load(&mut *transaction, &owner).await?.without_own(bytes), bytes)?;
        // Its own turn, which is now, is no later than that of any other.
        let last_ms = last_turn_ms(&mut transaction, &owner, row.try_get("lane")?).await?;
        let turn = turn_ms(now.as_millisecond(), last_ms, row.try_get("expected_ms")?);
        let queued = sqlx::query("UPDATE jobs SET turn_ms = $1 WHERE id = $2").bind(turn).bind(id.to_string());
        queued.execute(&mut *transaction).await?;
        transaction.commit().await?;
        Ok(RetryAnswer::Queued)
    }

    async fn add_result(&self, id: JobId, token: &str, file: &ResultFile) -> Result<bool, StoreError> {
        let mut transaction = self.write().await?;
        let job = find(&mut *transaction, id).await?;
        let Some(mut job) = job.filter(|job| job.are_results_kept && job.results_token.as_deref() == Some(token))
        else {
            return Ok(false);
        };
        if !job.has_result(&file.name) {
            job.results.push(file.clone());
            sqlx::query("UPDATE jobs SET results = $1, results_bytes = $3 WHERE id = $2")
                .bind(rows::to_json(&job.results))
                .bind(id.to_string())
                .bind(rows::bytes_of(&job.results))
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(true)
    }

    async fn has_jobs_of(&self, owner: &str) -> Result<bool, StoreError> {
        let found = sqlx::query("SELECT 1 FROM jobs WHERE owner = $1 LIMIT 1").bind(owner);
        Ok(found.fetch_optional(&self.reader).await?.is_some())
    }

    async fn adopt_jobs(&self, owner: &str) -> Result<u64, StoreError> {
        let mut transaction = self.write().await?;
        for statement in [
            "UPDATE jobs SET idempotency_key = NULL WHERE owner = '' AND idempotency_key IN
                (SELECT idempotency_key FROM jobs WHERE owner = $1)",
            "UPDATE jobs_by_label SET owner = $1 WHERE owner = ''",
        ] {
            sqlx::query(statement).bind(owner).execute(&mut *transaction).await?;
        }
        let adopted =
            sqlx::query("UPDATE jobs SET owner = $1 WHERE owner = ''").bind(owner).execute(&mut *transaction).await?;
        transaction.commit().await?;
        Ok(adopted.rows_affected())
    }

    async fn delete(&self, id: JobId) -> Result<bool, StoreError> {
        let mut transaction = self.write().await?;
        let labels = sqlx::query("DELETE FROM job_labels WHERE job_id = $1").bind(id.to_string());
        labels.execute(&mut *transaction).await?;
        let deleted =
            sqlx::query("DELETE FROM jobs WHERE id = $1").bind(id.to_string()).execute(&mut *transaction).await?;
        transaction.commit().await?;
        Ok(deleted.rows_affected() > 0)
    }
}

async fn find<'a>(executor: impl SqliteExecutor<'a, Database = Sqlite>, id: JobId) -> Result<Option<Job>, StoreError> {
    let row = sqlx::query("SELECT * FROM jobs WHERE id = $1").bind(id.to_string()).fetch_optional(executor).await?;
    row.as_ref().map(rows::job).transpose()
}

/// Why the statement found no job to retry.
fn not_retried(job: Option<Job>) -> RetryAnswer {
    match job {
        None => RetryAnswer::NotFound,
        Some(job) if job.state.after(Cause::Retry).is_some() => RetryAnswer::MaskErased,
        Some(job) => RetryAnswer::NotRetryable(job.state),
    }
}

/// The job that was sent before under the same idempotency key.
async fn known(transaction: &mut Transaction<'_, Sqlite>, job: &NewJob) -> Result<Option<JobId>, StoreError> {
    let Some(key) = &job.idempotency_key else { return Ok(None) };
    let row = sqlx::query("SELECT id, request_sha256 FROM jobs WHERE owner = $1 AND idempotency_key = $2")
        .bind(&job.owner)
        .bind(key)
        .fetch_optional(&mut **transaction)
        .await?;
    let Some(row) = row else { return Ok(None) };
    let is_equal = row.try_get::<Option<String>, _>("request_sha256")?.as_ref() == Some(&job.request_sha256);
    if is_equal { Ok(Some(rows::id(&row)?)) } else { Err(StoreError::KeyReused) }
}

/// The last turn of those of a tenant that wait in a lane.
async fn last_turn_ms(
    transaction: &mut Transaction<'_, Sqlite>,
    owner: &str,
    lane: i64,
) -> Result<Option<i64>, StoreError> {
    let last = sqlx::query(statements::LAST_TURN).bind(owner).bind(lane).fetch_one(&mut **transaction).await?;
    Ok(last.try_get(0)?)
}

async fn insert_queued(transaction: &mut Transaction<'_, Sqlite>, job: &NewJob) -> Result<(), StoreError> {
    let last_ms = last_turn_ms(transaction, &job.owner, job.lane()).await?;
    let turn = turn_ms(job.created_at.as_millisecond(), last_ms, job.expected_ms());
    sqlx::query(
        "INSERT INTO jobs (id, state, owner, labels, idempotency_key, request_sha256, mask_sha256, mask_bytes, params,
                           attempt, cancel_requested, created_at_ms, turn_ms, history, trace_id, callback_url,
                           callback_state, callback_lane, delivery_to, delivery_state, work_sha256, lane, expected_ms,
                           warnings, results)
         VALUES ($1, $14, $2, $3, $4, $5, $6, $7, $8, 0, 0, $9, $10, ' ' || $14 || '@' || CAST($9 AS TEXT), $11, $12,
                 CASE WHEN $12 IS NULL THEN NULL ELSE 'waiting' END, $17, $18,
                 CASE WHEN $18 IS NULL THEN NULL ELSE 'waiting' END, $13, $15, $16, '[]', '[]')",
    )
    .bind(job.id.to_string())
    .bind(&job.owner)
    .bind(rows::to_json(&job.labels))
    .bind(&job.idempotency_key)
    .bind(&job.request_sha256)
    .bind(&job.mask.sha256)
    .bind(rows::clamped(job.mask.bytes))
    .bind(&job.params_json)
    .bind(job.created_at.as_millisecond())
    .bind(turn)
    .bind(&job.trace_id)
    .bind(&job.callback_url)
    .bind(&job.work_sha256)
    .bind(JobState::FIRST.name())
    .bind(job.lane())
    .bind(job.expected_ms())
    .bind(job.callback_url.as_ref().map(|url| format!("{} {}", job.owner, host_of(url))))
    .bind(&job.deliver_to)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// A job whose results were there before it came.
async fn insert_succeeded(
    transaction: &mut Transaction<'_, Sqlite>,
    job: &NewJob,
    reused: &Reused,
) -> Result<(), StoreError> {
    insert_queued(transaction, job).await?;
    let MoveSql { set, from } = sql::moves(Cause::Reuse);
    sqlx::query(AssertSqlSafe(format!(
        "UPDATE jobs SET {set}, reused = 1, results = $3, warnings = $4, results_token = $5, program = $6, results_bytes = $7,
            started_at_ms = created_at_ms
         WHERE id = $2 AND {from}"
    )))
    .bind(job.created_at.as_millisecond())
    .bind(job.id.to_string())
    .bind(rows::to_json(&reused.results))
    .bind(rows::to_json(&reused.warnings))
    .bind(&reused.token)
    .bind(&reused.program)
    .bind(rows::bytes_of(&reused.results))
    .execute(&mut **transaction)
    .await?;
    Ok(())
}
