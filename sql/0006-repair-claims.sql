-- SPDX-License-Identifier: BSD-3-Clause
-- A repair of version 4: claims where the owner of the tables is no superuser. The server shows such an owner neither
-- when the session of another role began nor its address, also where a function with his rights runs in that session:
-- claim_set() failed, and claimant() called everybody local.
-- It changes no table and locks none: a plant may run meanwhile, and programs made before it go on with it.

-- A value that is the session's own, and stays when its transaction is rolled back.
CREATE SEQUENCE session_began;
COMMENT ON SEQUENCE session_began IS 'When a session first claimed, in microseconds since 1970: currval() of that session. Kept by session_began().';

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
    'When this session began; where the server does not tell its owner, when it first asked. Tells it from a later one of the same number.';
REVOKE ALL ON FUNCTION session_began() FROM PUBLIC;

CREATE OR REPLACE FUNCTION claimant(pid integer) RETURNS text LANGUAGE sql STABLE AS $$
    SELECT coalesce((SELECT format('%s (server process %s%s)', coalesce(nullif(a.application_name, ''), a.usename), a.pid,
                                   CASE WHEN a.pid = pg_backend_pid()
                                        THEN coalesce(', client ' || host(inet_client_addr()), ', local client')
                                        WHEN a.backend_start IS NOT NULL -- else it is not for us to see
                                        THEN coalesce(', client ' || host(a.client_addr), ', local client') END)
                       FROM pg_stat_activity AS a WHERE a.pid = claimant.pid), 'a writer that has just left')
$$;

DO $do$
BEGIN
    -- As in 0003, but that the session is asked when it began. No caller turns it: writable() and samples() say which
    -- names become part of a command, and the server when the session began.
    EXECUTE format($function$
CREATE OR REPLACE FUNCTION claim_set(targets text[], ids integer[], OUT at bigint, OUT holder text, OUT last bigint[])
    LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
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
END
$do$;
