//! What the files of jobs promise, whatever object store is behind them.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::sync::Arc;

use futures_util::TryStreamExt;
use medialrep::jobs::job::{JobId, ResultFile};
use medialrep::jobs::store::blobs::{Blobs, Content, LocalMask, without_kept};
use medialrep::jobs::store::{KeptFiles, new_token};
use object_store::memory::InMemory;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

fn described(name: &str, content: &[u8]) -> ResultFile {
    let sha256 = Sha256::digest(content).iter().map(|byte| format!("{byte:02x}")).collect();
    ResultFile { name: name.to_owned(), media_type: "a/b".to_owned(), bytes: content.len() as u64, sha256, dicom: None }
}

/// In this machine's folder, and where there are no local files.
fn all() -> (TempDir, [(&'static str, Blobs); 2]) {
    let dir = TempDir::new().unwrap();
    let local = Blobs::open(&dir.path().join("local"), "one").unwrap();
    let elsewhere = Blobs::open(&dir.path().join("elsewhere"), "one").unwrap();
    (dir, [("local", local), ("elsewhere", elsewhere.stored_in(Arc::new(InMemory::new())))])
}

async fn store_one(blobs: &Blobs, name: &str, content: &[u8]) -> (JobId, ResultFile) {
    let id = JobId::now();
    let folder = blobs.begin_attempt("t").unwrap();
    std::fs::write(folder.join(name), content).unwrap();
    blobs.keep_results(id, "t", &[name]).await.unwrap();
    blobs.end_attempt("t").unwrap();
    assert!(!folder.exists());
    (id, described(name, content))
}

#[tokio::test]
async fn a_mask_comes_back_as_a_local_file_until_it_is_erased() {
    let (dir, all) = all();
    for (what, blobs) in all {
        let (id, sent) = (JobId::now(), dir.path().join("sent"));
        std::fs::write(&sent, b"mask").unwrap();
        blobs.keep_mask(&sent, id).await.unwrap();
        let mask = blobs.local_mask(id).await.unwrap();
        assert_eq!(std::fs::read(mask.path()).unwrap(), b"mask", "{what}");
        assert_eq!(matches!(mask, LocalMask::Stored(_)), what == "local");
        blobs.erase_mask(id).await.unwrap();
        assert_eq!(blobs.local_mask(id).await.unwrap_err().kind(), std::io::ErrorKind::NotFound, "{what}");
        // What is not there is as good as erased.
        blobs.erase(id).await.unwrap();
    }
}

#[tokio::test]
async fn a_result_is_read_whole_or_in_part_and_never_when_damaged() {
    let (_dir, all) = all();
    // Small ones are read at once, large ones as a stream.
    for length in [1000, 9 << 20] {
        let content: Vec<u8> = (0..=250).cycle().take(length).collect();
        for (what, blobs) in &all {
            let (id, file) = store_one(blobs, "model.glb", &content).await;
            let found = blobs.read_checked(id, "t", &file).await.unwrap();
            assert_eq!(matches!(found, Some(Content::Bytes(..))), length == 1000, "{what}");
            assert!(found.is_some());
            let part = blobs.read_range((id, "t", "model.glb"), (10, 20)).await.unwrap();
            assert_eq!(part.try_collect::<Vec<_>>().await.unwrap().concat(), content[10..20], "{what}");
            let other = ResultFile { sha256: "0".repeat(64), ..file.clone() };
            assert!(blobs.read_checked(id, "t", &other).await.unwrap().is_none(), "{what}");
            let longer = ResultFile { bytes: file.bytes + 1, ..file };
            assert!(blobs.read_checked(id, "t", &longer).await.unwrap().is_none(), "{what}");
        }
    }
}

#[tokio::test]
async fn copies_stay_when_what_they_were_made_of_goes() {
    let (_dir, all) = all();
    for (what, blobs) in all {
        let (id, file) = store_one(&blobs, "thickness.json", b"{}").await;
        let copy = JobId::now();
        blobs.copy_results((id, "t"), (copy, "u"), std::slice::from_ref(&file)).await.unwrap();
        blobs.erase(id).await.unwrap();
        assert!(blobs.read_checked(id, "t", &file).await.is_err(), "{what}");
        assert!(blobs.read_checked(copy, "u", &file).await.unwrap().is_some(), "{what}");
    }
}

#[tokio::test]
async fn what_no_job_keeps_is_swept() {
    let (_dir, all) = all();
    for (what, blobs) in all {
        let (kept, file) = store_one(&blobs, "a", b"a").await;
        let (gone, _) = store_one(&blobs, "a", b"a").await;
        let keeps = vec![KeptFiles { id: kept, mask: false, tokens: vec!["t".to_owned()] }];
        let unnamed = without_kept(blobs.stored().await.unwrap(), keeps);
        assert_eq!(blobs.remove(&unnamed).await, 1, "{what}");
        assert!(blobs.read_checked(kept, "t", &file).await.unwrap().is_some(), "{what}");
        assert!(blobs.read_checked(gone, "t", &file).await.is_err(), "{what}");
    }
}

#[tokio::test]
async fn what_lies_among_the_files_and_is_none_is_swept_and_no_link_is_followed() {
    let dir = TempDir::new().unwrap();
    let (data, outside) = (dir.path().join("data"), dir.path().join("outside"));
    std::fs::create_dir(&outside).unwrap();
    std::fs::write(outside.join("file"), b"not ours").unwrap();
    let blobs = Blobs::open(&data, "instance").unwrap();
    let (kept, _) = store_one(&blobs, "a", b"a").await;
    std::fs::create_dir_all(data.join("masks")).unwrap();
    std::os::unix::fs::symlink(&outside, data.join("results/link")).unwrap();
    std::fs::write(data.join("results").join(OsStr::from_bytes(b"no\xFFname")), b"").unwrap();
    std::fs::write(data.join("masks/half#1"), b"").unwrap();
    let keeps = vec![KeptFiles { id: kept, mask: false, tokens: vec!["t".to_owned()] }];
    let unnamed = without_kept(blobs.stored().await.unwrap(), keeps);
    assert_eq!((unnamed.len(), blobs.remove(&unnamed).await), (3, 3));
    assert_eq!(std::fs::read(outside.join("file")).unwrap(), b"not ours");
    assert!(!data.join("results/link").exists() && data.join("results").join(kept.to_string()).exists());
}

#[test]
fn what_lies_among_the_scratch_folders_is_swept_with_them() {
    let dir = TempDir::new().unwrap();
    let blobs = Blobs::open(dir.path(), "instance").unwrap();
    std::fs::create_dir(dir.path().join("scratch/other")).unwrap();
    std::fs::write(dir.path().join("scratch/file"), b"").unwrap();
    let probe = dir.path().join(".probe-killed");
    std::fs::write(&probe, b"").unwrap();
    blobs.sweep_scratch_of_others().unwrap();
    let left = std::fs::read_dir(dir.path().join("scratch")).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(left.collect::<Vec<_>>(), ["instance"]);
    assert!(!probe.exists());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn what_is_kept_while_others_are_erased_is_there() {
    let dir = TempDir::new().unwrap();
    let blobs = Blobs::open(dir.path(), "instance").unwrap();
    let tasks = (0..4).map(|_| {
        let blobs = blobs.clone();
        tokio::spawn(async move {
            for _ in 0..100 {
                let (id, token) = (JobId::now(), new_token());
                let folder = blobs.begin_attempt(&token).unwrap();
                std::fs::write(folder.join("model.glb"), b"content").unwrap();
                // The folders above are empty again and again: erasing removes them.
                blobs.keep_results(id, &token, &["model.glb"]).await.unwrap();
                blobs.erase_results(id).await.unwrap();
                blobs.end_attempt(&token).unwrap();
            }
        })
    });
    for task in tasks.collect::<Vec<_>>() {
        task.await.unwrap();
    }
}
