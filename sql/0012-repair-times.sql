-- SPDX-License-Identifier: BSD-3-Clause
-- A repair of version 4: times and numbers that are absurdly ahead are refused in tables event, timing and request as well,
-- and who wrote a row of timing stands there. Times that functions put into commands do not depend on the session's
-- DateStyle. It alters timing, and gives three tables a trigger, each for a moment that their writers wait; a plant may run
-- meanwhile, and programs made before it go on with it.

-- ---- Too far ahead ----------------------------------------------------------------------------------------
-- As for rows of samples: more than a day ahead of this server's clock and, as that may be the wrong one, of the newest
-- measurement. A row is looked at closer only where it can be.
DO $do$
DECLARE
    target text;
BEGIN
    -- No caller turns it: it is the trigger of three tables of this schema, which only the owner makes, and not PUBLIC's;
    -- it executes no dynamic command.
    EXECUTE format($function$
CREATE FUNCTION refuse_ahead() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    bound bigint := least(9007199254740991,
                          greatest(1099511627776, 1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint));
BEGIN
    IF TG_RELID NOT IN ('event'::regclass, 'timing'::regclass, 'request'::regclass) THEN
        RAISE insufficient_privilege
        USING MESSAGE = 'refuse_ahead() is the trigger of tables event, timing and request only';
    END IF;
    IF pg_has_role(session_user, current_user, 'USAGE') THEN
        RETURN NEW;
    END IF;
    IF NEW.time > greatest(now(), (SELECT max(time) FROM sensor_newest)) + interval '1 day' THEN
        RAISE check_violation
        USING MESSAGE = format('%%s: time %%s is more than a day ahead of this server''s: %%s', TG_TABLE_NAME, NEW.time,
                               now());
    END IF;
    IF TG_TABLE_NAME = 'event' THEN
        IF NEW.seq > bound THEN
            RAISE check_violation
            USING MESSAGE = format('event: seq %%s is ahead of every count: expected at most %%s', NEW.seq, bound);
        END IF;
    END IF;
    RETURN NEW;
END
$$ $function$, current_schema());
    FOREACH target IN ARRAY ARRAY['event', 'timing', 'request'] LOOP
        EXECUTE format('CREATE TRIGGER ahead BEFORE INSERT ON %I FOR EACH ROW WHEN (NEW.time > now() + interval ''1 day''%s)'
                       ' EXECUTE FUNCTION refuse_ahead()', target,
                       CASE target WHEN 'event' THEN ' OR NEW.seq > 1099511627776' ELSE '' END);
    END LOOP;
END
$do$;
REVOKE ALL ON FUNCTION refuse_ahead() FROM PUBLIC;

-- ---- Who wrote it -----------------------------------------------------------------------------------------
ALTER TABLE timing ADD COLUMN role name; -- first: of rows that are there nobody knows
ALTER TABLE timing ALTER COLUMN role SET DEFAULT session_user; -- nobody is granted INSERT on it
COMMENT ON COLUMN timing.role IS
    'The database''s user who wrote the row: task is what a program says, this is what it is. NULL: of before 0012.';

-- ---- Times in commands ------------------------------------------------------------------------------------
-- Other styles write a zone by its abbreviation, which may be read as another one's.
ALTER FUNCTION make_days(text, date, integer, date) SET DateStyle TO 'ISO, YMD';
DO $do$
DECLARE
    maintain text := pg_get_functiondef('maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint, timestamptz)'::regprocedure);
    mended text := replace(maintain, '    dropped := 0;
', '    dropped := 0;
    PERFORM set_config(''DateStyle'', ''ISO, YMD'', true); -- until the first COMMIT: all commands are written by then
');
BEGIN
    ASSERT mended <> maintain, 'maintain() is that of 0007';
    EXECUTE mended;
END
$do$;
