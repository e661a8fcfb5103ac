//! The store in one SQLite file.
//!
//! WAL with `synchronous=FULL`: a commit is on disk when the call returns, but that of a claim, which is worth nothing
//! once its worker is gone. One connection writes,
//! so that writers queue in this process instead of failing with "database is locked"; writers of
//! other processes are waited for. Reads have connections of their own. Every change is one
//! statement or one transaction that begins by taking the write lock.

mod error;

mod rows;

mod statements;

mod jobs;

mod queue;

mod retention;

mod objects;

mod callbacks;

mod deliveries;

mod tokens;

use std::cmp::Ordering;
use std::path::Path;
use std::time::Duration;

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::query::Query;
use sqlx::sqlite::{
    SqliteArguments, SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteRow,
    SqliteSynchronous,
};
use sqlx::{Connection, Row, SqlSafeStr, Sqlite, SqliteConnection, Transaction};

use super::{AuditMarks, Store, StoreError};
use crate::audit::Mark;

/// Status polls are short reads; a few connections serve thousands a second.
const READ_CONNECTIONS: u32 = 4;
/// How long a connection waits for a lock that another process, a backup or a checkpoint holds.
const BUSY_TIMEOUT: Duration = Duration::from_secs(10);

/// How long it is waited for the connection that writes hastily: where the file cannot be opened to be written, it is tried
/// again all this time.
const HASTY_TIMEOUT: Duration = Duration::from_secs(2);
/// How long the wiping of deleted rows waits for readers.
const WIPE_TIMEOUT: Duration = Duration::from_millis(200);

/// Jobs in a SQLite file.
#[derive(Clone, Debug)]
pub struct SqliteStore {
    writer: SqlitePool,
    /// Writes what a loss of power may undo, without waiting for the disk. Used only by who holds the connection of
    /// `writer`.
    hasty: SqlitePool,
    reader: SqlitePool,
}

impl SqliteStore {
    /// Opens the file, making it when it is missing and `may_be_new`, and brings its tables up to date.
    ///
    /// # Errors
    /// When the file cannot be opened, has no tables though it must, or those of another program or of a later version of
    /// this one.
    pub async fn open(path: &Path, may_be_new: bool) -> Result<Self, StoreError> {
        if !may_be_new && !path.exists() {
            return Err(StoreError::Lost);
        }
        let options = common_options(path)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            // What is deleted is patient data: its bytes are overwritten.
            .pragma("secure_delete", "on");
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            // On a full disk SQLite takes back a transaction by itself; the connection goes on to think that it is in
            // one, and could begin none any more.
            .before_acquire(|connection, _| Box::pin(async move { Ok(!connection.is_in_transaction()) }))
            .after_connect(|connection, _| Box::pin(is_writable(connection)))
            .connect_with(options.clone())
            .await?;
        if step_of(&writer).await? == 0 && !may_be_new {
            return Err(StoreError::Lost);
        }
        let (steps, known) = (migrator(), last_step());
        steps.run(&writer).await.map_err(|error| error::of_migration(error, known))?;
        let reader = SqlitePoolOptions::new().max_connections(READ_CONNECTIONS).connect_with(options.clone()).await?;
        let hasty = options.synchronous(SqliteSynchronous::Normal);
        let hasty = SqlitePoolOptions::new()
            .max_connections(1)
            // Who waits for it holds up all that write.
            .acquire_timeout(HASTY_TIMEOUT)
            .after_connect(|connection, _| Box::pin(is_writable(connection)))
            .connect_lazy_with(hasty);
        Ok(Self { writer, hasty, reader })
    }

    /// Opens the file to be read, as it is: nothing of it changes, its tables neither.
    ///
    /// # Errors
    /// When it cannot be opened, or its tables are not those of this version of the program.
    pub async fn open_to_read(path: &Path) -> Result<Self, StoreError> {
        let options = common_options(path).read_only(true);
        let reader = SqlitePoolOptions::new().max_connections(READ_CONNECTIONS).connect_with(options).await?;
        let (found, known) = (step_of(&reader).await?, last_step());
        match found.cmp(&known) {
            Ordering::Less => Err(StoreError::Older { found, known }),
            Ordering::Equal => Ok(Self { writer: reader.clone(), hasty: reader.clone(), reader }),
            Ordering::Greater => Err(StoreError::Newer { found, known }),
        }
    }

    /// The row that a change returns, if it changed one. Asked for one row only, SQLite commits when it is no
    /// longer asked, and a disk that is full then is no error that anybody sees.
    async fn change(&self, query: Query<'_, Sqlite, SqliteArguments>) -> Result<Option<SqliteRow>, StoreError> {
        Ok(query.fetch_all(&self.writer).await?.pop())
    }

    /// As [`change`](Self::change), for what a loss of power may undo: who did it has lost power too.
    async fn change_hastily(&self, query: Query<'_, Sqlite, SqliteArguments>) -> Result<Option<SqliteRow>, StoreError> {
        let _turn = self.writer.acquire().await?;
        Ok(query.fetch_all(&self.hasty).await?.pop())
    }

    /// A transaction that holds the write lock from its first moment: one that takes it later may
    /// find that what it read is old.
    async fn write(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }
}

fn common_options(path: &Path) -> SqliteConnectOptions {
    // The file system may be read-only outside of the data directory.
    SqliteConnectOptions::new().filename(path).busy_timeout(BUSY_TIMEOUT).pragma("temp_store", "memory")
}

/// Fails where a connection can only read: SQLite opens a file so without a word when it cannot be written at that moment,
/// and would stay so when it can be again.
async fn is_writable(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    connection.begin_with("BEGIN IMMEDIATE").await?.rollback().await
}

/// The last step of the tables that a file has; 0 before the first.
async fn step_of(file: &SqlitePool) -> Result<i64, StoreError> {
    let tables = sqlx::query("SELECT COUNT(*), SUM(name = '_sqlx_migrations') FROM sqlite_schema WHERE type = 'table'");
    let tables = tables.fetch_one(file).await?;
    let (all, ours): (i64, Option<i64>) = (tables.try_get(0)?, tables.try_get(1)?);
    if ours.unwrap_or(0) == 0 {
        return if all == 0 { Ok(0) } else { Err(StoreError::Corrupt("its tables are another program's".to_owned())) };
    }
    let last: Option<i64> =
        sqlx::query("SELECT MAX(version) FROM _sqlx_migrations").fetch_one(file).await?.try_get(0)?;
    Ok(last.unwrap_or(0))
}

/// The last step of the tables that this program knows.
fn last_step() -> i64 {
    migrator().iter().map(|step| step.version).max().unwrap_or(0)
}

fn migrator() -> Migrator {
    let migration = |version, name: &'static str, sql: &'static str| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(vec![
        migration(1, "jobs", include_str!("../../../../migrations/sqlite/0001_jobs.sql")),
        migration(2, "turns", include_str!("../../../../migrations/sqlite/0002_turns.sql")),
        migration(3, "service", include_str!("../../../../migrations/sqlite/0003_service.sql")),
        migration(4, "suspects", include_str!("../../../../migrations/sqlite/0004_suspects.sql")),
        migration(5, "order", include_str!("../../../../migrations/sqlite/0005_order.sql")),
        migration(6, "callbacks", include_str!("../../../../migrations/sqlite/0006_callbacks.sql")),
        migration(7, "storage", include_str!("../../../../migrations/sqlite/0007_storage.sql")),
        migration(8, "audit", include_str!("../../../../migrations/sqlite/0008_audit.sql")),
        migration(9, "erased", include_str!("../../../../migrations/sqlite/0009_erased.sql")),
        migration(10, "deliveries", include_str!("../../../../migrations/sqlite/0010_deliveries.sql")),
        migration(11, "dicom_objects", include_str!("../../../../migrations/sqlite/0011_dicom_objects.sql")),
    ])
}

#[async_trait]
impl Store for SqliteStore {
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

    async fn check_readable(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT id FROM jobs LIMIT 1").fetch_optional(&self.reader).await?;
        Ok(())
    }

    async fn check_integrity(&self) -> Result<Vec<String>, StoreError> {
        let rows = sqlx::query("PRAGMA integrity_check").fetch_all(&self.reader).await?;
        let mut found = Vec::new();
        for row in rows {
            let line: String = row.try_get(0)?;
            if line != "ok" {
                found.push(line);
            }
        }
        Ok(found)
    }

    async fn audit_marks(&self) -> Result<Option<AuditMarks>, StoreError> {
        let mut marks = [None, None];
        for (mark, name) in marks.iter_mut().zip(["head", "tip"]) {
            let row = sqlx::query("SELECT seq, hash FROM audit_marks WHERE name = $1").bind(name);
            if let Some(row) = row.fetch_optional(&self.reader).await? {
                *mark = Some(Mark { seq: rows::count(&row, 0)?, hash: row.try_get(1)? });
            }
        }
        let [head, tip] = marks;
        Ok(head.zip(tip).map(|(head, tip)| AuditMarks { head, tip }))
    }

    async fn mark_audit(&self, marks: &AuditMarks) -> Result<(), StoreError> {
        let mut transaction = self.write().await?;
        for (name, mark) in [("head", &marks.head), ("tip", &marks.tip)] {
            sqlx::query(
                "INSERT INTO audit_marks (name, seq, hash) VALUES ($1, $2, $3)
                 ON CONFLICT (name) DO UPDATE SET seq = excluded.seq, hash = excluded.hash WHERE excluded.seq > seq",
            )
            .bind(name)
            .bind(rows::clamped(mark.seq))
            .bind(&mark.hash)
            .execute(&mut *transaction)
            .await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    async fn wipe_deleted(&self) -> Result<bool, StoreError> {
        // The log that goes before the tables holds rows as they were until it begins anew. A connection of its own: waiting for
        // readers would make all writers wait.
        let mut options = self.writer.connect_options().as_ref().clone();
        options = options.busy_timeout(WIPE_TIMEOUT);
        let mut connection = SqliteConnection::connect_with(&options).await?;
        let row = sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").fetch_one(&mut connection).await?;
        let is_busy: i64 = row.try_get(0)?;
        connection.close().await?;
        Ok(is_busy == 0)
    }

    async fn copy_to(&self, file: &Path) -> Result<(), StoreError> {
        sqlx::query("VACUUM INTO $1").bind(file.to_string_lossy().into_owned()).execute(&self.writer).await?;
        Ok(())
    }

    async fn close(&self) {
        self.reader.close().await;
        self.hasty.close().await;
        self.writer.close().await;
    }
}
