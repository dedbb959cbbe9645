-- SPDX-License-Identifier: BSD-3-Clause
-- Version 1: the tables of one plant. Run by `apc init` (apc_store_init) in one transaction, with the plant's
-- schema first in the search_path; so no name here is qualified, and every plant's schema is made alike.

CREATE TABLE migration (
    version    integer PRIMARY KEY CHECK (version > 0),
    name       text NOT NULL,
    applied_at timestamptz NOT NULL DEFAULT now()
);
COMMENT ON TABLE migration IS 'Which files of sql/ were applied. Written by apc init; read by every connection.';
COMMENT ON COLUMN migration.version IS 'Number of the file.';
COMMENT ON COLUMN migration.name IS 'Name of the file, without .sql.';
COMMENT ON COLUMN migration.applied_at IS 'When it was applied, UTC.';

-- ---- Samples --------------------------------------------------------------------------------------------
-- One table, one kind of variable. (id, seq) is the key; "newest" is the highest seq, never the latest time,
-- because clocks step. Rows are only ever inserted.
--
-- The tables that grow with every tick are partitioned by time, a week each, so that old weeks can be dropped
-- whole (procedure maintain). What lies in no week, because nobody made it ahead or a clock is wrong, goes to
-- the partition _rest: no row is ever refused for its time. A key over all partitions would have to contain the
-- time, so each has its own, and the trigger below sees to the rest.
--
-- The newest samples are kept in a table of their own beside each (_newest), by a trigger, so that reading them
-- costs the same however long the history is and whatever of it was dropped; docs/rationale.md has the figures.
--
-- History over a time range has a BRIN index: rows come in the order of time, so a few bytes for each 32 pages
-- tell which pages to look at.
CREATE TABLE sensor (
    id     integer NOT NULL,
    seq    bigint NOT NULL,
    time   timestamptz NOT NULL,
    status bigint NOT NULL,
    value  double precision NOT NULL,
    CONSTRAINT id_not_negative CHECK (id >= 0),
    CONSTRAINT seq_in_range CHECK (seq BETWEEN 1 AND 4611686018427387903), -- below 2^62: room to count on
    CONSTRAINT status_is_code CHECK (status BETWEEN 0 AND 4294967295),
    -- Also keeps NaN and the infinities out: for PostgreSQL NaN is greater than any number.
    CONSTRAINT value_finite CHECK (abs(value) < 1e300::double precision)
) PARTITION BY RANGE (time);
COMMENT ON COLUMN sensor.id IS 'Number of the variable: 1..n is a row of the vector, 0 a scalar.';
COMMENT ON COLUMN sensor.seq IS 'Counts a variable''s samples from 1; rises strictly, survives restarts.';
COMMENT ON COLUMN sensor.time IS 'Source time, UTC: when the value was acquired or made. May step with the clock.';
COMMENT ON COLUMN sensor.status IS 'OPC UA StatusCode; 0 is Good, the top two of 32 bits are the severity.';
COMMENT ON COLUMN sensor.value IS 'In the unit that table tag names; magnitude below 1e300.';

CREATE TABLE actuator (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
ALTER TABLE actuator ADD COLUMN sensor_seq bigint CONSTRAINT sensor_seq_positive CHECK (sensor_seq > 0);
ALTER TABLE actuator ADD COLUMN setpoint_seq bigint CONSTRAINT setpoint_seq_positive CHECK (setpoint_seq > 0);
COMMENT ON COLUMN actuator.sensor_seq IS 'seq of the measurement it was computed from; NULL: none.';
COMMENT ON COLUMN actuator.setpoint_seq IS 'seq of the setpoint it was computed from; NULL: none.';

CREATE TABLE setpoint (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE state (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE tuning (LIKE sensor INCLUDING ALL, PRIMARY KEY (id, seq));
CREATE TABLE manual (LIKE sensor INCLUDING ALL, PRIMARY KEY (id, seq));
CREATE TABLE dim (LIKE tuning INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));
CREATE TABLE opmode (LIKE tuning INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));

COMMENT ON TABLE sensor IS 'Measurements y. Written by apc-client.';
COMMENT ON TABLE actuator IS 'Manipulated variables u. Written by apc-controller.';
COMMENT ON TABLE setpoint IS 'Setpoints. Written by apc-scheduler and the operator.';
COMMENT ON TABLE dim IS 'Ids 1..3: number of measurements, setpoints, manipulated variables. Written at set-up.';
COMMENT ON TABLE opmode IS
    'Id 0: target mode, written by the operator; id 1: actual mode, written by apc-controller. 0 Man, 1 Auto, 2 OOS.';
COMMENT ON TABLE tuning IS 'Parameters of the control law. Written by the operator.';
COMMENT ON TABLE manual IS 'The operator''s outputs, used in mode Man. Written by the operator.';
COMMENT ON TABLE state IS 'What a restarted apc-controller resumes from. Written by apc-controller.';

-- ---- Partitions -----------------------------------------------------------------------------------------
CREATE FUNCTION make_partition(target text, suffix text) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    partition text := format('%s_%s', target, suffix);
BEGIN
    EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING CONSTRAINTS INCLUDING COMMENTS, PRIMARY KEY (id, seq))',
                   partition, target);
    EXECUTE format('COMMENT ON TABLE %I IS %L', partition, format('Partition of table %s.', target));
    EXECUTE format('ALTER TABLE %I OWNER TO %s', partition, -- it may be a superuser who maintains
                   (SELECT relowner::regrole FROM pg_class WHERE oid = to_regclass(quote_ident(target))));
END
$$;
COMMENT ON FUNCTION make_partition(text, text) IS 'A table that can become a partition of target.';

-- The week from a Monday on, UTC. Rows of it that were stored elsewhere meanwhile move to it. A week that has
-- begun and has rows elsewhere is left there: to move many would keep writers waiting.
CREATE FUNCTION make_week(target text, monday date, today date) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    name text := to_char(monday, 'YYYYMMDD');
    partition text := format('%s_%s', target, name);
    rest text := format('%s_rest', target);
    since timestamptz := monday::timestamp AT TIME ZONE 'UTC';
    until timestamptz := (monday + 7)::timestamp AT TIME ZONE 'UTC';
    any_there boolean;
BEGIN
    IF to_regclass(quote_ident(partition)) IS NOT NULL THEN
        RETURN;
    END IF;
    EXECUTE format('LOCK TABLE ONLY %I IN SHARE UPDATE EXCLUSIVE MODE', target);
    EXECUTE format('LOCK TABLE %I IN ACCESS EXCLUSIVE MODE', rest);
    EXECUTE format('SELECT EXISTS (SELECT FROM %I WHERE time >= $1 AND time < $2)', rest)
       INTO any_there USING since, until;
    IF any_there AND monday <= today THEN
        RETURN;
    END IF;
    PERFORM make_partition(target, name);
    IF any_there THEN
        EXECUTE format('WITH moved AS (DELETE FROM %I WHERE time >= $1 AND time < $2 RETURNING *)'
                       ' INSERT INTO %I SELECT * FROM moved', rest, partition) USING since, until;
    END IF;
    EXECUTE format('ALTER TABLE %I ATTACH PARTITION %I FOR VALUES FROM (%L) TO (%L)', target, partition, since,
                   until);
END
$$;
COMMENT ON FUNCTION make_week(text, date, date) IS 'Make the partition of a week, unless it is there.';

CREATE FUNCTION drop_week(target text, partition text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    EXECUTE format('ALTER TABLE %I DETACH PARTITION %I', target, partition);
    EXECUTE format('INSERT INTO %I SELECT p.* FROM %I AS p JOIN %I USING (id, seq)', target || '_rest', partition,
                   target || '_newest');
    EXECUTE format('DROP TABLE %I', partition);
END
$$;
COMMENT ON FUNCTION drop_week(text, text) IS 'Drop a partition, but not the newest sample of any variable.';

-- ---- The newest samples, and one row a key --------------------------------------------------------------
-- The row of a variable in _newest is also its lock: two who append to the same variable follow each other, and
-- always in the order of ids. When the trigger has it, it sees what the other has committed.
--
-- Where there are partitions, the key (id, seq) is guarded here: rows that are all newer than what was the newest
-- need no look at the history, which is the usual case; others do.
--
-- Waiters (apc_store_wait) are told of every commit that made something newer.
DO $do$
DECLARE
    target text;
    more text; -- columns
    parts boolean;
    guard text;
    monday date := date_trunc('week', now() AT TIME ZONE 'UTC')::date;
BEGIN
    FOREACH target IN ARRAY ARRAY['sensor', 'actuator', 'setpoint', 'state', 'tuning', 'manual', 'dim', 'opmode'] LOOP
        parts := target IN ('sensor', 'actuator', 'setpoint', 'state');
        more := CASE target WHEN 'actuator' THEN ', sensor_seq, setpoint_seq' ELSE '' END;
        EXECUTE format('CREATE INDEX ON %I USING brin (time) WITH (pages_per_range = 32, autosummarize = on)', target);
        IF parts THEN
            PERFORM make_partition(target, 'rest');
            EXECUTE format('ALTER TABLE %I ATTACH PARTITION %I DEFAULT', target, target || '_rest');
            PERFORM make_week(target, monday + 7 * week, monday) FROM generate_series(0, 4) AS week;
        END IF;

        -- Half of each page is left for the next versions of its rows: the index need not change with them.
        EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING COMMENTS, previous bigint NOT NULL DEFAULT 0,'
                       ' PRIMARY KEY (id)) WITH (fillfactor = 50)', target || '_newest', target);
        EXECUTE format('COMMENT ON TABLE %I IS %L', target || '_newest',
                       format('The newest sample of each variable of table %s. Kept by a trigger.', target));
        EXECUTE format('COMMENT ON COLUMN %I.previous IS %L', target || '_newest',
                       'seq of the newest before it; 0: none.');

        guard := format($guard$
    SELECT count(*) INTO samples FROM fresh;
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
    END IF;$guard$, target || '_newest', target);

        EXECUTE format($function$
CREATE FUNCTION %1$I() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    samples bigint;
    risen bigint; -- variables that have a newer newest
    taken record;
BEGIN
    INSERT INTO %2$I AS n (id, seq, time, status, value%3$s)
    SELECT DISTINCT ON (id) id, seq, time, status, value%3$s FROM fresh ORDER BY id, seq DESC
        ON CONFLICT (id) DO UPDATE
       SET previous = n.seq, (seq, time, status, value%3$s) =
           (excluded.seq, excluded.time, excluded.status, excluded.value%4$s)
     WHERE n.seq < excluded.seq;
    GET DIAGNOSTICS risen = ROW_COUNT;%5$s
    IF risen > 0 THEN
        PERFORM pg_notify('apc_' || TG_RELID, '');
    END IF;
    RETURN NULL;
END
$$ $function$, target || '_appended', target || '_newest', more, replace(more, ' s', ' excluded.s'),
                       CASE WHEN parts THEN guard ELSE '' END);
        EXECUTE format('CREATE TRIGGER appended AFTER INSERT ON %I REFERENCING NEW TABLE AS fresh'
                       ' EXECUTE FUNCTION %I()', target, target || '_appended');
    END LOOP;
END
$do$;

-- Positions in the arrays, from 1, of the samples that are not stored yet; of equal ones the first. With the owner's
-- rights, because a writer may not be allowed to read its own table.
CREATE FUNCTION absent(target text, ids integer[], seqs bigint[]) RETURNS SETOF bigint
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
BEGIN
    IF NOT has_table_privilege(session_user, to_regclass(quote_ident(target)), 'INSERT') THEN
        RAISE insufficient_privilege USING MESSAGE = format('%s may not write table %I', session_user, target);
    END IF;
    EXECUTE format('SELECT FROM %I WHERE id = ANY ($1) ORDER BY id FOR UPDATE', target || '_newest') USING ids;
    RETURN QUERY EXECUTE format(
        'SELECT min(i) FROM unnest($1, $2) WITH ORDINALITY AS v (id, seq, i) WHERE NOT EXISTS'
        ' (SELECT FROM %I AS s WHERE s.id = v.id AND s.seq = v.seq) GROUP BY v.id, v.seq', target) USING ids, seqs;
END
$$;
COMMENT ON FUNCTION absent(text, integer[], bigint[]) IS 'Which of these samples are not stored yet.';
REVOKE ALL ON FUNCTION absent(text, integer[], bigint[]) FROM PUBLIC;

-- ---- Descriptions, events, timing -----------------------------------------------------------------------
CREATE TABLE tag (
    table_name  text NOT NULL CHECK (table_name IN ('sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning',
                                                    'manual', 'state')),
    id          integer NOT NULL CHECK (id >= 0),
    name        text NOT NULL CHECK (octet_length(name) BETWEEN 1 AND 63),
    unit        text NOT NULL DEFAULT '' CHECK (octet_length(unit) <= 63),
    description text NOT NULL DEFAULT '' CHECK (octet_length(description) <= 127),
    low         double precision NOT NULL DEFAULT -1e300 CHECK (abs(low) <= 1e300::double precision),
    high        double precision NOT NULL DEFAULT 1e300 CHECK (abs(high) <= 1e300::double precision),
    PRIMARY KEY (table_name, id),
    UNIQUE (table_name, name) DEFERRABLE INITIALLY DEFERRED, -- names may change places
    CONSTRAINT low_not_above_high CHECK (low <= high)
);
COMMENT ON TABLE tag IS 'What a variable is called and may be. Replaced as a whole, by its owner only: apc init.';
COMMENT ON COLUMN tag.table_name IS 'Table of the variable.';
COMMENT ON COLUMN tag.id IS 'Number of the variable in that table.';
COMMENT ON COLUMN tag.name IS 'Name, unique in its table, at most 63 bytes.';
COMMENT ON COLUMN tag.unit IS 'Engineering unit of value; may be empty.';
COMMENT ON COLUMN tag.description IS 'For people.';
COMMENT ON COLUMN tag.low IS 'Lowest value allowed, in the unit; -1e300: no limit.';
COMMENT ON COLUMN tag.high IS 'Highest value allowed, in the unit; 1e300: no limit.';

CREATE TABLE event (
    id       bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    time     timestamptz NOT NULL,
    severity smallint NOT NULL CHECK (severity BETWEEN 1 AND 3),
    source   text NOT NULL CHECK (octet_length(source) <= 31),
    kind     text NOT NULL CHECK (octet_length(kind) <= 31),
    text     text NOT NULL CHECK (octet_length(text) <= 191),
    role     name NOT NULL DEFAULT session_user -- nobody is granted INSERT on it
);
CREATE INDEX ON event (time);
COMMENT ON TABLE event IS 'What happened: operator actions, mode changes, lost connections. Written by every program.';
COMMENT ON COLUMN event.id IS 'Order of arrival.';
COMMENT ON COLUMN event.time IS 'When it happened, UTC.';
COMMENT ON COLUMN event.severity IS '1 information, 2 warning, 3 alarm.';
COMMENT ON COLUMN event.source IS 'The program, or the operator''s name.';
COMMENT ON COLUMN event.kind IS 'start, stop, mode, operator, link, store, measurement, rejected, watchdog, overrun, clock.';
COMMENT ON COLUMN event.text IS 'One line for people.';
COMMENT ON COLUMN event.role IS 'The database''s user who wrote the row: source is what a program says, this is what it is.';

CREATE TABLE timing (
    id        bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    time      timestamptz NOT NULL,
    task      text NOT NULL CHECK (octet_length(task) <= 31),
    quantity  text NOT NULL CHECK (quantity IN ('lateness', 'jitter', 'run')),
    period    bigint NOT NULL CHECK (period >= 0),
    missed    bigint NOT NULL CHECK (missed >= 0),
    count     bigint NOT NULL CHECK (count >= 0),
    mean      double precision NOT NULL,
    sd        double precision NOT NULL,
    p50       bigint NOT NULL,
    p99       bigint NOT NULL,
    max       bigint NOT NULL,
    bin_low   bigint[] NOT NULL,
    bin_high  bigint[] NOT NULL,
    bin_count bigint[] NOT NULL,
    CONSTRAINT bins_match CHECK (cardinality(bin_low) = cardinality(bin_high)
                                 AND cardinality(bin_low) = cardinality(bin_count))
);
CREATE INDEX ON timing (time);
COMMENT ON TABLE timing IS 'Histograms of the tasks'' timing, one row a window. Written by every program with a task.';
COMMENT ON COLUMN timing.id IS 'Order of arrival.';
COMMENT ON COLUMN timing.time IS 'End of the window, UTC.';
COMMENT ON COLUMN timing.task IS 'Name of the task.';
COMMENT ON COLUMN timing.quantity IS
    'lateness: start after release; jitter: start to start minus the period; run: start to end.';
COMMENT ON COLUMN timing.period IS 'The task''s period, ns.';
COMMENT ON COLUMN timing.missed IS 'Releases missed in the window.';
COMMENT ON COLUMN timing.count IS 'Ticks in the window.';
COMMENT ON COLUMN timing.mean IS 'Mean, ns.';
COMMENT ON COLUMN timing.sd IS 'Standard deviation, ns.';
COMMENT ON COLUMN timing.p50 IS 'Median, ns.';
COMMENT ON COLUMN timing.p99 IS '99th percentile, ns.';
COMMENT ON COLUMN timing.max IS 'Largest, ns.';
COMMENT ON COLUMN timing.bin_low IS 'Lower edges of the filled buckets, ns.';
COMMENT ON COLUMN timing.bin_high IS 'Upper edges, ns.';
COMMENT ON COLUMN timing.bin_count IS 'How many fell into each.';

-- ---- One writer a table ---------------------------------------------------------------------------------
-- A claim is a session's advisory lock: it ends with the session, so a dead writer's claim is free at once.
-- The owner's rights are needed because a writer may not be allowed to read its own table, yet has to know
-- from which seq to count on. Who may not insert may not claim. That keeps honest programs apart; it is no
-- protection against a hostile user of the database, for whom pg_advisory_lock() itself is open to everybody.
CREATE FUNCTION claim(target text, n integer, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER
    SET search_path FROM CURRENT
AS $$
DECLARE
    target_oid oid;
BEGIN
    IF target NOT IN ('sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state') THEN
        RAISE undefined_table USING MESSAGE = format('%I is no table of samples', target);
    END IF;
    target_oid := to_regclass(quote_ident(target));
    IF NOT has_table_privilege(session_user, target_oid, 'INSERT') THEN
        RAISE insufficient_privilege USING MESSAGE = format('%s may not write table %I', session_user, target);
    END IF;
    IF NOT pg_try_advisory_lock(6385763, target_oid::integer) THEN -- 6385763: "apc"
        SELECT format('%s (server process %s, %s)', coalesce(nullif(a.application_name, ''), a.usename), l.pid,
                      coalesce('client ' || host(a.client_addr), 'local client'))
          INTO holder
          FROM pg_locks l LEFT JOIN pg_stat_activity a USING (pid)
         WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 6385763 AND l.objid = target_oid
           AND l.objsubid = 2 AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database());
        holder := coalesce(holder, 'a writer that has just left');
        RETURN;
    END IF;
    -- After the lock: what the previous writer committed is seen.
    EXECUTE format('SELECT array_agg(coalesce((SELECT seq FROM %I WHERE id = i), 0) ORDER BY i)'
                   ' FROM generate_series(1, $1) i', target || '_newest') INTO last USING n;
END
$$;
COMMENT ON FUNCTION claim(text, integer) IS
    'Become the one writer of a table for as long as this session lives. holder: NULL, or who has it; last: newest seq of ids 1..n.';
REVOKE ALL ON FUNCTION claim(text, integer) FROM PUBLIC;

-- ---- Housekeeping ---------------------------------------------------------------------------------------
-- For the owner: apc maintain, or CALL it with the plant's schema first in the search_path. Weeks are made ahead,
-- and what is older than asked for (NULL: nothing) is dropped, but for the newest sample of each variable. Each step
-- is a transaction of its own. What needs a table for itself waits for it a fifth of a second at most, because
-- writers would wait behind it, and then tries again.
CREATE PROCEDURE maintain(today timestamptz, samples_before timestamptz, events_before timestamptz,
                          timing_before timestamptz, INOUT dropped bigint) LANGUAGE plpgsql AS $$
DECLARE
    target text;
    step record;
    done boolean;
    rows bigint;
BEGIN
    dropped := 0;
    FOR step IN
        WITH parts (name, part) AS (
            SELECT relname, relkind = 'p' FROM pg_class
             WHERE relnamespace = to_regnamespace(quote_ident(current_schema()))
               AND relname IN ('sensor', 'actuator', 'setpoint', 'state', 'tuning', 'manual', 'dim', 'opmode')),
        monday (day) AS (SELECT date_trunc('week', today AT TIME ZONE 'UTC')::date)
        SELECT 1 AS phase, format('SELECT make_week(%L, %L, %L)', name, day + 7 * week,
                                  (today AT TIME ZONE 'UTC')::date) AS command
          FROM parts, monday, generate_series(0, 4) AS week WHERE part
        UNION ALL
        SELECT 2, format('SELECT drop_week(%L, %L)', name, c.relname)
          FROM parts JOIN pg_inherits ON inhparent = to_regclass(quote_ident(name))
          JOIN pg_class c ON c.oid = inhrelid
         WHERE part AND c.relname ~ '_[0-9]{8}$'
           AND (to_date(right(c.relname, 8), 'YYYYMMDD') + 7)::timestamp AT TIME ZONE 'UTC' <= samples_before
        UNION ALL
        SELECT 3, format('DELETE FROM %I AS s WHERE time < %L AND NOT EXISTS (SELECT FROM %I AS n'
                         ' WHERE n.id = s.id AND n.seq = s.seq)', name || CASE WHEN part THEN '_rest' ELSE '' END,
                         samples_before, name || '_newest')
          FROM parts WHERE samples_before IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM event WHERE time < %L', events_before) WHERE events_before IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM timing WHERE time < %L', timing_before) WHERE timing_before IS NOT NULL
        ORDER BY phase
    LOOP
        done := false;
        FOR try IN 1 .. 50 LOOP
            BEGIN
                PERFORM set_config('lock_timeout', '200ms', true);
                EXECUTE step.command;
                GET DIAGNOSTICS rows = ROW_COUNT;
                dropped := dropped + CASE WHEN step.phase > 1 THEN rows ELSE 0 END;
                done := true;
            EXCEPTION WHEN lock_not_available THEN
                done := false;
            END;
            COMMIT;
            EXIT WHEN done;
            PERFORM pg_sleep(0.05);
        END LOOP;
        IF NOT done THEN
            RAISE lock_not_available USING MESSAGE = 'a table is in use without a pause: try again later';
        END IF;
    END LOOP;
END
$$;
COMMENT ON PROCEDURE maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint) IS
    'Make partitions ahead, drop what is older than each given time; dropped: rows and partitions.';
REVOKE ALL ON PROCEDURE maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint) FROM PUBLIC;
