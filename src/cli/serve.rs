//! `medialrep serve`.

use std::process::ExitCode;

use clap::Args;

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub struct ServeArgs {}

/// Starts the service.
///
/// # Errors
/// When it cannot start.
pub fn serve(_arguments: ServeArgs) -> anyhow::Result<ExitCode> {
    anyhow::bail!("this build has no service")
}
