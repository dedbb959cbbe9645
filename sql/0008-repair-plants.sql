-- SPDX-License-Identifier: BSD-3-Clause
-- A repair of version 4: several plants in one database, each with roles of its own (sql/roles.sql, apc.roles), and
-- sessions that a pooler hands from one program to the next.
-- It changes no table and locks none: a plant may run meanwhile, and programs made before it go on with it.

-- By what the roles may do, not by their names: a person writes setpoints and claims nothing.
CREATE OR REPLACE FUNCTION is_person() RETURNS boolean LANGUAGE plpgsql STABLE AS $$ -- not sql, which plans it at each call
BEGIN
    RETURN NOT pg_has_role(session_user, current_user, 'USAGE')
       AND coalesce((SELECT NOT bool_or(has_function_privilege(grantee, 'claim(text, integer)', 'EXECUTE'))
                       FROM pg_class AS c, aclexplode(c.relacl) AS a
                      WHERE c.oid = 'setpoint'::regclass AND a.privilege_type = 'INSERT'
                        AND a.grantee <> 0 AND a.grantee <> c.relowner -- 0: PUBLIC
                        AND pg_has_role(session_user, a.grantee, 'MEMBER')), false);
END
$$;

-- A session without the lock has claimed nothing yet: rows of its number are a former program's in the same session, whose
-- locks the pooler gave back (DISCARD ALL).
DO $do$
DECLARE
    claim_set text := pg_get_functiondef('claim_set(text[], integer[])'::regprocedure);
    mended text := replace(claim_set, 'AND started <> began;', 'AND (started <> began OR NOT is_claimant(pid));');
BEGIN
    ASSERT mended <> claim_set, 'claim_set() is that of 0006';
    EXECUTE mended;
END
$do$;
