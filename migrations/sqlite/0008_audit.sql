-- What is known of the audit log, which lies in files: where the present one begins (after which entry, and its hash), and its last
-- entry. A log that was emptied or lost its first lines shows.
CREATE TABLE audit_marks (
    name TEXT   NOT NULL PRIMARY KEY,   -- head, tip
    seq  BIGINT NOT NULL,
    hash TEXT   NOT NULL
);
