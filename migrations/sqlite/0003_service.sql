-- What a service for several tenants keeps of a job, and the tokens that let them in.
ALTER TABLE jobs ADD COLUMN trace_id       TEXT   NOT NULL DEFAULT '';   -- of the request that sent it
ALTER TABLE jobs ADD COLUMN work_sha256    TEXT;                         -- of mask and parameters: equal work, equal results
ALTER TABLE jobs ADD COLUMN instance       TEXT;                         -- the process that runs it
ALTER TABLE jobs ADD COLUMN history        TEXT   NOT NULL DEFAULT '';   -- every state: ' state@ms state@ms'
ALTER TABLE jobs ADD COLUMN reused         BIGINT NOT NULL DEFAULT 0;    -- 1: results are those of an equal request
ALTER TABLE jobs ADD COLUMN program        TEXT;                         -- version that made the results
ALTER TABLE jobs ADD COLUMN mask_kept      BIGINT NOT NULL DEFAULT 1;    -- 0 once the mask is erased
ALTER TABLE jobs ADD COLUMN results_kept   BIGINT NOT NULL DEFAULT 1;    -- 0 once the results are erased
ALTER TABLE jobs ADD COLUMN callback_url   TEXT;
ALTER TABLE jobs ADD COLUMN callback_state TEXT;                         -- waiting, due, delivered, given_up
ALTER TABLE jobs ADD COLUMN callback_due_ms BIGINT;                      -- next try, while due
ALTER TABLE jobs ADD COLUMN callback_log   TEXT   NOT NULL DEFAULT '[]'; -- JSON array, one entry per try

UPDATE jobs SET history = ' queued@' || CAST(created_at_ms AS TEXT)
    || CASE WHEN started_at_ms IS NULL THEN '' ELSE ' running@' || CAST(started_at_ms AS TEXT) END
    || CASE WHEN ended_at_ms IS NULL THEN '' ELSE ' ' || state || '@' || CAST(ended_at_ms AS TEXT) END;
-- A refused mask was erased at once; jobs of that time do not say so.
UPDATE jobs SET mask_kept = 0 WHERE state = 'failed';

CREATE INDEX jobs_by_load ON jobs (state, owner, mask_bytes);
CREATE INDEX jobs_by_work ON jobs (owner, work_sha256);
CREATE INDEX jobs_by_owner ON jobs (owner, id);
CREATE INDEX jobs_by_end ON jobs (ended_at_ms);
CREATE INDEX jobs_by_callback ON jobs (callback_state, callback_due_ms);

-- The labels again, one row each, to be searched.
CREATE TABLE job_labels (
    job_id TEXT NOT NULL,
    name   TEXT NOT NULL,
    value  TEXT NOT NULL,
    PRIMARY KEY (job_id, name)
);
CREATE INDEX job_labels_by_value ON job_labels (name, value, job_id);

CREATE TABLE tokens (
    id            TEXT   NOT NULL PRIMARY KEY,   -- its public half
    secret_sha256 TEXT   NOT NULL,               -- of its secret half, which is kept nowhere
    tenant        TEXT   NOT NULL,               -- owner of the jobs sent with it
    scopes        TEXT   NOT NULL,               -- separated by spaces
    created_at_ms BIGINT NOT NULL,
    expires_at_ms BIGINT,
    revoked_at_ms BIGINT
);
