-- SPDX-License-Identifier: BSD-3-Clause
-- Least privilege: one group role for each kind of program, two for people who operate, one for who only looks. See sql/README.md for how to run it.
-- Harmless to repeat, once for each plant's schema, and to be repeated when the kind of the store in its catalogue has
-- changed (live or history) or a new version of the tables was made. Nobody but the owner deletes anything.
-- The groups are apc_plant, apc_client and so on. Plants that are to be kept apart have groups of their own: after
-- SET apc.roles TO 'line1' they are line1_plant, line1_client and so on, and the text below says line1_ for apc_.

DO $roles$
DECLARE
    prefix text := coalesce(nullif(current_setting('apc.roles', true), ''), 'apc');
BEGIN
    IF prefix !~ '^[a-z_][a-z0-9_]{0,51}$' OR prefix LIKE 'pg\_%' THEN -- pg_ is the server's; with _controller it is a name
        RAISE 'apc.roles is "%": expected a lower-case name of at most 52 letters, digits and _', prefix;
    END IF;
    EXECUTE replace($text$
DO $$
DECLARE
    name text;
BEGIN
    IF to_regclass('migration') IS NULL THEN
        RAISE 'no plant''s schema in the search_path: run apc init, then SET search_path TO apc';
    END IF;
    IF NOT EXISTS (SELECT FROM migration AS m WHERE m.name = '0001-baseline') THEN
        RAISE 'the plant''s schema is of before the baseline: run apc init first';
    END IF;
    FOREACH name IN ARRAY ARRAY['apc_plant', 'apc_client', 'apc_controller', 'apc_scheduler', 'apc_alarms',
                                'apc_historian', 'apc_operator', 'apc_engineer', 'apc_observer'] LOOP
        BEGIN
            EXECUTE format('CREATE ROLE %I NOLOGIN', name);
        EXCEPTION WHEN duplicate_object THEN
            NULL; -- from another plant's schema
        END;
        EXECUTE format('GRANT USAGE ON SCHEMA %I TO %I', current_schema(), name);
    END LOOP;
END
$$;

-- Everybody: is the schema there, how large is the plant, what is called what; tell what happened.
GRANT SELECT ON migration, dim, dim_newest, tag, catalogue
    TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator, apc_engineer,
    apc_observer;
GRANT INSERT (time, severity, source, kind, text, number, seq, author, class) ON event -- not role: nobody writes in
    -- another's name
    TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator, apc_engineer;
GRANT SELECT ON event, timing -- what may have been stored though no answer came is looked up, not written twice
    TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian;
REVOKE INSERT ON timing FROM apc_plant, apc_client, apc_controller, apc_scheduler;
GRANT INSERT (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, bin_count)
    ON timing TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian; -- not id: nobody
    -- takes the numbers to come
GRANT EXECUTE ON FUNCTION claim(text, integer), claim_set(text[], integer[]), claim_release(text[], integer[])
    TO apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian;
GRANT SELECT ON claim TO apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator, apc_engineer,
    apc_observer;
-- Not people, who never append.
GRANT EXECUTE ON FUNCTION absent(text, integer[], bigint[])
    TO apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian;
REVOKE EXECUTE ON FUNCTION absent(text, integer[], bigint[]) FROM apc_operator, apc_engineer;
-- What people write, others write too, each only where nobody was faster. The tables' own grants say who which.
GRANT EXECUTE ON FUNCTION setpoint_vacant(integer[], bigint[]), opmode_vacant(integer[], bigint[]),
    tuning_vacant(integer[], bigint[]), manual_vacant(integer[], bigint[]), author_number(text), loops()
    TO apc_controller, apc_scheduler, apc_historian, apc_operator, apc_engineer;
GRANT SELECT ON author TO apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator, apc_engineer, apc_observer;

GRANT SELECT ON actuator, actuator_newest TO apc_client;
GRANT SELECT ON sensor, actuator, setpoint, opmode, tuning, manual, actual, estimate, tick, plan TO apc_controller;
GRANT SELECT ON sensor_newest, actuator_newest, setpoint_newest, opmode_newest, tuning_newest, manual_newest,
    actual_newest, estimate_newest, tick_newest, plan_newest TO apc_controller;
GRANT SELECT ON setpoint, setpoint_newest, opmode, opmode_newest TO apc_scheduler;
GRANT SELECT ON sensor, actuator, setpoint, opmode, tuning, manual, actual, estimate, alarm, tick TO apc_alarms;
GRANT SELECT ON sensor_newest, actuator_newest, setpoint_newest, opmode_newest, tuning_newest, manual_newest,
    actual_newest, estimate_newest, alarm_newest, tick_newest TO apc_alarms;
GRANT SELECT ON sensor, actuator, setpoint, opmode, tuning, manual, actual, estimate, alarm, tick, plan,
    prediction, event, timing, request TO apc_historian, apc_operator, apc_engineer, apc_observer;
GRANT SELECT ON sensor_newest, actuator_newest, setpoint_newest, opmode_newest, tuning_newest, manual_newest,
    actual_newest, estimate_newest, alarm_newest, tick_newest, plan_newest, prediction_newest
    TO apc_historian, apc_operator, apc_engineer, apc_observer;
-- What is packed is read by who reads it unpacked.
GRANT SELECT ON actuator_packed, actuator_all TO apc_client;
GRANT SELECT ON setpoint_packed, setpoint_all TO apc_scheduler;
GRANT SELECT ON sensor_packed, sensor_all, actuator_packed, actuator_all, setpoint_packed, setpoint_all,
    actual_packed, actual_all, estimate_packed, estimate_all
    TO apc_controller, apc_alarms, apc_historian, apc_operator, apc_engineer, apc_observer;
GRANT EXECUTE ON FUNCTION unpack(bytea), unpack_column(bytea, integer, integer), eight_bytes(bytea, integer),
    double_of(bigint), bits_of(double precision), signal_called(text), trend(timestamptz, timestamptz, text[]),
    trend_bins(timestamptz, timestamptz, integer, text[])
    TO apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator, apc_engineer, apc_observer;

-- Chunks, of what it may write as rows (apc-historian --pack).
GRANT EXECUTE ON FUNCTION append_chunks(text, integer[], bigint[], bigint[], timestamptz[], timestamptz[], bigint[], bigint[],
    double precision[], double precision[], double precision[], double precision[], integer[], integer[], integer[], bytea,
    timestamptz[], bigint[], double precision[], bigint[]) TO apc_historian;

-- Who writes: in a live store each its own; of a history all but the owner's is the historian's, and people ask it.
REVOKE INSERT ON sensor, actuator, setpoint, dim, opmode, tuning, manual, actual, estimate, alarm, tick, plan,
    prediction, request FROM apc_client, apc_controller, apc_scheduler, apc_alarms, apc_historian, apc_operator,
    apc_engineer;
REVOKE INSERT (time, until, table_name, variable, value, author, reason) ON request FROM apc_operator, apc_engineer;
REVOKE UPDATE (seq, outcome) ON request FROM apc_historian;
REVOKE UPDATE (low, high, display_low, display_high) ON tag FROM apc_engineer;
DO $$
BEGIN
    IF (SELECT kind FROM catalogue ORDER BY revision DESC LIMIT 1) = 'history' THEN
        GRANT INSERT ON sensor, actuator, setpoint, dim, opmode, tuning, manual, actual, estimate, alarm, tick,
            plan, prediction TO apc_historian;
        GRANT INSERT (time, until, table_name, variable, value, author, reason) ON request
            TO apc_operator, apc_engineer;
        GRANT UPDATE (seq, outcome) ON request TO apc_historian;
    ELSE
        GRANT INSERT ON sensor TO apc_client;
        GRANT INSERT ON sensor, actuator, setpoint, manual, actual, estimate, tick, plan, prediction TO apc_controller;
        GRANT INSERT ON setpoint, plan TO apc_scheduler;
        GRANT INSERT ON alarm, actual, tick TO apc_alarms;
        GRANT INSERT ON setpoint, opmode, tuning, manual TO apc_operator, apc_engineer, apc_historian;
        GRANT INSERT ON tick TO apc_historian;
        GRANT UPDATE (low, high, display_low, display_high) ON tag TO apc_engineer;
    END IF;
END
$$;

-- Table opmode: who operates writes targets of loops that there are, switches, and from kind 10 on what waits for a second
-- person; an alarm is taken out of service (kind 5)
-- by an engineer.
ALTER TABLE opmode ENABLE ROW LEVEL SECURITY;
DROP POLICY IF EXISTS all_read ON opmode;
DROP POLICY IF EXISTS operator_target ON opmode;
DROP POLICY IF EXISTS engineer_target ON opmode;
CREATE POLICY all_read ON opmode FOR SELECT USING (true); -- who is granted SELECT
CREATE POLICY operator_target ON opmode FOR INSERT TO apc_operator
    WITH CHECK (id = 0 OR id BETWEEN 65536 AND 5 * 65536 - 1 OR id >= 10 * 65536 OR id IN (SELECT loops()));
CREATE POLICY engineer_target ON opmode FOR INSERT TO apc_engineer, apc_historian
    WITH CHECK (id = 0 OR id > 65535 OR id IN (SELECT loops()));
$text$, 'apc_', prefix || '_');
END
$roles$;
