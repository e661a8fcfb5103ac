//! Webhooks: which addresses a caller may have told of an event, and telling them.
//!
//! A URL from outside makes this server send a request from inside. So a URL counts only under a
//! listed prefix ([`Targets::check`], when it is given and again before each attempt), every
//! address that its host resolves to is judged, and the connection goes to judged addresses only
//! ([`Sender`]). Messages are signed after [Standard Webhooks](https://www.standardwebhooks.com).

mod addresses;
mod sender;
mod signature;
mod targets;

use std::time::Duration;

pub use sender::{Message, Resolver, SendError, Sender, SenderError, SystemResolver, WebhookConfig};
pub use signature::{Secret, SecretError};
pub use targets::{CallbackUrl, MAX_URL_BYTES, TargetError, Targets, TargetsError};

const MINUTE: u64 = 60;
const HOUR: u64 = 60 * MINUTE;
/// Waits between attempts, in seconds: short ones for a restart, long ones for a night.
const WAITS: [u64; 7] = [5, 30, 5 * MINUTE, 30 * MINUTE, 2 * HOUR, 6 * HOUR, 12 * HOUR];

/// How long to wait after attempt number `attempt`, counted from 1; none when it was the last.
#[must_use]
pub fn next_try_after(attempt: u32) -> Option<Duration> {
    let at = usize::try_from(attempt.saturating_sub(1)).ok()?;
    WAITS.get(at).copied().map(Duration::from_secs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_and_end() {
        let waits: Vec<_> = (1..=8).map(|attempt| next_try_after(attempt).map(|wait| wait.as_secs())).collect();
        let wanted = [5, 30, 300, 1800, 7200, 21_600, 43_200].map(Some);
        assert_eq!(waits[..7], wanted);
        assert_eq!(waits[7], None);
        assert_eq!(next_try_after(u32::MAX), None);
    }
}
