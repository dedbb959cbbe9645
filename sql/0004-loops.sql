-- SPDX-License-Identifier: BSD-3-Clause
-- Version 4: what version 1 kept for one controller becomes that of its loops. Ids of opmode are loops, their actual
-- mode stands in table actual, and what a controller resumes from in table tick. Programs of version 1 cannot go on:
-- they are stopped for that minute, and there is no way back but a dump made before. No row of sensor, actuator,
-- setpoint, tuning, manual or dim is touched.

-- ---- Nobody of version 1 is there -----------------------------------------------------------------------
DO $do$
DECLARE
    target text;
    there text;
BEGIN
    -- In the order in which appends take them; whoever comes from now on waits, and is then refused.
    LOCK TABLE opmode, state, tag IN ACCESS EXCLUSIVE MODE;
    IF (SELECT applied_at FROM migration WHERE version = 1) = now() THEN
        RETURN; -- being made in this transaction
    END IF;
    FOREACH target IN ARRAY ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'state'] LOOP
        IF NOT pg_try_advisory_xact_lock(6385763, target::regclass::oid::integer) THEN -- version 1's claim
            SELECT string_agg(claimant(pid), '; ') INTO there
              FROM pg_locks
             WHERE locktype = 'advisory' AND granted AND classid = 6385763 AND objid = target::regclass::oid
               AND objsubid = 2 AND database = (SELECT oid FROM pg_database WHERE datname = current_database());
            RAISE object_in_use USING MESSAGE = format('table %s is being written by %s: stop it first', target,
                                                       coalesce(there, 'a writer that has just left'));
        END IF;
    END LOOP;
    -- All programs of libapc are called apc or apc-...; one that waits for an advisory lock is another apc init.
    SELECT string_agg(claimant(a.pid), '; ' ORDER BY a.application_name, a.pid) INTO there
      FROM pg_stat_activity AS a
     WHERE a.datname = current_database() AND a.pid <> pg_backend_pid()
       AND a.application_name ~ '^(lib)?apc($|[- ])'
       AND NOT EXISTS (SELECT FROM pg_locks AS l
                        WHERE l.pid = a.pid AND l.locktype = 'advisory' AND NOT l.granted);
    IF there IS NOT NULL THEN
        RAISE object_in_use USING MESSAGE = format('connected are %s: stop them first', there);
    END IF;
END
$do$;

-- ---- Modes ----------------------------------------------------------------------------------------------
-- A loop for each output of the one controller. Its target is what the controller's was; its actual mode so far is the
-- controller's. Names are those that `apc init FILE` gives as well.
CREATE TABLE migrating_loop AS
    SELECT i AS loop, coalesce((SELECT name FROM tag WHERE table_name = 'actuator' AND id = i), 'u' || i) AS name
      FROM generate_series(1, least(coalesce((SELECT value FROM dim_newest WHERE id = 3), 0), 65535)::integer) AS i;
DELETE FROM tag WHERE table_name = 'opmode' AND id = 1;
INSERT INTO tag (table_name, id, name, description, low, high, controller)
SELECT 'opmode', loop, CASE name WHEN 'mode' THEN 'mode.1' ELSE name END, -- mode is the tag of id 0
       'target mode: 0 Man, 1 Auto, 2 out of service, 3 Cas', 0, 3, 'controller'
  FROM migrating_loop ORDER BY loop;
INSERT INTO tag (table_name, id, name, description, low, high, controller)
SELECT 'actual', number, CASE WHEN (SELECT count(*) FROM migrating_loop) = 1 THEN 'mode.actual'
                              WHEN octet_length(name) > 51 THEN 'mode.actual.' || id ELSE name || '.mode.actual' END,
       'actual mode; besides 4 initialising, 5 at the fault value', 0, 5, controller
  FROM tag WHERE table_name = 'opmode' AND id IN (SELECT loop FROM migrating_loop) ORDER BY id;

INSERT INTO actual (id, seq, time, status, value)
SELECT t.number, row_number() OVER (PARTITION BY t.number ORDER BY o.seq), o.time, o.status, o.value
  FROM opmode AS o JOIN tag AS t ON t.table_name = 'opmode' AND t.id IN (SELECT loop FROM migrating_loop)
 WHERE o.id = 1;

-- The seqs of id 1 go on: who has seen its newest row must see that there is a newer one. But not beyond what a double
-- holds, should somebody have written such a seq.
CREATE TABLE migrating_target AS
    SELECT loop, CASE loop WHEN 1 THEN coalesce((SELECT seq FROM opmode_newest WHERE id = 1 AND
                                                 seq < 9007199254740991 - 1048576), 0) ELSE 0 END + 1 AS seq
      FROM migrating_loop;
DELETE FROM opmode WHERE id = 1;
DELETE FROM opmode_newest WHERE id = 1;
INSERT INTO opmode (id, seq, time, status, value, origin)
SELECT loop, t.seq, n.time, n.status, n.value, CASE WHEN n.seq < 9007199254740992 THEN n.seq END
  FROM migrating_target AS t, opmode_newest AS n WHERE n.id = 0 ORDER BY loop;
DROP TABLE migrating_target, migrating_loop;

COMMENT ON TABLE opmode IS
    'Targets and switches, written by operators. Ids 1 to 65535: target mode of that loop, 0 Man, 1 Auto, 2 out of service, 3 Cas; id 0: of all loops. From 65536 on: kind x 65536 + tag.number.';
COMMENT ON COLUMN actuator.sensor_seq IS 'In rows of version 1: seq of the measurement it was computed from.';
COMMENT ON COLUMN actuator.setpoint_seq IS 'In rows of version 1: seq of the setpoint it was computed from.';
COMMENT ON COLUMN actuator.origin IS 'seq of the tick that it comes from; NULL: none, or of version 1.';

-- ---- What a controller of version 1 resumed from ----------------------------------------------------------
DROP TRIGGER appended ON state;
DROP FUNCTION state_appended();
DROP TABLE state_newest;
DO $do$
BEGIN
    IF NOT EXISTS (SELECT FROM state) THEN
        DROP TABLE state;
        RETURN;
    END IF;
    ALTER TABLE state RENAME TO state_v1;
    COMMENT ON TABLE state_v1 IS
        'What controllers of version 1 resumed from; read by nobody. maintain() drops it when it is older than what is kept.';
END
$do$;

CREATE FUNCTION drop_state_v1(before timestamptz) RETURNS SETOF text LANGUAGE plpgsql AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM state_v1 WHERE time >= before) THEN
        DROP TABLE state_v1;
        RETURN NEXT 'state_v1';
    END IF;
END
$$;
COMMENT ON FUNCTION drop_state_v1(timestamptz) IS 'Drop what controllers of version 1 resumed from, when it is older than that.';
REVOKE ALL ON FUNCTION drop_state_v1(timestamptz) FROM PUBLIC;

CREATE OR REPLACE FUNCTION samples() RETURNS text[] LANGUAGE sql IMMUTABLE AS $$
    SELECT ARRAY['sensor', 'actuator', 'setpoint', 'dim', 'opmode', 'tuning', 'manual', 'actual', 'estimate', 'alarm',
                 'tick', 'plan', 'prediction']
$$;

-- ---- Functions, but for what was said in them for version 1 -----------------------------------------------
-- Their texts are those that 0003 made, so that nothing else in them changes; what is not found there is an error.
CREATE FUNCTION without(changed regprocedure, what text, instead text) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    old text := pg_get_functiondef(changed);
BEGIN
    IF position(what IN old) = 0 THEN
        RAISE 'function % is not that of 0003', changed;
    END IF;
    EXECUTE replace(old, what, instead);
END
$$;

-- A commit that notifies takes one lock for the whole server until it is durable: only what people write does it.
SELECT without(format('%I()', t || '_appended')::regprocedure, $what$
    IF risen > 0 THEN
        PERFORM pg_notify('apc_' || TG_RELID, '');
    END IF;$what$, '') FROM unnest(ARRAY['sensor', 'actuator', 'dim']) AS t;
SELECT without('opmode_appended()', ' AND (id <> 1 OR id IN (SELECT loops()))', '');
-- Rows that come from another store bring those of the loops along, under their own seqs.
SELECT without('opmode_appended()', 'IF EXISTS (SELECT FROM fresh WHERE id = 0)', $instead$IF
        current_setting('apc.as_is', true) IS DISTINCT FROM 'on' AND EXISTS (SELECT FROM fresh WHERE id = 0)$instead$);
SELECT without('opmode_vacant(integer[], bigint[])', what, '')
  FROM unnest(ARRAY[' AND (v <> 1 OR NOT is_person() OR v IN (SELECT loops()))',
                    ' AND (v.id <> 1 OR NOT is_person() OR v.id IN (SELECT loops()))']) AS what;
SELECT without('maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint, timestamptz)', $what$
        SELECT 3, format('DELETE FROM timing$what$, $instead$
        SELECT 3, format('SELECT * FROM drop_state_v1(%L)', samples_before)
         WHERE samples_before IS NOT NULL AND to_regclass('state_v1') IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM timing$instead$);
DROP FUNCTION without(regprocedure, text, text);

INSERT INTO migration (version, name, compatible_from) VALUES (4, '0004-loops', 4);
