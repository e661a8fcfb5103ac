//! Who asks, and how much of the service they take at once.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Who asks for something: found out once per request, needed by everything that touches a job.
#[derive(Clone, Debug, Default)]
pub struct Caller {
    /// Owner of the jobs that are seen and sent; empty when nobody was asked who they are.
    pub tenant: String,
    /// Public half of the token.
    pub token: Option<String>,
    /// Trace that the request belongs to.
    pub trace_id: String,
    /// Archive that results of what is stored with the token go to.
    pub deliver_to: Option<String>,
}

/// Counts the requests that each tenant has open, or what else is under way for each of some names.
#[derive(Debug, Default)]
pub struct OpenRequests {
    counts: Mutex<BTreeMap<String, usize>>,
}

/// One open request; counted until this is dropped.
#[derive(Debug)]
pub struct OpenRequest {
    all: Arc<OpenRequests>,
    tenant: String,
}

impl OpenRequests {
    /// Counts one more request of a tenant, unless `limit` are open.
    #[must_use]
    pub fn open(self: &Arc<Self>, tenant: &str, limit: usize) -> Option<OpenRequest> {
        let mut counts = self.counts();
        let count = counts.entry(tenant.to_owned()).or_default();
        if *count >= limit {
            return None;
        }
        *count += 1;
        Some(OpenRequest { all: Arc::clone(self), tenant: tenant.to_owned() })
    }

    /// Whether as many of a tenant are open as may be.
    #[must_use]
    pub fn is_full(&self, tenant: &str, limit: usize) -> bool {
        self.counts().get(tenant).is_some_and(|count| *count >= limit)
    }

    fn counts(&self) -> MutexGuard<'_, BTreeMap<String, usize>> {
        // Nothing panics while it is held.
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for OpenRequest {
    fn drop(&mut self) {
        let mut counts = self.all.counts();
        match counts.get_mut(&self.tenant) {
            Some(count) if *count > 1 => *count -= 1,
            _ => drop(counts.remove(&self.tenant)),
        }
    }
}

/// What each tenant does one after the other.
#[derive(Debug, Default)]
pub struct InTurn {
    turns: Mutex<BTreeMap<String, Weak<tokio::sync::Mutex<()>>>>,
}

impl InTurn {
    /// The lock of a tenant; forgotten when nobody holds or awaits it.
    #[must_use]
    pub fn of(&self, tenant: &str) -> Arc<tokio::sync::Mutex<()>> {
        let mut turns = self.turns.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(own) = turns.get(tenant).and_then(Weak::upgrade) {
            return own;
        }
        turns.retain(|_, other| other.strong_count() > 0);
        let own = Arc::default();
        turns.insert(tenant.to_owned(), Arc::downgrade(&own));
        own
    }
}
