//! What the database remembers of the audit log. The chain in its files shows what was changed within; that a file was emptied, or lost
//! its first or its last lines, shows only what is kept elsewhere.

use super::blocking::on_own_thread;
use super::error::JobsError;
use super::service::Jobs;
use super::store::{AuditMarks, Store, StoreError};
use crate::audit::{Audit, Ends};

/// Why the log is not the one that is remembered.
///
/// # Errors
/// What is missing.
pub fn compare(known: Option<&AuditMarks>, found: &Ends) -> Result<(), String> {
    let Some(known) = known else { return Ok(()) };
    if found.tip.seq < known.tip.seq {
        return Err(format!("it ends with entry {}, and had {}", found.tip.seq, known.tip.seq));
    }
    if found.head == known.head || found.is_continued {
        return Ok(());
    }
    Err(format!(
        "it begins after entry {}, not {}, and no file beside it ends there: what was before is missing",
        found.head.seq, known.head.seq
    ))
}

/// Lets a new log go on where the last one ended.
///
/// # Errors
/// When the store fails.
pub async fn follow(audit: &Audit, store: &dyn Store) -> Result<(), StoreError> {
    if let Some(known) = store.audit_marks().await? {
        audit.go_on_after(&known.tip);
    }
    Ok(())
}

impl Jobs {
    /// Has the database remember where the log begins and ends, unless it is not the one that it remembers.
    pub(super) async fn mark_audit(&self) {
        if let Err(error) = self.try_to_mark_audit().await {
            tracing::error!(%error, "the audit log cannot be compared with what is known of it");
        }
    }

    async fn try_to_mark_audit(&self) -> Result<(), JobsError> {
        // First what is known: others append and have it remembered meanwhile.
        let known = self.store().audit_marks().await?;
        let audit = self.audit();
        let found = on_own_thread(move || audit.ends()).await?;
        match compare(known.as_ref(), &found) {
            Ok(()) => {
                let marks = AuditMarks { head: found.head, tip: found.tip };
                if known.as_ref() != Some(&marks) {
                    // What is remembered must not be lost to a power cut that the memory of it survives.
                    let audit = self.audit();
                    on_own_thread(move || audit.sync()).await?;
                    self.store().mark_audit(&marks).await?;
                }
            }
            Err(told) => {
                self.metrics().audit_failed();
                tracing::error!("the audit log is not the one that is known: {told}; see medialrep check");
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::Mark;

    fn mark(seq: u64) -> Mark {
        Mark { seq, hash: format!("{seq}") }
    }

    #[test]
    fn a_log_that_lost_something_is_told() {
        let known = AuditMarks { head: mark(0), tip: mark(7) };
        let found = |head, tip, is_continued| Ends { head: mark(head), tip: mark(tip), is_continued };
        for (ends, is_whole) in [
            (found(0, 7, false), true),
            (found(0, 9, false), true),
            // Its tail is gone; it was emptied; its first lines are gone; it was written anew.
            (found(0, 6, false), false),
            (found(0, 0, false), false),
            (found(3, 9, false), false),
            (found(7, 9, false), false),
            // Renamed, and gone on with in a new file.
            (found(7, 9, true), true),
        ] {
            assert_eq!(compare(Some(&known), &ends).is_ok(), is_whole, "{ends:?}");
            assert!(compare(None, &ends).is_ok());
        }
    }
}
