-- SPDX-License-Identifier: BSD-3-Clause
-- Version 1: the tables of one plant. Run by `apc init` (apc_store_init) in one transaction, with the plant's schema first
-- in the search_path. No name here is qualified, so every plant's schema is made alike.

-- Whose rights. Some functions run with the owner's rights (SECURITY DEFINER). Whoever makes one of them look at an object
-- of his own (a table, a view, a type with a cast, a function in pg_temp) has his code run by the owner. So for each:
-- * Its search_path is the plant's schema, in which only the owner makes anything, and then pg_temp. It is set here, and
--   not taken from the session that runs this file.
-- * A table's name is one of samples() before it becomes part of a command: writable().
-- * The arguments are of built-in types, for which nobody but a superuser makes casts or operators.
-- * A trigger's function refuses to run for any table but its own, so that the rows have the columns and types of that one
--   and not those of a table that somebody made.
-- * PUBLIC, which may execute every new function, may not execute these.
-- All other functions run with their caller's rights. The names in their commands are quoted by format(%I), and come from
-- the plant's schema: the words of samples(), and partitions of theirs, which only their owner can attach.
SELECT set_config('search_path', format('%I, pg_temp', current_schema()), true);

-- ---- Versions and repairs -------------------------------------------------------------------------------
CREATE TABLE migration (
    version         integer PRIMARY KEY CHECK (version > 0),
    name            text NOT NULL,
    applied_at      timestamptz NOT NULL DEFAULT now(),
    compatible_from integer CONSTRAINT compatible_from_not_above CHECK (compatible_from BETWEEN 1 AND version)
);
COMMENT ON TABLE migration IS 'Which files of sql/ were applied. Written by apc init; read by every connection.';
COMMENT ON COLUMN migration.version IS 'Number of the file.';
COMMENT ON COLUMN migration.name IS 'Name of the file, without .sql.';
COMMENT ON COLUMN migration.applied_at IS 'When it was applied, UTC.';
COMMENT ON COLUMN migration.compatible_from IS 'Oldest version whose programs can use the schema; NULL: this version.';

CREATE TABLE repair (
    name       text PRIMARY KEY,
    applied_at timestamptz NOT NULL DEFAULT now()
);
COMMENT ON TABLE repair IS 'Which repairs (sql/NNNN-repair-*.sql) were applied. A repair does not change the version.';
COMMENT ON COLUMN repair.name IS 'Name of the file, without .sql.';
COMMENT ON COLUMN repair.applied_at IS 'When it was applied, UTC.';

-- ---- Tables of rows -------------------------------------------------------------------------------------
-- One table, one kind of variable. (id, seq) is the key; "newest" is the highest seq, never the latest time,
-- because clocks step. Rows are only ever inserted.
--
-- The tables that grow with every tick are partitioned by time, a week or a day each, so that old ones can be dropped
-- whole (procedure maintain). What lies in none, because nobody made it ahead or a clock is wrong, goes to the
-- partition _rest: no row is ever refused for its partition. A key over all partitions would have to contain the
-- time, so each has its own, and the trigger below sees to the rest.
--
-- The newest rows are kept in a table of their own beside each (_newest), by a trigger, so that reading them
-- costs the same however long the history is and whatever of it was dropped; docs/rationale.md has the figures.
--
-- History over a time range has a BRIN index: rows come in the order of time, so a few bytes for each 32 pages
-- tell which pages to look at.
CREATE FUNCTION samples() RETURNS text[] LANGUAGE sql IMMUTABLE AS $$
    SELECT ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'actual', 'estimate', 'alarm',
                 'tick', 'plan', 'prediction']
$$;
COMMENT ON FUNCTION samples() IS
    'The tables of rows (id, seq), in the order of enum apc_table. No other name becomes part of a command.';

CREATE TABLE sensor (
    id     integer NOT NULL,
    seq    bigint NOT NULL,
    time   timestamptz NOT NULL,
    status bigint NOT NULL,
    value  double precision NOT NULL,
    origin bigint,
    author bigint,
    CONSTRAINT id_not_negative CHECK (id >= 0),
    CONSTRAINT seq_in_range CHECK (seq BETWEEN 1 AND 9007199254740991), -- below 2^53
    CONSTRAINT status_is_code CHECK (status BETWEEN 0 AND 4294967295),
    -- Also keeps NaN and the infinities out: for PostgreSQL NaN is greater than any number.
    CONSTRAINT value_finite CHECK (abs(value) < 1e300::double precision),
    CONSTRAINT origin_is_seq CHECK (origin BETWEEN 1 AND 9007199254740991)
) PARTITION BY RANGE (time);
COMMENT ON COLUMN sensor.id IS 'Number of the variable: 1..n is a row of the vector, 0 a scalar.';
COMMENT ON COLUMN sensor.seq IS 'Number of the row of its variable, from 1; each new row has the next one, also after a restart.';
COMMENT ON COLUMN sensor.time IS 'Source time, UTC: when the value was measured or calculated. May step with the clock.';
COMMENT ON COLUMN sensor.status IS 'OPC UA StatusCode: 0 is Good; the top two of 32 bits tell Good, Uncertain and Bad.';
COMMENT ON COLUMN sensor.value IS 'In the unit of table tag; magnitude below 1e300.';
COMMENT ON COLUMN sensor.origin IS 'seq of the row that this row answers; NULL: none.';
COMMENT ON COLUMN sensor.author IS 'author.number of the author; NULL: not known.';

CREATE TABLE actuator (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
ALTER TABLE actuator ADD COLUMN sensor_seq bigint CONSTRAINT sensor_seq_positive CHECK (sensor_seq > 0),
                     ADD COLUMN setpoint_seq bigint CONSTRAINT setpoint_seq_positive CHECK (setpoint_seq > 0);
CREATE TABLE setpoint (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE tuning (LIKE sensor INCLUDING ALL, PRIMARY KEY (id, seq));
CREATE TABLE manual (LIKE sensor INCLUDING ALL, PRIMARY KEY (id, seq));
CREATE TABLE dim (LIKE tuning INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));
CREATE TABLE opmode (LIKE tuning INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));

CREATE TABLE actual (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE estimate (LIKE sensor INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE alarm (LIKE dim INCLUDING ALL);

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
COMMENT ON COLUMN tick.id IS 'Number of the variable: 1..n.';
COMMENT ON COLUMN tick.seq IS 'Number of the row of its variable, from 1; each new row has the next one, also after a restart.';
COMMENT ON COLUMN tick.time IS 'Source time, UTC. May step with the clock.';
COMMENT ON COLUMN tick.status IS 'OPC UA StatusCode: 0 is Good; the top two of 32 bits tell Good, Uncertain and Bad.';
COMMENT ON COLUMN tick.value IS 'In the unit of table tag; magnitude below 1e300.';
CREATE TABLE plan (LIKE tick INCLUDING ALL) PARTITION BY RANGE (time);
CREATE TABLE prediction (LIKE tick INCLUDING ALL) PARTITION BY RANGE (time);

COMMENT ON COLUMN actuator.sensor_seq IS 'Not written any more. In old rows: seq of the measurement that the output was calculated from.';
COMMENT ON COLUMN actuator.setpoint_seq IS 'Not written any more. In old rows: seq of the setpoint that the output was calculated from.';
COMMENT ON COLUMN actuator.origin IS 'seq of the tick row that the output was calculated in; NULL: none.';
COMMENT ON COLUMN actual.id IS 'tag.number of the variable that was written.';
COMMENT ON COLUMN plan.id IS 'Number of the setpoint.';

COMMENT ON TABLE sensor IS 'Measurements and calculated signals, y. Written by apc-client and apc-controller.';
COMMENT ON TABLE actuator IS 'Outputs, u. Written by apc-controller.';
COMMENT ON TABLE setpoint IS 'Setpoints, z. Written by apc-scheduler, upper controllers and operators.';
COMMENT ON TABLE dim IS 'Ids 1..3: number of measurements, setpoints, outputs. Written by apc init.';
COMMENT ON TABLE opmode IS
    'Target modes, and switches of setpoints and alarms. Written by operators. Ids 1 to 65535: target mode of that loop, 0 Man, 1 Auto, 2 OOS, 3 Cas; id 0: of all loops. From 65536 on: kind x 65536 + tag.number.';
COMMENT ON TABLE tuning IS 'Tuning parameters of the laws. Written by operators.';
COMMENT ON TABLE manual IS 'Outputs of loops in Man. Written by operators.';
COMMENT ON TABLE actual IS
    'Outcome of writes: the value in force of the variable whose tag.number is id. Good: applied; Bad: refused; Uncertain: pending.';
COMMENT ON TABLE estimate IS 'Estimates of laws, and shadow outputs. Written by apc-controller.';
COMMENT ON TABLE alarm IS 'State of each alarm (ISA-18.2). Written by apc-alarms.';
COMMENT ON TABLE tick IS
    'One row a tick of a controller: its inputs, and its state for the next tick. Layout: catalogue. Kept for a day.';
COMMENT ON TABLE plan IS
    'Future setpoints: pairs of seconds after time, and value. Written by apc-scheduler and upper controllers.';
COMMENT ON TABLE prediction IS 'Predictions of laws over their horizon. Written by apc-controller. Kept for a day.';

-- ---- Partitions -----------------------------------------------------------------------------------------
CREATE FUNCTION make_partition(target text, suffix text) RETURNS void LANGUAGE plpgsql AS $$
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
COMMENT ON FUNCTION make_partition(text, text) IS 'A table that can become a partition of target.';

-- Rows of these days that were stored elsewhere meanwhile move to the partition. One that has begun and has rows
-- elsewhere is left there: to move many would keep writers waiting. Other styles of dates write a zone by its
-- abbreviation, which may be read as another one's.
CREATE FUNCTION make_days(target text, first date, days integer, today date) RETURNS void LANGUAGE plpgsql
    SET DateStyle TO 'ISO, YMD' AS $$
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
COMMENT ON FUNCTION make_days(text, date, integer, date) IS
    'Make the partition of that many days, unless it is there.';

CREATE FUNCTION make_week(target text, monday date, today date) RETURNS void LANGUAGE sql AS $$
    SELECT make_days(target, monday, 7, today)
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

CREATE FUNCTION span(target text) RETURNS integer LANGUAGE sql IMMUTABLE AS $$
    SELECT CASE WHEN target IN ('tick', 'prediction') THEN 1 ELSE 7 END
$$;
COMMENT ON FUNCTION span(text) IS 'Days that a partition of a table covers.';

CREATE FUNCTION ahead(target text, today date) RETURNS SETOF date LANGUAGE sql STABLE AS $$
    SELECT CASE span(target) WHEN 1 THEN today + i ELSE date_trunc('week', today::timestamp)::date + 7 * i END
      FROM generate_series(0, CASE span(target) WHEN 1 THEN 7 ELSE 4 END) AS i
$$;
COMMENT ON FUNCTION ahead(text, date) IS 'First days of the present and the next partitions.';

-- ---- Descriptions, events, timing -----------------------------------------------------------------------
CREATE TABLE tag (
    table_name   text NOT NULL CHECK (table_name = ANY (ARRAY[
                     'sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state', 'actual',
                     'estimate', 'alarm', 'tick', 'plan', 'prediction'])),
    id           integer NOT NULL CHECK (id >= 0),
    name         text NOT NULL CHECK (octet_length(name) BETWEEN 1 AND 63),
    unit         text NOT NULL DEFAULT '' CHECK (octet_length(unit) <= 63),
    description  text NOT NULL DEFAULT '' CHECK (octet_length(description) <= 127),
    low          double precision NOT NULL DEFAULT -1e300 CHECK (abs(low) <= 1e300::double precision),
    high         double precision NOT NULL DEFAULT 1e300 CHECK (abs(high) <= 1e300::double precision),
    number       integer GENERATED ALWAYS AS (id * 16 + array_position(ARRAY[
                     'sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state', 'actual',
                     'estimate', 'alarm', 'tick', 'plan', 'prediction'], table_name)) STORED UNIQUE,
    controller   text NOT NULL DEFAULT '' CHECK (octet_length(controller) <= 63),
    area         text NOT NULL DEFAULT '' CHECK (octet_length(area) <= 127),
    length       integer NOT NULL DEFAULT 0 CHECK (length >= 0),
    step         double precision NOT NULL DEFAULT 0 CHECK (step BETWEEN 0 AND 1e300),
    period       double precision NOT NULL DEFAULT 0 CHECK (period BETWEEN 0 AND 1e300),
    display_low  double precision NOT NULL DEFAULT 0 CHECK (abs(display_low) <= 1e300),
    display_high double precision NOT NULL DEFAULT 0 CHECK (abs(display_high) <= 1e300),
    PRIMARY KEY (table_name, id),
    UNIQUE (table_name, name) DEFERRABLE INITIALLY DEFERRED, -- names may change places
    CONSTRAINT low_not_above_high CHECK (low <= high)
);
COMMENT ON TABLE tag IS 'Name, unit and limits of each variable. Replaced as a whole by the owner: apc init.';
COMMENT ON COLUMN tag.table_name IS 'Table of the variable.';
COMMENT ON COLUMN tag.id IS 'Number of the variable in that table.';
COMMENT ON COLUMN tag.name IS 'Name, unique in its table, at most 63 bytes.';
COMMENT ON COLUMN tag.unit IS 'Engineering unit of value; may be empty.';
COMMENT ON COLUMN tag.description IS 'Description of the variable; may be empty.';
COMMENT ON COLUMN tag.low IS 'Low limit, in the unit; -1e300: none.';
COMMENT ON COLUMN tag.high IS 'High limit, in the unit; 1e300: none.';
COMMENT ON COLUMN tag.number IS
    'Number of the variable over all tables: 16 id + number of the table (enum apc_table).';
COMMENT ON COLUMN tag.controller IS 'Controller of the variable; may be empty.';
COMMENT ON COLUMN tag.area IS 'Area of the plant, a path such as unit1/reactor; may be empty.';
COMMENT ON COLUMN tag.length IS 'Elements of a vector; 0: a number.';
COMMENT ON COLUMN tag.step IS 'Seconds from element to element; 0: the elements are no series in time.';
COMMENT ON COLUMN tag.period IS 'Period of the variable, s; 0: not known.';
COMMENT ON COLUMN tag.display_low IS 'Low end of the scale, in the unit; equal to display_high: no scale.';
COMMENT ON COLUMN tag.display_high IS 'High end of the scale, in the unit.';

CREATE TABLE author (
    number bigint GENERATED ALWAYS AS IDENTITY (MAXVALUE 2147483647) PRIMARY KEY,
    name   text NOT NULL CHECK (octet_length(name) BETWEEN 1 AND 63),
    role   name NOT NULL,
    UNIQUE (name, role),
    UNIQUE (number, role)
);
COMMENT ON TABLE author IS 'Authors of what people write. Written by author_number().';
COMMENT ON COLUMN author.number IS 'Number that column author of a row has.';
COMMENT ON COLUMN author.name IS
    'Name given by the program, which may serve many people; in rows written by SQL the database user.';
COMMENT ON COLUMN author.role IS 'The database user who wrote under this name; no other user may.';

CREATE TABLE event (
    id       bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    time     timestamptz NOT NULL,
    severity smallint NOT NULL CHECK (severity BETWEEN 1 AND 3),
    source   text NOT NULL CHECK (octet_length(source) <= 31),
    kind     text NOT NULL CHECK (octet_length(kind) <= 31),
    text     text NOT NULL CHECK (octet_length(text) <= 191),
    role     name NOT NULL DEFAULT session_user, -- nobody is granted INSERT on it
    number   integer,
    seq      bigint,
    author   bigint,
    class    text CHECK (class IN ('operator', 'process', 'chatter')),
    CONSTRAINT author_is_the_users FOREIGN KEY (author, role) REFERENCES author (number, role)
);
CREATE INDEX ON event (time);
COMMENT ON TABLE event IS 'Events: operator actions, mode changes, lost links. Written by every program.';
COMMENT ON COLUMN event.id IS 'Order of arrival.';
COMMENT ON COLUMN event.time IS 'When it happened, UTC.';
COMMENT ON COLUMN event.severity IS '1 information, 2 warning, 3 alarm.';
COMMENT ON COLUMN event.source IS 'The program, or the operator''s name.';
COMMENT ON COLUMN event.kind IS 'start, stop, mode, operator, link, store, measurement, rejected, watchdog, overrun, clock.';
COMMENT ON COLUMN event.text IS 'The message, one line.';
COMMENT ON COLUMN event.role IS 'The database user who wrote the row; source is only what the program says.';
COMMENT ON COLUMN event.number IS 'tag.number of the variable; NULL: none.';
COMMENT ON COLUMN event.seq IS 'seq of the row; NULL: none.';
COMMENT ON COLUMN event.author IS 'author.number of the author; NULL: not known.';
COMMENT ON COLUMN event.class IS 'operator, process, chatter; NULL: not known.';

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
    role      name DEFAULT session_user, -- nobody is granted INSERT on it
    CONSTRAINT bins_match CHECK (cardinality(bin_low) = cardinality(bin_high)
                                 AND cardinality(bin_low) = cardinality(bin_count))
);
CREATE INDEX ON timing (time);
COMMENT ON TABLE timing IS 'Histograms of the tasks'' timing, one row a window. Written by every program with a task.';
COMMENT ON COLUMN timing.id IS 'Order of arrival.';
COMMENT ON COLUMN timing.time IS 'End of the window, UTC.';
COMMENT ON COLUMN timing.task IS 'Name of the task.';
COMMENT ON COLUMN timing.quantity IS
    'lateness: start after the planned time; jitter: start to start minus the period; run: start to end.';
COMMENT ON COLUMN timing.period IS 'Period of the task, ns.';
COMMENT ON COLUMN timing.missed IS 'Ticks missed in the window.';
COMMENT ON COLUMN timing.count IS 'Ticks in the window.';
COMMENT ON COLUMN timing.mean IS 'Mean, ns.';
COMMENT ON COLUMN timing.sd IS 'Standard deviation, ns.';
COMMENT ON COLUMN timing.p50 IS 'Median, ns.';
COMMENT ON COLUMN timing.p99 IS '99th percentile, ns.';
COMMENT ON COLUMN timing.max IS 'Largest, ns.';
COMMENT ON COLUMN timing.bin_low IS 'Low edges of the bins that are not empty, ns.';
COMMENT ON COLUMN timing.bin_high IS 'High edges of these bins, ns.';
COMMENT ON COLUMN timing.bin_count IS 'Ticks in each of these bins.';
COMMENT ON COLUMN timing.role IS
    'The database user who wrote the row; task is only what the program says. NULL: an older row.';

-- ---- What the plant is, and what people ask for ---------------------------------------------------------
CREATE TABLE catalogue (
    revision bigint PRIMARY KEY CHECK (revision > 0),
    time     timestamptz NOT NULL DEFAULT now(),
    kind     text NOT NULL CHECK (kind IN ('live', 'history')),
    text     text NOT NULL
);
COMMENT ON TABLE catalogue IS
    'The plant: signals, controllers, loops, layout of vectors. The highest revision is in force. Written by the owner: apc init.';
COMMENT ON COLUMN catalogue.revision IS 'Counts from 1.';
COMMENT ON COLUMN catalogue.time IS 'Start of this revision, UTC.';
COMMENT ON COLUMN catalogue.kind IS
    'live: the live store of the modules. history: written by a historian; people write to table request.';
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
COMMENT ON TABLE request IS
    'Requests of people for writes, in a history: a historian writes each to the live store, once.';
COMMENT ON COLUMN request.id IS 'Order of arrival.';
COMMENT ON COLUMN request.time IS 'When the write was requested, UTC.';
COMMENT ON COLUMN request.until IS 'The request expires then, UTC.';
COMMENT ON COLUMN request.table_name IS 'Table of the variable.';
COMMENT ON COLUMN request.variable IS 'Number of the variable in that table.';
COMMENT ON COLUMN request.value IS 'The value to write.';
COMMENT ON COLUMN request.author IS 'The author, as the program says.';
COMMENT ON COLUMN request.reason IS 'Reason for the write; may be empty.';
COMMENT ON COLUMN request.role IS 'The database user who wrote the row.';
COMMENT ON COLUMN request.seq IS
    'seq of the row in the live store; 0: there is none; NULL: pending. Written by the historian.';
COMMENT ON COLUMN request.outcome IS 'Outcome of the write, in words. Written by the historian.';

CREATE FUNCTION request_made() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_notify('apc_' || TG_RELID, '');
    RETURN NULL;
END
$$;
CREATE TRIGGER made AFTER INSERT ON request EXECUTE FUNCTION request_made();

-- ---- Too far ahead ----------------------------------------------------------------------------------------
-- As for rows of samples: more than a day ahead of this server's clock and, as that may be the wrong one, of the newest
-- measurement. A row is looked at closer only where it can be.
-- No caller turns it: it is the trigger of three tables of this schema; it executes no dynamic command.
CREATE FUNCTION refuse_ahead() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
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
        USING MESSAGE = format('%s: time %s is more than a day ahead of this server''s: %s', TG_TABLE_NAME, NEW.time,
                               now());
    END IF;
    IF TG_TABLE_NAME = 'event' THEN
        IF NEW.seq > bound THEN
            RAISE check_violation
            USING MESSAGE = format('event: seq %s is ahead of every count: expected at most %s', NEW.seq, bound);
        END IF;
    END IF;
    RETURN NEW;
END
$$;
CREATE TRIGGER ahead BEFORE INSERT ON event FOR EACH ROW
    WHEN (NEW.time > now() + interval '1 day' OR NEW.seq > 1099511627776) EXECUTE FUNCTION refuse_ahead();
CREATE TRIGGER ahead BEFORE INSERT ON timing FOR EACH ROW
    WHEN (NEW.time > now() + interval '1 day') EXECUTE FUNCTION refuse_ahead();
CREATE TRIGGER ahead BEFORE INSERT ON request FOR EACH ROW
    WHEN (NEW.time > now() + interval '1 day') EXECUTE FUNCTION refuse_ahead();

-- ---- Who writes -----------------------------------------------------------------------------------------
-- With the rights of claim(), absent() and their like, which alone may call it.
CREATE FUNCTION writable(target text) RETURNS oid LANGUAGE plpgsql STABLE AS $$
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
COMMENT ON FUNCTION writable(text) IS 'The table of rows of that name, if the user of the session may write it; else an error.';

-- With the rights of the functions and triggers here, which alone may call them. By what the roles may do, not by their
-- names: a person writes setpoints and claims nothing.
CREATE FUNCTION is_person() RETURNS boolean LANGUAGE plpgsql STABLE AS $$ -- not sql, which plans it at each call
BEGIN
    RETURN NOT pg_has_role(session_user, current_user, 'USAGE')
       AND coalesce((SELECT NOT bool_or(has_function_privilege(grantee, 'claim(text, integer)', 'EXECUTE'))
                       FROM pg_class AS c, aclexplode(c.relacl) AS a
                      WHERE c.oid = 'setpoint'::regclass AND a.privilege_type = 'INSERT'
                        AND a.grantee <> 0 AND a.grantee <> c.relowner -- 0: PUBLIC
                        AND pg_has_role(session_user, a.grantee, 'MEMBER')), false);
END
$$;
COMMENT ON FUNCTION is_person() IS 'Is the user of the session a person who operates, and not a program?';

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
COMMENT ON FUNCTION number_of(text) IS 'The number of that name of the user of the session; a new name is added.';

-- No caller turns it: it executes no dynamic command, and the name that it keeps is his own user's.
CREATE FUNCTION author_number(said text) RETURNS bigint LANGUAGE sql VOLATILE SECURITY DEFINER
    SET search_path FROM CURRENT AS $$ SELECT number_of(said) $$;
COMMENT ON FUNCTION author_number(text) IS 'The number for column author, of a person for whom this user writes.';

-- With its caller's rights, as a policy of opmode asks it; the search_path is not his.
CREATE FUNCTION loops() RETURNS SETOF integer LANGUAGE sql STABLE SET search_path FROM CURRENT AS $$
    SELECT id FROM tag WHERE table_name = 'opmode' AND id BETWEEN 1 AND 65535 AND controller <> ''
$$;
COMMENT ON FUNCTION loops() IS 'Numbers of the loops: variables of opmode whose tag has a controller.';

-- ---- One writer a variable ------------------------------------------------------------------------------
-- A claim holds as long as the session's advisory lock: it ends with the session, so a dead writer's claim is free at
-- once. The owner's rights are needed because a writer may not be allowed to read its own table, yet has to know
-- from which seq to count on. Who may not insert may not claim. That keeps honest programs apart; it is no
-- protection against a hostile user of the database, for whom pg_advisory_lock() itself is open to everybody.
CREATE UNLOGGED TABLE claim ( -- empty after a crash, as are the sessions
    table_name text NOT NULL,
    id         integer NOT NULL,
    name       text NOT NULL,
    pid        integer NOT NULL,
    started    timestamptz NOT NULL,
    PRIMARY KEY (table_name, id)
);
CREATE INDEX ON claim (pid);
COMMENT ON TABLE claim IS
    'Which session has the claim to a variable; valid while that session lives. Written by claim_set().';
COMMENT ON COLUMN claim.table_name IS 'Table of the variable.';
COMMENT ON COLUMN claim.id IS 'Number of the variable in that table.';
COMMENT ON COLUMN claim.name IS 'Holder of the claim, in words: program, server process, client.';
COMMENT ON COLUMN claim.pid IS
    'Server process of the session; it lives while the advisory lock (oid of this table, pid) is held.';
COMMENT ON COLUMN claim.started IS 'When that session began; distinguishes it from a later one with the same number.';

-- The server shows an owner who is no superuser neither when the session of another role began nor its address, also
-- where a function with his rights runs in that session. So a session keeps when it began: a value that is its own, and
-- stays when its transaction is rolled back.
CREATE SEQUENCE session_began;
COMMENT ON SEQUENCE session_began IS 'When a session made its first claim, in us since 1970: currval() of that session. Written by session_began().';

CREATE FUNCTION session_began() RETURNS timestamptz LANGUAGE plpgsql AS $$
DECLARE
    began timestamptz := (SELECT backend_start FROM pg_stat_activity WHERE pid = pg_backend_pid());
BEGIN
    RETURN coalesce(began, to_timestamp(currval('session_began') / 1e6));
EXCEPTION WHEN object_not_in_prerequisite_state THEN
    RETURN to_timestamp(setval('session_began', (extract(epoch FROM clock_timestamp()) * 1e6)::bigint) / 1e6);
END
$$;
COMMENT ON FUNCTION session_began() IS
    'When this session began; where the server hides it from the owner, when the session first asked.';

CREATE FUNCTION is_claimant(pid integer) RETURNS boolean LANGUAGE sql STABLE AS $$
    SELECT EXISTS (SELECT FROM pg_locks AS l
                    WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 'claim'::regclass
                      AND l.objid = is_claimant.pid::oid AND l.objsubid = 2
                      AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database()))
$$;
COMMENT ON FUNCTION is_claimant(integer) IS 'Does the session of that server process hold claims?';

CREATE FUNCTION claimant(pid integer) RETURNS text LANGUAGE sql STABLE AS $$
    SELECT coalesce((SELECT format('%s (server process %s%s)', coalesce(nullif(a.application_name, ''), a.usename), a.pid,
                                   CASE WHEN a.pid = pg_backend_pid()
                                        THEN coalesce(', client ' || host(inet_client_addr()), ', local client')
                                        WHEN a.backend_start IS NOT NULL -- else it is not for us to see
                                        THEN coalesce(', client ' || host(a.client_addr), ', local client') END)
                       FROM pg_stat_activity AS a WHERE a.pid = claimant.pid), 'a writer that has just left')
$$;
COMMENT ON FUNCTION claimant(integer) IS 'User and program of that server process, in words.';

-- No caller turns it: of each target nothing is used before writable() has found it; ids and texts are executed
-- nowhere. pid and start of the session are the server's own word.
CREATE FUNCTION claim_set(targets text[], ids integer[], OUT at bigint, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    target text;
    began timestamptz := session_began();
    newest bigint[];
BEGIN
    IF cardinality(targets) <> cardinality(ids) OR array_position(ids, NULL) IS NOT NULL THEN
        RAISE invalid_parameter_value USING MESSAGE = 'a table and an id for each variable';
    END IF;
    FOR target IN SELECT DISTINCT t FROM unnest(targets) AS t ORDER BY t LOOP
        PERFORM pg_advisory_xact_lock(6385762, writable(target)::integer); -- one claims at a time
    END LOOP;
    -- Whoever claims a whole table has each variable of it.
    SELECT v.i, claimant(l.pid) INTO at, holder
      FROM unnest(targets) WITH ORDINALITY AS v (name, i)
      JOIN pg_locks AS l ON l.objid = v.name::regclass
     WHERE l.locktype = 'advisory' AND l.granted AND l.classid = 6385763 AND l.objsubid = 2
       AND l.pid <> pg_backend_pid() AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
     ORDER BY v.i LIMIT 1;
    IF FOUND THEN
        RETURN;
    END IF;
    DELETE FROM claim WHERE pid = pg_backend_pid() AND (started <> began OR NOT is_claimant(pid));
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
                       ' LEFT JOIN %I AS n ON n.id = v.id', target || '_newest')
           INTO newest USING target, targets, ids, last;
        last := newest;
    END LOOP;
END
$$;
COMMENT ON FUNCTION claim_set(text[], integer[]) IS
    'Claim these variables, all or none, for as long as this session lives. holder: NULL, or the holder of the variable at that place; last: newest seq of each.';

-- No caller turns it: it executes no dynamic command, and takes away only what is this session's.
CREATE FUNCTION claim_release(targets text[], ids integer[]) RETURNS bigint
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    released bigint;
BEGIN
    DELETE FROM claim AS c USING unnest(targets, ids) AS v (table_name, id)
     WHERE c.table_name = v.table_name AND c.id = v.id AND c.pid = pg_backend_pid() AND is_claimant(pg_backend_pid());
    GET DIAGNOSTICS released = ROW_COUNT;
    RETURN released;
END
$$;
COMMENT ON FUNCTION claim_release(text[], integer[]) IS
    'Release claims to these variables; returns their count.';

-- A whole table. No caller turns it: of target nothing is used before writable() has found it. What it says of the
-- holder is text, executed nowhere.
CREATE FUNCTION claim(target text, n integer, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    target_oid oid := writable(target);
BEGIN
    IF (n BETWEEN 0 AND 1048576) IS NOT TRUE THEN
        RAISE invalid_parameter_value USING MESSAGE = format('%s variables: expected 0 to 1048576', n);
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
    EXECUTE format('SELECT array_agg(coalesce((SELECT seq FROM %I WHERE id = i), 0) ORDER BY i)'
                   ' FROM generate_series(1, $1) i', target || '_newest') INTO last USING n;
END
$$;
COMMENT ON FUNCTION claim(text, integer) IS
    'Claim a table for as long as this session lives. holder: NULL, or the holder; last: newest seq of ids 1..n.';

-- ---- The newest rows, and one row a key -----------------------------------------------------------------
-- The row of a variable in _newest is also its lock: two who append to the same variable follow each other, and
-- always in the order of ids. When the trigger has it, it sees what the other has committed.
--
-- Where there are partitions, the key (id, seq) is guarded here: rows that are all newer than what was the newest
-- need no look at the history, which is the usual case; others do. Rows of one statement whose times are of one day are
-- in one partition, whose key keeps a seq from coming twice.
--
-- Waiters (apc_store_wait) are told of every commit that made something newer that people write. A commit that notifies
-- takes one lock for the whole server until it is durable: so the rest does not.
--
-- The texts are of one table each: {table} is its name, {columns} are those besides the five of every table.
DO $do$
DECLARE
    target text;
    text text;
    columns text;
    checks text; -- after the newest rows are kept
    day date := (now() AT TIME ZONE 'UTC')::date;
    people CONSTANT text[] := ARRAY['setpoint', 'opmode', 'tuning', 'manual'];
    packed CONSTANT text[] := ARRAY['sensor', 'actuator', 'setpoint', 'actual', 'estimate'];
    parts boolean;
BEGIN
    FOREACH target IN ARRAY samples() LOOP
        parts := (SELECT relkind FROM pg_class WHERE oid = to_regclass(target)) = 'p';
        columns := CASE WHEN target IN ('tick', 'plan', 'prediction') THEN ''
                        WHEN target = 'actuator' THEN ', sensor_seq, setpoint_seq, origin, author'
                        ELSE ', origin, author' END;
        EXECUTE format('CREATE INDEX ON %I USING brin (time) WITH (pages_per_range = 32, autosummarize = on)', target);
        IF parts THEN
            PERFORM make_partition(target, 'rest');
            EXECUTE format('ALTER TABLE %I ATTACH PARTITION %I DEFAULT', target, target || '_rest');
            PERFORM make_days(target, first, span(target), day) FROM ahead(target, day) AS first;
        END IF;
        -- Half of each page is left for the next versions of its rows: the index need not change with them.
        EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING COMMENTS INCLUDING STORAGE, previous bigint NOT NULL'
                       ' DEFAULT 0, PRIMARY KEY (id)) WITH (fillfactor = 50)', target || '_newest', target);
        EXECUTE format('COMMENT ON TABLE %I IS %L', target || '_newest',
                       format('The newest row of each variable of table %s. Written by a trigger.', target));
        EXECUTE format('COMMENT ON COLUMN %I.previous IS %L', target || '_newest',
                       'seq of the newest before it; 0: none.');

        checks := CASE WHEN parts THEN $guard$
    IF risen < samples THEN -- by itself: plpgsql would set up the queries below even where it needs them not
        SELECT count(*) > risen OR bool_or(lowest <= previous) AS doubtful, min(earliest) AS earliest INTO taken
          FROM (SELECT id, min(seq) AS lowest, min(time) AS earliest FROM fresh GROUP BY id) AS f
          JOIN {table}_newest USING (id);
        IF taken.doubtful OR ((taken.earliest AT TIME ZONE 'UTC')::date < (latest AT TIME ZONE 'UTC')::date AND
                              EXISTS (SELECT FROM fresh GROUP BY id, seq HAVING count(*) > 1))
        THEN
            SELECT s.id, s.seq INTO taken
              FROM (SELECT DISTINCT id, seq FROM fresh) AS f CROSS JOIN LATERAL
                   (SELECT id, seq FROM {table} WHERE id = f.id AND seq = f.seq{chunks} LIMIT 2) AS s
             GROUP BY s.id, s.seq HAVING count(*) > 1 LIMIT 1;
            IF FOUND THEN
                RAISE unique_violation
                USING MESSAGE = format('{table}: id %s, seq %s is there already', taken.id, taken.seq);
            END IF;
        END IF;
    END IF;$guard$ ELSE '' END;
        checks := replace(checks, '{chunks}', CASE WHEN target = ANY (packed) THEN ' UNION ALL'
                          ' SELECT p.id, f.seq FROM (SELECT id, first FROM {table}_packed WHERE id = f.id AND last >= f.seq'
                          ' ORDER BY last LIMIT 1) AS p WHERE p.first <= f.seq' ELSE '' END);

        -- People's values have no one writer who counts: each row is the successor of the newest.
        checks := checks || CASE WHEN target = ANY (people) THEN $follows$
    IF NOT owner THEN
        SELECT id, f.seq INTO taken FROM fresh AS f JOIN {table}_newest AS n USING (id)
         WHERE (f.seq <> n.seq OR f.seq <> n.previous + 1) LIMIT 1;
        IF FOUND THEN
            RAISE check_violation
            USING MESSAGE = format('{table} %s: seq %s does not follow the newest', taken.id, taken.seq);
        END IF;
    END IF;$follows$ ELSE '' END;

        -- Nobody writes in another's name.
        checks := checks || CASE WHEN columns <> '' THEN $author$
    IF authors > 0 AND NOT owner THEN
        SELECT id, f.author AS number INTO taken FROM fresh AS f
         WHERE f.author IS NOT NULL AND NOT EXISTS
               (SELECT FROM author AS a WHERE a.number = f.author AND a.role = session_user) LIMIT 1;
        IF FOUND THEN
            RAISE insufficient_privilege
            USING MESSAGE = format('{table} %s: author %s is not %s''s', taken.id, taken.number, session_user);
        END IF;
    END IF;$author$ ELSE '' END;

        -- The target mode of all loops: what is written to id 0 is written to each, unless that has a row of its own.
        -- Rows that come from another store bring those of the loops along, under their own seqs.
        checks := checks || CASE target WHEN 'opmode' THEN $spread$
    IF current_setting('apc.as_is', true) IS DISTINCT FROM 'on' AND EXISTS (SELECT FROM fresh WHERE id = 0)
       AND EXISTS (SELECT FROM loops()) THEN
        PERFORM FROM opmode_newest WHERE id IN (SELECT loops()) ORDER BY id FOR UPDATE;
        INSERT INTO opmode (id, seq, time, status, value, origin, author)
        SELECT l, coalesce((SELECT seq FROM opmode_newest WHERE id = l), 0) + 1, f.time, f.status, f.value, f.seq,
               f.author
          FROM loops() AS l, (SELECT * FROM fresh WHERE id = 0 ORDER BY seq DESC LIMIT 1) AS f
         WHERE l NOT IN (SELECT id FROM fresh) ORDER BY l;
    END IF;$spread$ ELSE '' END;

        checks := checks || CASE WHEN target = ANY (people) THEN $told$
    IF risen > 0 THEN
        PERFORM pg_notify('apc_' || TG_RELID, '');
    END IF;$told$ ELSE '' END;

        -- No caller turns it: it executes no dynamic command.
        text := $function$
CREATE FUNCTION {table}_appended() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    owner boolean := pg_has_role(session_user, current_user, 'USAGE');
    samples bigint;
    authors bigint;
    highest bigint;
    latest timestamptz;
    most bigint;
    risen bigint; -- variables that have a newer newest
    taken record;
BEGIN
    IF TG_RELID <> '{table}'::regclass THEN
        RAISE insufficient_privilege USING MESSAGE = '{table}_appended() is the trigger of table {table} only';
    END IF;
    SELECT count(*), max(seq), max(time), {authors} INTO samples, highest, latest, authors FROM fresh;

    -- A seq counts samples. No count is ahead of one that began in 2020 and went on 2^20 times a second; so whatever
    -- was written, there is always room for the next one. (The first bound is for a server without the date.)
    IF highest > 1099511627776 THEN
        most := CASE WHEN owner THEN 9007199254740991
                ELSE least(9007199254740991, greatest(1099511627776,
                           1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint)) END;
        IF highest > most THEN
            RAISE check_violation
            USING MESSAGE = format('{table}: seq %s breaks seq_in_range: expected at most %s', highest, most);
        END IF;
    END IF;
    -- Clocks may be wrong by hours, this server's by any time while the samples go on as they did. Old times are
    -- those of a spool.
    IF latest > now() + interval '1 day' AND NOT owner THEN
        SELECT id, f.time INTO taken FROM fresh AS f LEFT JOIN {table}_newest AS n USING (id)
         WHERE f.time > greatest(now(), n.time) + interval '1 day' LIMIT 1;
        IF FOUND THEN
            RAISE check_violation
            USING MESSAGE = format('{table} %s: time %s is more than a day ahead of this server''s: %s',
                                   taken.id, taken.time, now());
        END IF;
    END IF;

    INSERT INTO {table}_newest AS n (id, seq, time, status, value{columns})
    SELECT DISTINCT ON (id) id, seq, time, status, value{columns} FROM fresh ORDER BY id, seq DESC
        ON CONFLICT (id) DO UPDATE
       SET previous = n.seq, (seq, time, status, value{columns}) =
           (excluded.seq, excluded.time, excluded.status, excluded.value{excluded})
     WHERE n.seq < excluded.seq;
    GET DIAGNOSTICS risen = ROW_COUNT;{checks}
    RETURN NULL;
END
$$;
CREATE TRIGGER appended AFTER INSERT ON {table} REFERENCING NEW TABLE AS fresh EXECUTE FUNCTION {table}_appended() $function$;
        text := replace(text, '{checks}', checks);
        text := replace(text, '{columns}', columns);
        text := replace(text, '{excluded}', replace(columns, ', ', ', excluded.'));
        text := replace(text, '{authors}', CASE columns WHEN '' THEN '0' ELSE 'count(author)' END);
        EXECUTE replace(text, '{table}', target);

        CONTINUE WHEN target <> ALL (people);
        -- Who writes what people write holds the variable's row of newest values from before his first row on: so an
        -- open transaction, also one in the middle of a COPY, shows there (vacant()). And a person is named.
        -- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not
        -- PUBLIC's; it executes no dynamic command.
        EXECUTE replace($function$
CREATE FUNCTION {table}_held() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
BEGIN
    IF TG_TABLE_SCHEMA <> current_schema() OR TG_TABLE_NAME !~ '^{table}(_rest|_[0-9]{8})?$' THEN
        RAISE insufficient_privilege USING MESSAGE = '{table}_held() is the trigger of table {table} only';
    END IF;
    PERFORM FROM {table}_newest WHERE id = NEW.id FOR UPDATE;
    IF NOT FOUND THEN
        INSERT INTO {table}_newest (id, seq, time, status, value) VALUES (NEW.id, 0, '-infinity', 2157641728, 0)
            ON CONFLICT DO NOTHING;
    END IF;
    IF NEW.author IS NULL AND is_person() THEN
        NEW.author := number_of(session_user);
    END IF;
    RETURN NEW;
END
$$;
CREATE TRIGGER held BEFORE INSERT ON {table} FOR EACH ROW EXECUTE FUNCTION {table}_held() $function$, '{table}', target);

        -- Compare and set. The rows of newest values that are still what the caller knows, or whatever they are where he
        -- gives a negative seq, become his until his transaction ends. Those that another transaction holds count as
        -- changed: a tick neither waits for a person's open transaction nor fails by it. A variable that has no row yet
        -- gets one of seq 0 to hold; only for that it may have to wait, shortly.
        -- No caller turns it: it executes no dynamic command, and asks first whether he may write the table.
        EXECUTE replace($function$
CREATE FUNCTION {table}_vacant(ids integer[], seqs bigint[]) RETURNS TABLE (i bigint, next bigint)
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT SET lock_timeout TO '20ms' AS $$
DECLARE
    missing integer;
BEGIN
    PERFORM writable('{table}');
    IF (SELECT min(s) FROM unnest(seqs) AS s) <= 0 THEN
        FOR missing IN SELECT v FROM unnest(ids) AS v WHERE NOT EXISTS (SELECT FROM {table}_newest WHERE id = v)
                        ORDER BY v LOOP
            BEGIN
                INSERT INTO {table}_newest (id, seq, time, status, value) VALUES (missing, 0, '-infinity', 2157641728, 0)
                    ON CONFLICT DO NOTHING;
            EXCEPTION WHEN lock_not_available THEN
                NULL; -- somebody is writing the first one
            END;
        END LOOP;
    END IF;
    RETURN QUERY SELECT v.i, n.seq + 1
                   FROM unnest(ids, seqs) WITH ORDINALITY AS v (id, seq, i) CROSS JOIN LATERAL
                        (SELECT o.seq FROM {table}_newest AS o WHERE o.id = v.id FOR UPDATE SKIP LOCKED) AS n
                  WHERE (n.seq = v.seq OR v.seq < 0);
END
$$;
COMMENT ON FUNCTION {table}_vacant(integer[], bigint[]) IS
    'Lock those of these variables that have this newest seq and no other lock: position, next seq.'
        $function$, '{table}', target);
    END LOOP;
END
$do$;

-- What a person writes to a setpoint that another controller or the scheduler moves makes it his: the loop's target becomes
-- Auto, the switch Local, when the transaction ends. dim says which setpoint is a loop's.
-- A target or a switch that was written in the very transaction has been thought of: then it stays. One that was
-- written in a savepoint of it is not seen to be, and the setpoint is Local.
-- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not PUBLIC's; it
-- executes no dynamic command.
CREATE FUNCTION setpoint_local() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    owner record;
    known record;
BEGIN
    IF TG_TABLE_SCHEMA <> current_schema() OR TG_TABLE_NAME !~ '^setpoint(_rest|_[0-9]{8})?$' THEN
        RAISE insufficient_privilege USING MESSAGE = 'setpoint_local() is the trigger of table setpoint only';
    END IF;
    IF NOT is_person() THEN
        RETURN NULL;
    END IF;
    FOR owner IN
        SELECT l AS id, 3 AS remote, 1 AS local, 'cascade open' AS said
          FROM loops() AS l JOIN dim_newest AS d ON d.id = 3 + 2 * l WHERE d.value = NEW.id
         UNION ALL
        SELECT o.id, 1, 0, 'the scheduler stands aside'
          FROM tag AS z JOIN tag AS o ON o.table_name = 'opmode' AND o.id = 65536 + z.number
         WHERE z.table_name = 'setpoint' AND z.id = NEW.id
    LOOP
        SELECT seq, value, xmin = pg_current_xact_id()::xid AS own INTO known
          FROM opmode_newest WHERE id = owner.id FOR UPDATE;
        -- A switch that nobody has set says Remote.
        IF known.own IS TRUE OR
           (CASE WHEN known.seq > 0 THEN known.value >= owner.remote ELSE owner.remote = 1 END) IS NOT TRUE THEN
            CONTINUE;
        END IF;
        INSERT INTO opmode (id, seq, time, status, value, origin, author)
        VALUES (owner.id, coalesce(known.seq, 0) + 1, now(), 0, owner.local, NEW.seq, NEW.author);
        INSERT INTO event (time, severity, source, kind, text, number, seq, author, class)
        SELECT now(), 1, (SELECT s FROM unnest(ARRAY[a.name, session_user, 'operator']) AS s
                        WHERE octet_length(s) <= 31 LIMIT 1), 'mode',
               coalesce(t.name, 'setpoint ' || NEW.id) || ' taken Local, ' || owner.said, t.number, NEW.seq,
               NEW.author, 'operator'
          FROM (VALUES (NEW.author)) AS v (number) LEFT JOIN author AS a USING (number)
          LEFT JOIN tag AS t ON t.table_name = 'setpoint' AND t.id = NEW.id;
    END LOOP;
    RETURN NULL;
END
$$;
CREATE CONSTRAINT TRIGGER local AFTER INSERT ON setpoint DEFERRABLE INITIALLY DEFERRED
    FOR EACH ROW EXECUTE FUNCTION setpoint_local();

-- Positions in the arrays, from 1, of the samples that are not stored yet; of equal ones the first. With the owner's
-- rights, because a writer may not be allowed to read its own table. No caller turns it: of target nothing is used before
-- writable() has found it.
CREATE FUNCTION absent(target text, ids integer[], seqs bigint[]) RETURNS SETOF bigint
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
BEGIN
    PERFORM writable(target);
    EXECUTE format('SELECT FROM %I WHERE id = ANY ($1) ORDER BY id FOR UPDATE', target || '_newest') USING ids;
    RETURN QUERY EXECUTE format(
        'SELECT min(i) FROM unnest($1, $2) WITH ORDINALITY AS v (id, seq, i) WHERE NOT EXISTS'
        ' (SELECT FROM %I AS s WHERE s.id = v.id AND s.seq = v.seq)' ||
        CASE WHEN to_regclass(quote_ident(target || '_packed')) IS NULL THEN '' ELSE format(
        ' AND (SELECT p.first <= v.seq FROM %I AS p WHERE p.id = v.id AND p.last >= v.seq ORDER BY p.last LIMIT 1)'
        ' IS NOT TRUE', target || '_packed') END || ' GROUP BY v.id, v.seq', target) USING ids, seqs;
END
$$;
COMMENT ON FUNCTION absent(text, integer[], bigint[]) IS 'Positions of the samples that are not stored yet.';

-- ---- What is in a chunk -----------------------------------------------------------------------------------
-- Weeks that are complete can be packed: up to 1024 samples of one variable, whose seqs follow each other, are one row of
-- X_packed, and view X_all shows them as the rows that they were, with those of table X. Nothing is packed until the owner
-- asks for it (apc maintain --pack) or a historian is told to (apc-historian --pack).
-- src/shareddata/pack.h says how a chunk is made. These are for people: libapc asks for the chunks and unpacks them itself.
CREATE FUNCTION eight_bytes(data bytea, place integer) RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE AS $$
    SELECT ('x' || encode(substring(data FROM place + 1 FOR 8), 'hex'))::bit(64)::bigint
$$;
COMMENT ON FUNCTION eight_bytes(bytea, integer) IS 'The integer at that place, from 0.';

CREATE FUNCTION double_of(bits bigint) RETURNS double precision LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE AS $$
DECLARE
    exponent integer := (bits >> 52) & 2047;
    fraction bigint := bits & 4503599627370495;
    size double precision := CASE exponent WHEN 0 THEN fraction ELSE fraction + 4503599627370496 END;
BEGIN
    IF size > 0 THEN
        exponent := greatest(exponent, 1) - 1075; -- in two steps, as neither may leave the range
        size := size * 2::double precision ^ (exponent / 2) * 2::double precision ^ (exponent - exponent / 2);
    END IF;
    RETURN CASE WHEN bits < 0 THEN -size ELSE size END;
END
$$;
COMMENT ON FUNCTION double_of(bigint) IS 'The number with these bits.';

CREATE FUNCTION bits_of(number double precision) RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE AS $$
    SELECT ('x' || encode(float8send(number), 'hex'))::bit(64)::bigint
$$;
COMMENT ON FUNCTION bits_of(double precision) IS 'The bits of a number.';

CREATE FUNCTION unpack_column(data bytea, INOUT place integer, n integer, OUT x bigint[])
    LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    mode integer := get_byte(data, place);
    start bigint := 0;
    slope bigint := 0;
    length integer;
    base bigint;
    width integer;
    bits varbit;
    codes bigint[];
    step double precision;
    near double precision;
BEGIN
    place := place + 1;
    IF mode = 5 THEN
        near := double_of(eight_bytes(data, place));
        step := double_of(eight_bytes(data, place + 8));
        SELECT c.x, c.place INTO codes, place FROM unpack_column(data, place + 16, n) AS c;
        SELECT c.x, c.place INTO x, place FROM unpack_column(data, place, n) AS c;
        x := ARRAY(SELECT bits_of(near + step * k) + e FROM unnest(codes, x) WITH ORDINALITY AS v (k, e, i) ORDER BY i);
        RETURN;
    END IF;
    IF mode IN (1, 3, 4) THEN
        start := eight_bytes(data, place);
        place := place + 8;
    END IF;
    IF mode IN (1, 3) THEN
        slope := eight_bytes(data, place);
        place := place + 8;
    END IF;
    IF mode < 2 THEN
        x := ARRAY(SELECT start + i * slope FROM generate_series(0, n - 1) AS i ORDER BY i);
        RETURN;
    END IF;
    x := '{}';
    FOR done IN 0 .. n - 1 BY 128 LOOP
        length := least(128, n - done);
        base := eight_bytes(data, place);
        width := get_byte(data, place + 8);
        bits := ('x' || encode(substring(data FROM place + 10 FOR (length * width + 7) / 8), 'hex'))::varbit;
        place := place + 9 + (length * width + 7) / 8;
        x := x || ARRAY(SELECT base + CASE width WHEN 0 THEN 0 ELSE
                               (substring(bits FROM i * width + 1 FOR width)::bit(64) >> (64 - width))::bigint END
                          FROM generate_series(0, length - 1) AS i ORDER BY i);
    END LOOP;
    IF mode = 3 THEN
        x := ARRAY(SELECT start + ((i - 1) * slope >> 12) + v FROM unnest(x) WITH ORDINALITY AS u (v, i) ORDER BY i);
    ELSIF mode = 4 THEN
        x := ARRAY(SELECT start + sum(v) OVER (ORDER BY i)::bigint FROM unnest(x) WITH ORDINALITY AS u (v, i) ORDER BY i);
    END IF;
END
$$;
COMMENT ON FUNCTION unpack_column(bytea, integer, integer) IS 'A column of a chunk, and the place of the next one.';

CREATE FUNCTION unpack(data bytea)
    RETURNS TABLE (i integer, "time" timestamptz, status bigint, value double precision, origin bigint, author bigint,
                   sensor_seq bigint, setpoint_seq bigint)
    LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path FROM CURRENT AS $$
DECLARE
    n integer := get_byte(data, 1) * 256 + get_byte(data, 2);
    place integer := 3;
    c bigint[][];
    t bigint[]; s bigint[]; v bigint[]; o bigint[]; a bigint[]; p bigint[]; q bigint[];
BEGIN
    IF get_byte(data, 0) <> 1 THEN
        RAISE data_exception USING MESSAGE = format('a chunk of format %s: upgrade the tables', get_byte(data, 0));
    END IF;
    SELECT u.x, u.place INTO t, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO s, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO v, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO o, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO a, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO p, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO q, place FROM unpack_column(data, place, n) AS u;
    RETURN QUERY
    SELECT k, timestamptz '2000-01-01 00:00:00+00' + t[k + 1] * interval '1 microsecond', s[k + 1], double_of(v[k + 1]),
           nullif(o[k + 1], 0), nullif(a[k + 1], 0), nullif(p[k + 1], 0), nullif(q[k + 1], 0)
      FROM generate_series(0, n - 1) AS k;
END
$$;
COMMENT ON FUNCTION unpack(bytea) IS 'The samples of a chunk, numbered from 0; seq is first + i.';

DO $do$
DECLARE
    target text;
    more text;
BEGIN
    FOREACH target IN ARRAY ARRAY['sensor', 'actuator', 'setpoint', 'actual', 'estimate'] LOOP
        more := CASE target WHEN 'actuator' THEN ', @.sensor_seq, @.setpoint_seq' ELSE '' END || ', @.origin, @.author';
        EXECUTE replace(replace(replace($tables$
CREATE TABLE {table}_packed (
    first   bigint NOT NULL,
    last    bigint NOT NULL,
    since   timestamptz NOT NULL,
    until   timestamptz NOT NULL,
    final   bigint NOT NULL,
    worst   bigint NOT NULL,
    lowest  double precision NOT NULL,
    highest double precision NOT NULL,
    mean    double precision NOT NULL,
    latest  double precision NOT NULL,
    id      integer NOT NULL,
    good    integer NOT NULL,
    data    bytea NOT NULL,
    PRIMARY KEY (id, last),
    CONSTRAINT last_not_before_first CHECK (first <= last)
);
ALTER TABLE {table}_packed ALTER COLUMN data SET STORAGE EXTERNAL; -- it is compressed
COMMENT ON TABLE {table}_packed IS
    'Chunks of table {table}: samples of one variable with seqs from first to last. Written by apc maintain --pack.';
COMMENT ON COLUMN {table}_packed.first IS 'seq of its first sample.';
COMMENT ON COLUMN {table}_packed.last IS 'seq of its last sample.';
COMMENT ON COLUMN {table}_packed.since IS 'Earliest time of its samples.';
COMMENT ON COLUMN {table}_packed.until IS 'Latest time of its samples.';
COMMENT ON COLUMN {table}_packed.final IS 'seq of the last sample that is not Bad; 0: none.';
COMMENT ON COLUMN {table}_packed.worst IS 'Highest status of all samples.';
COMMENT ON COLUMN {table}_packed.lowest IS 'Lowest value that is not Bad; 0: none.';
COMMENT ON COLUMN {table}_packed.highest IS 'Highest value that is not Bad; 0: none.';
COMMENT ON COLUMN {table}_packed.mean IS 'Mean of the values that are not Bad; 0: none.';
COMMENT ON COLUMN {table}_packed.latest IS 'Value of the sample with seq final; 0: none.';
COMMENT ON COLUMN {table}_packed.id IS 'Number of the variable.';
COMMENT ON COLUMN {table}_packed.good IS 'Number of samples that are not Bad.';
COMMENT ON COLUMN {table}_packed.data IS 'The samples in compressed form: unpack().';
CREATE VIEW {table}_all AS SELECT id, seq, time, status, value{of_rows} FROM {table} AS s UNION ALL
    SELECT p.id, p.first + u.i, u.time, u.status, u.value{of_chunks}
      FROM {table}_packed AS p CROSS JOIN LATERAL unpack(p.data) AS u;
COMMENT ON VIEW {table}_all IS 'All rows of table {table}, packed or not.' $tables$,
                        '{of_rows}', replace(more, '@', 's')), '{of_chunks}', replace(more, '@', 'u')), '{table}', target);
    END LOOP;
END
$do$;

-- ---- Packing ----------------------------------------------------------------------------------------------
-- For the owner: apc maintain --pack. It reads a week while others use it, makes chunks of it, and drops it, in one
-- transaction. What is written to the week meanwhile, by a clock that is wrong or a spool that is late, leaves a word
-- in table late; then the week stays as it is until the next time.
CREATE TABLE late (partition name NOT NULL);
COMMENT ON TABLE late IS 'Partitions that are being packed: one row for each row written to them meanwhile.';
COMMENT ON COLUMN late.partition IS 'Name of the partition.';

-- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not PUBLIC's; it
-- executes no dynamic command, and what it writes is the name of its table.
CREATE FUNCTION note_late() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path FROM CURRENT AS $$
BEGIN
    IF TG_TABLE_SCHEMA <> current_schema() OR TG_TABLE_NAME !~ '_[0-9]{8}$' THEN
        RAISE insufficient_privilege USING MESSAGE = 'note_late() is the trigger of weeks that are being packed only';
    END IF;
    INSERT INTO late VALUES (TG_TABLE_NAME);
    RETURN NULL;
END
$$;

CREATE FUNCTION packable(before timestamptz) RETURNS TABLE (target text, partition text) LANGUAGE sql STABLE AS $$
    SELECT p.relname::text, c.relname::text
      FROM pg_class AS p JOIN pg_inherits ON inhparent = p.oid JOIN pg_class AS c ON c.oid = inhrelid
     WHERE p.relnamespace = to_regnamespace(quote_ident(current_schema()))
       AND p.relname IN ('sensor', 'actuator', 'setpoint', 'actual', 'estimate')
       AND CASE WHEN c.relname ~ format('^%s_[0-9]{8}$', p.relname) -- first: what else there is has no date
                THEN (to_date(right(c.relname, 8), 'YYYYMMDD') + 7)::timestamp AT TIME ZONE 'UTC' <= before END
     ORDER BY right(c.relname, 8), p.relname
$$;
COMMENT ON FUNCTION packable(timestamptz) IS 'Weeks that ended by then and are not packed.';

-- Waits a fifth of a second at a time, because writers would wait behind it.
CREATE FUNCTION pack_lock(tables text, mode text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    PERFORM set_config('lock_timeout', '200ms', true);
    FOR try IN 1 .. 50 LOOP
        BEGIN
            EXECUTE format('LOCK TABLE %s IN %s MODE', tables, mode);
            RETURN;
        EXCEPTION
            WHEN lock_not_available THEN
                PERFORM pg_sleep(0.05);
            WHEN undefined_table THEN
                RAISE serialization_failure USING MESSAGE = 'somebody else has packed or dropped it meanwhile';
        END;
    END LOOP;
    RAISE serialization_failure USING MESSAGE = 'it is in use without a pause, or somebody else packs it: it stays as it is';
END
$$;
COMMENT ON FUNCTION pack_lock(text, text) IS 'Lock tables, named by %I, or fail with serialization_failure.';

-- From here on a row that is written to the week is noticed.
CREATE FUNCTION pack_begin(partition text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pack_lock(quote_ident(partition), 'SHARE ROW EXCLUSIVE');
    IF NOT EXISTS (SELECT FROM pg_trigger WHERE tgrelid = to_regclass(quote_ident(partition)) AND tgname = 'late') THEN
        EXECUTE format('CREATE TRIGGER late AFTER INSERT ON %I FOR EACH ROW EXECUTE FUNCTION note_late()', partition);
    END IF;
    DELETE FROM late AS l WHERE l.partition = pack_begin.partition;
END
$$;
COMMENT ON FUNCTION pack_begin(text) IS 'First transaction of packing a week: from now on late rows are noticed.';

-- What stays rows, because too few seqs follow each other, goes where rows of no week are. A week's small chunks are packed
-- likewise; which there are is not said by packable(). Two maintainers exclude each other by
-- pack_lock(partition, SHARE UPDATE EXCLUSIVE), with which the second transaction begins.
CREATE FUNCTION pack_end(target text, partition text, ids integer[], firsts bigint[], lasts bigint[]) RETURNS bigint
    LANGUAGE plpgsql AS $$
DECLARE
    open boolean := partition = target || '_open_' || right(partition, 8);
    stayed bigint := 0;
BEGIN
    PERFORM pack_lock(CASE WHEN open THEN format('ONLY %I, %I', target || '_packed', partition)
                      ELSE format('ONLY %I, %I, %I', target, partition, target || '_rest') END, 'ACCESS EXCLUSIVE');
    IF EXISTS (SELECT FROM late AS l WHERE l.partition = pack_end.partition) THEN
        RAISE serialization_failure USING MESSAGE = 'rows were written to it while it was being packed: it stays as it is';
    END IF;
    IF NOT open THEN
        EXECUTE format('ALTER TABLE %I DETACH PARTITION %I', target, partition);
        EXECUTE format('INSERT INTO %I SELECT s.* FROM unnest($1, $2, $3) AS r (id, first, last) JOIN %I AS s'
                       ' ON s.id = r.id AND s.seq BETWEEN r.first AND r.last', target || '_rest', partition)
          USING ids, firsts, lasts;
        GET DIAGNOSTICS stayed = ROW_COUNT;
    END IF;
    EXECUTE format('DROP TABLE %I', partition);
    RETURN stayed;
END
$$;
COMMENT ON FUNCTION pack_end(text, text, integer[], bigint[], bigint[]) IS
    'Last statement of packing a week: drops it, except the rows of these runs; returns their count.';

-- As drop_week() does: but not the newest sample of any variable, whose week may be there still.
CREATE FUNCTION drop_packed(target text, before timestamptz) RETURNS SETOF bigint LANGUAGE plpgsql AS $$
BEGIN
    RETURN QUERY EXECUTE format(
        'WITH gone AS (DELETE FROM %1$I WHERE until < $1 RETURNING id, first, last),'
        ' kept AS (INSERT INTO %2$I (id, seq, time, status, value, origin, author%4$s)'
        ' SELECT n.id, n.seq, n.time, n.status, n.value, n.origin, n.author%5$s FROM %3$I AS n JOIN gone'
        ' ON n.id = gone.id AND n.seq BETWEEN gone.first AND gone.last) SELECT last FROM gone',
        target || '_packed', target, target || '_newest',
        CASE target WHEN 'actuator' THEN ', sensor_seq, setpoint_seq' ELSE '' END,
        CASE target WHEN 'actuator' THEN ', n.sensor_seq, n.setpoint_seq' ELSE '' END) USING before;
END
$$;
COMMENT ON FUNCTION drop_packed(text, timestamptz) IS
    'Drop chunks that ended before that time, but not the newest sample of any variable.';

-- ---- Chunks as they come ----------------------------------------------------------------------------------
-- The historian may write several samples of a variable as one chunk (apc-historian --pack), into a table of the week that
-- is open. X_open_YYYYMMDD inherits X_packed, so whoever reads chunks reads these too. When its week is packed, small
-- chunks become large ones and the table goes.
CREATE FUNCTION make_open(target text, partition text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    EXECUTE format('CREATE TABLE %I (PRIMARY KEY (id, last)) INHERITS (%I)', partition, target || '_packed');
    EXECUTE format('COMMENT ON TABLE %I IS %L', partition,
                   format('Small chunks of table %s, in the week when they came. Written by apc-historian --pack.', target));
    EXECUTE format('ALTER TABLE %I OWNER TO %s', partition, -- it may be a superuser who writes
                   (SELECT relowner::regrole FROM pg_class WHERE oid = to_regclass(quote_ident(target))));
END
$$;
COMMENT ON FUNCTION make_open(text, text) IS 'The table of small chunks of a week.';

-- All or none. What needs a closer look, because it is not newer than all that is there or comes from a clock or a count
-- that is ahead, is refused as if it were there already: its writer sends it again as rows, and their trigger looks.
-- What is in a chunk cannot be looked at here at a price: its writer answers for it. So what people write stays rows.
-- No caller turns it: writable() and the list say which names become part of a command, and the server which week it
-- is; the table of newest values and the chunks are those of the plant's schema, where only the owner makes any.
CREATE FUNCTION append_chunks(target text, ids integer[], firsts bigint[], lasts bigint[], sinces timestamptz[],
                              untils timestamptz[], finals bigint[], worsts bigint[], lowests double precision[],
                              highests double precision[], means double precision[], latests double precision[],
                              goods integer[], starts integer[], lengths integer[], data bytea, times timestamptz[],
                              statuses bigint[], numbers double precision[], origins bigint[])
    RETURNS bigint LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path FROM CURRENT AS $$
DECLARE
    opened text := target || to_char(date_trunc('week', now() AT TIME ZONE 'UTC'), '"_open_"YYYYMMDD');
    ahead bigint := least(9007199254740991,
                          greatest(1099511627776, 1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint));
    risen bigint;
BEGIN
    PERFORM writable(target);
    IF target NOT IN ('sensor', 'actuator', 'actual', 'estimate') THEN
        RAISE invalid_parameter_value USING MESSAGE = format('%s is not written in chunks', target);
    END IF;
    IF (SELECT bool_and(id >= 0 AND first >= 1 AND last - first BETWEEN 0 AND 1023 AND good BETWEEN 0 AND last - first + 1
                        AND final BETWEEN 0 AND last AND worst BETWEEN 0 AND 4294967295 AND status BETWEEN 0 AND worst
                        AND origin IS DISTINCT FROM 0 AND origin IS NOT DISTINCT FROM abs(origin) AND since <= until
                        AND (number, lowest, highest, mean, latest) IS NOT NULL
                        AND greatest(abs(number), abs(lowest), abs(highest), abs(mean), abs(latest)) < 1e300
                        AND start >= 1 AND length BETWEEN 10 AND 65536 AND start + length - 1 <= octet_length(data)
                        AND get_byte(data, start - 1) = 1
                        AND get_byte(data, start) * 256 + get_byte(data, start + 1) = last - first + 1)
          FROM unnest(ids, firsts, lasts, sinces, untils, finals, worsts, lowests, highests, means, latests, goods, starts,
                      lengths, statuses, numbers, origins)
            AS v (id, first, last, since, until, final, worst, lowest, highest, mean, latest, good, start, length, status,
                  number, origin)) IS NOT TRUE THEN
        RAISE check_violation USING MESSAGE = format('what comes as chunks of table %s is none', target);
    END IF;
    IF (SELECT max(s) FROM unnest(lasts) AS s) > ahead
       OR (SELECT max(t) FROM unnest(untils) AS t) > now() + interval '1 day' THEN
        RAISE unique_violation USING MESSAGE = format('%s: chunks of a clock or a count that is ahead', target);
    END IF;
    EXECUTE format('INSERT INTO %I AS n (id, seq, time, status, value, origin, previous)'
                   ' SELECT id, last, time, status, value, origin, first - 1 FROM unnest($1, $2, $3, $4, $5, $6, $7)'
                   ' AS v (id, last, time, status, value, origin, first) ORDER BY id ON CONFLICT (id) DO UPDATE'
                   ' SET previous = n.seq, (seq, time, status, value, origin, author)'
                   ' = (excluded.seq, excluded.time, excluded.status, excluded.value, excluded.origin, NULL)'
                   ' WHERE n.seq <= excluded.previous', target || '_newest')
      USING ids, lasts, times, statuses, numbers, origins, firsts;
    GET DIAGNOSTICS risen = ROW_COUNT;
    IF risen < cardinality(ids) THEN
        RAISE unique_violation USING MESSAGE = format('%s: chunks that are not newer than what is there', target);
    END IF;
    IF to_regclass(quote_ident(opened)) IS NULL THEN
        PERFORM make_open(target, opened);
    END IF;
    EXECUTE format('INSERT INTO %I (id, first, last, since, until, final, worst, lowest, highest, mean, latest, good, data)'
                   ' SELECT id, first, last, since, until, final, worst, lowest, highest, mean, latest, good,'
                   ' substring($15 FROM start FOR length)'
                   ' FROM unnest($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14) AS v (id, first, last, since,'
                   ' until, final, worst, lowest, highest, mean, latest, good, start, length)', opened)
      USING ids, firsts, lasts, sinces, untils, finals, worsts, lowests, highests, means, latests, goods, starts, lengths,
            data;
    RETURN risen;
END
$$;
COMMENT ON FUNCTION append_chunks IS
    'Append chunks, one a variable, each with its place in data and its last sample. unique_violation: a chunk is not newer than the stored rows.';

-- ---- Trends -----------------------------------------------------------------------------------------------
-- trend() gives what signals were in a span of time, by their names, and trend_bins() sums it up for a chart. View X_all
-- unpacks all chunks of a variable, whatever time is asked for; these unpack those only which reach into the span, and
-- trend_bins() none that is short beside a bin.
-- All three have their caller's rights. Of what he gives nothing becomes part of a command but the name of a table, which
-- table tag has; its own constraint says which there may be.
CREATE FUNCTION signal_called(asked text, OUT target text, OUT variable integer)
    LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    meant text[];
BEGIN
    -- As `apc history` takes it: y may be a measurement and what is set for it; a loop's mode is LOOP.mode.
    WITH named AS (SELECT t.table_name, t.id FROM tag AS t WHERE t.table_name NOT IN ('state', 'tick', 'plan', 'prediction')
                      AND asked IN (CASE WHEN t.table_name = 'opmode' AND t.id BETWEEN 1 AND 65535 THEN t.name || '.mode'
                                    ELSE t.name END, t.table_name || '.' || t.id))
    SELECT array_agg(n.table_name || '.' || n.id), min(n.table_name), min(n.id) INTO meant, target, variable FROM named AS n
     WHERE n.table_name NOT IN ('setpoint', 'actuator') OR NOT EXISTS (SELECT FROM named AS s WHERE s.table_name = 'sensor');
    IF meant IS NULL THEN
        RAISE undefined_object USING MESSAGE = format('no signal is called %s', quote_nullable(asked)),
                                     HINT = 'SELECT table_name, name FROM tag says which there are.';
    ELSIF cardinality(meant) > 1 THEN
        RAISE undefined_object USING MESSAGE = format('%s signals are called %s: say %s', cardinality(meant),
                                                      quote_nullable(asked), array_to_string(meant, ' or '));
    END IF;
END
$$;
COMMENT ON FUNCTION signal_called(text) IS 'Table and id of the signal of that name, or TABLE.ID; or an error.';

CREATE FUNCTION trend(since timestamptz, until timestamptz, VARIADIC signals text[])
    RETURNS TABLE ("time" timestamptz, signal text, value double precision, status bigint, seq bigint)
    LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    asked text;
    s record;
BEGIN
    FOREACH asked IN ARRAY signals LOOP
        SELECT * INTO s FROM signal_called(asked);
        RETURN QUERY EXECUTE format(
            'SELECT r.time, $4, CASE WHEN r.status < 2147483648 THEN r.value END, r.status, r.seq FROM'
            ' (SELECT time, value, status, seq FROM %I WHERE id = $1 AND time >= $2 AND time < $3%s) AS r ORDER BY r.seq',
            s.target, CASE WHEN to_regclass(s.target || '_packed') IS NULL THEN '' ELSE format(
            ' UNION ALL SELECT u.time, u.value, u.status, p.first + u.i'
            ' FROM (SELECT first, data FROM %I WHERE id = $1 AND until >= $2 AND since < $3) AS p'
            ' CROSS JOIN LATERAL unpack(p.data) AS u WHERE u.time >= $2 AND u.time < $3', s.target || '_packed') END)
           USING s.variable, since, until, asked;
    END LOOP;
END
$$;
COMMENT ON FUNCTION trend(timestamptz, timestamptz, text[]) IS
    'Samples of signals since a time and before another, packed or not: signal by signal, each by seq. A value that is Bad is NULL.';

-- A chunk that is shorter than four bins counts as a whole for the bin in which it begins: so each row says from when to
-- when it is, and what it says of that time is exact.
CREATE FUNCTION trend_bins(since timestamptz, until timestamptz, bins integer, VARIADIC signals text[])
    RETURNS TABLE ("time" timestamptz, till timestamptz, signal text, samples bigint, bad bigint,
                   lowest double precision, mean double precision, highest double precision)
    LANGUAGE plpgsql STABLE SET search_path FROM CURRENT AS $$
DECLARE
    asked text;
    s record;
    width interval;
BEGIN
    IF (isfinite(since) AND isfinite(until) AND since < until AND bins BETWEEN 1 AND 100000) IS NOT TRUE THEN
        RAISE invalid_parameter_value
        USING MESSAGE = format('%s bins from %s to %s: expected 1 to 100000, from a time to a later one', bins, since, until);
    END IF;
    width := (until - since) / bins;
    FOREACH asked IN ARRAY signals LOOP
        SELECT * INTO s FROM signal_called(asked);
        RETURN QUERY EXECUTE format(
            'SELECT min(b.since), max(b.until), $4, sum(b.samples)::bigint, sum(b.samples - b.good)::bigint,'
            ' min(b.lowest) FILTER (WHERE b.good > 0), sum(b.mean * b.good) / nullif(sum(b.good), 0),'
            ' max(b.highest) FILTER (WHERE b.good > 0) FROM (SELECT r.time AS since, r.time AS until, 1::bigint AS samples,'
            ' (r.status < 2147483648)::integer AS good, r.value AS lowest, r.value AS mean, r.value AS highest'
            ' FROM %I AS r WHERE r.id = $1 AND r.time >= $2 AND r.time < $3%s) AS b'
            ' GROUP BY floor(extract(epoch FROM b.since - $2) / extract(epoch FROM $5)) ORDER BY 1',
            s.target, CASE WHEN to_regclass(s.target || '_packed') IS NULL THEN '' ELSE format(
            ' UNION ALL SELECT p.since, p.until, p.last - p.first + 1, p.good, p.lowest, p.mean, p.highest FROM %1$I AS p'
            ' WHERE p.id = $1 AND p.since >= $2 AND p.until < $3 AND p.until - p.since < 4 * $5'
            ' UNION ALL SELECT u.time, u.time, 1, (u.status < 2147483648)::integer, u.value, u.value, u.value'
            ' FROM (SELECT data FROM %1$I AS c WHERE c.id = $1 AND c.until >= $2 AND c.since < $3'
            ' AND NOT (c.since >= $2 AND c.until < $3 AND c.until - c.since < 4 * $5)) AS p'
            ' CROSS JOIN LATERAL unpack(p.data) AS u WHERE u.time >= $2 AND u.time < $3', s.target || '_packed') END)
           USING s.variable, since, until, asked, width;
    END LOOP;
END
$$;
COMMENT ON FUNCTION trend_bins(timestamptz, timestamptz, integer, text[]) IS
    'The same in at most that many bins a signal, each with its span. A chunk shorter than four bins counts in one bin.';

-- ---- Housekeeping -----------------------------------------------------------------------------------------
-- For the owner: apc maintain, or CALL it with the plant's schema first in the search_path. Partitions are made ahead,
-- and what is older than asked for (NULL: nothing) is dropped, but for the newest row of each variable; ticks and
-- predictions after a day, or from ticks_before on. Each step is a transaction of its own. What needs a table for itself
-- waits for it a fifth of a second at most, because writers would wait behind it, and then tries again.
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
    PERFORM set_config('DateStyle', 'ISO, YMD', true); -- until the first COMMIT: all commands are written by then
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
        SELECT 3, format('SELECT * FROM drop_packed(%L, %L)', name, before)
          FROM parts WHERE before IS NOT NULL AND to_regclass(quote_ident(name || '_packed')) IS NOT NULL
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
    'Make partitions ahead; drop rows that are older than each given time. dropped: rows and partitions.';

-- Who may execute what is said by sql/roles.sql.
DO $do$
BEGIN
    EXECUTE format('REVOKE ALL ON ALL ROUTINES IN SCHEMA %I FROM PUBLIC', current_schema());
END
$do$;
