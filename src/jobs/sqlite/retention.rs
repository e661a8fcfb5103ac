//! What is erased in time. The row comes first: a file that no row names is swept.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::{SqliteStore, rows};
use crate::jobs::job::JobId;
use crate::jobs::store::{KeptFiles, RetentionStore, StoreError};

#[async_trait]
impl RetentionStore for SqliteStore {
    async fn expire_masks(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        let rows = sqlx::query(
            "UPDATE jobs SET mask_kept = 0 WHERE id IN
                (SELECT id FROM jobs WHERE ended_at_ms < $1 AND mask_kept = 1 LIMIT $2)
             RETURNING id",
        )
        .bind(ended_before.as_millisecond())
        .bind(i64::from(limit))
        .fetch_all(&self.writer)
        .await?;
        rows.iter().map(rows::id).collect()
    }

    async fn forget_mask(&self, id: JobId) -> Result<(), StoreError> {
        sqlx::query("UPDATE jobs SET mask_kept = 0 WHERE id = $1").bind(id.to_string()).execute(&self.writer).await?;
        Ok(())
    }

    async fn expire_results(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        let rows = sqlx::query(
            "UPDATE jobs SET results_kept = 0 WHERE id IN
                (SELECT id FROM jobs WHERE ended_at_ms < $1 AND results_kept = 1 AND state = 'succeeded' LIMIT $2)
             RETURNING id",
        )
        .bind(ended_before.as_millisecond())
        .bind(i64::from(limit))
        .fetch_all(&self.writer)
        .await?;
        rows.iter().map(rows::id).collect()
    }

    async fn expire_jobs(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError> {
        let mut transaction = self.write().await?;
        let rows = sqlx::query(
            "DELETE FROM jobs WHERE id IN (SELECT id FROM jobs WHERE ended_at_ms < $1 LIMIT $2) RETURNING id",
        )
        .bind(ended_before.as_millisecond())
        .bind(i64::from(limit))
        .fetch_all(&mut *transaction)
        .await?;
        let ids: Vec<JobId> = rows.iter().map(rows::id).collect::<Result<_, _>>()?;
        for id in &ids {
            let labels = sqlx::query("DELETE FROM job_labels WHERE job_id = $1").bind(id.to_string());
            labels.execute(&mut *transaction).await?;
        }
        transaction.commit().await?;
        Ok(ids)
    }

    async fn kept_files(&self) -> Result<Vec<KeptFiles>, StoreError> {
        let rows = sqlx::query("SELECT id, mask_kept, results_kept, results_token, lease_token FROM jobs")
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(kept).collect()
    }
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
