//! Results that are DICOM objects. The table follows the results of jobs by triggers: nothing here writes to it.

use async_trait::async_trait;
use sqlx::sqlite::SqliteRow;
use sqlx::{AssertSqlSafe, Row};

use super::{SqliteStore, rows, statements};
use crate::formats::dicom_object::DicomObject;
use crate::jobs::job::{JobId, ResultFile};
use crate::jobs::store::{KeptObject, ObjectQuery, ObjectStore, ObjectsBy, StoreError};

/// What every file of such an object is sent as.
const MEDIA_TYPE: &str = "application/dicom";

#[async_trait]
impl ObjectStore for SqliteStore {
    async fn find_objects(&self, query: &ObjectQuery) -> Result<Vec<KeptObject>, StoreError> {
        let (column, uid) = match &query.by {
            ObjectsBy::Any => (None, None),
            ObjectsBy::Study(uid) => (Some("study"), Some(uid)),
            ObjectsBy::Series(uid) => (Some("series"), Some(uid)),
            ObjectsBy::Instance(uid) => (Some("instance"), Some(uid)),
        };
        let rows = sqlx::query(AssertSqlSafe(statements::objects(column)))
            .bind(&query.owner)
            .bind(uid)
            .bind(i64::from(query.limit))
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(kept).collect()
    }
}

fn kept(row: &SqliteRow) -> Result<KeptObject, StoreError> {
    let object = DicomObject {
        class: row.try_get("class")?,
        study: row.try_get("study")?,
        series: row.try_get("series")?,
        instance: row.try_get("instance")?,
    };
    let file = ResultFile {
        name: row.try_get("name")?,
        media_type: MEDIA_TYPE.to_owned(),
        bytes: rows::bytes(row, "bytes")?,
        sha256: row.try_get("sha256")?,
        dicom: Some(object.clone()),
    };
    let id = JobId::parse(row.try_get("job_id")?).ok_or_else(|| rows::corrupt("job_id"))?;
    Ok(KeptObject { id, token: row.try_get("token")?, file, object })
}
