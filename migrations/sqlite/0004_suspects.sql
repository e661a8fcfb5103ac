-- Jobs that ran beside others in a process that crashed: one of them may have taken it down.
ALTER TABLE jobs ADD COLUMN suspect BIGINT NOT NULL DEFAULT 0;   -- 1: runs alone in its process
CREATE INDEX jobs_by_instance ON jobs (instance, state);
