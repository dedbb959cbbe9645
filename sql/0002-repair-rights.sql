-- SPDX-License-Identifier: BSD-3-Clause
-- A repair of version 1: what a role may do is what sql/roles.sql grants it, and no way leads from it to the owner's
-- rights. It changes no table of samples and locks none, so that a plant may run meanwhile; and programs of version
-- 1, also those made before it, go on with it.

-- ---- Versions and repairs -------------------------------------------------------------------------------
CREATE TABLE repair (
    name       text PRIMARY KEY,
    applied_at timestamptz NOT NULL DEFAULT now()
);
COMMENT ON TABLE repair IS 'Which repairs (sql/NNNN-repair-*.sql) were applied: they leave the version as it was.';
COMMENT ON COLUMN repair.name IS 'Name of the file, without .sql.';
COMMENT ON COLUMN repair.applied_at IS 'When it was applied, UTC.';

ALTER TABLE migration ADD COLUMN compatible_from integer
    CONSTRAINT compatible_from_not_above CHECK (compatible_from BETWEEN 1 AND version);
COMMENT ON COLUMN migration.compatible_from IS 'Programs made for this version or a later one go on with it; NULL: of its own.';

-- ---- Whose rights ---------------------------------------------------------------------------------------
-- Three kinds of functions run with the owner's rights (SECURITY DEFINER): claim(), absent() and the triggers
-- X_appended(). Whoever makes one of them look at an object of his own (a table, a view, a type with a cast, a
-- function in pg_temp) has his code run by the owner. So for each:
-- * The search_path is pinned here, word by word, not taken from the session that runs this file. Temporary
--   objects come last, behind the plant's schema, in which only the owner makes anything.
-- * A table's name is one of eight words of ours before it is used, so it is found in the plant's schema.
-- * The arguments are of built-in types, for which nobody but a superuser makes casts or operators.
-- * PUBLIC, which may execute every new function, may not execute these.
-- All other functions here (make_partition(), make_week(), drop_week(), maintain()) run with their caller's own
-- rights. The names in their commands are quoted by format(%I), and come from the plant's schema: the eight words,
-- and partitions of theirs, which only their owner can attach.

DO $do$
DECLARE
    target text;
    more text; -- columns
    guard text;
    follows text;
BEGIN
    FOREACH target IN ARRAY ARRAY['sensor', 'actuator', 'setpoint', 'state', 'tuning', 'manual', 'dim', 'opmode'] LOOP
        more := CASE target WHEN 'actuator' THEN ', sensor_seq, setpoint_seq' ELSE '' END;
        -- As in version 1.
        guard := CASE WHEN target NOT IN ('sensor', 'actuator', 'setpoint', 'state') THEN '' ELSE format($guard$
    IF risen < samples THEN -- by itself: plpgsql would set up the queries below even where it needs them not
        IF risen < (SELECT count(DISTINCT id) FROM fresh) OR EXISTS (
            SELECT FROM (SELECT id, min(seq) AS lowest, count(*) > count(DISTINCT seq) AS twice
                           FROM fresh GROUP BY id) AS f
              JOIN %1$I USING (id) WHERE lowest <= previous OR twice)
        THEN
            SELECT s.id, s.seq INTO taken
              FROM (SELECT DISTINCT id, seq FROM fresh) AS f CROSS JOIN LATERAL
                   (SELECT id, seq FROM %2$I WHERE id = f.id AND seq = f.seq LIMIT 2) AS s
             GROUP BY s.id, s.seq HAVING count(*) > 1 LIMIT 1;
            IF FOUND THEN
                RAISE unique_violation
                USING MESSAGE = format('%2$s: id %%s, seq %%s is there already', taken.id, taken.seq);
            END IF;
        END IF;
    END IF;$guard$, target || '_newest', target) END;

        -- People's values have no one writer who counts: each row is the successor of the newest. (Of opmode only the
        -- target; the actual mode is the controller's.)
        follows := CASE WHEN target NOT IN ('setpoint', 'tuning', 'manual', 'opmode') THEN '' ELSE format($follows$
    IF NOT pg_has_role(session_user, current_user, 'USAGE') THEN
        SELECT id, f.seq INTO taken FROM fresh AS f JOIN %1$I AS n USING (id)
         WHERE (f.seq <> n.seq OR f.seq <> n.previous + 1)%3$s LIMIT 1;
        IF FOUND THEN
            RAISE check_violation
            USING MESSAGE = format('%2$s %%s: seq %%s does not follow the newest', taken.id, taken.seq);
        END IF;
    END IF;$follows$, target || '_newest', target, CASE target WHEN 'opmode' THEN ' AND id = 0' ELSE '' END) END;

        -- The trigger's body. No caller turns it: it refuses to run for any table but its own, so that fresh has the
        -- columns and types of that one and not those of a table that somebody made; it executes no dynamic command.
        EXECUTE format($function$
CREATE OR REPLACE FUNCTION %1$I() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path TO %7$I, pg_temp
AS $$
DECLARE
    samples bigint;
    highest bigint;
    latest timestamptz;
    most bigint;
    risen bigint; -- variables that have a newer newest
    taken record;
BEGIN
    IF TG_RELID <> '%8$s'::regclass THEN
        RAISE insufficient_privilege USING MESSAGE = '%1$s() is the trigger of table %8$s only';
    END IF;
    SELECT count(*), max(seq), max(time) INTO samples, highest, latest FROM fresh;

    -- A seq counts samples. No count is ahead of one that began in 2020 and went on 2^20 times a second; so whatever
    -- was written, there is always room for the next one. (The first bound is for a server without the date.)
    IF highest > 1099511627776 THEN
        most := CASE WHEN pg_has_role(session_user, current_user, 'USAGE') THEN 9007199254740991
                ELSE least(9007199254740991, greatest(1099511627776,
                           1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint)) END;
        IF highest > most THEN
            RAISE check_violation
            USING MESSAGE = format('%8$s: seq %%s breaks seq_in_range: expected at most %%s', highest, most);
        END IF;
    END IF;
    -- Clocks may be wrong by hours, this server's by any time while the samples go on as they did. Old times are
    -- those of a spool.
    IF latest > now() + interval '1 day' AND NOT pg_has_role(session_user, current_user, 'USAGE') THEN
        SELECT id, f.time INTO taken FROM fresh AS f LEFT JOIN %2$I AS n USING (id)
         WHERE f.time > greatest(now(), n.time) + interval '1 day' LIMIT 1;
        IF FOUND THEN
            RAISE check_violation
            USING MESSAGE = format('%8$s %%s: time %%s is more than a day ahead of this server''s: %%s',
                                   taken.id, taken.time, now());
        END IF;
    END IF;

    INSERT INTO %2$I AS n (id, seq, time, status, value%3$s)
    SELECT DISTINCT ON (id) id, seq, time, status, value%3$s FROM fresh ORDER BY id, seq DESC
        ON CONFLICT (id) DO UPDATE
       SET previous = n.seq, (seq, time, status, value%3$s) =
           (excluded.seq, excluded.time, excluded.status, excluded.value%4$s)
     WHERE n.seq < excluded.seq;
    GET DIAGNOSTICS risen = ROW_COUNT;%5$s%6$s
    IF risen > 0 THEN
        PERFORM pg_notify('apc_' || TG_RELID, '');
    END IF;
    RETURN NULL;
END
$$ $function$, target || '_appended', target || '_newest', more, replace(more, ' s', ' excluded.s'), guard, follows,
                       current_schema(), target);
        EXECUTE format('REVOKE ALL ON FUNCTION %I() FROM PUBLIC', target || '_appended');
    END LOOP;

    -- No caller turns it: of target nothing is used before it is one of the eight words.
    EXECUTE format($function$
CREATE OR REPLACE FUNCTION absent(target text, ids integer[], seqs bigint[]) RETURNS SETOF bigint
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
BEGIN
    PERFORM writable(target);
    EXECUTE format('SELECT FROM %%I WHERE id = ANY ($1) ORDER BY id FOR UPDATE', target || '_newest') USING ids;
    RETURN QUERY EXECUTE format(
        'SELECT min(i) FROM unnest($1, $2) WITH ORDINALITY AS v (id, seq, i) WHERE NOT EXISTS'
        ' (SELECT FROM %%I AS s WHERE s.id = v.id AND s.seq = v.seq) GROUP BY v.id, v.seq', target) USING ids, seqs;
END
$$ $function$, current_schema());

    -- No caller turns it: the same. What it says of the holder is text, executed nowhere.
    EXECUTE format($function$
CREATE OR REPLACE FUNCTION claim(target text, n integer, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    target_oid oid := writable(target);
BEGIN
    IF (n BETWEEN 0 AND 1048576) IS NOT TRUE THEN
        RAISE invalid_parameter_value USING MESSAGE = format('%%s variables: expected 0 to 1048576', n);
    END IF;
    IF NOT pg_try_advisory_lock(6385763, target_oid::integer) THEN -- 6385763: "apc"
        SELECT format('%%s (server process %%s, %%s)', coalesce(nullif(a.application_name, ''), a.usename), l.pid,
                      coalesce('client ' || host(a.client_addr), 'local client'))
          INTO holder
          FROM pg_locks l LEFT JOIN pg_stat_activity a USING (pid)
         WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 6385763 AND l.objid = target_oid
           AND l.objsubid = 2 AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database());
        holder := coalesce(holder, 'a writer that has just left');
        RETURN;
    END IF;
    -- After the lock: what the previous writer committed is seen.
    EXECUTE format('SELECT array_agg(coalesce((SELECT seq FROM %%I WHERE id = i), 0) ORDER BY i)'
                   ' FROM generate_series(1, $1) i', target || '_newest') INTO last USING n;
END
$$ $function$, current_schema());
END
$do$;

-- With the rights of claim() and absent(), which alone may call it.
CREATE FUNCTION writable(target text) RETURNS oid LANGUAGE plpgsql STABLE AS $$
BEGIN
    IF (target IN ('sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state')) IS NOT TRUE THEN
        RAISE undefined_table USING MESSAGE = format('%s is no table of samples', coalesce(quote_ident(target), 'NULL'));
    END IF;
    IF has_table_privilege(session_user, target::regclass, 'INSERT') IS NOT TRUE THEN
        RAISE insufficient_privilege USING MESSAGE = format('%s may not write table %I', session_user, target);
    END IF;
    RETURN target::regclass;
END
$$;
COMMENT ON FUNCTION writable(text) IS 'The table of samples of that name, which the session''s user may write; or an error.';

REVOKE ALL ON FUNCTION writable(text), make_partition(text, text), make_week(text, date, date), drop_week(text, text)
    FROM PUBLIC;
