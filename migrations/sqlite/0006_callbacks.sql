-- Webhooks by who sends them where, so that those to a receiver that hangs hold up no others.
ALTER TABLE jobs ADD COLUMN callback_lane TEXT;   -- tenant and host
UPDATE jobs SET callback_lane = owner || ' ' || callback_url WHERE callback_url IS NOT NULL;
DROP INDEX jobs_by_callback;
CREATE INDEX jobs_by_callback ON jobs (callback_state, callback_lane, callback_due_ms);
