-- SPDX-License-Identifier: BSD-3-Clause
-- Least privilege: one group role for each kind of program. See sql/README.md for how to run it. Harmless to
-- repeat, once for each plant's schema. Nobody but the owner may update or delete anything.

DO $$
DECLARE
    name text;
BEGIN
    IF to_regclass('migration') IS NULL THEN
        RAISE 'no plant''s schema in the search_path: run apc init, then SET search_path TO apc';
    END IF;
    FOREACH name IN ARRAY ARRAY['apc_plant', 'apc_client', 'apc_controller', 'apc_scheduler', 'apc_operator'] LOOP
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
GRANT SELECT ON migration, dim, dim_newest, tag TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_operator;
GRANT INSERT (time, severity, source, kind, text) ON event -- not role: nobody writes in another's name
    TO apc_plant, apc_client, apc_controller, apc_scheduler, apc_operator;
GRANT SELECT ON event -- a spool that drains looks up which are there already
    TO apc_plant, apc_client, apc_controller, apc_scheduler;
REVOKE INSERT ON timing FROM apc_plant, apc_client, apc_controller, apc_scheduler;
GRANT INSERT (time, task, quantity, period, missed, count, mean, sd, p50, p99, max, bin_low, bin_high, bin_count)
    ON timing TO apc_plant, apc_client, apc_controller, apc_scheduler; -- not id: nobody takes the numbers to come
GRANT EXECUTE ON FUNCTION claim(text, integer) TO apc_client, apc_controller, apc_scheduler;
-- Not the operator, who never appends: with it a transaction left open would lock the controller's row of opmode.
GRANT EXECUTE ON FUNCTION absent(text, integer[], bigint[]) TO apc_client, apc_controller, apc_scheduler;
REVOKE EXECUTE ON FUNCTION absent(text, integer[], bigint[]) FROM apc_operator;

GRANT INSERT ON sensor TO apc_client;
GRANT SELECT ON actuator, actuator_newest TO apc_client;

GRANT SELECT ON sensor, setpoint, opmode, tuning, manual, state TO apc_controller;
GRANT SELECT ON sensor_newest, setpoint_newest, opmode_newest, tuning_newest, manual_newest, state_newest
    TO apc_controller;
GRANT INSERT ON actuator, state, opmode TO apc_controller;

GRANT SELECT ON setpoint, setpoint_newest TO apc_scheduler;
GRANT INSERT ON setpoint TO apc_scheduler;

GRANT SELECT ON sensor, actuator, setpoint, opmode, tuning, manual, state, event, timing TO apc_operator;
GRANT SELECT ON sensor_newest, actuator_newest, setpoint_newest, opmode_newest, tuning_newest, manual_newest,
    state_newest TO apc_operator;
GRANT INSERT ON setpoint, opmode, tuning, manual TO apc_operator;

-- Table opmode has two writers, each with a row of its own: the operator's target and the controller's actual mode.
ALTER TABLE opmode ENABLE ROW LEVEL SECURITY;
DROP POLICY IF EXISTS all_read ON opmode;
DROP POLICY IF EXISTS operator_target ON opmode;
DROP POLICY IF EXISTS controller_actual ON opmode;
CREATE POLICY all_read ON opmode FOR SELECT USING (true); -- who is granted SELECT
CREATE POLICY operator_target ON opmode FOR INSERT TO apc_operator WITH CHECK (id = 0);
CREATE POLICY controller_actual ON opmode FOR INSERT TO apc_controller WITH CHECK (id = 1);
