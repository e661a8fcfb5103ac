//! What SQLite says, as what callers act on.

use sqlx::migrate::MigrateError;

use crate::jobs::store::StoreError;
use crate::problem::is_full;

/// Primary result codes. The extended ones hold them in their lowest byte.
const SQLITE_BUSY: i32 = 5;
const SQLITE_LOCKED: i32 = 6;
const SQLITE_READONLY: i32 = 8;
const SQLITE_IOERR: i32 = 10;
const SQLITE_CORRUPT: i32 = 11;
const SQLITE_FULL: i32 = 13;
const SQLITE_CANTOPEN: i32 = 14;
const SQLITE_NOTADB: i32 = 26;

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        match &error {
            sqlx::Error::Database(told) => of_code(told.code().and_then(|code| code.parse().ok()), &error),
            sqlx::Error::Io(cause) if is_full(cause) => Self::Full,
            sqlx::Error::PoolTimedOut | sqlx::Error::PoolClosed | sqlx::Error::WorkerCrashed => {
                Self::Unavailable(error.to_string())
            }
            sqlx::Error::ColumnDecode { .. } | sqlx::Error::ColumnNotFound(_) => Self::Corrupt(error.to_string()),
            _ => Self::Other(error.to_string()),
        }
    }
}

fn of_code(code: Option<i32>, error: &sqlx::Error) -> StoreError {
    match code.map(|code| code & 0xff) {
        Some(SQLITE_FULL) => StoreError::Full,
        // The disk may take writes again later.
        Some(SQLITE_BUSY | SQLITE_LOCKED | SQLITE_READONLY | SQLITE_IOERR | SQLITE_CANTOPEN) => {
            StoreError::Unavailable(error.to_string())
        }
        Some(SQLITE_CORRUPT | SQLITE_NOTADB) => StoreError::Corrupt(error.to_string()),
        _ => StoreError::Other(error.to_string()),
    }
}

/// Why the tables cannot be brought up to date to step `known`.
pub(super) fn of_migration(error: MigrateError, known: i64) -> StoreError {
    match error {
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => error.into(),
        MigrateError::VersionMissing(found) => StoreError::Newer { found, known },
        MigrateError::VersionMismatch(step) => {
            StoreError::Corrupt(format!("step {step} of its tables was made by another program"))
        }
        other => StoreError::Other(other.to_string()),
    }
}
