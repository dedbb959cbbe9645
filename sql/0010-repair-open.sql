-- SPDX-License-Identifier: BSD-3-Clause
-- An addition to version 4: the historian may write several samples of a variable as one chunk (apc-historian --pack),
-- into a table of the week that is open. X_open_YYYYMMDD inherits X_packed, so whoever reads chunks reads these too.
-- When its week is packed, small chunks become large ones and the table goes.
-- It changes no table and locks none, and no chunk is written until a historian is told to: a plant may run meanwhile,
-- and programs made before it go on with it.

CREATE FUNCTION make_open(target text, partition text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    EXECUTE format('CREATE TABLE %I (PRIMARY KEY (id, last)) INHERITS (%I)', partition, target || '_packed');
    EXECUTE format('COMMENT ON TABLE %I IS %L', partition,
                   format('Small chunks of table %s, in the week that they came in. Written by apc-historian --pack.', target));
    EXECUTE format('ALTER TABLE %I OWNER TO %s', partition, -- it may be a superuser who writes
                   (SELECT relowner::regrole FROM pg_class WHERE oid = to_regclass(quote_ident(target))));
END
$$;
COMMENT ON FUNCTION make_open(text, text) IS 'The table of small chunks of a week.';

-- All or none. What needs a closer look, because it is not newer than all that is there or comes from a clock or a count
-- that is ahead, is refused as if it were there already: its writer sends it again as rows, and their trigger looks.
--
-- What is in a chunk cannot be looked at here at a price: its writer answers for it. So what people write stays rows.
DO $do$
BEGIN
    -- No caller turns it: writable() and the list say which names become part of a command, and the server which week it
    -- is; the table of newest values and the chunks are those of the plant's schema, where only the owner makes any.
    EXECUTE format($function$
CREATE FUNCTION append_chunks(target text, ids integer[], firsts bigint[], lasts bigint[], sinces timestamptz[],
                              untils timestamptz[], finals bigint[], worsts bigint[], lowests double precision[],
                              highests double precision[], means double precision[], latests double precision[],
                              goods integer[], starts integer[], lengths integer[], data bytea, times timestamptz[],
                              statuses bigint[], numbers double precision[], origins bigint[])
    RETURNS bigint LANGUAGE plpgsql VOLATILE SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
DECLARE
    opened text := target || to_char(date_trunc('week', now() AT TIME ZONE 'UTC'), '"_open_"YYYYMMDD');
    ahead bigint := least(9007199254740991,
                          greatest(1099511627776, 1048576 * extract(epoch FROM now() - '2020-01-01 00:00:00+00')::bigint));
    risen bigint;
BEGIN
    PERFORM writable(target);
    IF target NOT IN ('sensor', 'actuator', 'actual', 'estimate') THEN
        RAISE invalid_parameter_value USING MESSAGE = format('%%s is not written in chunks', target);
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
        RAISE check_violation USING MESSAGE = format('what comes as chunks of table %%s is none', target);
    END IF;
    IF (SELECT max(s) FROM unnest(lasts) AS s) > ahead
       OR (SELECT max(t) FROM unnest(untils) AS t) > now() + interval '1 day' THEN
        RAISE unique_violation USING MESSAGE = format('%%s: chunks of a clock or a count that is ahead', target);
    END IF;
    EXECUTE format('INSERT INTO %%I AS n (id, seq, time, status, value, origin, previous)'
                   ' SELECT id, last, time, status, value, origin, first - 1 FROM unnest($1, $2, $3, $4, $5, $6, $7)'
                   ' AS v (id, last, time, status, value, origin, first) ORDER BY id ON CONFLICT (id) DO UPDATE SET previous = n.seq, (seq, time, status, value, origin, author)'
                   ' = (excluded.seq, excluded.time, excluded.status, excluded.value, excluded.origin, NULL)'
                   ' WHERE n.seq <= excluded.previous', target || '_newest')
      USING ids, lasts, times, statuses, numbers, origins, firsts;
    GET DIAGNOSTICS risen = ROW_COUNT;
    IF risen < cardinality(ids) THEN
        RAISE unique_violation USING MESSAGE = format('%%s: chunks that are not newer than what is there', target);
    END IF;
    IF to_regclass(quote_ident(opened)) IS NULL THEN
        PERFORM make_open(target, opened);
    END IF;
    EXECUTE format('INSERT INTO %%I (id, first, last, since, until, final, worst, lowest, highest, mean, latest, good, data)'
                   ' SELECT id, first, last, since, until, final, worst, lowest, highest, mean, latest, good,'
                   ' substring($15 FROM start FOR length)'
                   ' FROM unnest($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14) AS v (id, first, last, since,'
                   ' until, final, worst, lowest, highest, mean, latest, good, start, length)', opened)
      USING ids, firsts, lasts, sinces, untils, finals, worsts, lowests, highests, means, latests, goods, starts, lengths,
            data;
    RETURN risen;
END
$$ $function$, current_schema());
    COMMENT ON FUNCTION append_chunks(text, integer[], bigint[], bigint[], timestamptz[], timestamptz[], bigint[], bigint[],
        double precision[], double precision[], double precision[], double precision[], integer[], integer[], integer[],
        bytea, timestamptz[], bigint[], double precision[], bigint[]) IS
        'Append chunks, one a variable, each with its place in data and its last sample. Those that are not newer than what is there: unique_violation.';
END
$do$;

-- ---- Packing them -------------------------------------------------------------------------------------------
-- As in 0007; and of a week's small chunks. Which there are is not said by packable(): programs made before this file could
-- not read them.
CREATE OR REPLACE FUNCTION pack_end(target text, partition text, ids integer[], firsts bigint[], lasts bigint[])
    RETURNS bigint LANGUAGE plpgsql AS $$
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

-- As in 0007, but that the week of what stays may be there still.
CREATE OR REPLACE FUNCTION drop_packed(target text, before timestamptz) RETURNS SETOF bigint LANGUAGE plpgsql AS $$
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

REVOKE ALL ON FUNCTION make_open(text, text), append_chunks(text, integer[], bigint[], bigint[], timestamptz[],
    timestamptz[], bigint[], bigint[], double precision[], double precision[], double precision[], double precision[],
    integer[], integer[], integer[], bytea, timestamptz[], bigint[], double precision[], bigint[]) FROM PUBLIC;
