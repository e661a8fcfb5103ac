//! What is erased in time. The row comes first: a file that no row names is swept.

use async_trait::async_trait;
use futures_util::TryStreamExt;
use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, Sqlite, SqliteExecutor};
use tokio::task::consume_budget;

use super::{SqliteStore, rows, statements};
use crate::jobs::job::JobId;
use crate::jobs::store::{KeptFiles, RetentionStore, StoreError};

#[async_trait]
impl RetentionStore for SqliteStore {
    async fn expire_masks(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        expire(&self.writer, statements::EXPIRE_MASKS, ended_before, limit).await
    }

    async fn forget_mask(&self, id: JobId) -> Result<(), StoreError> {
        sqlx::query("UPDATE jobs SET mask_kept = 0 WHERE id = $1").bind(id.to_string()).execute(&self.writer).await?;
        Ok(())
    }

    async fn forget_results(&self, id: JobId) -> Result<(), StoreError> {
        sqlx::query("UPDATE jobs SET results_kept = 0 WHERE id = $1")
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        Ok(())
    }

    async fn expire_results(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        expire(&self.writer, statements::EXPIRE_RESULTS, ended_before, limit).await
    }

    async fn expire_jobs(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        let mut transaction = self.write().await?;
        let ids = expire(&mut *transaction, statements::EXPIRE_JOBS, ended_before, limit).await?;
        for id in &ids {
            let labels = sqlx::query("DELETE FROM job_labels WHERE job_id = $1").bind(id.to_string());
            labels.execute(&mut *transaction).await?;
        }
        transaction.commit().await?;
        Ok(ids)
    }

    async fn erased_jobs(&self) -> Result<Vec<JobId>, StoreError> {
        sqlx::query("SELECT id FROM erased_jobs").fetch_all(&self.reader).await?.iter().map(rows::id).collect()
    }

    async fn forget_erased(&self, before: Timestamp) -> Result<(), StoreError> {
        let old = sqlx::query("DELETE FROM erased_jobs WHERE erased_at_ms < $1").bind(before.as_millisecond());
        old.execute(&self.writer).await?;
        Ok(())
    }

    async fn kept_files(&self) -> Result<Vec<KeptFiles>, StoreError> {
        let mut rows =
            sqlx::query("SELECT id, mask_kept, results_kept, results_token, lease_token FROM jobs").fetch(&self.reader);
        let mut all = Vec::new();
        while let Some(row) = rows.try_next().await? {
            all.push(kept(&row)?);
            // There may be very many.
            consume_budget().await;
        }
        Ok(all)
    }
}

/// The jobs that `due` changes: its parameters are the time and the limit.
async fn expire<'a>(
    executor: impl SqliteExecutor<'a, Database = Sqlite>,
    due: &'static str,
    ended_before: Timestamp,
    limit: u32,
) -> Result<Vec<JobId>, StoreError> {
    let query = sqlx::query(due).bind(ended_before.as_millisecond()).bind(i64::from(limit));
    query.fetch_all(executor).await?.iter().map(rows::id).collect()
}

fn kept(row: &SqliteRow) -> Result<KeptFiles, StoreError> {
    let published: Option<String> = row.try_get("results_token")?;
    let published = if rows::flag(row, "results_kept")? { published } else { None };
    let running: Option<String> = row.try_get("lease_token")?;
    Ok(KeptFiles {
        id: rows::id(row)?,
        mask: rows::flag(row, "mask_kept")?,
        tokens: published.into_iter().chain(running).collect(),
    })
}
