//! Statements that must find what they look for by an index, however many jobs there are. A test holds them to that.

/// The job whose turn comes first.
pub(super) const FIRST: &str = "SELECT id FROM jobs WHERE state = 'queued' ORDER BY turn_ms, id LIMIT 1";

/// What waits, of all and of one tenant.
pub(super) const LOAD: &str = "SELECT count(*), coalesce(sum(mask_bytes), 0), count(CASE WHEN owner = $1 THEN 1 END),
            coalesce(sum(CASE WHEN owner = $1 THEN mask_bytes END), 0),
            coalesce((SELECT bytes FROM storage WHERE owner = $1), 0)
     FROM jobs WHERE state = 'queued'";

/// The job that has waited longest.
pub(super) const OLDEST: &str = "SELECT created_at_ms FROM jobs WHERE state = 'queued' ORDER BY id LIMIT 1";

/// The turn of a job that waits.
pub(super) const TURN: &str = "SELECT turn_ms FROM jobs WHERE id = $1 AND state = 'queued'";

/// Those that wait after one and up to another.
pub(super) const PASSED: &str = "SELECT count(*) FROM jobs WHERE state = 'queued'
     AND (turn_ms, id) > ($1, $2) AND (turn_ms, id) <= ($3, $4)";

/// The last turn of a tenant in a lane.
pub(super) const LAST_TURN: &str = "SELECT max(turn_ms) FROM jobs WHERE state = 'queued' AND owner = $1 AND lane = $2";

/// Equal work whose results can be used again.
pub(super) const EQUAL: &str =
    "SELECT * FROM jobs WHERE owner = $1 AND work_sha256 = $2 AND program = $3 AND state = 'succeeded'
     AND results_kept = 1 ORDER BY id DESC LIMIT 1";

/// Masks that are due.
pub(super) const EXPIRE_MASKS: &str = "UPDATE jobs SET mask_kept = 0 WHERE id IN
     (SELECT id FROM jobs WHERE ended_at_ms < $1 AND mask_kept = 1 ORDER BY ended_at_ms LIMIT $2) RETURNING id";

/// Results that are due.
pub(super) const EXPIRE_RESULTS: &str = "UPDATE jobs SET results_kept = 0 WHERE id IN
     (SELECT id FROM jobs WHERE ended_at_ms < $1 AND results_kept = 1 AND state = 'succeeded'
      ORDER BY ended_at_ms LIMIT $2) RETURNING id";

/// Jobs that are due.
pub(super) const EXPIRE_JOBS: &str = "DELETE FROM jobs WHERE id IN (SELECT id FROM jobs WHERE ended_at_ms < $1 ORDER BY ended_at_ms LIMIT $2) RETURNING id";

/// The webhook that is due first in the next lane: of the next tenant, or to its next host.
pub(super) const NEXT_CALLBACK: &str = "SELECT id, owner, callback_url, callback_lane, callback_due_ms FROM jobs
     WHERE callback_state = 'due' AND callback_lane > $1 ORDER BY callback_lane, callback_due_ms LIMIT 1";

/// The delivery to an archive that came due first.
pub(super) const NEXT_DELIVERY: &str = "SELECT id FROM jobs
     WHERE delivery_state = 'due' AND delivery_to = $1 AND delivery_due_ms <= $2 ORDER BY delivery_due_ms LIMIT 1";

/// Deliveries that would come due later.
pub(super) const ALL_DELIVERIES_DUE: &str = "UPDATE jobs SET delivery_due_ms = $1 WHERE id IN
     (SELECT id FROM jobs WHERE delivery_state = 'due' AND delivery_due_ms > $1)";

/// A tenant's jobs, newest first: of `$1` before `$3`, in state `$2`, with label `$4` of value `$5`, `$6` at the most.
pub(super) fn list(has_label: bool, has_state: bool) -> String {
    let state = if has_state { "AND state = $2" } else { "" };
    if has_label {
        return format!(
            "SELECT * FROM jobs WHERE id IN (SELECT job_id FROM jobs_by_label
                WHERE owner = $1 AND name = $4 AND value = $5 AND job_id < $3 {state} ORDER BY job_id DESC LIMIT $6)
             ORDER BY id DESC"
        );
    }
    format!("SELECT * FROM jobs WHERE owner = $1 AND id < $3 {state} ORDER BY id DESC LIMIT $6")
}

/// A tenant's DICOM objects, newest job first: of `$1`, whose identifier in `column` is `$2`, `$3` at the most.
pub(super) fn objects(column: Option<&'static str>) -> String {
    let only = column.map(|column| format!("AND {column} = $2")).unwrap_or_default();
    format!("SELECT * FROM dicom_objects WHERE owner = $1 {only} ORDER BY job_id DESC, name DESC LIMIT $3")
}

#[cfg(test)]
mod tests {
    use sqlx::{AssertSqlSafe, Row};

    use super::*;
    use crate::jobs::store::sqlite::SqliteStore;

    /// How SQLite would go about it, a step a line.
    async fn plan(store: &SqliteStore, statement: &str) -> String {
        let rows = sqlx::query(AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}")));
        let mut lines = Vec::new();
        for row in rows.fetch_all(&store.writer).await.unwrap() {
            lines.push(row.try_get::<String, _>("detail").unwrap());
        }
        lines.join("\n")
    }

    #[tokio::test]
    async fn what_is_looked_for_is_found_by_an_index() {
        let folder = tempfile::tempdir().unwrap();
        let store = SqliteStore::open(&folder.path().join("jobs.sqlite"), true).await.unwrap();
        let lists = [(false, false), (false, true), (true, false), (true, true)].map(|(l, s)| list(l, s));
        let objects = [None, Some("study"), Some("series"), Some("instance")].map(objects);
        let fixed = [
            (FIRST, "jobs_by_turn"),
            (LOAD, "jobs_by_load"),
            (OLDEST, "jobs_by_state"),
            (TURN, "sqlite_autoindex_jobs_1"),
            (PASSED, "jobs_by_turn"),
            (LAST_TURN, "jobs_by_lane"),
            (EQUAL, "jobs_by_work"),
            (EXPIRE_MASKS, "jobs_by_end_of_mask"),
            (EXPIRE_RESULTS, "jobs_by_end_of_results"),
            (EXPIRE_JOBS, "jobs_by_end"),
            (NEXT_CALLBACK, "jobs_by_callback"),
            (NEXT_DELIVERY, "jobs_by_delivery"),
            (ALL_DELIVERIES_DUE, "jobs_by_delivery"),
            (&*lists[0], "jobs_by_owner"),
            (&*lists[1], "jobs_by_owner_and_state"),
            (&*lists[2], "PRIMARY KEY"),
            (&*lists[3], "jobs_by_label_and_state"),
            (&*objects[0], "dicom_objects_by_owner"),
            (&*objects[1], "dicom_objects_by_study"),
            (&*objects[2], "dicom_objects_by_series"),
            (&*objects[3], "dicom_objects_by_instance"),
        ];
        for (statement, index) in fixed {
            let plan = plan(&store, statement).await;
            assert!(plan.contains(&format!("{index} (")), "{statement}\n{plan}");
            assert!(!plan.contains("SCAN jobs\n") && !plan.ends_with("SCAN jobs"), "{statement}\n{plan}");
            // Only what a list gives out, a few hundred, may be sorted.
            assert!(!plan.contains("TEMP B-TREE") || statement.contains("jobs_by_label"), "{statement}\n{plan}");
        }
    }
}
