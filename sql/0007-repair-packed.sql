-- SPDX-License-Identifier: BSD-3-Clause
-- Weeks that are complete can be packed: up to 1024 samples of one variable, whose seqs follow each other, are one row of
-- X_packed, and view X_all shows them as the rows that they were, with those of table X. It changes no table and locks
-- none, and nothing is packed until the owner asks for it (apc maintain --pack): a plant may run meanwhile, and programs
-- made before it go on with it, but find no row of a packed week in their history.

-- ---- What is in a chunk -----------------------------------------------------------------------------------
-- src/shareddata/pack.h says how it is made. These are for people: libapc asks for the chunks and unpacks them itself.
CREATE FUNCTION eight_bytes(data bytea, place integer) RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE AS $$
    SELECT ('x' || encode(substring(data FROM place + 1 FOR 8), 'hex'))::bit(64)::bigint
$$;
COMMENT ON FUNCTION eight_bytes(bytea, integer) IS 'The whole number at that place, from 0.';

CREATE FUNCTION double_of(bits bigint) RETURNS double precision LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE AS $$
DECLARE
    exponent integer := (bits >> 52) & 2047;
    fraction bigint := bits & 4503599627370495;
    size double precision := CASE exponent WHEN 0 THEN fraction ELSE fraction + 4503599627370496 END;
BEGIN
    IF size > 0 THEN
        exponent := greatest(exponent, 1) - 1075; -- in two steps, as neither may leave the range
        size := size * 2::double precision ^ (exponent / 2) * 2::double precision ^ (exponent - exponent / 2);
    END IF;
    RETURN CASE WHEN bits < 0 THEN -size ELSE size END;
END
$$;
COMMENT ON FUNCTION double_of(bigint) IS 'The number whose bits these are.';

CREATE FUNCTION bits_of(number double precision) RETURNS bigint LANGUAGE sql IMMUTABLE PARALLEL SAFE AS $$
    SELECT ('x' || encode(float8send(number), 'hex'))::bit(64)::bigint
$$;
COMMENT ON FUNCTION bits_of(double precision) IS 'The bits of a number.';

DO $do$
DECLARE
    target text;
    more text;
    said record;
BEGIN
    EXECUTE format($function$
CREATE FUNCTION unpack_column(data bytea, INOUT place integer, n integer, OUT x bigint[])
    LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path TO %1$I, pg_temp AS $$
DECLARE
    mode integer := get_byte(data, place);
    start bigint := 0;
    slope bigint := 0;
    length integer;
    base bigint;
    width integer;
    bits varbit;
    codes bigint[];
    step double precision;
    near double precision;
BEGIN
    place := place + 1;
    IF mode = 5 THEN
        near := double_of(eight_bytes(data, place));
        step := double_of(eight_bytes(data, place + 8));
        SELECT c.x, c.place INTO codes, place FROM unpack_column(data, place + 16, n) AS c;
        SELECT c.x, c.place INTO x, place FROM unpack_column(data, place, n) AS c;
        x := ARRAY(SELECT bits_of(near + step * k) + e FROM unnest(codes, x) WITH ORDINALITY AS v (k, e, i) ORDER BY i);
        RETURN;
    END IF;
    IF mode IN (1, 3, 4) THEN
        start := eight_bytes(data, place);
        place := place + 8;
    END IF;
    IF mode IN (1, 3) THEN
        slope := eight_bytes(data, place);
        place := place + 8;
    END IF;
    IF mode < 2 THEN
        x := ARRAY(SELECT start + i * slope FROM generate_series(0, n - 1) AS i ORDER BY i);
        RETURN;
    END IF;
    x := '{}';
    FOR done IN 0 .. n - 1 BY 128 LOOP
        length := least(128, n - done);
        base := eight_bytes(data, place);
        width := get_byte(data, place + 8);
        bits := ('x' || encode(substring(data FROM place + 10 FOR (length * width + 7) / 8), 'hex'))::varbit;
        place := place + 9 + (length * width + 7) / 8;
        x := x || ARRAY(SELECT base + CASE width WHEN 0 THEN 0 ELSE
                               (substring(bits FROM i * width + 1 FOR width)::bit(64) >> (64 - width))::bigint END
                          FROM generate_series(0, length - 1) AS i ORDER BY i);
    END LOOP;
    IF mode = 3 THEN
        x := ARRAY(SELECT start + ((i - 1) * slope >> 12) + v FROM unnest(x) WITH ORDINALITY AS u (v, i) ORDER BY i);
    ELSIF mode = 4 THEN
        x := ARRAY(SELECT start + sum(v) OVER (ORDER BY i)::bigint FROM unnest(x) WITH ORDINALITY AS u (v, i) ORDER BY i);
    END IF;
END
$$ $function$, current_schema());
    COMMENT ON FUNCTION unpack_column(bytea, integer, integer) IS 'A column of a chunk, and where the next one begins.';

    EXECUTE format($function$
CREATE FUNCTION unpack(data bytea)
    RETURNS TABLE (i integer, "time" timestamptz, status bigint, value double precision, origin bigint, author bigint,
                   sensor_seq bigint, setpoint_seq bigint)
    LANGUAGE plpgsql IMMUTABLE PARALLEL SAFE SET search_path TO %1$I, pg_temp AS $$
DECLARE
    n integer := get_byte(data, 1) * 256 + get_byte(data, 2);
    place integer := 3;
    c bigint[][];
    t bigint[]; s bigint[]; v bigint[]; o bigint[]; a bigint[]; p bigint[]; q bigint[];
BEGIN
    IF get_byte(data, 0) <> 1 THEN
        RAISE data_exception USING MESSAGE = format('a chunk of format %%s: upgrade the tables', get_byte(data, 0));
    END IF;
    SELECT u.x, u.place INTO t, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO s, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO v, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO o, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO a, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO p, place FROM unpack_column(data, place, n) AS u;
    SELECT u.x, u.place INTO q, place FROM unpack_column(data, place, n) AS u;
    RETURN QUERY
    SELECT k, timestamptz '2000-01-01 00:00:00+00' + t[k + 1] * interval '1 microsecond', s[k + 1], double_of(v[k + 1]),
           nullif(o[k + 1], 0), nullif(a[k + 1], 0), nullif(p[k + 1], 0), nullif(q[k + 1], 0)
      FROM generate_series(0, n - 1) AS k;
END
$$ $function$, current_schema());
    COMMENT ON FUNCTION unpack(bytea) IS 'The samples of a chunk, numbered from 0: its seqs begin at its first.';

    -- ---- Tables and views -----------------------------------------------------------------------------------
    FOREACH target IN ARRAY ARRAY['sensor', 'actuator', 'setpoint', 'actual', 'estimate'] LOOP
        EXECUTE format('CREATE TABLE %I (first bigint NOT NULL, last bigint NOT NULL, since timestamptz NOT NULL,'
                       ' until timestamptz NOT NULL, final bigint NOT NULL, worst bigint NOT NULL,'
                       ' lowest double precision NOT NULL, highest double precision NOT NULL,'
                       ' mean double precision NOT NULL, latest double precision NOT NULL, id integer NOT NULL,'
                       ' good integer NOT NULL, data bytea NOT NULL, PRIMARY KEY (id, last),'
                       ' CONSTRAINT last_not_before_first CHECK (first <= last))', target || '_packed');
        EXECUTE format('ALTER TABLE %I ALTER COLUMN data SET STORAGE EXTERNAL', target || '_packed'); -- it is compressed
        EXECUTE format('COMMENT ON TABLE %I IS %L', target || '_packed',
                       format('Chunks of table %s: samples of one variable whose seqs are first to last. Made by apc maintain --pack.', target));
        FOR said IN SELECT * FROM (VALUES
            ('first', 'seq of its first sample.'), ('last', 'seq of its last sample.'),
            ('since', 'Earliest time of its samples.'), ('until', 'Latest time of its samples.'),
            ('final', 'seq of the last that is not Bad; 0: none.'), ('worst', 'Highest status of all.'),
            ('lowest', 'Least value of those not Bad; 0: none.'), ('highest', 'Greatest value of those not Bad; 0: none.'),
            ('mean', 'Mean of those not Bad; 0: none.'), ('latest', 'Value of seq final; 0: none.'),
            ('id', 'Number of the variable.'), ('good', 'How many samples are not Bad.'), ('data', 'For unpack().'))
            AS v (name, comment)
        LOOP
            EXECUTE format('COMMENT ON COLUMN %I.%I IS %L', target || '_packed', said.name, said.comment);
        END LOOP;
        more := CASE target WHEN 'actuator' THEN ', %1$s.sensor_seq, %1$s.setpoint_seq' ELSE '' END
                || ', %1$s.origin, %1$s.author';
        EXECUTE format('CREATE VIEW %I AS SELECT id, seq, time, status, value%s FROM %I AS s UNION ALL'
                       ' SELECT p.id, p.first + u.i, u.time, u.status, u.value%s'
                       ' FROM %I AS p CROSS JOIN LATERAL unpack(p.data) AS u',
                       target || '_all', format(more, 's'), target, format(more, 'u'), target || '_packed');
        EXECUTE format('COMMENT ON VIEW %I IS %L', target || '_all',
                       format('All rows of table %s, packed or not.', target));
        -- Who reads the rows may read them packed, and nobody else.
        FOR said IN SELECT DISTINCT grantee FROM pg_class, aclexplode(relacl)
                     WHERE oid = to_regclass(target) AND privilege_type = 'SELECT' AND grantee <> relowner LOOP
            EXECUTE format('GRANT SELECT ON %1$I, %2$I TO %3$s; GRANT EXECUTE ON FUNCTION unpack(bytea),'
                           ' unpack_column(bytea, integer, integer), eight_bytes(bytea, integer), double_of(bigint),'
                           ' bits_of(double precision) TO %3$s', target || '_packed', target || '_all',
                           CASE said.grantee WHEN 0 THEN 'PUBLIC' ELSE said.grantee::regrole::text END);
        END LOOP;
    END LOOP;
END
$do$;

-- ---- No seq twice -----------------------------------------------------------------------------------------
-- Texts of functions as they are, but that they look among what is packed as well; what is not found there is an error.
CREATE FUNCTION instead(changed regprocedure, what text, new text) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    old text := pg_get_functiondef(changed);
BEGIN
    IF position(what IN old) = 0 THEN
        RAISE 'function % is not that of the versions before', changed;
    END IF;
    EXECUTE replace(old, what, new);
END
$$;

-- Both have the owner's rights. No caller turns them: the names are those of samples() still, and the table of chunks is
-- looked for in the plant's schema, where only the owner makes any.
SELECT instead(format('%I()', t || '_appended')::regprocedure,
               format('(SELECT id, seq FROM %I WHERE id = f.id AND seq = f.seq LIMIT 2)', t),
               format('(SELECT id, seq FROM %I WHERE id = f.id AND seq = f.seq UNION ALL'
                      ' SELECT p.id, f.seq FROM (SELECT id, first FROM %I WHERE id = f.id AND last >= f.seq'
                      ' ORDER BY last LIMIT 1) AS p WHERE p.first <= f.seq LIMIT 2)', t, t || '_packed'))
  FROM unnest(ARRAY['sensor', 'actuator', 'setpoint', 'actual', 'estimate']) AS t;
SELECT instead('absent(text, integer[], bigint[])',
               $what$s.seq = v.seq) GROUP BY v.id, v.seq', target) USING ids, seqs;$what$,
               $new$s.seq = v.seq)' || CASE WHEN to_regclass(quote_ident(target || '_packed')) IS NULL THEN '' ELSE format(
        ' AND (SELECT p.first <= v.seq FROM %I AS p WHERE p.id = v.id AND p.last >= v.seq ORDER BY p.last LIMIT 1)'
        ' IS NOT TRUE', target || '_packed') END || ' GROUP BY v.id, v.seq', target) USING ids, seqs;$new$);

-- ---- Packing ----------------------------------------------------------------------------------------------
-- For the owner: apc maintain --pack. It reads a week while others use it, makes chunks of it, and drops it, in one
-- transaction. What is written to the week meanwhile, by a clock that is wrong or a spool that is late, leaves a word
-- in table late; then the week stays as it is until the next time.
CREATE TABLE late (partition name NOT NULL);
COMMENT ON TABLE late IS 'Partitions that are being packed, once for each row that was written to them meanwhile.';
COMMENT ON COLUMN late.partition IS 'Name of the partition.';

DO $do$
BEGIN
    -- No caller turns it: it is the trigger of tables of this schema, which only the owner makes, and not PUBLIC's; it
    -- executes no dynamic command, and what it writes is the name of its table.
    EXECUTE format($function$
CREATE FUNCTION note_late() RETURNS trigger LANGUAGE plpgsql SECURITY DEFINER SET search_path TO %1$I, pg_temp AS $$
BEGIN
    IF TG_TABLE_SCHEMA <> '%1$s' OR TG_TABLE_NAME !~ '_[0-9]{8}$' THEN
        RAISE insufficient_privilege USING MESSAGE = 'note_late() is the trigger of weeks that are being packed only';
    END IF;
    INSERT INTO late VALUES (TG_TABLE_NAME);
    RETURN NULL;
END
$$ $function$, current_schema());
END
$do$;

CREATE FUNCTION packable(before timestamptz) RETURNS TABLE (target text, partition text) LANGUAGE sql STABLE AS $$
    SELECT p.relname::text, c.relname::text
      FROM pg_class AS p JOIN pg_inherits ON inhparent = p.oid JOIN pg_class AS c ON c.oid = inhrelid
     WHERE p.relnamespace = to_regnamespace(quote_ident(current_schema()))
       AND p.relname IN ('sensor', 'actuator', 'setpoint', 'actual', 'estimate')
       AND CASE WHEN c.relname ~ format('^%s_[0-9]{8}$', p.relname) -- first: what else there is has no date
                THEN (to_date(right(c.relname, 8), 'YYYYMMDD') + 7)::timestamp AT TIME ZONE 'UTC' <= before END
     ORDER BY right(c.relname, 8), p.relname
$$;
COMMENT ON FUNCTION packable(timestamptz) IS 'Weeks that ended by then and are not packed.';

-- Waits a fifth of a second at a time, because writers would wait behind it.
CREATE FUNCTION pack_lock(tables text, mode text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    PERFORM set_config('lock_timeout', '200ms', true);
    FOR try IN 1 .. 50 LOOP
        BEGIN
            EXECUTE format('LOCK TABLE %s IN %s MODE', tables, mode);
            RETURN;
        EXCEPTION
            WHEN lock_not_available THEN
                PERFORM pg_sleep(0.05);
            WHEN undefined_table THEN
                RAISE serialization_failure USING MESSAGE = 'somebody else has packed or dropped it meanwhile';
        END;
    END LOOP;
    RAISE serialization_failure USING MESSAGE = 'it is in use without a pause, or somebody else packs it: it stays as it is';
END
$$;
COMMENT ON FUNCTION pack_lock(text, text) IS 'Lock tables, named by %I, or fail with serialization_failure.';

-- From here on a row that is written to the week is noticed.
CREATE FUNCTION pack_begin(partition text) RETURNS void LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pack_lock(quote_ident(partition), 'SHARE ROW EXCLUSIVE');
    IF NOT EXISTS (SELECT FROM pg_trigger WHERE tgrelid = to_regclass(quote_ident(partition)) AND tgname = 'late') THEN
        EXECUTE format('CREATE TRIGGER late AFTER INSERT ON %I FOR EACH ROW EXECUTE FUNCTION note_late()', partition);
    END IF;
    DELETE FROM late AS l WHERE l.partition = pack_begin.partition;
END
$$;
COMMENT ON FUNCTION pack_begin(text) IS 'The first transaction of packing a week: notice what comes late from now on.';

-- What stays rows, because too few seqs follow each other, goes where rows of no week are. Two maintainers exclude each
-- other by pack_lock(partition, SHARE UPDATE EXCLUSIVE), with which the second transaction begins.
CREATE FUNCTION pack_end(target text, partition text, ids integer[], firsts bigint[], lasts bigint[]) RETURNS bigint
    LANGUAGE plpgsql AS $$
DECLARE
    stayed bigint;
BEGIN
    PERFORM pack_lock(format('ONLY %I, %I, %I', target, partition, target || '_rest'), 'ACCESS EXCLUSIVE');
    IF EXISTS (SELECT FROM late AS l WHERE l.partition = pack_end.partition) THEN
        RAISE serialization_failure USING MESSAGE = 'rows were written to it while it was being packed: it stays as it is';
    END IF;
    EXECUTE format('ALTER TABLE %I DETACH PARTITION %I', target, partition);
    EXECUTE format('INSERT INTO %I SELECT s.* FROM unnest($1, $2, $3) AS r (id, first, last) JOIN %I AS s'
                   ' ON s.id = r.id AND s.seq BETWEEN r.first AND r.last', target || '_rest', partition)
      USING ids, firsts, lasts;
    GET DIAGNOSTICS stayed = ROW_COUNT;
    EXECUTE format('DROP TABLE %I', partition);
    RETURN stayed;
END
$$;
COMMENT ON FUNCTION pack_end(text, text, integer[], bigint[], bigint[]) IS
    'The last statement of packing a week: it goes, but for the rows of these runs; how many these are.';

-- As drop_week() does: but not the newest sample of any variable.
CREATE FUNCTION drop_packed(target text, before timestamptz) RETURNS SETOF bigint LANGUAGE plpgsql AS $$
BEGIN
    RETURN QUERY EXECUTE format(
        'WITH gone AS (DELETE FROM %1$I WHERE until < $1 RETURNING id, first, last),'
        ' kept AS (INSERT INTO %2$I (id, seq, time, status, value, origin, author%4$s)'
        ' SELECT n.id, n.seq, n.time, n.status, n.value, n.origin, n.author%5$s FROM %3$I AS n JOIN gone'
        ' ON n.id = gone.id AND n.seq BETWEEN gone.first AND gone.last) SELECT last FROM gone',
        target || '_packed', target || '_rest', target || '_newest',
        CASE target WHEN 'actuator' THEN ', sensor_seq, setpoint_seq' ELSE '' END,
        CASE target WHEN 'actuator' THEN ', n.sensor_seq, n.setpoint_seq' ELSE '' END) USING before;
END
$$;
COMMENT ON FUNCTION drop_packed(text, timestamptz) IS 'Drop chunks that ended before, but not the newest sample of any variable.';

SELECT instead('maintain(timestamptz, timestamptz, timestamptz, timestamptz, bigint, timestamptz)', $what$
        SELECT 3, format('DELETE FROM event WHERE$what$, $new$
        SELECT 3, format('SELECT * FROM drop_packed(%L, %L)', name, before)
          FROM parts WHERE before IS NOT NULL AND to_regclass(quote_ident(name || '_packed')) IS NOT NULL
        UNION ALL
        SELECT 3, format('DELETE FROM event WHERE$new$);
DROP FUNCTION instead(regprocedure, text, text);

REVOKE ALL ON FUNCTION unpack(bytea), unpack_column(bytea, integer, integer), eight_bytes(bytea, integer),
    double_of(bigint), bits_of(double precision), note_late(), packable(timestamptz), pack_lock(text, text), pack_begin(text),
    pack_end(text, text, integer[], bigint[], bigint[]), drop_packed(text, timestamptz) FROM PUBLIC;
