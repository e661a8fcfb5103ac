//! Databases that earlier versions of the program left, opened by today's with all that was in them.

use std::path::{Path, PathBuf};

use jiff::Timestamp;
use medialrep::jobs::job::{Job, JobId, JobState, SendState};
use medialrep::jobs::place::{OpenError, Place};
use medialrep::jobs::store::{ListQuery, QueueLimits, Reclaim, RetryAnswer, Store, StoreError};
use medialrep::jobs::token::{Scope, Token};
use sqlx::SqlSafeStr;
use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqlitePool, SqlitePoolOptions};
use tempfile::TempDir;

use crate::help::process::run;

const LIMITS: QueueLimits = QueueLimits { jobs: 1000, bytes: 1 << 30, share_percent: 100, storage_bytes: u64::MAX };

/// When the first job came.
const START_MS: i64 = 1_790_000_000_000;

const ERROR: &str = r#"{"type":"urn:medialrep:problem:too_thin","title":"Too thin","status":422,"code":"too_thin",
    "detail":"thin","hint":"do not","retryable":false}"#;
const WARNINGS: &str = r#"[{"code":"no_orientation","message":"none"}]"#;
const RESULTS: &str = r#"[{"name":"model.glb","media_type":"model/gltf-binary","bytes":9,"sha256":"ab"}]"#;

/// A step of the tables: its number, and its SQL.
type Step = (i64, &'static str);

/// All steps, from the files.
fn steps() -> Vec<Step> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("migrations/sqlite");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut steps = Vec::new();
    for file in files {
        let number = file.file_name().unwrap().to_str().unwrap().split('_').next().unwrap().parse().unwrap();
        steps.push((number, &*String::leak(std::fs::read_to_string(file).unwrap())));
    }
    steps
}

/// A database whose tables came as far as these steps.
async fn database(dir: &Path, steps: &[Step]) -> SqlitePool {
    std::fs::create_dir_all(dir.join("db")).unwrap();
    let options = SqliteConnectOptions::new().filename(dir.join("db/jobs.sqlite")).create_if_missing(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await.unwrap();
    let mut migrations = Vec::new();
    for (number, sql) in steps {
        let sql = sql.into_sql_str();
        migrations.push(Migration::new(*number, "step".into(), MigrationType::Simple, sql, false));
    }
    Migrator::with_migrations(migrations).run(&pool).await.unwrap();
    pool
}

/// What every version kept of a job.
struct Kept {
    id: JobId,
    state: JobState,
    created_at_ms: i64,
    has_begun: bool,
    turn_ms: i64,
}

/// A job in each state, and three that wait: the second of them is the first whose turn comes.
fn jobs() -> Vec<Kept> {
    let states = [
        JobState::Succeeded,
        JobState::Failed,
        JobState::Canceled,
        JobState::Running,
        JobState::Queued,
        JobState::Queued,
        JobState::Queued,
    ];
    let mut jobs = Vec::new();
    for (at, state) in (0..).zip(states) {
        let id = JobId::parse(&format!("01a20604-b92d-731c-9b47-{at:012}")).unwrap();
        let created_at_ms = START_MS + 1000 * at;
        let turn_ms = if at == 4 { created_at_ms + 60_000 } else { created_at_ms };
        let has_begun = !matches!(state, JobState::Queued | JobState::Canceled);
        jobs.push(Kept { id, state, created_at_ms, has_begun, turn_ms });
    }
    jobs
}

/// Writes a job as the program did whose tables were at this step.
async fn write(pool: &SqlitePool, step: i64, job: &Kept) {
    write_first(pool, job).await;
    match step {
        1 => {}
        2 => write_second(pool, job).await,
        3..=11 => {
            write_second(pool, job).await;
            write_third(pool, job).await;
        }
        _ => panic!("say here how the program writes rows whose tables are at step {step}"),
    }
}

async fn write_first(pool: &SqlitePool, job: &Kept) {
    let (is_running, has_succeeded) = (job.state == JobState::Running, job.state == JobState::Succeeded);
    let later = |is_so: bool, ms: i64| is_so.then_some(job.created_at_ms + ms);
    sqlx::query(
        "INSERT INTO jobs (id, state, owner, labels, mask_sha256, mask_bytes, params, attempt, cancel_requested,
                           lease_token, lease_until_ms, created_at_ms, started_at_ms, ended_at_ms, error, warnings,
                           results, results_token)
         VALUES ($1, $2, '', '{}', 'ab', 7, '{\"grid\": \"auto\"}', $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13)",
    )
    .bind(job.id.to_string())
    .bind(job.state.name())
    .bind(i64::from(job.has_begun))
    .bind(i64::from(job.state == JobState::Canceled))
    .bind(is_running.then_some("lease"))
    .bind(later(is_running, 30_010))
    .bind(job.created_at_ms)
    .bind(later(job.has_begun, 10))
    .bind(later(job.state.has_ended(), 20))
    .bind((job.state == JobState::Failed).then_some(ERROR))
    .bind(if has_succeeded { WARNINGS } else { "[]" })
    .bind(if has_succeeded { RESULTS } else { "[]" })
    .bind(has_succeeded.then_some("attempt"))
    .execute(pool)
    .await
    .unwrap();
}

async fn write_second(pool: &SqlitePool, job: &Kept) {
    let turn = sqlx::query("UPDATE jobs SET turn_ms = $1 WHERE id = $2").bind(job.turn_ms).bind(job.id.to_string());
    turn.execute(pool).await.unwrap();
}

async fn write_third(pool: &SqlitePool, job: &Kept) {
    let mut history = format!(" queued@{}", job.created_at_ms);
    if job.has_begun {
        history.push_str(&format!(" running@{}", job.created_at_ms + 10));
    }
    if job.state.has_ended() {
        history.push_str(&format!(" {}@{}", job.state.name(), job.created_at_ms + 20));
    }
    sqlx::query(
        "UPDATE jobs SET owner = 'one', labels = '{\"study\":\"liver\"}', idempotency_key = id, request_sha256 = 'r',
            trace_id = 't', work_sha256 = 'w', instance = $1, history = $2, program = $3, mask_kept = $4,
            callback_url = 'https://hook.example/', callback_state = $5, callback_due_ms = $6 WHERE id = $7",
    )
    .bind((job.state == JobState::Running).then_some("killed"))
    .bind(history)
    .bind((job.state == JobState::Succeeded).then_some("0.1.0"))
    .bind(i64::from(job.state != JobState::Failed))
    .bind(if job.state.has_ended() { "due" } else { "waiting" })
    .bind(job.state.has_ended().then_some(job.created_at_ms + 20))
    .bind(job.id.to_string())
    .execute(pool)
    .await
    .unwrap();
    let label = sqlx::query("INSERT INTO job_labels (job_id, name, value) VALUES ($1, 'study', 'liver')");
    label.bind(job.id.to_string()).execute(pool).await.unwrap();
}

/// Tokens came with the third step.
async fn write_token(pool: &SqlitePool, token: &Token) {
    let stored = token.stored("one".to_owned(), vec![Scope::Read], None);
    let written = sqlx::query(
        "INSERT INTO tokens (id, secret_sha256, tenant, scopes, created_at_ms) VALUES ($1, $2, 'one', 'read write', 5)",
    );
    written.bind(&stored.id).bind(&stored.secret_sha256).execute(pool).await.unwrap();
}

/// A folder as the program left it whose tables were at this step.
async fn left_at(step: i64) -> (TempDir, Token) {
    let (dir, token) = (TempDir::new().unwrap(), Token::new().unwrap());
    let steps: Vec<Step> = steps().into_iter().filter(|(number, _)| *number <= step).collect();
    let pool = database(dir.path(), &steps).await;
    for job in jobs() {
        write(&pool, step, &job).await;
    }
    if step >= 3 {
        write_token(&pool, &token).await;
    }
    pool.close().await;
    (dir, token)
}

async fn get(store: &dyn Store, id: JobId) -> Job {
    store.get(id).await.unwrap().unwrap()
}

fn check_kept(step: i64, kept: &Kept, job: &Job) {
    assert_eq!((job.state, job.mask.bytes, job.params_json.as_str()), (kept.state, 7, "{\"grid\": \"auto\"}"));
    assert_eq!(job.created_at.as_millisecond(), kept.created_at_ms);
    assert_eq!(job.started_at.is_some(), kept.has_begun);
    assert_eq!(job.ended_at.is_some(), kept.state.has_ended());
    assert_eq!(job.history[0].at, job.created_at);
    assert_eq!((job.history.len(), job.history.last().unwrap().state), (states_of(kept), kept.state));
    assert_eq!(
        job.error.as_ref().map(|error| error.code.as_str()),
        (kept.state == JobState::Failed).then_some("too_thin")
    );
    let results = job.kept_results().map(|(token, files)| (token, files[0].name.as_str(), job.warnings.len()));
    assert_eq!(results, (kept.state == JobState::Succeeded).then_some(("attempt", "model.glb", 1)));
    // A refused mask was erased at once.
    assert_eq!(job.is_mask_kept, kept.state != JobState::Failed);
    assert_eq!(job.owner, if step < 3 { "" } else { "one" });
}

fn states_of(kept: &Kept) -> usize {
    1 + usize::from(kept.has_begun) + usize::from(kept.state.has_ended())
}

#[tokio::test]
async fn jobs_of_every_earlier_version_are_what_they_were() {
    for (step, _) in steps() {
        let (dir, _) = left_at(step).await;
        let store = Place::at(dir.path()).open_store().await.unwrap();
        for kept in jobs() {
            check_kept(step, &kept, &get(&*store, kept.id).await);
        }
        assert_eq!(store.check_integrity().await.unwrap(), [""; 0], "step {step}");
    }
}

#[tokio::test]
async fn jobs_of_every_earlier_version_go_on() {
    for (step, _) in steps() {
        let (dir, _) = left_at(step).await;
        let store = Place::at(dir.path()).open_store().await.unwrap();
        let (jobs, now) = (jobs(), Timestamp::now());
        let waiting = [&jobs[4], &jobs[5], &jobs[6]].map(|job| job.id);
        // The turn of the first comes a minute later, once there are turns.
        let order = if step == 1 { [0, 1, 2] } else { [1, 2, 0] };
        let positions = store.positions(&waiting).await.unwrap();
        assert_eq!(order.map(|at| positions[&waiting[at]]), [1, 2, 3], "step {step}");
        for at in order {
            assert_eq!(store.claim("here", now, now).await.unwrap().unwrap().job.id, waiting[at], "step {step}");
        }
        let running = jobs[3].id;
        let long_after = Reclaim::LeaseBefore(Timestamp::from_millisecond(START_MS + 60_000).unwrap());
        let which = if step < 3 { long_after } else { Reclaim::Instance("killed") };
        assert_eq!(store.reclaim(which, now).await.unwrap(), [(running, JobState::Queued)], "step {step}");
        assert_eq!(store.claim("here", now, now).await.unwrap().unwrap().job.attempt, 2, "step {step}");
        assert_eq!(store.retry(jobs[1].id, now, LIMITS).await.unwrap(), RetryAnswer::MaskErased, "step {step}");
        assert_eq!(store.retry(jobs[2].id, now, LIMITS).await.unwrap(), RetryAnswer::Queued, "step {step}");
    }
}

#[tokio::test]
async fn tokens_keys_labels_and_webhooks_are_what_they_were() {
    let (dir, token) = left_at(3).await;
    let store = Place::at(dir.path()).open_store().await.unwrap();
    let (jobs, now) = (jobs(), Timestamp::now());
    let stored = store.get_token(&token.id).await.unwrap().unwrap();
    assert!(stored.is_secret(token.secret()) && stored.is_valid_at(now));
    assert_eq!((stored.tenant.as_str(), stored.scopes), ("one", vec![Scope::Read, Scope::Write]));
    let key = jobs[5].id.to_string();
    assert_eq!(store.find_key("one", &key).await.unwrap(), Some(jobs[5].id));
    assert_eq!(store.find_equal("one", "w", "0.1.0").await.unwrap().unwrap().id, jobs[0].id);
    let label = Some(("study".to_owned(), "liver".to_owned()));
    let query = ListQuery { owner: "one".to_owned(), label, limit: 100, ..ListQuery::default() };
    assert_eq!(store.list(&query).await.unwrap().len(), jobs.len());
    assert_eq!(store.claim_callback(now, now, &|_, _| false).await.unwrap().unwrap().job.id, jobs[0].id);
    assert_eq!(get(&*store, jobs[3].id).await.callback.unwrap().state, SendState::Waiting);
}

#[tokio::test]
async fn a_database_of_a_later_version_is_refused_in_words() {
    let dir = TempDir::new().unwrap();
    let mut steps = steps();
    let known = steps.last().unwrap().0;
    steps.push((known + 1, "CREATE TABLE later (id TEXT)"));
    database(dir.path(), &steps).await.close().await;
    let refused = Place::at(dir.path()).open_store().await.err().unwrap();
    let OpenError::Store(StoreError::Newer { found, known: last }) = refused else { panic!("{refused:?}") };
    assert_eq!((found, last), (known + 1, known));
    for command in ["check", "serve"] {
        let output = run(&[command, "--min-free-mib", "0", "--listen", "127.0.0.1:0"], dir.path());
        let told = [output.stdout, output.stderr].concat();
        let told = String::from_utf8_lossy(&told);
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains("a later version of this program"), "{command}: {told}");
    }
}

#[tokio::test]
async fn commands_that_only_read_tell_an_older_database_and_leave_it_as_it_is() {
    let dir = TempDir::new().unwrap();
    let mut steps = steps();
    let known = steps.pop().unwrap().0;
    // Numbers may be left out.
    let found = steps.last().unwrap().0;
    database(dir.path(), &steps).await.close().await;
    let file = dir.path().join("db/jobs.sqlite");
    let before = std::fs::read(&file).unwrap();
    let out = dir.path().join("copy").display().to_string();
    for command in [vec!["check", "--min-free-mib", "0"], vec!["backup", "--out", &out]] {
        let output = run(&command, dir.path());
        let told = [output.stdout, output.stderr].concat();
        let told = String::from_utf8_lossy(&told);
        assert_eq!(output.status.code(), Some(1), "{told}");
        assert!(told.contains("an earlier version of this program"), "{command:?}: {told}");
        assert!(told.contains(&format!("at step {found}, this version has {known}")), "{command:?}: {told}");
        assert_eq!(std::fs::read(&file).unwrap(), before, "{command:?}");
    }
}

#[tokio::test]
async fn what_is_no_database_is_refused() {
    let dir = TempDir::new().unwrap();
    std::fs::create_dir(dir.path().join("db")).unwrap();
    std::fs::write(dir.path().join("db/jobs.sqlite"), "no database at all, though as long as one. ".repeat(100))
        .unwrap();
    let refused = Place::at(dir.path()).open_store().await.err().unwrap();
    assert!(matches!(refused, OpenError::Store(StoreError::Corrupt(_))), "{refused:?}");
}
