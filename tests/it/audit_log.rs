//! The audit log: its chain, its writers, and what a power loss or a full disk leaves.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;

use medialrep::audit::{Action, Audit, AuditError, Entry, Verified, verify};
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

const ENTRY: Entry<'static> = Entry {
    tenant: Some("radiology"),
    token: Some("k3x9"),
    action: Action::Submit,
    job: Some("01890a5d-ac96-774b-bcce-b302099a8057"),
    outcome: "accepted",
    trace_id: Some("4bf92f3577b34da6a3ce929d0e0e4736"),
};
const CHILD_LOG: &str = "MEDIALREP_TEST_AUDIT_LOG";

/// A log of so many entries; the folder lives as long as the first.
fn log_of(entries: usize) -> (TempDir, PathBuf, Audit) {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("audit/log.jsonl");
    let audit = Audit::open(&path).unwrap();
    append(&audit, entries);
    (dir, path, audit)
}

fn append(audit: &Audit, entries: usize) {
    for _ in 0..entries {
        audit.append(&ENTRY).unwrap();
    }
}

fn lines(path: &Path) -> Vec<String> {
    fs::read_to_string(path).unwrap().lines().map(str::to_owned).collect()
}

fn write_lines(path: &Path, lines: &[String]) {
    fs::write(path, lines.iter().map(|line| format!("{line}\n")).collect::<String>()).unwrap();
}

fn tear(path: &Path, bytes: &[u8]) {
    OpenOptions::new().append(true).open(path).unwrap().write_all(bytes).unwrap();
}

fn sha256(text: &str) -> String {
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_line_is_as_documented() {
    let (_dir, path, audit) = log_of(1);
    let denied = Entry {
        tenant: None,
        token: None,
        action: Action::ReadResult,
        job: None,
        outcome: "unauthorized",
        trace_id: None,
    };
    audit.append(&denied).unwrap();
    audit.sync().unwrap();
    let lines = lines(&path);
    let first: Value = serde_json::from_str(&lines[0]).unwrap();
    let at = first["at"].as_str().unwrap();
    assert_eq!((at.len(), &at[19..20], &at[23..]), (24, ".", "Z"));
    assert_eq!(
        lines[0],
        format!(
            r#"{{"seq":1,"at":"{at}","tenant":"radiology","token":"k3x9","action":"submit","job":"01890a5d-ac96-774b-bcce-b302099a8057","outcome":"accepted","trace_id":"4bf92f3577b34da6a3ce929d0e0e4736","prev":"{}"}}"#,
            "0".repeat(64)
        )
    );
    assert!(lines[1].starts_with(r#"{"seq":2,"#));
    let rest = format!(
        r#""tenant":null,"token":null,"action":"read_result","job":null,"outcome":"unauthorized","trace_id":null,"prev":"{}"}}"#,
        sha256(&lines[0])
    );
    assert!(lines[1].ends_with(&rest), "{}", lines[1]);
}

#[test]
fn nobody_else_can_read_it() {
    let (_dir, path, _audit) = log_of(1);
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&path), mode(path.parent().unwrap())), (0o600, 0o700));
}

#[test]
fn a_whole_chain_verifies_and_goes_on_after_a_restart() {
    let (_dir, path, audit) = log_of(0);
    let empty = Verified { last_hash: "0".repeat(64), ..Verified::default() };
    assert_eq!(verify(&path).unwrap(), empty);
    append(&audit, 3);
    drop(audit);
    append(&Audit::open(&path).unwrap(), 2);
    let expected = Verified {
        entries: 5,
        torn: 0,
        first_seq: 1,
        last_seq: 5,
        begins_with: None,
        last_hash: sha256(lines(&path).last().unwrap()),
    };
    assert_eq!(verify(&path).unwrap(), expected);
}

#[test]
fn tampering_is_found_and_named() {
    let (_dir, path, _audit) = log_of(6);
    let whole = lines(&path);
    let check = |changed: &[String]| {
        write_lines(&path, changed);
        verify(&path).map_err(|error| error.to_string())
    };
    let broken = |line| Err(AuditError::BrokenChain { line }.to_string());
    let gap = |line, expected, found| Err(AuditError::Gap { line, expected, found }.to_string());

    let mut changed = whole.clone();
    changed[2] = changed[2].replace("accepted", "acceptee");
    assert_eq!(check(&changed), broken(4));

    let mut changed = whole.clone();
    changed.remove(3);
    assert_eq!(check(&changed), gap(4, 4, 5));

    let mut changed = whole.clone();
    changed.swap(2, 3);
    assert_eq!(check(&changed), gap(3, 3, 4));

    let mut changed = whole.clone();
    changed[1] = changed[1].replace('}', "");
    assert_eq!(check(&changed), Err(AuditError::NotAnEntry { line: 2 }.to_string()));

    let mut changed = whole.clone();
    changed[0] = changed[0].replace("\"prev\":\"0", "\"prev\":\"1");
    assert_eq!(check(&changed), broken(1));

    // Of a tail cut off only the last hash, kept elsewhere, tells.
    let kept = check(&whole).unwrap();
    let cut = check(&whole[..5]).unwrap();
    assert_eq!(cut.entries, 5);
    assert_ne!(cut.last_hash, kept.last_hash);
}

#[test]
fn a_tail_cut_off_under_a_writer_shows() {
    let (_dir, path, audit) = log_of(4);
    write_in_place(&path, &lines(&path)[..2]);
    append(&audit, 1);
    assert!(matches!(verify(&path), Err(AuditError::Gap { line: 3, expected: 3, found: 5 })));
}

/// Keeps the file, so that this is no rotation.
fn write_in_place(path: &Path, lines: &[String]) {
    let len: usize = lines.iter().map(|line| line.len() + 1).sum();
    OpenOptions::new().write(true).open(path).unwrap().set_len(len as u64).unwrap();
}

#[test]
fn handles_and_threads_write_one_chain() {
    let (_dir, path, one) = log_of(0);
    let two = Audit::open(&path).unwrap();
    thread::scope(|scope| {
        for at in 0..8 {
            let audit = if at % 2 == 0 { &one } else { &two };
            scope.spawn(move || append(audit, 200));
        }
    });
    let verified = verify(&path).unwrap();
    assert_eq!((verified.entries, verified.last_seq, verified.torn), (1600, 1600, 0));
}

#[test]
fn a_torn_line_is_kept_and_followed_by_a_recovery() {
    let long_hole = vec![0; 20_000];
    for torn in [&b"{\"seq\":4,\"at\":\"20"[..], b"\xff", &long_hole] {
        let (_dir, path, audit) = log_of(3);
        drop(audit);
        tear(&path, torn);
        assert!(matches!(verify(&path), Err(AuditError::TornEnd { line: 4 })));
        append(&Audit::open(&path).unwrap(), 1);
        let bytes = fs::read(&path).unwrap();
        let recovery = bytes.split(|&byte| byte == b'\n').nth(4).unwrap();
        let recovery: Value = serde_json::from_slice(recovery).unwrap();
        assert_eq!(recovery["action"], "recovered");
        let verified = verify(&path).unwrap();
        assert_eq!((verified.entries, verified.torn, verified.last_seq), (5, 1, 6));
    }
}

#[test]
fn every_way_to_tear_a_file_recovers() {
    let (_dir, path, audit) = log_of(2);
    drop(audit);
    let whole = fs::read(&path).unwrap();
    for len in 0..whole.len() {
        fs::write(&path, &whole[..len]).unwrap();
        append(&Audit::open(&path).unwrap(), 1);
        // Torn again, in the middle of what followed.
        let twice = fs::read(&path).unwrap();
        fs::write(&path, &twice[..len + (twice.len() - len) / 3]).unwrap();
        append(&Audit::open(&path).unwrap(), 1);
        verify(&path).unwrap_or_else(|error| panic!("{len}: {error}"));
    }
}

#[test]
fn a_writer_mends_what_another_left_torn() {
    let (_dir, path, audit) = log_of(2);
    tear(&path, b"{\"seq\":3");
    append(&audit, 2);
    let verified = verify(&path).unwrap();
    assert_eq!((verified.entries, verified.torn), (5, 1));
}

#[test]
fn a_recovery_covers_only_what_is_torn() {
    let (_dir, path, audit) = log_of(3);
    tear(&path, b"{\"seq\":4");
    append(&audit, 1);
    let whole = lines(&path);
    verify(&path).unwrap();

    // The torn line holds no hash of the third: the recovery does.
    let mut changed = whole.clone();
    changed[2] = changed[2].replace("accepted", "acceptee");
    write_lines(&path, &changed);
    assert!(matches!(verify(&path), Err(AuditError::BrokenChain { line: 5 })));

    let mut changed = whole.clone();
    changed[2] = "torn".to_owned();
    write_lines(&path, &changed);
    assert!(matches!(verify(&path), Err(AuditError::BrokenChain { line: 5 })));

    let mut changed = whole;
    changed[3] = "torn".to_owned();
    write_lines(&path, &changed);
    assert!(matches!(verify(&path), Err(AuditError::BrokenChain { line: 5 })));
}

#[test]
fn an_entry_that_is_too_long_is_refused() {
    let (_dir, path, audit) = log_of(1);
    let outcome = "x".repeat(4096);
    assert!(audit.append(&Entry { outcome: &outcome, ..ENTRY }).is_err());
    append(&audit, 1);
    assert_eq!(verify(&path).unwrap().entries, 2);
}

#[test]
fn the_chain_goes_on_in_the_file_after_a_rename() {
    let (dir, path, one) = log_of(3);
    let two = Audit::open(&path).unwrap();
    append(&two, 2);
    let rotated = dir.path().join("audit/log.1.jsonl");
    fs::rename(&path, &rotated).unwrap();
    // The first to write has not seen the last two.
    append(&one, 1);
    append(&two, 1);
    let (old, new) = (verify(&rotated).unwrap(), verify(&path).unwrap());
    assert_eq!((old.entries, new.entries), (5, 2));
    assert_eq!((new.first_seq, new.begins_with), (6, Some(old.last_hash)));
}

#[test]
fn a_rename_that_was_seen_vouches_for_what_went_on_there_and_for_nothing_else() {
    let (dir, path, audit) = log_of(3);
    std::fs::rename(&path, dir.path().join("elsewhere")).unwrap();
    append(&audit, 2);
    let ends = audit.ends().unwrap();
    assert_eq!((ends.head.seq, ends.tip.seq, ends.is_continued), (3, 5, true));
    // A handle that did not see it cannot know.
    assert!(!Audit::open(&path).unwrap().ends().unwrap().is_continued);
    // In the same file.
    let rest: String = lines(&path)[1..].iter().map(|line| format!("{line}\n")).collect();
    fs::write(&path, rest).unwrap();
    let ends = audit.ends().unwrap();
    assert_eq!((ends.head.seq, ends.is_continued), (4, false));
    // Removed is not renamed.
    std::fs::remove_file(&path).unwrap();
    append(&audit, 1);
    assert!(!audit.ends().unwrap().is_continued);
}

#[test]
fn renames_under_writers_lose_nothing() {
    let (dir, path, one) = log_of(0);
    let two = Audit::open(&path).unwrap();
    let rotated = |at: usize| dir.path().join(format!("audit/log.{at}.jsonl"));
    thread::scope(|scope| {
        for audit in [&one, &two, &one, &two] {
            scope.spawn(move || append(audit, 200));
        }
        for at in 0..10 {
            while fs::metadata(&path).map_or(0, |facts| facts.len()) == 0 {
                thread::yield_now();
            }
            fs::rename(&path, rotated(at)).unwrap();
            // Both follow before the next rename; nobody knows a file that came and went unseen.
            append(&one, 1);
            append(&two, 1);
        }
    });
    let parts: Vec<_> = (0..10).map(rotated).chain([path.clone()]).map(|part| verify(&part).unwrap()).collect();
    assert_eq!(parts.iter().map(|part| part.entries).sum::<u64>(), 820);
    for pair in parts.windows(2) {
        assert_eq!(pair[1].begins_with.as_ref(), Some(&pair[0].last_hash));
        assert_eq!(pair[1].first_seq, pair[0].last_seq + 1);
    }
}

#[test]
fn a_part_of_a_line_is_taken_back_when_the_disk_is_full() {
    if let Some(path) = std::env::var_os(CHILD_LOG) {
        return fill_disk(Path::new(&path));
    }
    let (_dir, path, audit) = log_of(0);
    // A limit on the size of files stands for the disk: the write that meets it is cut short.
    let child = Command::new("sh")
        .args(["-c", r#"trap "" XFSZ; ulimit -f 4; exec "$0" "$@""#])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", "audit_log::a_part_of_a_line_is_taken_back_when_the_disk_is_full"])
        .env(CHILD_LOG, &path)
        .output()
        .unwrap();
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    let before = verify(&path).unwrap();
    assert!(before.entries > 2);
    append(&audit, 1);
    let after = verify(&path).unwrap();
    assert_eq!((after.entries, after.torn), (before.entries + 1, 0));
}

fn fill_disk(path: &Path) {
    let audit = Audit::open(path).unwrap();
    let refused = (0..100).find_map(|_| audit.append(&ENTRY).err()).unwrap();
    assert_eq!(refused.kind(), std::io::ErrorKind::FileTooLarge);
    let kept = verify(path).unwrap();
    assert!(audit.append(&ENTRY).is_err());
    assert_eq!(verify(path).unwrap(), kept);
    // The size of an entry is no divisor of the limit: a part of the refused one did fit.
    assert!(!fs::metadata(path).unwrap().len().is_multiple_of(512));
}
