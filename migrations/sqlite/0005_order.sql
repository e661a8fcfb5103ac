-- Turns are fixed when a job begins to wait: after the last one of its tenant that is about as long. Before, each claim
-- looked at all that waited.
ALTER TABLE jobs ADD COLUMN expected_ms BIGINT NOT NULL DEFAULT 0;   -- how long it is expected to take
ALTER TABLE jobs ADD COLUMN lane        BIGINT NOT NULL DEFAULT 0;   -- 0 under 1 s, 1 under 10 s, 2 longer
CREATE INDEX jobs_by_lane ON jobs (owner, lane, turn_ms) WHERE state = 'queued';

-- Lists of a tenant's jobs in a state, newest first.
CREATE INDEX jobs_by_owner_and_state ON jobs (owner, state, id);

-- Equal work whose results can be used again.
DROP INDEX jobs_by_work;
CREATE INDEX jobs_by_work ON jobs (owner, work_sha256, program, id) WHERE state = 'succeeded' AND results_kept = 1;

-- What is still to be erased, oldest first.
CREATE INDEX jobs_by_end_of_mask ON jobs (ended_at_ms) WHERE mask_kept = 1;
CREATE INDEX jobs_by_end_of_results ON jobs (state, ended_at_ms) WHERE results_kept = 1;

-- Jobs by their labels, with what lists of them ask for. Follows job_labels and the states of jobs by itself.
CREATE TABLE jobs_by_label (
    owner  TEXT NOT NULL,
    name   TEXT NOT NULL,
    value  TEXT NOT NULL,
    state  TEXT NOT NULL,
    job_id TEXT NOT NULL,
    PRIMARY KEY (owner, name, value, job_id)
) WITHOUT ROWID;
CREATE INDEX jobs_by_label_and_state ON jobs_by_label (owner, name, value, state, job_id);
CREATE INDEX labels_of_job ON jobs_by_label (job_id);
INSERT INTO jobs_by_label SELECT owner, name, value, state, id FROM job_labels JOIN jobs ON id = job_id;
DROP INDEX job_labels_by_value;
CREATE TRIGGER label_added AFTER INSERT ON job_labels BEGIN
    INSERT INTO jobs_by_label SELECT owner, NEW.name, NEW.value, state, id FROM jobs WHERE id = NEW.job_id;
END;
CREATE TRIGGER label_removed AFTER DELETE ON job_labels BEGIN
    DELETE FROM jobs_by_label WHERE job_id = OLD.job_id AND name = OLD.name;
END;
CREATE TRIGGER state_of_labels AFTER UPDATE OF state ON jobs WHEN NEW.state <> OLD.state BEGIN
    UPDATE jobs_by_label SET state = NEW.state WHERE job_id = NEW.id;
END;
