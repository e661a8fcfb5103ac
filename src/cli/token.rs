//! `medialrep token`: who may use the service. Works on the data directory, beside a running
//! service, which heeds it at once.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use jiff::Timestamp;

use super::{complain, exit};
use crate::audit::{Action, Entry};
use crate::dicomweb::ServerError;
use crate::jobs::audit_marks::follow;
use crate::jobs::place::Place;
use crate::jobs::store::Store;
use crate::jobs::token::{Scope, StoredToken, Token, check_tenant};
use crate::name::is_name;

/// What to do with tokens.
#[derive(Debug, clap::Subcommand)]
pub enum TokenCommand {
    /// Make a token and print it: it is shown this once. From the first one on nobody is let in without.
    Create(CreateArgs),
    /// List all tokens, revoked ones too; never their secrets
    List(DataArgs),
    /// Revoke a token; the next request with it is refused
    Revoke(RevokeArgs),
    /// Give a tenant the jobs that were sent before there was a token: nobody sees them otherwise
    Adopt(AdoptArgs),
}

/// Where the tokens are.
#[derive(Debug, clap::Args)]
pub struct DataArgs {
    /// The service's data directory, made when it is not there [default: data, which is not made]
    #[arg(long, env = "MEDIALREP_DATA_DIR", value_name = "DIR")]
    data_dir: Option<PathBuf>,
}

/// Where a service keeps its data that is started without a word about it.
const DEFAULT_DATA_DIR: &str = "data";

impl DataArgs {
    /// The folder, which is told; none where nobody named one and none is there: a token for a service that does not exist
    /// would let nobody in.
    fn folder(&self) -> Option<PathBuf> {
        let folder = self.data_dir.clone().unwrap_or_else(|| DEFAULT_DATA_DIR.into());
        let shown = std::path::absolute(&folder).unwrap_or_else(|_| folder.clone());
        if self.data_dir.is_none() && !Place::at(&folder).is_used() {
            complain(&format!(
                "there is no data directory at {}; name that of the service with --data-dir",
                shown.display()
            ));
            return None;
        }
        complain(&format!("data directory {}", shown.display()));
        Some(folder)
    }
}

/// Who gets what nobody owns.
#[derive(Debug, clap::Args)]
pub struct AdoptArgs {
    #[command(flatten)]
    data: DataArgs,

    /// Whose they are from now on.
    #[arg(long, value_name = "NAME", value_parser = check_tenant)]
    tenant: String,
}

/// A token to be made.
#[derive(Debug, clap::Args)]
pub struct CreateArgs {
    #[command(flatten)]
    data: DataArgs,

    /// Whose jobs it sees and sends. Tokens of one tenant see the same jobs, those of another none of them.
    #[arg(long, value_name = "NAME", value_parser = check_tenant)]
    tenant: String,

    /// What it allows, separated by commas: read, write, metrics.
    #[arg(long, value_delimiter = ',', default_value = "read,write", value_name = "SCOPES")]
    scopes: Vec<Scope>,

    /// When it ends by itself: 12h, 90days.
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    expires_in: Option<Duration>,

    /// The PACS that results of segmentations go to which are stored with it (STOW-RS): a name of serve's --pacs.
    #[arg(long, value_name = "NAME", value_parser = check_pacs)]
    deliver_to: Option<String>,
}

/// A token to be revoked.
#[derive(Debug, clap::Args)]
pub struct RevokeArgs {
    #[command(flatten)]
    data: DataArgs,

    /// Its id: the part between the underscores.
    #[arg(value_name = "ID")]
    id: String,
}

/// Does it.
///
/// # Errors
/// When the data directory cannot be used.
pub fn token(command: TokenCommand) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let data = match &command {
        TokenCommand::Create(args) => &args.data,
        TokenCommand::List(args) => args,
        TokenCommand::Revoke(args) => &args.data,
        TokenCommand::Adopt(args) => &args.data,
    };
    let Some(folder) = data.folder() else { return Ok(ExitCode::from(exit::USAGE)) };
    runtime.block_on(async {
        match command {
            TokenCommand::Create(args) => create(args, &folder).await,
            TokenCommand::List(_) => list(&folder).await,
            TokenCommand::Revoke(args) => revoke(&args.id, &folder).await,
            TokenCommand::Adopt(args) => adopt(&args.tenant, &folder).await,
        }
    })
}

/// Whether there ever was a token in this data directory; makes nothing.
///
/// # Errors
/// When there is a database and it cannot be read.
pub(super) async fn has_tokens(data_dir: &Path) -> anyhow::Result<bool> {
    let place = Place::at(data_dir);
    Ok(place.is_used() && place.open_store().await?.has_tokens().await?)
}

async fn open(data_dir: &Path) -> anyhow::Result<Arc<dyn Store>> {
    let place = Place::at(data_dir);
    place.open_store().await.with_context(|| format!("cannot use {place}"))
}

async fn create(args: CreateArgs, folder: &Path) -> anyhow::Result<ExitCode> {
    let store = open(folder).await?;
    let token = Token::new().map_err(|error| anyhow::anyhow!("no random numbers: {error}"))?;
    let expires_at = args.expires_in.map(|time| Timestamp::now().checked_add(time)).transpose()?;
    let stored = StoredToken { deliver_to: args.deliver_to, ..token.stored(args.tenant, args.scopes, expires_at) };
    store.insert_token(&stored).await?;
    // Shown whatever comes next: it holds from now on.
    print(&token.reveal());
    record(folder, &*store, Action::TokenCreated, &stored).await?;
    if store.has_jobs_of("").await? {
        complain(&format!(
            "jobs that were sent before there was a token are hidden now: medialrep token adopt --tenant {} shows them to it",
            stored.tenant
        ));
    }
    Ok(ExitCode::SUCCESS)
}

/// Whether a PACS can have this name; which there are is told to the server, not here.
fn check_pacs(name: &str) -> Result<String, ServerError> {
    if is_name(name) { Ok(name.to_owned()) } else { Err(ServerError::Name) }
}

async fn list(data_dir: &Path) -> anyhow::Result<ExitCode> {
    for token in open(data_dir).await?.list_tokens().await? {
        let scopes: Vec<_> = token.scopes.iter().map(|scope| scope.name()).collect();
        let end = match (token.revoked_at, token.expires_at) {
            (Some(time), _) => format!("revoked {time}"),
            (None, Some(time)) if time <= Timestamp::now() => format!("expired {time}"),
            (None, Some(time)) => format!("expires {time}"),
            (None, None) => "valid".to_owned(),
        };
        let target = token.deliver_to.map_or_else(String::new, |name| format!("  delivers to {name}"));
        let (id, tenant, scopes) = (token.id, token.tenant, scopes.join(","));
        print(&format!("{id}  {tenant}  {scopes}  made {}  {end}{target}", token.created_at));
    }
    Ok(ExitCode::SUCCESS)
}

async fn adopt(tenant: &str, folder: &Path) -> anyhow::Result<ExitCode> {
    let store = open(folder).await?;
    let count = store.adopt_jobs(tenant).await?;
    let outcome = if count == 0 { "none" } else { "ok" };
    let entry =
        Entry { tenant: Some(tenant), token: None, action: Action::Adopted, job: None, outcome, trace_id: None };
    append(folder, &*store, &entry).await?;
    print(&format!("{count} jobs belong to {tenant} now"));
    Ok(ExitCode::SUCCESS)
}

async fn revoke(id: &str, folder: &Path) -> anyhow::Result<ExitCode> {
    let store = open(folder).await?;
    if !store.revoke_token(id, Timestamp::now()).await? {
        complain("there is no valid token of this id; see medialrep token list");
        return Ok(ExitCode::from(exit::USAGE));
    }
    if let Some(stored) = store.get_token(id).await? {
        record(folder, &*store, Action::TokenRevoked, &stored).await?;
    }
    Ok(ExitCode::SUCCESS)
}

async fn record(folder: &Path, store: &dyn Store, action: Action, token: &StoredToken) -> anyhow::Result<()> {
    let entry =
        Entry { tenant: Some(&token.tenant), token: Some(&token.id), action, job: None, outcome: "ok", trace_id: None };
    append(folder, store, &entry).await
}

async fn append(folder: &Path, store: &dyn Store, entry: &Entry<'_>) -> anyhow::Result<()> {
    let audit = Place::at(folder).open_audit()?;
    follow(&audit, store).await?;
    audit.append(entry).context("cannot write the audit log")
}

#[expect(clippy::print_stdout, reason = "this is what was asked for")]
fn print(line: &str) {
    println!("{line}");
}
