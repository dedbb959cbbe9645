-- SPDX-License-Identifier: BSD-3-Clause
-- An addition to version 4: trend() gives what signals were in a span of time, by their names, and trend_bins() sums it up
-- for a chart. View X_all unpacks all chunks of a variable, whatever time is asked for; these unpack those only which reach
-- into the span, and trend_bins() none that is short beside a bin.
-- It changes no table and locks none: a plant may run meanwhile, and programs made before it go on with it.

-- All three have their caller's rights. Of what he gives nothing becomes part of a command but the name of a table, which
-- table tag has; its own constraint says which there may be.
DO $do$
DECLARE
    reader oid;
BEGIN
    EXECUTE format($function$
CREATE FUNCTION signal_called(asked text, OUT target text, OUT variable integer)
    LANGUAGE plpgsql STABLE SET search_path TO %1$I, pg_temp AS $$
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
        RAISE undefined_object USING MESSAGE = format('no signal is called %%s', quote_nullable(asked)),
                                     HINT = 'SELECT table_name, name FROM tag says which there are.';
    ELSIF cardinality(meant) > 1 THEN
        RAISE undefined_object USING MESSAGE = format('%%s signals are called %%s: say %%s', cardinality(meant),
                                                      quote_nullable(asked), array_to_string(meant, ' or '));
    END IF;
END
$$ $function$, current_schema());

    EXECUTE format($function$
CREATE FUNCTION trend(since timestamptz, until timestamptz, VARIADIC signals text[])
    RETURNS TABLE ("time" timestamptz, signal text, value double precision, status bigint, seq bigint)
    LANGUAGE plpgsql STABLE SET search_path TO %1$I, pg_temp AS $$
DECLARE
    asked text;
    s record;
BEGIN
    FOREACH asked IN ARRAY signals LOOP
        SELECT * INTO s FROM signal_called(asked);
        RETURN QUERY EXECUTE format(
            'SELECT r.time, $4, CASE WHEN r.status < 2147483648 THEN r.value END, r.status, r.seq FROM'
            ' (SELECT time, value, status, seq FROM %%I WHERE id = $1 AND time >= $2 AND time < $3%%s) AS r ORDER BY r.seq',
            s.target, CASE WHEN to_regclass(s.target || '_packed') IS NULL THEN '' ELSE format(
            ' UNION ALL SELECT u.time, u.value, u.status, p.first + u.i'
            ' FROM (SELECT first, data FROM %%I WHERE id = $1 AND until >= $2 AND since < $3) AS p'
            ' CROSS JOIN LATERAL unpack(p.data) AS u WHERE u.time >= $2 AND u.time < $3', s.target || '_packed') END)
           USING s.variable, since, until, asked;
    END LOOP;
END
$$ $function$, current_schema());

    -- A chunk that is shorter than four bins counts as a whole for the bin in which it begins: so each row says from when to
    -- when it is, and what it says of that time is exact.
    EXECUTE format($function$
CREATE FUNCTION trend_bins(since timestamptz, until timestamptz, bins integer, VARIADIC signals text[])
    RETURNS TABLE ("time" timestamptz, till timestamptz, signal text, samples bigint, bad bigint,
                   lowest double precision, mean double precision, highest double precision)
    LANGUAGE plpgsql STABLE SET search_path TO %1$I, pg_temp AS $$
DECLARE
    asked text;
    s record;
    width interval;
BEGIN
    IF (isfinite(since) AND isfinite(until) AND since < until AND bins BETWEEN 1 AND 100000) IS NOT TRUE THEN
        RAISE invalid_parameter_value
        USING MESSAGE = format('%%s bins from %%s to %%s: expected 1 to 100000, from a time to a later one', bins, since, until);
    END IF;
    width := (until - since) / bins;
    FOREACH asked IN ARRAY signals LOOP
        SELECT * INTO s FROM signal_called(asked);
        RETURN QUERY EXECUTE format(
            'SELECT min(b.since), max(b.until), $4, sum(b.samples)::bigint, sum(b.samples - b.good)::bigint,'
            ' min(b.lowest) FILTER (WHERE b.good > 0), sum(b.mean * b.good) / nullif(sum(b.good), 0),'
            ' max(b.highest) FILTER (WHERE b.good > 0) FROM (SELECT r.time AS since, r.time AS until, 1::bigint AS samples,'
            ' (r.status < 2147483648)::integer AS good, r.value AS lowest, r.value AS mean, r.value AS highest'
            ' FROM %%I AS r WHERE r.id = $1 AND r.time >= $2 AND r.time < $3%%s) AS b'
            ' GROUP BY floor(extract(epoch FROM b.since - $2) / extract(epoch FROM $5)) ORDER BY 1',
            s.target, CASE WHEN to_regclass(s.target || '_packed') IS NULL THEN '' ELSE format(
            ' UNION ALL SELECT p.since, p.until, p.last - p.first + 1, p.good, p.lowest, p.mean, p.highest FROM %%1$I AS p'
            ' WHERE p.id = $1 AND p.since >= $2 AND p.until < $3 AND p.until - p.since < 4 * $5'
            ' UNION ALL SELECT u.time, u.time, 1, (u.status < 2147483648)::integer, u.value, u.value, u.value'
            ' FROM (SELECT data FROM %%1$I AS c WHERE c.id = $1 AND c.until >= $2 AND c.since < $3'
            ' AND NOT (c.since >= $2 AND c.until < $3 AND c.until - c.since < 4 * $5)) AS p'
            ' CROSS JOIN LATERAL unpack(p.data) AS u WHERE u.time >= $2 AND u.time < $3', s.target || '_packed') END)
           USING s.variable, since, until, asked, width;
    END LOOP;
END
$$ $function$, current_schema());

    -- Who reads what is packed.
    FOR reader IN SELECT grantee FROM pg_proc, aclexplode(proacl)
                   WHERE oid = 'unpack(bytea)'::regprocedure AND grantee NOT IN (0, proowner) LOOP
        EXECUTE format('GRANT EXECUTE ON FUNCTION signal_called(text), trend(timestamptz, timestamptz, text[]),'
                       ' trend_bins(timestamptz, timestamptz, integer, text[]) TO %s', reader::regrole);
    END LOOP;
END
$do$;
COMMENT ON FUNCTION signal_called(text) IS 'Table and id of the signal of that name, or TABLE.ID; or an error.';
COMMENT ON FUNCTION trend(timestamptz, timestamptz, text[]) IS
    'Samples of signals from a time on and before another, packed or not: one signal after the other, each by seq. A value that is Bad is NULL.';
COMMENT ON FUNCTION trend_bins(timestamptz, timestamptz, integer, text[]) IS
    'The same summed up in at most so many rows a signal. Each says from when to when it is; a chunk that is shorter than four bins is in one as a whole.';
REVOKE ALL ON FUNCTION signal_called(text), trend(timestamptz, timestamptz, text[]),
    trend_bins(timestamptz, timestamptz, integer, text[]) FROM PUBLIC;
