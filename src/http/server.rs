//! The service under way: accepts connections until it is told to stop, then lets what runs end.

use std::future::Future;
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt::set_socket_send_buffer_size;
use tokio::net::{TcpListener, TcpStream};
use tokio::time::{sleep, timeout};

use super::auth::Access;
use super::connections::{Answering, Connections, PlaceTaken, Watched};
use super::router;
use crate::config::{ConnectionLimits, ServeConfig};
use crate::dicomweb::{Pacs, PacsError};
use crate::jobs::place::{OpenError, Place};
use crate::jobs::service::Jobs;
use crate::jobs::worker::{Processor, Workers};
use crate::webhook::{Sender, SenderError};

/// Pause after a connection could not be accepted (out of file descriptors, say).
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Why the service does not run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The data directory cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Webhooks cannot be sent as configured.
    #[error(transparent)]
    Webhooks(#[from] SenderError),
    /// A PACS cannot be asked as configured.
    #[error(transparent)]
    Pacs(#[from] PacsError),
}

/// Runs the service on `listener` until `shutdown` is ready, and returns once everything is at
/// rest: no connection, no job running.
///
/// # Errors
/// When the data directory cannot be opened, or webhooks cannot be sent or a PACS asked as configured.
pub async fn run(
    listener: TcpListener,
    config: &ServeConfig,
    processor: &Processor,
    shutdown: impl Future<Output = ()>,
) -> Result<(), RunError> {
    let webhooks = config.webhooks.clone().map(Sender::new).transpose()?;
    let pacs = config.pacs.clone().map(Pacs::new).transpose()?;
    let mut jobs = Jobs::open(&Place::at(&config.data_dir), config.jobs, webhooks).await?;
    if let Some(pacs) = pacs {
        jobs = jobs.with_pacs(pacs);
    }
    let jobs = Arc::new(jobs);
    let workers = Workers::start(&jobs, processor, config.workers);
    let is_local = listener.local_addr().is_ok_and(|address| address.ip().is_loopback());
    let router = router(jobs, Access { cors_origins: config.cors_origins.clone(), is_local });
    let connections = accept(listener, router, config.connections, shutdown).await;
    tracing::info!(drain_seconds = config.drain.as_secs(), "stopping");
    let _ = tokio::join!(workers.drain(config.drain), timeout(config.drain, connections.shutdown()));
    tracing::info!("stopped");
    Ok(())
}

/// The framework's own loop has no timeout for headers and no bound on connections.
async fn accept(
    listener: TcpListener,
    router: Router,
    limits: ConnectionLimits,
    shutdown: impl Future<Output = ()>,
) -> GracefulShutdown {
    let graceful = GracefulShutdown::new();
    let connections = Connections::new(limits);
    let mut shutdown = pin!(shutdown);
    loop {
        let next = async {
            let accepted = listener.accept().await?;
            Ok::<_, io::Error>((accepted.0, connections.admit().await))
        };
        tokio::select! {
            () = &mut shutdown => return graceful,
            accepted = next => match accepted {
                Ok((stream, place)) => serve(stream, router.clone(), limits, &graceful, place),
                Err(error) => {
                    tracing::warn!(%error, "connection not accepted");
                    sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }
}

fn serve(stream: TcpStream, router: Router, limits: ConnectionLimits, graceful: &GracefulShutdown, place: PlaceTaken) {
    // Status answers are small: waiting to fill a packet would only delay them.
    let _ = stream.set_nodelay(true);
    // The system's own bound is several MiB for each.
    let _ = set_socket_send_buffer_size(&stream, limits.unread_bytes);
    let open = Arc::clone(&place.0);
    let service = TowerToHyperService::new(router);
    let counted = service_fn(move |request| {
        let (answering, answer) = (Answering::of(&open), service.call(request));
        async move { answer.await.map(|answer| answer.map(|body| answering.with(body))) }
    });
    let stream = Watched::new(stream, Arc::clone(&place.0));
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.header_read)
        .max_buf_size(limits.buffer_bytes)
        .serve_connection(TokioIo::new(stream), counted);
    let connection = graceful.watch(connection);
    tokio::spawn(async move {
        // A client that goes away is no event.
        tokio::select! {
            _ = connection => {}
            () = place.0.closed() => {}
        }
        drop(place);
    });
}
