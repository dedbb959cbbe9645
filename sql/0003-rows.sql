-- SPDX-License-Identifier: BSD-3-Clause
-- Version 3: what loops, vectors, claims by set and a catalogue need. It only adds: programs of version 1 go on with
-- it, also those that run meanwhile. So their tables keep their columns and their notifications, and opmode ids 0 and
-- 1 their meaning, until tags say that a plant has loops (loops()). The tables that exist are altered last, each for
-- a moment that their writers wait.

-- ---- Names ----------------------------------------------------------------------------------------------
CREATE FUNCTION samples() RETURNS text[] LANGUAGE sql IMMUTABLE AS $$
    SELECT ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state', 'actual', 'estimate',
                 'alarm', 'tick', 'plan', 'prediction']
$$;
COMMENT ON FUNCTION samples() IS 'The tables of rows (id, seq), in the library''s order; the only names that become part of a command.';

CREATE TABLE author (
    number bigint GENERATED ALWAYS AS IDENTITY (MAXVALUE 2147483647) PRIMARY KEY,
    name   text NOT NULL CHECK (octet_length(name) BETWEEN 1 AND 63),
    role   name NOT NULL,
    UNIQUE (name, role),
    UNIQUE (number, role)
);
COMMENT ON TABLE author IS 'Who writes what people write. Kept by author_number().';
COMMENT ON COLUMN author.number IS 'Stands in column author of a row.';
COMMENT ON COLUMN author.name IS 'As the program says, which may serve many people; in rows written by SQL the database''s user.';
COMMENT ON COLUMN author.role IS 'The database''s user who wrote under this name, and who alone may.';

CREATE UNLOGGED TABLE claim ( -- empty after a crash, as are the sessions
    table_name text NOT NULL,
    id         integer NOT NULL,
    name       text NOT NULL,
    pid        integer NOT NULL,
    started    timestamptz NOT NULL,
    PRIMARY KEY (table_name, id)
);
CREATE INDEX ON claim (pid);
COMMENT ON TABLE claim IS 'Which session is the one writer of a variable; true as long as that session lives. Kept by claim_set().';
COMMENT ON COLUMN claim.table_name IS 'Table of the variable.';
COMMENT ON COLUMN claim.id IS 'Number of the variable in that table.';
COMMENT ON COLUMN claim.name IS 'Who, for people: program, server process, client.';
COMMENT ON COLUMN claim.pid IS 'Server process of the session; it lives while the advisory lock (oid of this table, pid) is held.';
COMMENT ON COLUMN claim.started IS 'When that session began: tells it from a later one of the same number.';

CREATE TABLE catalogue (
    revision bigint PRIMARY KEY CHECK (revision > 0),
    time     timestamptz NOT NULL DEFAULT now(),
    kind     text NOT NULL CHECK (kind IN ('live', 'history')),
    text     text NOT NULL
);
COMMENT ON TABLE catalogue IS 'What the plant is: signals, controllers, loops, layout of vectors. The highest revision is in force. Written by its owner only.';
COMMENT ON COLUMN catalogue.revision IS 'Counts from 1.';
COMMENT ON COLUMN catalogue.time IS 'From when on, UTC.';
COMMENT ON COLUMN catalogue.kind IS 'live: the modules meet here. history: a record of what a historian brings; people write to table request.';
COMMENT ON COLUMN catalogue.text IS 'The experiment file in force.';

CREATE TABLE request (
    id         bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    time       timestamptz NOT NULL DEFAULT now(),
    until      timestamptz NOT NULL DEFAULT now() + interval '10 seconds',
    table_name text NOT NULL CHECK (table_name IN ('setpoint', 'opmode', 'tuning', 'manual')),
    variable   integer NOT NULL CHECK (variable >= 0),
    value      double precision NOT NULL CHECK (abs(value) < 1e300::double precision),
    author     text NOT NULL DEFAULT session_user CHECK (octet_length(author) BETWEEN 1 AND 63),
    reason     text NOT NULL DEFAULT '' CHECK (octet_length(reason) <= 127),
    role       name NOT NULL DEFAULT session_user, -- nobody is granted INSERT on it
    seq        bigint CHECK (seq BETWEEN 0 AND 9007199254740991),
    outcome    text CHECK (octet_length(outcome) <= 191),
    CONSTRAINT until_is_near CHECK (until <= time + interval '1 hour')
);
COMMENT ON TABLE request IS 'What people want written, where this is a history: a historian takes it to the live store, once.';
COMMENT ON COLUMN request.id IS 'Order of arrival.';
COMMENT ON COLUMN request.time IS 'When it was asked for, UTC.';
COMMENT ON COLUMN request.until IS 'Not to be done later than that.';
COMMENT ON COLUMN request.table_name IS 'Table of the variable.';
COMMENT ON COLUMN request.variable IS 'Number of the variable in that table.';
COMMENT ON COLUMN request.value IS 'What it is to be.';
COMMENT ON COLUMN request.author IS 'Who wants it, as the program says.';
COMMENT ON COLUMN request.reason IS 'Why, for people; may be empty.';
COMMENT ON COLUMN request.role IS 'The database''s user who wrote the row.';
COMMENT ON COLUMN request.seq IS 'Of the row in the live store; 0: there is none; NULL: not done yet. Written by the historian.';
COMMENT ON COLUMN request.outcome IS 'What became of it, for people. Written by the historian.';

-- ---- Tables of rows -------------------------------------------------------------------------------------
CREATE TABLE actual (
    id     integer NOT NULL,
    seq    bigint NOT NULL,
    time   timestamptz NOT NULL,
    status bigint NOT NULL,
    value  double precision NOT NULL,
    origin bigint,
    author bigint,
    CONSTRAINT id_not_negative CHECK (id >= 0),
    CONSTRAINT seq_in_range CHECK (seq BETWEEN 1 AND 9007199254740991),
    CONSTRAINT status_is_code CHECK (status BETWEEN 0 AND 4294967295),
    CONSTRAINT value_finite CHECK (abs(value) < 1e300::double precision),
    CONSTRAINT origin_is_seq CHECK (origin BETWEEN 1 AND 9007199254740991)
) PARTITION BY RANGE (time);
CREATE TABLE estimate (LIKE actual INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE alarm (LIKE actual INCLUDING ALL, PRIMARY KEY (id, seq),
                    CONSTRAINT value_whole CHECK (value = trunc(value)));

CREATE TABLE tick (
    id     integer NOT NULL,
    seq    bigint NOT NULL,
    time   timestamptz NOT NULL,
    status bigint NOT NULL,
    value  double precision[] NOT NULL,
    CONSTRAINT id_not_negative CHECK (id >= 0),
    CONSTRAINT seq_in_range CHECK (seq BETWEEN 1 AND 9007199254740991),
    CONSTRAINT status_is_code CHECK (status BETWEEN 0 AND 4294967295),
    CONSTRAINT value_is_vector CHECK (coalesce(array_ndims(value), 1) = 1 AND array_position(value, NULL) IS NULL),
    CONSTRAINT value_finite CHECK (1e300::double precision > ALL (value) AND -1e300::double precision < ALL (value))
) PARTITION BY RANGE (time);
ALTER TABLE tick ALTER COLUMN value SET STORAGE EXTERNAL; -- doubles do not compress
CREATE TABLE plan (LIKE tick INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE prediction (LIKE tick INCLUDING ALL) PARTITION BY RANGE (time);

COMMENT ON TABLE actual IS 'What became of what somebody wants: the value in force of the variable whose tag.number is id. Good: taken; Bad: refused; Uncertain: not yet.';
COMMENT ON TABLE estimate IS 'What laws publish, and what a controller in shadow would put out. Written by apc-controller.';
COMMENT ON TABLE alarm IS 'State of each alarm (ISA-18.2). Written by who evaluates it.';
COMMENT ON TABLE tick IS 'A row a tick of a controller: what it was made from, what the next one goes on from. Layout: catalogue. Kept a day.';
COMMENT ON TABLE plan IS 'What a setpoint will be: pairs of seconds from time on, and value. Written by apc-scheduler and upper controllers.';
COMMENT ON TABLE prediction IS 'What laws publish over a horizon. Written by apc-controller. Kept a day.';

DO $do$
DECLARE
    target text;
BEGIN
    FOREACH target IN ARRAY ARRAY['actual', 'estimate', 'alarm', 'tick', 'plan', 'prediction'] LOOP
        EXECUTE format('COMMENT ON COLUMN %I.id IS %L', target, CASE target WHEN 'actual' THEN
                       'tag.number of the wanted variable.' WHEN 'plan' THEN 'Number of the setpoint.' ELSE
                       'Number of the variable: 1..n.' END);
        EXECUTE format('COMMENT ON COLUMN %I.seq IS %L', target,
                       'Counts a variable''s rows from 1; rises strictly, survives restarts. A double holds it exactly.');
        EXECUTE format('COMMENT ON COLUMN %I.time IS %L', target, 'Source time, UTC. May step with the clock.');
        EXECUTE format('COMMENT ON COLUMN %I.status IS %L', target,
                       'OPC UA StatusCode; 0 is Good, the top two of 32 bits are the severity.');
        EXECUTE format('COMMENT ON COLUMN %I.value IS %L', target,
                       'In the unit that table tag names; magnitude below 1e300.');
    END LOOP;
END
$do$;

-- ---- Partitions -----------------------------------------------------------------------------------------
-- As in version 1, of a week or of a day; with the storage of columns.
CREATE OR REPLACE FUNCTION make_partition(target text, suffix text) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    partition text := format('%s_%s', target, suffix);
BEGIN
    EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING CONSTRAINTS INCLUDING COMMENTS INCLUDING STORAGE,'
                   ' PRIMARY KEY (id, seq))', partition, target);
    EXECUTE format('COMMENT ON TABLE %I IS %L', partition, format('Partition of table %s.', target));
    EXECUTE format('ALTER TABLE %I OWNER TO %s', partition, -- it may be a superuser who maintains
                   (SELECT relowner::regrole FROM pg_class WHERE oid = to_regclass(quote_ident(target))));
END
$$;

CREATE FUNCTION make_days(target text, first date, days integer, today date) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    name text := to_char(first, 'YYYYMMDD');
    partition text := format('%s_%s', target, name);
    rest text := format('%s_rest', target);
    since timestamptz := first::timestamp AT TIME ZONE 'UTC';
    until timestamptz := (first + days)::timestamp AT TIME ZONE 'UTC';
    any_there boolean;
BEGIN
    IF to_regclass(quote_ident(partition)) IS NOT NULL THEN
        RETURN;
    END IF;
    EXECUTE format('LOCK TABLE ONLY %I IN SHARE UPDATE EXCLUSIVE MODE', target);
    EXECUTE format('LOCK TABLE %I IN ACCESS EXCLUSIVE MODE', rest);
    EXECUTE format('SELECT EXISTS (SELECT FROM %I WHERE time >= $1 AND time < $2)', rest)
       INTO any_there USING since, until;
    IF any_there AND first <= today THEN
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
COMMENT ON FUNCTION make_days(text, date, integer, date) IS 'Make the partition of so many days from the first on, unless it is there.';

CREATE OR REPLACE FUNCTION make_week(target text, monday date, today date) RETURNS void LANGUAGE sql AS $$
    SELECT make_days(target, monday, 7, today)
$$;

CREATE FUNCTION span(target text) RETURNS integer LANGUAGE sql IMMUTABLE AS $$
    SELECT CASE WHEN target IN ('tick', 'prediction') THEN 1 ELSE 7 END
$$;
COMMENT ON FUNCTION span(text) IS 'How many days a partition of a table is for.';

CREATE FUNCTION ahead(target text, today date) RETURNS SETOF date LANGUAGE sql STABLE AS $$
    SELECT CASE span(target) WHEN 1 THEN today + i ELSE date_trunc('week', today::timestamp)::date + 7 * i END
      FROM generate_series(0, CASE span(target) WHEN 1 THEN 7 ELSE 4 END) AS i
$$;
COMMENT ON FUNCTION ahead(text, date) IS 'First days of the partitions for now and the time to come.';

DROP PROCEDURE maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint);
-- As in version 1; ticks and predictions are dropped after a day, or from ticks_before on.
CREATE PROCEDURE maintain(today timestamptz, samples_before timestamptz, events_before timestamptz,
                          timing_before timestamptz, INOUT dropped bigint, ticks_before timestamptz DEFAULT NULL)
    LANGUAGE plpgsql AS $$
DECLARE
    target text;
    step record;
    done boolean;
    rows bigint;
BEGIN
    dropped := 0;
    FOR step IN
        WITH parts (name, part, before) AS (
            SELECT relname, relkind = 'p',
                   CASE span(relname) WHEN 1 THEN coalesce(ticks_before, greatest(today - interval '1 day', samples_before))
                        ELSE samples_before END
              FROM pg_class
             WHERE relnamespace = to_regnamespace(quote_ident(current_schema())) AND relname = ANY (samples()))
        SELECT 1 AS phase, format('SELECT make_days(%L, %L, %L, %L)', name, first, span(name), day) AS command
          FROM parts, CAST(today AT TIME ZONE 'UTC' AS date) AS day, ahead(name, day) AS first WHERE part
        UNION ALL
        SELECT 2, format('SELECT drop_week(%L, %L)', name, c.relname)
          FROM parts JOIN pg_inherits ON inhparent = to_regclass(quote_ident(name))
          JOIN pg_class c ON c.oid = inhrelid
         WHERE part AND c.relname ~ '_[0-9]{8}$'
           AND (to_date(right(c.relname, 8), 'YYYYMMDD') + span(name))::timestamp AT TIME ZONE 'UTC' <= before
        UNION ALL
        SELECT 3, format('DELETE FROM %I AS s WHERE time < %L AND NOT EXISTS (SELECT FROM %I AS n'
                         ' WHERE n.id = s.id AND n.seq = s.seq)', name || CASE WHEN part THEN '_rest' ELSE '' END,
                         before, name || '_newest')
          FROM parts WHERE before IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM event WHERE time < %L', events_before) WHERE events_before IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM request WHERE time < %L', events_before) WHERE events_before IS NOT NULL
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
COMMENT ON PROCEDURE maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint, timestamptz) IS
    'Make partitions ahead, drop what is older than each given time; dropped: rows and partitions.';

-- ---- Whose rights ---------------------------------------------------------------------------------------
-- As before, and for each new function with the owner's rights (SECURITY DEFINER): its search_path is pinned; a table's
-- name is one of samples() before it becomes part of a command (writable()); arguments are of built-in types; PUBLIC
-- may not execute it, so that nobody makes it the trigger of a table of his own.
CREATE OR REPLACE FUNCTION writable(target text) RETURNS oid LANGUAGE plpgsql STABLE AS $$
BEGIN
    IF (target = ANY (samples())) IS NOT TRUE THEN
        RAISE undefined_table USING MESSAGE = format('%s is no table of samples', coalesce(quote_ident(target), 'NULL'));
    END IF;
    IF has_table_privilege(session_user, target::regclass, 'INSERT') IS NOT TRUE THEN
        RAISE insufficient_privilege USING MESSAGE = format('%s may not write table %I', session_user, target);
    END IF;
    RETURN target::regclass;
END
$$;

-- ---- Triggers -------------------------------------------------------------------------------------------
DO $do$
DECLARE
    target text;
    part regclass;
    more text; -- columns
    guard text;
    follows text;
    told text;
    spread text;
    day date := (now() AT TIME ZONE 'UTC')::date;
    people CONSTANT text[] := ARRAY['setpoint', 'opmode', 'tuning', 'manual'];
    former CONSTANT text[] := ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state'];
BEGIN
    FOREACH target IN ARRAY samples() LOOP
        CONTINUE WHEN target = ANY (former);
        EXECUTE format('CREATE INDEX ON %I USING brin (time) WITH (pages_per_range = 32, autosummarize = on)', target);
        IF target <> 'alarm' THEN
            PERFORM make_partition(target, 'rest');
            EXECUTE format('ALTER TABLE %I ATTACH PARTITION %I DEFAULT', target, target || '_rest');
            PERFORM make_days(target, first, span(target), day) FROM ahead(target, day) AS first;
        END IF;
        EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING COMMENTS INCLUDING STORAGE, previous bigint NOT NULL'
                       ' DEFAULT 0, PRIMARY KEY (id)) WITH (fillfactor = 50)', target || '_newest', target);
        EXECUTE format('COMMENT ON TABLE %I IS %L', target || '_newest',
                       format('The newest row of each variable of table %s. Kept by a trigger.', target));
        EXECUTE format('COMMENT ON COLUMN %I.previous IS %L', target || '_newest',
                       'seq of the newest before it; 0: none.');
    END LOOP;

    -- From here on who writes to version 1's tables waits.
    ALTER TABLE tag DROP CONSTRAINT tag_table_name_check;
    ALTER TABLE tag ADD CONSTRAINT tag_table_name_check CHECK (table_name = ANY (ARRAY[
                        'sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state', 'actual',
                        'estimate', 'alarm', 'tick', 'plan', 'prediction'])),
                    ADD COLUMN number integer GENERATED ALWAYS AS (id * 16 + array_position(ARRAY[
                        'sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state', 'actual',
                        'estimate', 'alarm', 'tick', 'plan', 'prediction'], table_name)) STORED UNIQUE,
                    ADD COLUMN controller text NOT NULL DEFAULT '' CHECK (octet_length(controller) <= 63),
                    ADD COLUMN area text NOT NULL DEFAULT '' CHECK (octet_length(area) <= 127),
                    ADD COLUMN length integer NOT NULL DEFAULT 0 CHECK (length >= 0),
                    ADD COLUMN step double precision NOT NULL DEFAULT 0 CHECK (step BETWEEN 0 AND 1e300),
                    ADD COLUMN period double precision NOT NULL DEFAULT 0 CHECK (period BETWEEN 0 AND 1e300),
                    ADD COLUMN display_low double precision NOT NULL DEFAULT 0 CHECK (abs(display_low) <= 1e300),
                    ADD COLUMN display_high double precision NOT NULL DEFAULT 0 CHECK (abs(display_high) <= 1e300);

    ALTER TABLE event ADD COLUMN number integer, ADD COLUMN seq bigint, ADD COLUMN author bigint,
                      ADD COLUMN class text CHECK (class IN ('operator', 'process', 'chatter')),
                      ADD CONSTRAINT author_is_the_users FOREIGN KEY (author, role) REFERENCES author (number, role)
                      NOT VALID;
    COMMENT ON COLUMN tag.number IS 'Number of the variable over all tables: 16 id + number of the table in the library''s order.';
    COMMENT ON COLUMN tag.controller IS 'Name of the controller that it belongs to; may be empty.';
    COMMENT ON COLUMN tag.area IS 'Where in the plant, a path such as unit1/reactor; may be empty.';
    COMMENT ON COLUMN tag.length IS 'Elements of a vector; 0: a number.';
    COMMENT ON COLUMN tag.step IS 'Seconds from element to element; 0: they are no course in time.';
    COMMENT ON COLUMN tag.period IS 'How often it comes, s; 0: not said.';
    COMMENT ON COLUMN tag.display_low IS 'Lower end of its scale, in the unit; equal to display_high: not said.';
    COMMENT ON COLUMN tag.display_high IS 'Upper end of its scale, in the unit.';
    COMMENT ON COLUMN event.number IS 'tag.number of the variable that it is about; NULL: of none.';
    COMMENT ON COLUMN event.seq IS 'seq of the row that it is about; NULL: of none.';
    COMMENT ON COLUMN event.author IS 'author.number of who did it; NULL: not said.';
    COMMENT ON COLUMN event.class IS 'operator, process, chatter; NULL: not said.';

    FOREACH target IN ARRAY samples() LOOP
        more := CASE WHEN target IN ('tick', 'plan', 'prediction') THEN ''
                     WHEN target = 'actuator' THEN ', sensor_seq, setpoint_seq, origin, author'
                     ELSE ', origin, author' END;
        IF target = ANY (former) THEN
            EXECUTE format('ALTER TABLE %I ADD COLUMN origin bigint, ADD COLUMN author bigint, ADD CONSTRAINT'
                           ' origin_is_seq CHECK (origin BETWEEN 1 AND 9007199254740991) NOT VALID, ADD CONSTRAINT'
                           ' seq_in_range_of_double CHECK (seq < 9007199254740992) NOT VALID', target);
            EXECUTE format('ALTER TABLE %I ADD COLUMN origin bigint, ADD COLUMN author bigint', target || '_newest');
        END IF;
        IF more <> '' THEN
            FOR part IN SELECT oid FROM pg_class WHERE relkind IN ('r', 'p') AND oid IN
                        (SELECT to_regclass(t)::oid FROM unnest(ARRAY[target, target || '_newest']) AS t
                          UNION ALL SELECT inhrelid FROM pg_inherits WHERE inhparent = to_regclass(target))
            LOOP
                EXECUTE format('COMMENT ON COLUMN %s.origin IS %L', part, 'seq of the row that it comes from; NULL: none.');
                EXECUTE format('COMMENT ON COLUMN %s.author IS %L', part, 'author.number of who wrote it; NULL: not said.');
            END LOOP;
        END IF;

        -- As before.
        guard := CASE WHEN (SELECT relkind FROM pg_class WHERE oid = to_regclass(target)) <> 'p' THEN ''
                 ELSE format($guard$
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

        -- Of opmode id 1 is version 1's actual mode, which a controller counts, unless it is a loop's target.
        follows := CASE WHEN target <> ALL (people) THEN '' ELSE format($follows$
    IF NOT owner THEN
        SELECT id, f.seq INTO taken FROM fresh AS f JOIN %1$I AS n USING (id)
         WHERE (f.seq <> n.seq OR f.seq <> n.previous + 1)%3$s LIMIT 1;
        IF FOUND THEN
            RAISE check_violation
            USING MESSAGE = format('%2$s %%s: seq %%s does not follow the newest', taken.id, taken.seq);
        END IF;
    END IF;$follows$, target || '_newest', target,
                       CASE target WHEN 'opmode' THEN ' AND (id <> 1 OR id IN (SELECT loops()))' ELSE '' END) END;

        -- Nobody writes in another's name.
        spread := CASE WHEN more = '' THEN '' ELSE format($spread$
    IF authors > 0 AND NOT owner THEN
        SELECT id, f.author AS number INTO taken FROM fresh AS f
         WHERE f.author IS NOT NULL AND NOT EXISTS
               (SELECT FROM author AS a WHERE a.number = f.author AND a.role = session_user) LIMIT 1;
        IF FOUND THEN
            RAISE insufficient_privilege
            USING MESSAGE = format('%1$s %%s: author %%s is not %%s''s', taken.id, taken.number, session_user);
        END IF;
    END IF;$spread$, target) END;

        -- The target mode of all loops: what is written to id 0 is written to each, unless that has a row of its own.
        spread := spread || CASE target WHEN 'opmode' THEN $spread$
    IF EXISTS (SELECT FROM fresh WHERE id = 0) AND EXISTS (SELECT FROM loops()) THEN
        PERFORM FROM opmode_newest WHERE id IN (SELECT loops()) ORDER BY id FOR UPDATE;
        INSERT INTO opmode (id, seq, time, status, value, origin, author)
        SELECT l, coalesce((SELECT seq FROM opmode_newest WHERE id = l), 0) + 1, f.time, f.status, f.value, f.seq,
               f.author
          FROM loops() AS l, (SELECT * FROM fresh WHERE id = 0 ORDER BY seq DESC LIMIT 1) AS f
         WHERE l NOT IN (SELECT id FROM fresh) ORDER BY l;
    END IF;$spread$ ELSE '' END;

        -- People are waited for, and in version 1's programs everything was.
        told := CASE WHEN target <> ALL (former) THEN '' ELSE $told$
    IF risen > 0 THEN
        PERFORM pg_notify('apc_' || TG_RELID, '');
    END IF;$told$ END;

        -- The trigger's body. No caller turns it: it refuses to run for any table but its own, so that fresh has the
        -- columns and types of that one and not those of a table that somebody made; it executes no dynamic command.
        EXECUTE format($function$
CREATE OR REPLACE FUNCTION %1$I() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path TO %7$I, pg_temp
AS $$
DECLARE
    owner boolean := pg_has_role(session_user, current_user, 'USAGE');
    samples bigint;
    authors bigint := 0;
    highest bigint;
    latest timestamptz;
    most bigint;
    risen bigint; -- variables that have a newer newest
    taken record;
BEGIN
    IF TG_RELID <> '%8$s'::regclass THEN
        RAISE insufficient_privilege USING MESSAGE = '%1$s() is the trigger of table %8$s only';
    END IF;
    SELECT count(*), max(seq), max(time)%9$s INTO samples, highest, latest%10$s FROM fresh;

    -- A seq counts samples. No count is ahead of one that began in 2020 and went on 2^20 times a second; so whatever
    -- was written, there is always room for the next one. (The first bound is for a server without the date.)
    IF highest > 1099511627776 THEN
        most := CASE WHEN owner THEN 9007199254740991
                ELSE least(9007199254740991, greatest(1099511627776,
                           1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint)) END;
        IF highest > most THEN
            RAISE check_violation
            USING MESSAGE = format('%8$s: seq %%s breaks seq_in_range: expected at most %%s', highest, most);
        END IF;
    END IF;
    -- Clocks may be wrong by hours, this server's by any time while the samples go on as they did. Old times are
    -- those of a spool.
    IF latest > now() + interval '1 day' AND NOT owner THEN
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
    GET DIAGNOSTICS risen = ROW_COUNT;%5$s%6$s%11$s%12$s
    RETURN NULL;
END
$$ $function$, target || '_appended', target || '_newest', more, replace(more, ', ', ', excluded.'), guard, follows,
                       current_schema(), target, CASE more WHEN '' THEN '' ELSE ', count(author)' END,
                       CASE more WHEN '' THEN '' ELSE ', authors' END, spread, told);
        EXECUTE format('REVOKE ALL ON FUNCTION %I() FROM PUBLIC', target || '_appended');
        IF target <> ALL (former) THEN
            EXECUTE format('CREATE TRIGGER appended AFTER INSERT ON %I REFERENCING NEW TABLE AS fresh'
                           ' EXECUTE FUNCTION %I()', target, target || '_appended');
        END IF;

        -- Who writes what people write holds the variable's row of newest values from before his first row on: so an
        -- open transaction, also one in the middle of a COPY, shows there (vacant()). And a person is named.
        -- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not
        -- PUBLIC's; it executes no dynamic command.
        IF target = ANY (people) THEN
            EXECUTE format($function$
CREATE FUNCTION %1$I() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path TO %3$I, pg_temp AS $$
BEGIN
    IF TG_TABLE_SCHEMA <> '%3$s' OR TG_TABLE_NAME !~ '^%4$s(_rest|_[0-9]{8})?$' THEN
        RAISE insufficient_privilege USING MESSAGE = '%1$s() is the trigger of table %4$s only';
    END IF;
    PERFORM FROM %2$I WHERE id = NEW.id FOR UPDATE;
    IF NOT FOUND THEN
        INSERT INTO %2$I (id, seq, time, status, value) VALUES (NEW.id, 0, '-infinity', 2157641728, 0)
            ON CONFLICT DO NOTHING;
    END IF;
    IF NEW.author IS NULL AND is_person() THEN
        NEW.author := number_of(session_user);
    END IF;
    RETURN NEW;
END
$$ $function$, target || '_held', target || '_newest', current_schema(), target);
            EXECUTE format('REVOKE ALL ON FUNCTION %I() FROM PUBLIC', target || '_held');
            EXECUTE format('CREATE TRIGGER held BEFORE INSERT ON %I FOR EACH ROW EXECUTE FUNCTION %I()', target,
                           target || '_held');
        END IF;
    END LOOP;
END
$do$;

-- With the rights of the functions and triggers here, which alone may call them.
CREATE FUNCTION is_person() RETURNS boolean LANGUAGE plpgsql STABLE AS $$ -- not sql, which plans it at each call
BEGIN
    RETURN NOT pg_has_role(session_user, current_user, 'USAGE')
       AND coalesce(pg_has_role(session_user, to_regrole('apc_operator'), 'MEMBER')
                    OR pg_has_role(session_user, to_regrole('apc_engineer'), 'MEMBER'), false)
       AND NOT coalesce(pg_has_role(session_user, to_regrole('apc_controller'), 'MEMBER')
                        OR pg_has_role(session_user, to_regrole('apc_scheduler'), 'MEMBER')
                        OR pg_has_role(session_user, to_regrole('apc_historian'), 'MEMBER'), false);
END
$$;
COMMENT ON FUNCTION is_person() IS 'Does the session''s user operate, and is no program that writes setpoints by itself?';

CREATE FUNCTION number_of(said text) RETURNS bigint LANGUAGE plpgsql AS $$
DECLARE
    found_number bigint;
BEGIN
    LOOP
        SELECT number INTO found_number FROM author WHERE name = said AND role = session_user;
        EXIT WHEN FOUND;
        INSERT INTO author (name, role) VALUES (said, session_user) ON CONFLICT DO NOTHING;
    END LOOP;
    RETURN found_number;
END
$$;
COMMENT ON FUNCTION number_of(text) IS 'The number of that name of the session''s user; it is kept when it is new.';

DO $do$
DECLARE
    target text;
BEGIN
    -- With its caller's rights, as a policy of opmode asks it; the search_path is not his.
    EXECUTE format($function$
CREATE FUNCTION loops() RETURNS SETOF integer LANGUAGE sql STABLE SET search_path TO %1$I, pg_temp AS $$
    SELECT id FROM tag WHERE table_name = 'opmode' AND id BETWEEN 1 AND 65535 AND controller <> ''
$$ $function$, current_schema());
    COMMENT ON FUNCTION loops() IS 'Numbers of the loops: what of opmode has a tag that names its controller.';

    -- No caller turns it: it executes no dynamic command, and the name that it keeps is his own user's.
    EXECUTE format($function$
CREATE FUNCTION author_number(said text) RETURNS bigint LANGUAGE sql VOLATILE SECURITY DEFINER
    SET search_path TO %1$I, pg_temp AS $$ SELECT number_of(said) $$ $function$, current_schema());
    COMMENT ON FUNCTION author_number(text) IS 'What stands in column author for somebody whom this user speaks for.';

    -- Compare and set. The rows of newest values that are still what the caller knows, or whatever they are where he
    -- gives a negative seq, become his until his transaction ends. Those that another transaction holds count as
    -- changed: a tick neither waits for a person's open transaction nor fails by it. A variable that has no row yet gets one
    -- of seq 0 to hold; only for that it may have to wait, shortly.
    -- No caller turns it: it executes no dynamic command, and asks first whether he may write the table. Of opmode a
    -- person holds no row that is a controller's.
    FOREACH target IN ARRAY ARRAY['setpoint', 'opmode', 'tuning', 'manual'] LOOP
        EXECUTE format($function$
CREATE FUNCTION %1$I(ids integer[], seqs bigint[]) RETURNS TABLE (i bigint, next bigint)
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %3$I, pg_temp SET lock_timeout TO '20ms' AS $$
DECLARE
    missing integer;
BEGIN
    PERFORM writable('%4$s');
    IF (SELECT min(s) FROM unnest(seqs) AS s) <= 0 THEN
        FOR missing IN SELECT v FROM unnest(ids) AS v WHERE NOT EXISTS (SELECT FROM %2$I WHERE id = v)%5$s
                        ORDER BY v LOOP
            BEGIN
                INSERT INTO %2$I (id, seq, time, status, value) VALUES (missing, 0, '-infinity', 2157641728, 0)
                    ON CONFLICT DO NOTHING;
            EXCEPTION WHEN lock_not_available THEN
                NULL; -- somebody is writing the first one
            END;
        END LOOP;
    END IF;
    RETURN QUERY SELECT v.i, n.seq + 1
                   FROM unnest(ids, seqs) WITH ORDINALITY AS v (id, seq, i) CROSS JOIN LATERAL
                        (SELECT o.seq FROM %2$I AS o WHERE o.id = v.id FOR UPDATE SKIP LOCKED) AS n
                  WHERE (n.seq = v.seq OR v.seq < 0)%6$s;
END
$$ $function$, target || '_vacant', target || '_newest', current_schema(), target,
                       CASE target WHEN 'opmode' THEN ' AND (v <> 1 OR NOT is_person() OR v IN (SELECT loops()))' ELSE '' END,
                       CASE target WHEN 'opmode' THEN ' AND (v.id <> 1 OR NOT is_person() OR v.id IN (SELECT loops()))' ELSE '' END);
        EXECUTE format('COMMENT ON FUNCTION %I(integer[], bigint[]) IS %L', target || '_vacant',
                       'Hold those of these variables whose newest seq it is and that nobody else holds: position, next seq.');
        EXECUTE format('REVOKE ALL ON FUNCTION %I(integer[], bigint[]) FROM PUBLIC', target || '_vacant');
    END LOOP;

    -- What a person writes to a setpoint that another controller moves makes it his: the loop's target becomes Auto,
    -- when the transaction ends, so that programs may have done it themselves. dim says which setpoint is a loop's.
    -- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not PUBLIC's; it
    -- executes no dynamic command.
    EXECUTE format($function$
CREATE FUNCTION setpoint_local() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER
    SET search_path TO %1$I, pg_temp AS $$
DECLARE
    moved integer; -- the loop
    known bigint;
    mode double precision;
BEGIN
    IF TG_TABLE_SCHEMA <> '%1$s' OR TG_TABLE_NAME !~ '^setpoint(_rest|_[0-9]{8})?$' THEN
        RAISE insufficient_privilege USING MESSAGE = 'setpoint_local() is the trigger of table setpoint only';
    END IF;
    IF NOT is_person() THEN
        RETURN NULL;
    END IF;
    FOR moved IN SELECT l FROM loops() AS l JOIN dim_newest AS d ON d.id = 3 + 2 * l WHERE d.value = NEW.id LOOP
        SELECT seq, value INTO known, mode FROM opmode_newest WHERE id = moved FOR UPDATE;
        IF mode = 3 THEN
            INSERT INTO opmode (id, seq, time, status, value, origin, author)
            VALUES (moved, known + 1, now(), 0, 1, NEW.seq, NEW.author);
            INSERT INTO event (time, severity, source, kind, text, number, seq, author, class)
            SELECT now(), 1, (SELECT s FROM unnest(ARRAY[a.name, session_user, 'operator']) AS s
                            WHERE octet_length(s) <= 31 LIMIT 1), 'mode',
                   coalesce(t.name, 'setpoint ' || NEW.id) || ' taken Local, cascade open', t.number, NEW.seq,
                   NEW.author, 'operator'
              FROM (VALUES (NEW.author)) AS v (number) LEFT JOIN author AS a USING (number)
              LEFT JOIN tag AS t ON t.table_name = 'setpoint' AND t.id = NEW.id;
        END IF;
    END LOOP;
    RETURN NULL;
END
$$ $function$, current_schema());

    -- No caller turns it: of each target nothing is used before writable() has found it; ids and texts are executed
    -- nowhere. pid and start of the session are the server's own word.
    EXECUTE format($function$
CREATE FUNCTION claim_set(targets text[], ids integer[], OUT at bigint, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    target text;
    began timestamptz := (SELECT backend_start FROM pg_stat_activity WHERE pid = pg_backend_pid());
    newest bigint[];
BEGIN
    IF cardinality(targets) <> cardinality(ids) OR array_position(ids, NULL) IS NOT NULL THEN
        RAISE invalid_parameter_value USING MESSAGE = 'a table and an id for each variable';
    END IF;
    FOR target IN SELECT DISTINCT t FROM unnest(targets) AS t ORDER BY t LOOP
        PERFORM pg_advisory_xact_lock(6385762, writable(target)::integer); -- one claims at a time
    END LOOP;
    -- Programs of version 1 claim a whole table.
    SELECT v.i, claimant(l.pid) INTO at, holder
      FROM unnest(targets) WITH ORDINALITY AS v (name, i)
      JOIN pg_locks AS l ON l.objid = v.name::regclass
     WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 6385763 AND l.objsubid = 2
       AND l.pid <> pg_backend_pid() AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
     ORDER BY v.i LIMIT 1;
    IF FOUND THEN
        RETURN;
    END IF;
    DELETE FROM claim WHERE pid = pg_backend_pid() AND started <> began;
    DELETE FROM claim AS c USING unnest(targets, ids) AS v (table_name, id)
     WHERE c.table_name = v.table_name AND c.id = v.id AND NOT is_claimant(c.pid);
    SELECT v.i, c.name INTO at, holder
      FROM unnest(targets, ids) WITH ORDINALITY AS v (table_name, id, i) JOIN claim AS c USING (table_name, id)
     WHERE c.pid <> pg_backend_pid() ORDER BY v.i LIMIT 1;
    IF FOUND THEN
        RETURN;
    END IF;
    IF NOT is_claimant(pg_backend_pid()) THEN
        PERFORM pg_advisory_lock('claim'::regclass::integer, pg_backend_pid());
    END IF;
    INSERT INTO claim SELECT DISTINCT table_name, id, claimant(pg_backend_pid()), pg_backend_pid(), began
                        FROM unnest(targets, ids) AS v (table_name, id)
        ON CONFLICT DO NOTHING; -- it is ours already
    -- After the locks: what a former writer committed is seen.
    last := array_fill(0::bigint, ARRAY[cardinality(ids)]);
    FOR target IN SELECT DISTINCT t FROM unnest(targets) AS t LOOP
        EXECUTE format('SELECT array_agg(CASE WHEN v.name = $1 THEN coalesce(n.seq, 0) ELSE v.last END ORDER BY v.i)'
                       ' FROM unnest($2, $3, $4) WITH ORDINALITY AS v (name, id, last, i)'
                       ' LEFT JOIN %%I AS n ON n.id = v.id', target || '_newest')
           INTO newest USING target, targets, ids, last;
        last := newest;
    END LOOP;
END
$$ $function$, current_schema());
    COMMENT ON FUNCTION claim_set(text[], integer[]) IS
        'Become the one writer of these variables, all or none, for as long as this session lives. holder: NULL, or who has the one at that place; last: newest seq of each.';

    -- No caller turns it: it executes no dynamic command, and takes away only what is this session's.
    EXECUTE format($function$
CREATE FUNCTION claim_release(targets text[], ids integer[]) RETURNS bigint
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    released bigint;
BEGIN
    DELETE FROM claim AS c USING unnest(targets, ids) AS v (table_name, id)
     WHERE c.table_name = v.table_name AND c.id = v.id AND c.pid = pg_backend_pid() AND is_claimant(pg_backend_pid());
    GET DIAGNOSTICS released = ROW_COUNT;
    RETURN released;
END
$$ $function$, current_schema());
    COMMENT ON FUNCTION claim_release(text[], integer[]) IS 'Give up being the one writer of these variables; how many there were.';

    -- As before; and nobody has a variable of it.
    EXECUTE format($function$
CREATE OR REPLACE FUNCTION claim(target text, n integer, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    target_oid oid := writable(target);
BEGIN
    IF (n BETWEEN 0 AND 1048576) IS NOT TRUE THEN
        RAISE invalid_parameter_value USING MESSAGE = format('%%s variables: expected 0 to 1048576', n);
    END IF;
    PERFORM pg_advisory_xact_lock(6385762, target_oid::integer);
    SELECT c.name INTO holder FROM claim AS c
     WHERE c.table_name = target AND c.pid <> pg_backend_pid() AND is_claimant(c.pid) LIMIT 1;
    IF FOUND THEN
        RETURN;
    END IF;
    IF NOT pg_try_advisory_lock(6385763, target_oid::integer) THEN -- 6385763: "apc"
        SELECT claimant(l.pid) INTO holder
          FROM pg_locks l
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

CREATE CONSTRAINT TRIGGER local AFTER INSERT ON setpoint DEFERRABLE INITIALLY DEFERRED
    FOR EACH ROW EXECUTE FUNCTION setpoint_local();

CREATE FUNCTION is_claimant(pid integer) RETURNS boolean LANGUAGE sql STABLE AS $$
    SELECT EXISTS (SELECT FROM pg_locks AS l
                    WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 'claim'::regclass
                      AND l.objid = is_claimant.pid::oid AND l.objsubid = 2
                      AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database()))
$$;
COMMENT ON FUNCTION is_claimant(integer) IS 'Does the session of that server process hold claims by set?';

CREATE FUNCTION claimant(pid integer) RETURNS text LANGUAGE sql STABLE AS $$
    SELECT coalesce((SELECT format('%s (server process %s, %s)', coalesce(nullif(a.application_name, ''), a.usename),
                                   a.pid, coalesce('client ' || host(a.client_addr), 'local client'))
                       FROM pg_stat_activity AS a WHERE a.pid = claimant.pid), 'a writer that has just left')
$$;
COMMENT ON FUNCTION claimant(integer) IS 'Who that server process works for, in words.';

CREATE FUNCTION request_made() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_notify('apc_' || TG_RELID, '');
    RETURN NULL;
END
$$;
CREATE TRIGGER made AFTER INSERT ON request EXECUTE FUNCTION request_made();

REVOKE ALL ON FUNCTION samples(), loops(), is_person(), number_of(text), author_number(text), setpoint_local(),
    claim_set(text[], integer[]), claim_release(text[], integer[]), is_claimant(integer), claimant(integer),
    request_made(), make_days(text, date, integer, date), span(text), ahead(text, date) FROM PUBLIC;
REVOKE ALL ON PROCEDURE maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint, timestamptz) FROM PUBLIC;

INSERT INTO migration (version, name, compatible_from) VALUES (3, '0003-rows', 1);
