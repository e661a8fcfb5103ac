//! Deliveries under way: columns of their job, so that its results and the duty to deliver them are one write.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;

use super::{SqliteStore, rows, statements};
use crate::jobs::job::{Job, JobId, SendTry};
use crate::jobs::store::{DeliveryStore, SendNext, StoreError};

#[async_trait]
impl DeliveryStore for SqliteStore {
    async fn claim_delivery(&self, to: &str, now: Timestamp, until: Timestamp) -> Result<Option<Job>, StoreError> {
        // Looked for by a reader first: most of the time there is none, and a write would lock.
        let first = sqlx::query(statements::NEXT_DELIVERY).bind(to).bind(now.as_millisecond());
        let Some(first) = first.fetch_optional(&self.reader).await? else { return Ok(None) };
        let claimed = sqlx::query(
            "UPDATE jobs SET delivery_due_ms = $1
             WHERE id = $2 AND delivery_state = 'due' AND delivery_due_ms <= $3 RETURNING *",
        )
        .bind(until.as_millisecond())
        .bind(first.try_get::<String, _>("id")?)
        .bind(now.as_millisecond());
        self.change(claimed).await?.as_ref().map(rows::job).transpose()
    }

    async fn extend_delivery(&self, id: JobId, held: Timestamp, until: Timestamp) -> Result<bool, StoreError> {
        let extended = sqlx::query(
            "UPDATE jobs SET delivery_due_ms = $1
             WHERE id = $2 AND delivery_state = 'due' AND delivery_due_ms = $3 AND results_kept = 1",
        )
        .bind(until.as_millisecond())
        .bind(id.to_string())
        .bind(held.as_millisecond());
        Ok(extended.execute(&self.writer).await?.rows_affected() > 0)
    }

    async fn all_deliveries_due(&self, now: Timestamp) -> Result<(), StoreError> {
        sqlx::query(statements::ALL_DELIVERIES_DUE).bind(now.as_millisecond()).execute(&self.writer).await?;
        Ok(())
    }

    async fn delivery_stored(&self, id: JobId, name: &str) -> Result<(), StoreError> {
        sqlx::query(
            "UPDATE jobs SET delivery_stored = json_insert(delivery_stored, '$[#]', $1)
             WHERE id = $2 AND NOT EXISTS (SELECT 1 FROM json_each(delivery_stored) WHERE value = $1)",
        )
        .bind(name)
        .bind(id.to_string())
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn retry_delivery(&self, id: JobId, now: Timestamp) -> Result<bool, StoreError> {
        let retried = sqlx::query(
            "UPDATE jobs SET delivery_state = 'due', delivery_due_ms = $1, delivery_tries = 0
             WHERE id = $2 AND delivery_state = 'given_up' AND results_kept = 1",
        )
        .bind(now.as_millisecond())
        .bind(id.to_string());
        Ok(retried.execute(&self.writer).await?.rows_affected() > 0)
    }

    async fn delivery_tried(
        &self,
        id: JobId,
        held: Timestamp,
        tried: &SendTry,
        next: SendNext,
    ) -> Result<(), StoreError> {
        let (state, due) = rows::next(next);
        sqlx::query(
            "UPDATE jobs SET delivery_state = $1, delivery_due_ms = $2, delivery_tries = delivery_tries + 1,
                delivery_last = $3
             WHERE id = $4 AND delivery_state = 'due' AND delivery_due_ms = $5",
        )
        .bind(state)
        .bind(due)
        .bind(rows::to_json(tried))
        .bind(id.to_string())
        .bind(held.as_millisecond())
        .execute(&self.writer)
        .await?;
        Ok(())
    }
}
