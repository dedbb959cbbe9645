-- SPDX-License-Identifier: BSD-3-Clause
-- A repair of version 4: what a person writes to a setpoint that the scheduler moves makes it Local, as it does where a
-- controller moves it; and who gives a setpoint away, to either, is not taken at the row of it that he writes along.
-- It changes no table and locks none: a plant may run meanwhile, and programs made before it go on with it.

DO $do$
BEGIN
    -- A target or a switch that was written in the very transaction has been thought of: then it stays. One that was
    -- written in a savepoint of it is not seen to be, and the setpoint is Local.
    -- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not PUBLIC's; it
    -- executes no dynamic command.
    EXECUTE format($function$
CREATE OR REPLACE FUNCTION setpoint_local() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER
    SET search_path TO %1$I, pg_temp AS $$
DECLARE
    owner record;
    known record;
BEGIN
    IF TG_TABLE_SCHEMA <> '%1$s' OR TG_TABLE_NAME !~ '^setpoint(_rest|_[0-9]{8})?$' THEN
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
        IF known.own IS TRUE OR (CASE WHEN known.seq > 0 THEN known.value >= owner.remote ELSE owner.remote = 1 END) IS NOT TRUE THEN
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
$$ $function$, current_schema());
END
$do$;
