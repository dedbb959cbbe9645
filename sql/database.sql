-- SPDX-License-Identifier: BSD-3-Clause
-- For a database that serves plants and nothing else: as a superuser, after sql/roles.sql, with a plant's schema first
-- in the search_path and apc.roles set as for it. Harmless to repeat, once for each plant. Only the plants' programs
-- connect, nobody but the owner makes temporary objects or takes advisory locks (the claims are such): programs do so through claim(), which has the owner's rights.

DO $$
DECLARE
    prefix text := coalesce(nullif(current_setting('apc.roles', true), ''), 'apc');
    owner regrole := (SELECT relowner FROM pg_class WHERE oid = 'migration'::regclass);
    command text;
BEGIN
    FOR command IN -- names of the server's own catalogue, quoted by %I, regrole and regprocedure
        SELECT format('REVOKE ALL ON DATABASE %I FROM PUBLIC', current_database())
        UNION ALL
        SELECT format('GRANT CONNECT ON DATABASE %I TO %s', current_database(), rolname::regrole)
          FROM pg_roles WHERE rolname IN (SELECT prefix || '_' || kind FROM unnest(ARRAY['plant', 'client', 'controller',
                                            'scheduler', 'alarms', 'historian', 'operator', 'engineer',
                                            'observer']) AS kind)
        UNION ALL
        SELECT format('GRANT CONNECT, CREATE ON DATABASE %I TO %s', current_database(), owner)
        UNION ALL
        SELECT 'REVOKE CREATE ON SCHEMA public FROM PUBLIC' WHERE to_regnamespace('public') IS NOT NULL
        UNION ALL
        SELECT format('REVOKE ALL ON FUNCTION %s FROM PUBLIC; GRANT EXECUTE ON FUNCTION %1$s TO %s',
                      oid::regprocedure, owner)
          FROM pg_proc WHERE pronamespace = 'pg_catalog'::regnamespace AND proname ~ '^pg_(try_)?advisory_'
    LOOP
        EXECUTE command;
    END LOOP;
END
$$;
