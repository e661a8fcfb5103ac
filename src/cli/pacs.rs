//! Arguments that name archives.

use std::env::{self, VarError};
use std::fs;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, bail, ensure};

use crate::dicomweb::{CREDENTIALS_ENV, Credentials, PacsConfig, PacsServer};

/// Longest time to connect to an archive; it is near.
const CONNECT: Duration = Duration::from_secs(5);

/// Archives that masks may be fetched from.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "PACS")]
pub(super) struct PacsArgs {
    /// A PACS that segmentations may be fetched from by DICOMweb, by a name of your choice:
    /// main=https://pacs.example.org/dicom-web. Several are given by several of these options, or separated by commas.
    #[arg(long, env = "MEDIALREP_PACS", value_delimiter = ',', value_name = "NAME=URL")]
    pacs: Vec<String>,

    /// File with what a PACS asks for, one line: USER:PASSWORD or Bearer TOKEN. Where none is named, the variable
    /// MEDIALREP_PACS_CREDENTIALS_NAME is looked at, the name in capitals, with _ for dots and hyphens.
    #[arg(long, env = CREDENTIALS_ENV, value_delimiter = ',', value_name = "NAME=FILE")]
    pacs_credentials: Vec<String>,

    /// File with certificates (PEM) that are trusted beside the public ones: those of the hospital.
    #[arg(long, env = "MEDIALREP_PACS_CA_FILE", value_name = "FILE")]
    pacs_ca_file: Option<PathBuf>,
}

/// Which file is for which archive.
#[derive(Clone, Debug)]
struct CredentialsFile {
    name: String,
    file: PathBuf,
}

impl FromStr for CredentialsFile {
    type Err = anyhow::Error;

    /// Says nothing of the text: a password may stand in the place of the file.
    fn from_str(text: &str) -> anyhow::Result<Self> {
        let (name, file) = text.split_once('=').with_context(|| {
            format!("--pacs-credentials (or {CREDENTIALS_ENV}) is NAME=FILE, with the name of a --pacs")
        })?;
        Ok(Self { name: name.to_owned(), file: file.into() })
    }
}

impl CredentialsFile {
    /// Names the option and the archive, never the file, as above.
    fn read(&self) -> anyhow::Result<Credentials> {
        let name = &self.name;
        let text = fs::read_to_string(&self.file).with_context(|| {
            format!("cannot read the file that --pacs-credentials (or {CREDENTIALS_ENV}) names for {name}")
        })?;
        text.trim().parse().with_context(|| format!("in the file that --pacs-credentials names for {name}"))
    }
}

impl PacsArgs {
    /// The same, checked; `None` where no archive is named. `idle` is the longest silence.
    ///
    /// # Errors
    /// When a name is not unique or not known, or a file cannot be used.
    pub(super) fn config(&self, idle: Duration) -> anyhow::Result<Option<PacsConfig>> {
        let mut servers = self.servers()?;
        let mut files = Vec::new();
        for text in &self.pacs_credentials {
            let given: CredentialsFile = text.parse()?;
            let name = &given.name;
            ensure!(
                servers.iter().any(|server| server.name == *name),
                "--pacs-credentials has a name that no --pacs has"
            );
            ensure!(
                files.iter().all(|other: &CredentialsFile| other.name != *name),
                "two --pacs-credentials for {name}"
            );
            files.push(given);
        }
        for server in &mut servers {
            let file = files.iter().find(|given| given.name == server.name);
            server.credentials = match file {
                Some(given) => Some(given.read()?),
                None => credentials_of_environment(&server.name)?,
            };
        }
        if servers.is_empty() {
            return Ok(None);
        }
        let extra_roots = match &self.pacs_ca_file {
            Some(file) => fs::read(file).with_context(|| format!("cannot read {}", file.display()))?,
            None => Vec::new(),
        };
        Ok(Some(PacsConfig { servers, extra_roots, connect: CONNECT, idle }))
    }

    /// Read here and not by the parser of arguments, which repeats what it cannot read: that may hold a password.
    fn servers(&self) -> anyhow::Result<Vec<PacsServer>> {
        let mut servers: Vec<PacsServer> = Vec::new();
        for (at, text) in self.pacs.iter().enumerate() {
            let server: PacsServer = text.trim().parse().with_context(|| format!("in --pacs number {}", at + 1))?;
            let variable = variable_of(&server.name);
            if let Some(other) = servers.iter().find(|other| variable_of(&other.name) == variable) {
                ensure!(other.name != server.name, "two --pacs are named {}", server.name);
                bail!("the --pacs {} and {} share the variable {variable}: rename one", other.name, server.name);
            }
            servers.push(server);
        }
        Ok(servers)
    }
}

/// Where the credentials of an archive are looked for that no file is named for.
fn variable_of(name: &str) -> String {
    format!("{CREDENTIALS_ENV}_{}", name.to_ascii_uppercase().replace(['.', '-'], "_"))
}

fn credentials_of_environment(name: &str) -> anyhow::Result<Option<Credentials>> {
    let variable = variable_of(name);
    match env::var(&variable) {
        Ok(text) => text.trim().parse().map(Some).with_context(|| format!("in {variable}")),
        Err(VarError::NotPresent) => Ok(None),
        // It would repeat the value.
        Err(VarError::NotUnicode(_)) => bail!("{variable} is not UTF-8"),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        pacs: PacsArgs,
    }

    fn config(arguments: &[&str]) -> anyhow::Result<Option<PacsConfig>> {
        let arguments = ["medialrep"].iter().chain(arguments);
        Command::try_parse_from(arguments)?.pacs.config(Duration::from_secs(1))
    }

    #[test]
    fn servers_have_names_and_their_credentials() {
        assert_eq!(config(&[]).unwrap(), None);
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(b"peer:secret\n").unwrap();
        let credentials = format!("main={}", file.path().display());
        let [main, other] = ["main=http://127.0.0.1:8042/dicom-web", "other=https://pacs.example.org"];
        let arguments = ["--pacs", main, "--pacs", other, "--pacs-credentials", credentials.as_str()];
        let found = config(&arguments).unwrap().unwrap();
        let told: Vec<_> = found.servers.iter().map(|s| (s.name.as_str(), s.credentials.is_some())).collect();
        assert_eq!(told, [("main", true), ("other", false)]);
        assert!(!format!("{found:?}").contains("secret"));
    }

    #[test]
    fn what_contradicts_itself_is_told_without_secrets() {
        let url = "main=http://127.0.0.1:8042";
        for (arguments, told) in [
            (vec!["--pacs", url, "--pacs", url], "two --pacs are named main"),
            (vec!["--pacs", url, "--pacs-credentials", "other=/nowhere"], "a name that no --pacs has"),
            (vec!["--pacs", url, "--pacs-credentials", "main=peer:secret"], "names for main"),
            (vec!["--pacs", url, "--pacs-credentials", "peer:secret"], "NAME=FILE"),
            (vec!["--pacs", url, "--pacs", "MAIN=http://127.0.0.1"], "main and MAIN share the variable"),
            (vec!["--pacs", "a-b=http://127.0.0.1", "--pacs", "a.b=http://127.0.0.1"], "a-b and a.b share"),
            (vec!["--pacs", "main=http://peer:secret@127.0.0.1"], "user name or a password"),
        ] {
            let error = format!("{:#}", config(&arguments).unwrap_err());
            assert!(error.contains(told) && !error.contains("secret"), "{error}");
        }
    }
}
