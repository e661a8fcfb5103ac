//! Webhooks under way: columns of their job, so that the end of a job and the duty to tell of it
//! are one write.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;

use super::{SqliteStore, rows, statements};
use crate::jobs::job::{JobId, SendTry};
use crate::jobs::store::{CallbackStore, DueCallback, SendNext, StoreError, host_of};

#[async_trait]
impl CallbackStore for SqliteStore {
    async fn claim_callback(
        &self,
        now: Timestamp,
        until: Timestamp,
        is_busy: &(dyn for<'a> Fn(&'a str, &'a str) -> bool + Sync),
    ) -> Result<Option<DueCallback>, StoreError> {
        // Looked for by a reader first: most of the time there is none, and a write would lock.
        let Some(id) = self.first_due(now, is_busy).await? else { return Ok(None) };
        let claimed = sqlx::query(
            "UPDATE jobs SET callback_due_ms = $1
             WHERE id = $2 AND callback_state = 'due' AND callback_due_ms <= $3 RETURNING *",
        )
        .bind(until.as_millisecond())
        .bind(id)
        .bind(now.as_millisecond());
        let Some(row) = self.change(claimed).await? else { return Ok(None) };
        let job = rows::job(&row)?;
        let callback = job.callback.clone().ok_or_else(|| rows::corrupt("callback_url"))?;
        let tries = u32::try_from(callback.log.len()).unwrap_or(u32::MAX);
        Ok(Some(DueCallback { job, url: callback.url, tries }))
    }

    async fn callback_tried(&self, id: JobId, tried: &SendTry, next: SendNext) -> Result<(), StoreError> {
        let (state, due) = rows::next(next);
        // The log is a JSON array of objects: its bracket makes room for one more.
        sqlx::query(
            "UPDATE jobs SET callback_state = $1, callback_due_ms = $2, callback_log =
                CASE WHEN callback_log = '[]' THEN '[' || $3 || ']'
                     ELSE substr(callback_log, 1, length(callback_log) - 1) || ',' || $3 || ']' END
             WHERE id = $4 AND callback_state = 'due'",
        )
        .bind(state)
        .bind(due)
        .bind(rows::to_json(tried))
        .bind(id.to_string())
        .execute(&self.writer)
        .await?;
        Ok(())
    }
}

impl SqliteStore {
    /// The webhook that is due first, lane by lane.
    async fn first_due(
        &self,
        now: Timestamp,
        is_busy: &(dyn for<'a> Fn(&'a str, &'a str) -> bool + Sync),
    ) -> Result<Option<String>, StoreError> {
        let (mut lane, mut first) = (String::new(), None);
        let mut reads = self.reader.acquire().await?;
        while let Some(row) = sqlx::query(statements::NEXT_CALLBACK).bind(&lane).fetch_optional(&mut *reads).await? {
            lane = row.try_get("callback_lane")?;
            let due: i64 = row.try_get("callback_due_ms")?;
            let (owner, url): (String, String) = (row.try_get("owner")?, row.try_get("callback_url")?);
            let is_first = first.as_ref().is_none_or(|(other, _)| due < *other);
            if due <= now.as_millisecond() && is_first && !is_busy(&owner, host_of(&url)) {
                first = Some((due, row.try_get("id")?));
            }
        }
        Ok(first.map(|(_, id)| id))
    }
}
