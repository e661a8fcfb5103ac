//! Rows to what they mean, and back.

use jiff::Timestamp;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use crate::jobs::job::{Callback, Change, Delivery, Job, JobId, JobState, MaskInfo, ResultFile, SendState};
use crate::jobs::store::{SendNext, StoreError};

pub(super) fn job(row: &SqliteRow) -> Result<Job, StoreError> {
    let error: Option<String> = row.try_get("error")?;
    Ok(Job {
        id: id(row)?,
        owner: row.try_get("owner")?,
        labels: json(row, "labels")?,
        trace_id: row.try_get("trace_id")?,
        state: state(row)?,
        history: history(row.try_get("history")?)?,
        attempt: u32::try_from(row.try_get::<i64, _>("attempt")?).map_err(|_| corrupt("attempt"))?,
        cancel_requested: flag(row, "cancel_requested")?,
        mask: MaskInfo { sha256: row.try_get("mask_sha256")?, bytes: bytes(row, "mask_bytes")? },
        params_json: row.try_get("params")?,
        created_at: time(row, "created_at_ms")?.ok_or_else(|| corrupt("created_at_ms"))?,
        started_at: time(row, "started_at_ms")?,
        ended_at: time(row, "ended_at_ms")?,
        error: error.map(|text| serde_json::from_str(&text).map_err(|_| corrupt("error"))).transpose()?,
        warnings: json(row, "warnings")?,
        results: json(row, "results")?,
        results_token: row.try_get("results_token")?,
        reused: flag(row, "reused")?,
        program: row.try_get("program")?,
        is_mask_kept: flag(row, "mask_kept")?,
        are_results_kept: flag(row, "results_kept")?,
        callback: callback(row)?,
        delivery: delivery(row)?,
    })
}

pub(super) fn id(row: &SqliteRow) -> Result<JobId, StoreError> {
    JobId::parse(row.try_get("id")?).ok_or_else(|| corrupt("id"))
}

pub(super) fn state(row: &SqliteRow) -> Result<JobState, StoreError> {
    JobState::from_name(row.try_get("state")?).ok_or_else(|| corrupt("state"))
}

pub(super) fn flag(row: &SqliteRow, column: &'static str) -> Result<bool, StoreError> {
    Ok(row.try_get::<i64, _>(column)? != 0)
}

pub(super) fn time(row: &SqliteRow, column: &'static str) -> Result<Option<Timestamp>, StoreError> {
    let ms: Option<i64> = row.try_get(column)?;
    ms.map(|ms| Timestamp::from_millisecond(ms).map_err(|_| corrupt(column))).transpose()
}

pub(super) fn count(row: &SqliteRow, column: usize) -> Result<u64, StoreError> {
    Ok(row.try_get::<i64, _>(column)?.unsigned_abs())
}

pub(super) fn bytes(row: &SqliteRow, column: &'static str) -> Result<u64, StoreError> {
    Ok(row.try_get::<i64, _>(column)?.unsigned_abs())
}

/// `state@ms`, separated by spaces.
fn history(text: &str) -> Result<Vec<Change>, StoreError> {
    let change = |entry: &str| {
        let (state, ms) = entry.split_once('@')?;
        let at = Timestamp::from_millisecond(ms.parse().ok()?).ok()?;
        Some(Change { state: JobState::from_name(state)?, at })
    };
    text.split_whitespace().map(|entry| change(entry).ok_or_else(|| corrupt("history"))).collect()
}

fn callback(row: &SqliteRow) -> Result<Option<Callback>, StoreError> {
    let Some(url) = row.try_get("callback_url")? else { return Ok(None) };
    let state = SendState::from_name(row.try_get("callback_state")?).ok_or_else(|| corrupt("callback_state"))?;
    Ok(Some(Callback { url, state, log: json(row, "callback_log")? }))
}

/// How something that is sent goes on, in columns: its state, and when it is due.
pub(super) fn next(next: SendNext) -> (&'static str, Option<i64>) {
    let (state, due) = match next {
        SendNext::Delivered => (SendState::Delivered, None),
        SendNext::TryAt(time) => (SendState::Due, Some(time)),
        SendNext::GiveUp => (SendState::GivenUp, None),
    };
    (state.name(), due.map(Timestamp::as_millisecond))
}

fn delivery(row: &SqliteRow) -> Result<Option<Delivery>, StoreError> {
    let Some(to) = row.try_get("delivery_to")? else { return Ok(None) };
    let state = SendState::from_name(row.try_get("delivery_state")?).ok_or_else(|| corrupt("delivery_state"))?;
    let last: Option<String> = row.try_get("delivery_last")?;
    Ok(Some(Delivery {
        to,
        state,
        stored: json(row, "delivery_stored")?,
        tries: u32::try_from(row.try_get::<i64, _>("delivery_tries")?).map_err(|_| corrupt("delivery_tries"))?,
        next_try_at: time(row, "delivery_due_ms")?,
        last_try: last.map(|text| serde_json::from_str(&text).map_err(|_| corrupt("delivery_last"))).transpose()?,
    }))
}

fn json<T: DeserializeOwned>(row: &SqliteRow, column: &'static str) -> Result<T, StoreError> {
    serde_json::from_str(row.try_get(column)?).map_err(|_| corrupt(column))
}

pub(super) fn corrupt(column: &'static str) -> StoreError {
    StoreError::Corrupt(format!("column {column}"))
}

/// JSON of plain data.
pub(super) fn to_json<T: Serialize>(value: &T) -> String {
    serde_json::to_string(value).expect("plain structs with string keys are JSON")
}

/// SQL has signed integers only; no size or count comes near their end.
pub(super) fn clamped(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// Bytes of files together.
pub(super) fn bytes_of(files: &[ResultFile]) -> i64 {
    clamped(files.iter().map(|file| file.bytes).sum())
}
