//! Sends a message once. No proxy, no redirects, no reuse of connections: each would lead past
//! the check of the address.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use bytes::Bytes;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use reqwest::header::CONTENT_TYPE;
use reqwest::redirect::Policy;
use reqwest::{Client, StatusCode};
use uuid::Uuid;

use super::signature::Secret;
use super::targets::{TargetError, Targets};
use crate::outbound::{Fault, USER_AGENT, causes, parse_roots};

/// What a [`Sender`] needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WebhookConfig {
    /// Where messages may go.
    pub targets: Targets,
    /// What they are signed with.
    pub secret: Secret,
    /// Certificates in PEM that are trusted besides the public ones; may be empty.
    pub extra_roots: Vec<u8>,
    /// Longest time to resolve, connect and agree on TLS.
    pub connect: Duration,
    /// Longest time for an attempt.
    pub total: Duration,
}

impl WebhookConfig {
    /// With the public certificates, 5 s to connect and 15 s in all.
    #[must_use]
    pub fn new(targets: Targets, secret: Secret) -> Self {
        let (connect, total) = (Duration::from_secs(5), Duration::from_secs(15));
        Self { targets, secret, extra_roots: Vec::new(), connect, total }
    }
}

/// Why there is no sender.
#[derive(Debug, thiserror::Error)]
pub enum SenderError {
    /// No certificates where some were meant.
    #[error("the extra root certificates are not certificates in PEM")]
    Roots,
    /// The client refused its settings.
    #[error("the HTTP client cannot be made: {0}")]
    Client(#[from] reqwest::Error),
}

/// What is sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// The same in every attempt, so that a receiver can tell repeats.
    pub id: Uuid,
    /// JSON.
    pub body: Bytes,
}

/// Why an attempt failed. Holds nothing of the URL or the message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// The list of targets does not allow the URL, or no longer.
    #[error("the target is not allowed: {0}")]
    TargetNotAllowed(#[from] TargetError),
    /// The host has no address.
    #[error("the name of the host could not be resolved")]
    NameNotResolved,
    /// The host has an address that is neither public nor listed.
    #[error("the host has an address that is not allowed")]
    AddressNotAllowed,
    /// Nobody listens there.
    #[error("the connection could not be made")]
    ConnectFailed,
    /// The certificate does not fit, or the server speaks no TLS.
    #[error("the secure connection could not be made")]
    TlsFailed,
    /// No answer in time.
    #[error("there was no answer in time")]
    TimedOut,
    /// The connection ended without an answer, or with something that is none.
    #[error("the connection ended without an answer")]
    Interrupted,
    /// The answer points elsewhere, where nothing is sent.
    #[error("the answer was a redirect, {0}, which is not followed")]
    Redirected(u16),
    /// The receiver wants no more messages: 410.
    #[error("the receiver has gone for good, 410")]
    Gone,
    /// Any other status that is not a success.
    #[error("the answer was status {0}")]
    RefusedStatus(u16),
}

impl SendError {
    /// Stable, snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::TargetNotAllowed(_) => "target_not_allowed",
            Self::NameNotResolved => "name_not_resolved",
            Self::AddressNotAllowed => "address_not_allowed",
            Self::ConnectFailed => "connect_failed",
            Self::TlsFailed => "tls_failed",
            Self::TimedOut => "timed_out",
            Self::Interrupted => "interrupted",
            Self::Redirected(_) => "redirected",
            Self::Gone => "gone",
            Self::RefusedStatus(_) => "refused_status",
        }
    }

    /// Status of the answer, where there was one.
    #[must_use]
    pub fn status(&self) -> Option<u16> {
        match self {
            Self::Redirected(status) | Self::RefusedStatus(status) => Some(*status),
            Self::Gone => Some(410),
            _ => None,
        }
    }

    /// Whether no further attempt is to be made.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(self, Self::Gone)
    }
}

/// Finds the addresses of a host.
#[async_trait]
pub trait Resolver: Send + Sync + 'static {
    /// All addresses of `host`.
    ///
    /// # Errors
    /// When it has none, or they cannot be asked for.
    async fn lookup(&self, host: &str) -> io::Result<Vec<IpAddr>>;
}

/// Asks the operating system.
#[derive(Clone, Copy, Debug)]
pub struct SystemResolver;

#[async_trait]
impl Resolver for SystemResolver {
    async fn lookup(&self, host: &str) -> io::Result<Vec<IpAddr>> {
        Ok(tokio::net::lookup_host((host, 0)).await?.map(|address| address.ip()).collect())
    }
}

/// Sends messages.
#[derive(Clone, Debug)]
pub struct Sender {
    client: Client,
    targets: Arc<Targets>,
    secret: Secret,
}

impl Sender {
    /// With the resolver of the operating system.
    ///
    /// # Errors
    /// When the extra certificates cannot be used.
    pub fn new(config: WebhookConfig) -> Result<Self, SenderError> {
        Self::with_resolver(config, Arc::new(SystemResolver))
    }

    /// With another resolver.
    ///
    /// # Errors
    /// As [`Sender::new`].
    pub fn with_resolver(config: WebhookConfig, resolver: Arc<dyn Resolver>) -> Result<Self, SenderError> {
        let targets = Arc::new(config.targets);
        let mut client = Client::builder()
            .user_agent(USER_AGENT)
            .no_proxy()
            .redirect(Policy::none())
            .pool_max_idle_per_host(0)
            .connect_timeout(config.connect)
            .timeout(config.total)
            .dns_resolver(Arc::new(CheckedResolver { resolver, targets: Arc::clone(&targets) }));
        for root in parse_roots(&config.extra_roots).map_err(|_| SenderError::Roots)? {
            client = client.add_root_certificate(root);
        }
        Ok(Self { client: client.build()?, targets, secret: config.secret })
    }

    /// Where messages may go.
    #[must_use]
    pub fn targets(&self) -> &Targets {
        &self.targets
    }

    /// Sends `message` to `url`; the status of success.
    ///
    /// The URL is checked here too: the list may be another one than when it was given. The
    /// certificate of an https server is checked against the host of the URL.
    ///
    /// # Errors
    /// When the URL is not allowed, the message could not be sent, or the answer is not a success.
    pub async fn send(&self, url: &str, message: &Message) -> Result<u16, SendError> {
        let url = self.targets.check(url)?;
        // No resolver is asked for these.
        if let Some(address) = url.address() {
            check_addresses(&self.targets, &[address])?;
        }
        let id = message.id.to_string();
        let timestamp = jiff::Timestamp::now().as_second();
        let request = self
            .client
            .post(url.into_url())
            .header(CONTENT_TYPE, "application/json")
            .header("webhook-signature", self.secret.sign(&id, timestamp, &message.body))
            .header("webhook-id", id)
            .header("webhook-timestamp", timestamp)
            .body(message.body.clone());
        // The body of the answer is left unread: its sender could make it endless.
        let answer = request.send().await.map_err(fault)?;
        judge(answer.status())
    }
}

/// Part of the client, so that it connects to what was checked and to nothing else, whatever the
/// name resolves to a moment later.
struct CheckedResolver {
    resolver: Arc<dyn Resolver>,
    targets: Arc<Targets>,
}

impl Resolve for CheckedResolver {
    fn resolve(&self, name: Name) -> Resolving {
        let (resolver, targets) = (Arc::clone(&self.resolver), Arc::clone(&self.targets));
        Box::pin(async move {
            let addresses = resolver.lookup(name.as_str()).await.map_err(|error| {
                tracing::info!(%error, "the host of a webhook could not be resolved");
                SendError::NameNotResolved
            })?;
            check_addresses(&targets, &addresses)?;
            // The client puts in the port of the URL.
            let addresses = addresses.into_iter().map(|address| SocketAddr::new(address, 0));
            Ok(Box::new(addresses) as Addrs)
        })
    }
}

/// One bad address is enough to refuse: who mixes them means to try.
fn check_addresses(targets: &Targets, addresses: &[IpAddr]) -> Result<(), SendError> {
    if addresses.is_empty() {
        return Err(SendError::NameNotResolved);
    }
    match addresses.iter().find(|address| !targets.allows_address(**address)) {
        Some(address) => {
            tracing::warn!(%address, "the host of a webhook has an address that is neither public nor listed");
            Err(SendError::AddressNotAllowed)
        }
        None => Ok(()),
    }
}

fn judge(status: StatusCode) -> Result<u16, SendError> {
    match status.as_u16() {
        status @ 200..=299 => Ok(status),
        status @ 300..=399 => Err(SendError::Redirected(status)),
        410 => Err(SendError::Gone),
        status => Err(SendError::RefusedStatus(status)),
    }
}

fn fault(error: reqwest::Error) -> SendError {
    let error = error.without_url();
    if let Some(ours) = causes(&error).find_map(|cause| cause.downcast_ref::<SendError>()) {
        return *ours;
    }
    let fault = match Fault::of(&error) {
        Fault::TimedOut => SendError::TimedOut,
        Fault::TlsFailed => SendError::TlsFailed,
        Fault::ConnectFailed => SendError::ConnectFailed,
        Fault::Interrupted => SendError::Interrupted,
    };
    let cause = causes(&error).last().map(ToString::to_string);
    tracing::info!(code = fault.code(), cause, "a webhook could not be sent");
    fault
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_statuses_from_200_to_299_are_success() {
        let judged = |status| judge(StatusCode::from_u16(status).unwrap());
        assert_eq!(judged(200), Ok(200));
        assert_eq!(judged(204), Ok(204));
        assert_eq!(judged(304), Err(SendError::Redirected(304)));
        assert_eq!(judged(404), Err(SendError::RefusedStatus(404)));
        assert_eq!(judged(500), Err(SendError::RefusedStatus(500)));
        assert_eq!(judged(410), Err(SendError::Gone));
        assert!(SendError::Gone.is_final());
        assert!(!SendError::RefusedStatus(404).is_final());
    }
}
