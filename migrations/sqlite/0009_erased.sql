-- Jobs whose rows were deleted a short while ago. Their end may not stand in the audit log yet: whoever deletes a row and is killed
-- does not write it. Without this they would be taken for jobs that the database has lost.
CREATE TABLE erased_jobs (
    id           TEXT   NOT NULL PRIMARY KEY,
    erased_at_ms BIGINT NOT NULL
);
CREATE TRIGGER jobs_erased AFTER DELETE ON jobs BEGIN
    INSERT INTO erased_jobs (id, erased_at_ms) VALUES (OLD.id, CAST(unixepoch('subsec') * 1000 AS INTEGER))
    ON CONFLICT (id) DO NOTHING;
END;
