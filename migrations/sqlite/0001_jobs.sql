-- One row per job: the queue and the resource that clients see are the same table.
-- Times are milliseconds since 1970 UTC. Only TEXT and BIGINT, so that PostgreSQL takes the same file.
CREATE TABLE jobs (
    id               TEXT   NOT NULL PRIMARY KEY,   -- UUIDv7, so that the order of ids is the order of arrival
    state            TEXT   NOT NULL,               -- queued, running, succeeded, failed, canceled
    owner            TEXT   NOT NULL,               -- who sent it; empty while there are no tokens
    labels           TEXT   NOT NULL,               -- the client's own labels, a JSON object
    idempotency_key  TEXT,
    request_sha256   TEXT,                          -- of mask and params: the same key with another request is refused
    mask_sha256      TEXT   NOT NULL,
    mask_bytes       BIGINT NOT NULL,
    params           TEXT   NOT NULL,               -- JSON as sent
    attempt          BIGINT NOT NULL,               -- runs begun
    cancel_requested BIGINT NOT NULL,               -- 0 or 1
    lease_token      TEXT,                          -- who may write the outcome; also the folder of the attempt's files
    lease_until_ms   BIGINT,
    created_at_ms    BIGINT NOT NULL,
    started_at_ms    BIGINT,
    ended_at_ms      BIGINT,
    error            TEXT,                          -- a problem object, JSON
    warnings         TEXT   NOT NULL,               -- JSON array
    results          TEXT   NOT NULL,               -- JSON array; what is not named here is not published
    results_token    TEXT                           -- the lease token of the attempt whose files are published
);
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE UNIQUE INDEX jobs_by_idempotency_key ON jobs (owner, idempotency_key);

-- One row, written to see that the database can be written to.
CREATE TABLE write_checks (
    id            TEXT   NOT NULL PRIMARY KEY,
    checked_at_ms BIGINT NOT NULL
);
