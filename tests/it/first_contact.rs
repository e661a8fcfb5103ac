//! `make run` and `make test` on a machine that lacks something: a copy of the scripts, on a path of
//! stand-ins for the tools that they call.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// What the scripts and the stand-ins use of every system.
const SYSTEM: [&str; 19] = [
    "bash", "cat", "chmod", "dirname", "env", "grep", "head", "id", "make", "mkdir", "mktemp", "paste", "rm", "sed",
    "seq", "sleep", "sort", "tail", "tee",
];
const FILES: [&str; 9] = [
    "Makefile",
    "Cargo.toml",
    "rust-toolchain.toml",
    "scripts/need.sh",
    "scripts/run.sh",
    "scripts/test.sh",
    "web/package.json",
    "web/package-lock.json",
    "tests/tools/package-lock.json",
];
const PACKAGES: [&str; 2] = ["web", "tests/tools"];

/// A machine with everything: nothing is to be fetched, and the program that is built ends at once.
const TOOLS: [(&str, &str); 7] = [
    ("node", "echo v22.12.0"),
    ("npm", "case $1 in ci) mkdir -p node_modules && >node_modules/.package-lock.json ;; esac"),
    (
        "cargo",
        "case $1 in build) mkdir -p target/release && echo 'exit 1' >target/release/medialrep && chmod +x target/release/medialrep ;; esac",
    ),
    ("rustc", "echo 'rustc 1.95.0 (0123456789 2026-04-14)'"),
    ("cc", ""),
    // Nobody listens.
    ("curl", "exit 7"),
    ("chromium", ""),
];

const OFFLINE_NPM: &str = "echo 'npm warn using --force' >&2; echo 'npm error code EAI_AGAIN' >&2; exit 1";
const OFFLINE_CARGO: &str = "case $1 in
    tree) echo 'error: no matching package found' >&2; exit 101 ;;
    fetch) echo '    Updating crates.io index' >&2; echo '  Could not resolve host: index' >&2; exit 101 ;;
esac";

struct Machine {
    dir: TempDir,
}

impl Machine {
    fn with_everything() -> Self {
        let machine = Self { dir: TempDir::new().unwrap() };
        for file in FILES {
            let (from, to) = (Path::new(ROOT).join(file), machine.repository().join(file));
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            shell("cp \"$0\" \"$1\"", &[text(&from), text(&to)]);
        }
        std::fs::create_dir(machine.path()).unwrap();
        for name in SYSTEM {
            symlink(found(name), machine.path().join(name)).unwrap();
        }
        for (name, script) in TOOLS {
            machine.set(name, script);
        }
        for folder in PACKAGES {
            let modules = machine.repository().join(folder).join("node_modules");
            std::fs::create_dir(&modules).unwrap();
            std::fs::write(modules.join(".package-lock.json"), "").unwrap();
        }
        machine
    }

    fn repository(&self) -> PathBuf {
        self.dir.path().join("repository")
    }

    fn path(&self) -> PathBuf {
        self.dir.path().join("bin")
    }

    /// A tool that keeps what it is called with and does what `script` says.
    fn set(&self, name: &str, script: &str) {
        let (file, calls) = (self.path().join(name), self.dir.path().join("calls"));
        let script = format!("#!{}\necho {name} \"$@\" >>{}\n{script}\n", found("bash").display(), calls.display());
        // Never through a link to the system's own.
        let _ = std::fs::remove_file(&file);
        shell("printf %s \"$1\" >\"$0\" && chmod 755 \"$0\"", &[text(&file), &script]);
    }

    fn lacks(self, name: &str) -> Self {
        std::fs::remove_file(self.path().join(name)).unwrap();
        self
    }

    fn where_tool(self, name: &str, script: &str) -> Self {
        self.set(name, script);
        self
    }

    fn without_packages(self) -> Self {
        for folder in PACKAGES {
            std::fs::remove_dir_all(self.repository().join(folder).join("node_modules")).unwrap();
        }
        self
    }

    /// Exit code, stdout and stderr of a step.
    fn make(&self, step: &str) -> (Option<i32>, String, String) {
        let script = self.repository().join(format!("scripts/{step}.sh"));
        let done = Command::new(found("bash")).arg(script).env_clear().env("PATH", self.path()).output().unwrap();
        let told = |bytes| String::from_utf8(bytes).unwrap();
        (done.status.code(), told(done.stdout), told(done.stderr))
    }

    fn calls(&self) -> String {
        std::fs::read_to_string(self.dir.path().join("calls")).unwrap_or_default()
    }
}

/// Writes files that will be run: what is open for writing, in this process or one that another thread
/// has just forked, cannot be.
fn shell(script: &str, arguments: &[&str]) {
    let done = Command::new(found("bash")).args(["-c", script]).args(arguments).status().unwrap();
    assert!(done.success(), "{script} {arguments:?}");
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Where this machine has a program.
fn found(name: &str) -> PathBuf {
    let path = std::env::var_os("PATH").unwrap();
    let file = std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file());
    file.unwrap_or_else(|| panic!("{name} is missing"))
}

/// One sentence, with these words, and nothing was fetched or built.
#[track_caller]
fn check_refused(machine: &Machine, step: &str, words: &[&str]) {
    let (code, stdout, stderr) = machine.make(step);
    let told = stdout + &stderr;
    assert_eq!(code, Some(1), "{told}");
    assert_eq!(told.lines().count(), 1, "{told}");
    assert!(told.starts_with(&format!("make {step}: ")), "{told}");
    for word in words {
        assert!(told.contains(word), "{word}: {told}");
    }
    let calls = machine.calls();
    for call in ["npm run", "npm ci", "npm test", "cargo build", "cargo test"] {
        assert!(!calls.contains(call), "{call}: {calls}");
    }
}

fn check_both(change: impl Fn(Machine) -> Machine, words: &[&str]) {
    for step in ["run", "test"] {
        check_refused(&change(Machine::with_everything()), step, words);
    }
}

#[test]
fn a_missing_tool_is_named_with_what_to_install() {
    check_both(|machine| machine.lacks("node"), &["Node.js is missing", "install Node.js"]);
    check_both(|machine| machine.lacks("npm"), &["npm is missing", "install Node.js"]);
    check_both(|machine| machine.lacks("cargo"), &["Rust is missing", "rustup"]);
    check_both(|machine| machine.lacks("rustc"), &["Rust is missing", "rustup"]);
    check_both(|machine| machine.lacks("cc"), &["C compiler", "apt-get install gcc"]);
    check_refused(&Machine::with_everything().lacks("curl"), "run", &["curl is missing", "apt-get install curl"]);
    check_refused(&Machine::with_everything().lacks("chromium"), "test", &["Chromium is missing", "MEDIALREP_BROWSER"]);
}

#[test]
fn a_node_that_is_too_old_or_an_odd_one_is_refused() {
    for version in ["18.19.0", "20.18.3", "21.7.3", "22.11.0", "23.11.0"] {
        let words = [&format!("Node.js {version} cannot"), "20.19 or 22.12 or 24 and later", "install Node.js"];
        check_both(|machine| machine.where_tool("node", &format!("echo v{version}")), &words);
    }
}

#[test]
fn a_node_that_package_json_allows_is_taken() {
    for version in ["20.19.0", "20.20.2", "22.12.0", "22.100.1", "24.0.0", "26.3.1"] {
        let machine = Machine::with_everything().where_tool("node", &format!("echo v{version}"));
        machine.make("run");
        assert!(machine.calls().contains("cargo build"), "{version}: {}", machine.calls());
    }
}

#[test]
fn a_rust_that_is_too_old_or_cannot_be_fetched_is_refused() {
    let old = "echo 'rustc 1.63.0 (4b91a6ea7 2022-08-08)'";
    check_both(|machine| machine.where_tool("rustc", old), &["Rust 1.63.0 is too old", "1.90", "rustup"]);
    let offline = "echo 'info: syncing channel updates' >&2; echo 'error: error downloading file' >&2; exit 1";
    let words = ["Rust 1.95.0", "check the network", "rustup toolchain install 1.95.0"];
    check_both(|machine| machine.where_tool("cargo", offline), &words);
}

#[test]
fn a_compiler_without_headers_counts_as_missing() {
    let script = "echo '<stdin>:1:10: fatal error: stdlib.h: No such file or directory' >&2; exit 1";
    check_both(|machine| machine.where_tool("cc", script), &["C compiler", "libc6-dev"]);
}

#[test]
fn a_registry_that_does_not_answer_is_named() {
    let offline = |machine: Machine| machine.without_packages().where_tool("npm", OFFLINE_NPM);
    check_both(offline, &["npm's registry does not answer (EAI_AGAIN)", "check the network"]);
    let words = ["cargo cannot fetch", "check the network", "Could not resolve host"];
    check_both(|machine| machine.where_tool("cargo", OFFLINE_CARGO), &words);
    let root = Machine::with_everything().lacks("chromium").where_tool("id", "echo 0");
    let machine = root.where_tool("apt-get", "echo 'Err:1 http://debian'; exit 100");
    check_refused(&machine, "test", &["Chromium is missing", "apt-get cannot fetch it", "check the network"]);
}

#[test]
fn a_registry_that_does_not_know_the_question_has_answered() {
    let script = "case $1 in ping) echo 'npm error code E404' >&2; exit 1 ;; esac";
    let machine = Machine::with_everything().without_packages().where_tool("npm", script);
    machine.make("run");
    assert!(machine.calls().contains("npm ci"), "{}", machine.calls());
}

#[test]
fn a_port_that_is_taken_is_told_before_the_build() {
    let machine = Machine::with_everything().where_tool("curl", "");
    check_refused(&machine, "run", &["http://127.0.0.1:8080", "MEDIALREP_LISTEN="]);
}

#[test]
fn what_is_there_needs_no_network_and_each_step_is_a_line() {
    let npm = "case $1 in run) echo 'openapi-typescript' ;; ping | ci) exit 1 ;; esac";
    let machine = Machine::with_everything().where_tool("npm", npm);
    let (_, stdout, stderr) = machine.make("run");
    let steps: Vec<_> = stdout.lines().map(|line| line.split(" ...").next().unwrap()).collect();
    assert_eq!(steps, ["building the page", "building the program"], "{stdout}{stderr}");
    assert_eq!(stderr, "");
    let calls = machine.calls();
    assert!(calls.contains("cargo build --release --locked") && !calls.contains("fetch"), "{calls}");
}

#[test]
fn what_is_not_there_is_fetched_first() {
    let cargo = "case $1 in tree) exit 101 ;; fetch) echo '  Downloaded anyhow v1.0.0' >&2 ;; esac";
    let machine = Machine::with_everything().without_packages().where_tool("cargo", cargo);
    let (_, stdout, _) = machine.make("run");
    let steps: Vec<_> = stdout.lines().map(|line| line.split(" ").next().unwrap()).collect();
    assert_eq!(steps, ["fetching", "fetching", "building", "building"], "{stdout}");
}

#[test]
fn a_page_that_cannot_be_built_shows_why() {
    let script = "case $1 in run) echo 'error TS2304: Cannot find name' >&2; exit 2 ;; esac";
    let machine = Machine::with_everything().where_tool("npm", script);
    let (code, _, stderr) = machine.make("run");
    assert!(code != Some(0) && stderr.contains("error TS2304"), "{stderr}");
    assert!(!machine.calls().contains("cargo build"));
}
