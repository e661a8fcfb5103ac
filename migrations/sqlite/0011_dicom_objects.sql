-- Results that are DICOM objects, by what archives name them by. Follows the results of jobs by itself: what is erased, or belongs to
-- another tenant, is so here in the same moment. Holds identifiers alone, and nothing that a patient is called by. Results of
-- versions before this one did not say which objects they are, and have no rows.
CREATE TABLE dicom_objects (
    job_id   TEXT   NOT NULL,
    name     TEXT   NOT NULL,   -- of the file
    owner    TEXT   NOT NULL,
    token    TEXT   NOT NULL,   -- the attempt in whose folder the file lies
    bytes    BIGINT NOT NULL,
    sha256   TEXT   NOT NULL,
    study    TEXT   NOT NULL,
    series   TEXT   NOT NULL,
    instance TEXT   NOT NULL,
    class    TEXT   NOT NULL,
    PRIMARY KEY (job_id, name)
) WITHOUT ROWID;
CREATE INDEX dicom_objects_by_owner ON dicom_objects (owner, job_id, name);
CREATE INDEX dicom_objects_by_study ON dicom_objects (owner, study, job_id, name);
CREATE INDEX dicom_objects_by_series ON dicom_objects (owner, series, job_id, name);
CREATE INDEX dicom_objects_by_instance ON dicom_objects (owner, instance, job_id, name);
CREATE TRIGGER dicom_objects_of_changed AFTER UPDATE OF owner, results, results_kept, results_token ON jobs BEGIN
    DELETE FROM dicom_objects WHERE job_id = OLD.id;
    INSERT INTO dicom_objects (job_id, name, owner, token, bytes, sha256, study, series, instance, class)
    SELECT NEW.id, value ->> 'name', NEW.owner, NEW.results_token, value ->> 'bytes', value ->> 'sha256',
           value ->> '$.dicom.study', value ->> '$.dicom.series', value ->> '$.dicom.instance', value ->> '$.dicom.class'
    FROM json_each(NEW.results)
    WHERE NEW.results_kept = 1 AND NEW.results_token IS NOT NULL AND value ->> '$.dicom.instance' IS NOT NULL;
END;
-- What the row says of results that are erased names no object any more.
CREATE TRIGGER dicom_objects_erased AFTER UPDATE OF results_kept ON jobs WHEN NEW.results_kept = 0 BEGIN
    UPDATE jobs SET results = (SELECT json_group_array(json_remove(value, '$.dicom')) FROM json_each(NEW.results))
    WHERE id = NEW.id;
END;
CREATE TRIGGER dicom_objects_gone AFTER DELETE ON jobs BEGIN
    DELETE FROM dicom_objects WHERE job_id = OLD.id;
END;
