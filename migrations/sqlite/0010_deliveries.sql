-- Results that go to an archive once their job has succeeded. The duty is part of the job's row, so that it comes with the
-- results in one write.
ALTER TABLE jobs ADD COLUMN delivery_to     TEXT;                       -- name of the archive
ALTER TABLE jobs ADD COLUMN delivery_state  TEXT;                       -- waiting, due, delivered, given_up
ALTER TABLE jobs ADD COLUMN delivery_due_ms BIGINT;                     -- next try, while due
ALTER TABLE jobs ADD COLUMN delivery_tries  BIGINT NOT NULL DEFAULT 0;
ALTER TABLE jobs ADD COLUMN delivery_stored TEXT   NOT NULL DEFAULT '[]'; -- JSON array of names
ALTER TABLE jobs ADD COLUMN delivery_last   TEXT;                       -- the last try, JSON
CREATE INDEX jobs_by_delivery ON jobs (delivery_state, delivery_to, delivery_due_ms);
-- What is erased cannot be delivered any more.
CREATE TRIGGER deliveries_erased AFTER UPDATE OF results_kept ON jobs WHEN NEW.results_kept = 0 AND NEW.delivery_state = 'due' BEGIN
    UPDATE jobs SET delivery_state = 'given_up', delivery_due_ms = NULL WHERE id = NEW.id;
END;

-- Where results of what is stored with this token go.
ALTER TABLE tokens ADD COLUMN deliver_to TEXT;
