-- What is kept of each tenant's files, bytes. Follows the jobs by itself. Results that several jobs share on disk count for each.
ALTER TABLE jobs ADD COLUMN results_bytes BIGINT NOT NULL DEFAULT 0;
UPDATE jobs SET results_bytes = (SELECT coalesce(sum(json_extract(value, '$.bytes')), 0) FROM json_each(results));
CREATE TABLE storage (
    owner TEXT   NOT NULL PRIMARY KEY,
    bytes BIGINT NOT NULL
) WITHOUT ROWID;
INSERT INTO storage SELECT owner, sum(mask_kept * mask_bytes + results_kept * results_bytes) FROM jobs GROUP BY owner;
CREATE TRIGGER storage_of_new AFTER INSERT ON jobs BEGIN
    INSERT INTO storage VALUES (NEW.owner, NEW.mask_kept * NEW.mask_bytes + NEW.results_kept * NEW.results_bytes)
        ON CONFLICT (owner) DO UPDATE SET bytes = bytes + excluded.bytes;
END;
CREATE TRIGGER storage_of_changed AFTER UPDATE OF owner, mask_kept, results_kept, results_bytes ON jobs BEGIN
    UPDATE storage SET bytes = bytes - OLD.mask_kept * OLD.mask_bytes - OLD.results_kept * OLD.results_bytes
        WHERE owner = OLD.owner;
    INSERT INTO storage VALUES (NEW.owner, NEW.mask_kept * NEW.mask_bytes + NEW.results_kept * NEW.results_bytes)
        ON CONFLICT (owner) DO UPDATE SET bytes = bytes + excluded.bytes;
END;
CREATE TRIGGER storage_of_gone AFTER DELETE ON jobs BEGIN
    UPDATE storage SET bytes = bytes - OLD.mask_kept * OLD.mask_bytes - OLD.results_kept * OLD.results_bytes
        WHERE owner = OLD.owner;
END;
