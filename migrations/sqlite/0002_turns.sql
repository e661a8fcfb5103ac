-- When a job's turn comes: its arrival, later by a multiple of the time it is expected to take. Short jobs
-- overtake long ones, but none is overtaken for ever.
ALTER TABLE jobs ADD COLUMN turn_ms BIGINT NOT NULL DEFAULT 0;
UPDATE jobs SET turn_ms = created_at_ms;
CREATE INDEX jobs_by_turn ON jobs (state, turn_ms, id);
