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
-- One table, one kind of variable. (id, seq) is the key and, read backwards, the way to the newest sample;
-- "newest" is the highest seq, never the latest time, because clocks step. Rows are only ever inserted.
--
-- History over a time range has a BRIN index: rows come in the order of time, so a few bytes for each 32 pages
-- tell which pages to look at. A B-tree on (id, time) would answer no faster for the newest and would cost each
-- insert as much again as the primary key does.
CREATE TABLE sensor (
    id     integer NOT NULL,
    seq    bigint NOT NULL,
    time   timestamptz NOT NULL,
    status bigint NOT NULL,
    value  double precision NOT NULL,
    PRIMARY KEY (id, seq),
    CONSTRAINT id_not_negative CHECK (id >= 0),
    CONSTRAINT seq_in_range CHECK (seq BETWEEN 1 AND 4611686018427387903), -- below 2^62: room to count on
    CONSTRAINT status_is_code CHECK (status BETWEEN 0 AND 4294967295),
    -- Also keeps NaN and the infinities out: for PostgreSQL NaN is greater than any number.
    CONSTRAINT value_finite CHECK (abs(value) < 1e300::double precision)
);
CREATE INDEX ON sensor USING brin (time) WITH (pages_per_range = 32, autosummarize = on);
COMMENT ON COLUMN sensor.id IS 'Number of the variable: 1..n is a row of the vector, 0 a scalar.';
COMMENT ON COLUMN sensor.seq IS 'Counts a variable''s samples from 1; rises strictly, survives restarts.';
COMMENT ON COLUMN sensor.time IS 'Source time, UTC: when the value was acquired or made. May step with the clock.';
COMMENT ON COLUMN sensor.status IS 'OPC UA StatusCode; 0 is Good, the top two of 32 bits are the severity.';
COMMENT ON COLUMN sensor.value IS 'In the unit that table tag names; magnitude below 1e300.';

CREATE TABLE actuator (LIKE sensor INCLUDING ALL);
ALTER TABLE actuator ADD COLUMN sensor_seq bigint CONSTRAINT sensor_seq_positive CHECK (sensor_seq > 0);
ALTER TABLE actuator ADD COLUMN setpoint_seq bigint CONSTRAINT setpoint_seq_positive CHECK (setpoint_seq > 0);
COMMENT ON COLUMN actuator.sensor_seq IS 'seq of the measurement it was computed from; NULL: none.';
COMMENT ON COLUMN actuator.setpoint_seq IS 'seq of the setpoint it was computed from; NULL: none.';

CREATE TABLE setpoint (LIKE sensor INCLUDING ALL);
CREATE TABLE tuning (LIKE sensor INCLUDING ALL);
CREATE TABLE manual (LIKE sensor INCLUDING ALL);
CREATE TABLE state (LIKE sensor INCLUDING ALL);
CREATE TABLE dim (LIKE sensor INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));
CREATE TABLE opmode (LIKE sensor INCLUDING ALL, CONSTRAINT value_whole CHECK (value = trunc(value)));

-- Waiters (apc_store_wait) are told of every commit that wrote samples, whoever wrote them.
CREATE FUNCTION changed() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_notify('apc_' || TG_RELID, '');
    RETURN NULL;
END
$$;
CREATE TRIGGER changed AFTER INSERT ON sensor EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON actuator EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON setpoint EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON dim EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON opmode EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON tuning EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON manual EXECUTE FUNCTION changed();
CREATE TRIGGER changed AFTER INSERT ON state EXECUTE FUNCTION changed();

COMMENT ON TABLE sensor IS 'Measurements y. Written by apc-client.';
COMMENT ON TABLE actuator IS 'Manipulated variables u. Written by apc-controller.';
COMMENT ON TABLE setpoint IS 'Setpoints. Written by apc-scheduler and the operator.';
COMMENT ON TABLE dim IS 'Ids 1..3: number of measurements, setpoints, manipulated variables. Written at set-up.';
COMMENT ON TABLE opmode IS
    'Id 0: target mode, written by the operator; id 1: actual mode, written by apc-controller. 0 Man, 1 Auto, 2 OOS.';
COMMENT ON TABLE tuning IS 'Parameters of the control law. Written by the operator.';
COMMENT ON TABLE manual IS 'The operator''s outputs, used in mode Man. Written by the operator.';
COMMENT ON TABLE state IS 'What a restarted apc-controller resumes from. Written by apc-controller.';

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
    EXECUTE format('SELECT array_agg(coalesce((SELECT max(seq) FROM %I WHERE id = i), 0) ORDER BY i)'
                   ' FROM generate_series(1, $1) i', target) INTO last USING n;
END
$$;
COMMENT ON FUNCTION claim(text, integer) IS
    'Become the one writer of a table for as long as this session lives. holder: NULL, or who has it; last: newest seq of ids 1..n.';
REVOKE ALL ON FUNCTION claim(text, integer) FROM PUBLIC;
