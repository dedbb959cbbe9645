# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# What the tests of outcomes share: a controller that does with a write what it is told to, in the database of the test.

# puppet_controller: provide for $work/fast.conf, and be its controller from here on
puppet_controller() {
  "$apc" init "$work/fast.conf" --store postgresql: >/dev/null
  sql "CREATE TABLE public.habit (is_now text); INSERT INTO public.habit VALUES ('takes');
       CREATE TABLE public.seen (seq bigint); INSERT INTO public.seen SELECT coalesce(max(seq), 0) FROM apc.setpoint WHERE id = 1"
  background puppet psql -Xqc "DO \$\$
    DECLARE habit text; n bigint := 0; z apc.setpoint%ROWTYPE; done bigint;
    BEGIN
      LOOP
        SELECT is_now INTO habit FROM public.habit;
        SELECT seq INTO done FROM public.seen;
        SELECT * INTO z FROM apc.setpoint WHERE id = 1 ORDER BY seq DESC LIMIT 1;
        IF habit <> 'gone' AND NOT (habit = 'dies' AND z.seq > done) THEN
          n := n + 1;
          INSERT INTO apc.tick VALUES (1, n, clock_timestamp(), 0, '{0}');
        END IF;
        IF z.seq > done AND habit IN ('takes', 'refuses', 'passes') THEN
          IF habit = 'passes' THEN
            INSERT INTO apc.setpoint (id, seq, time, status, value) VALUES (1, z.seq + 1, clock_timestamp(), 0, 13) RETURNING * INTO z;
          ELSIF habit = 'refuses' THEN
            INSERT INTO apc.event (time, severity, source, kind, text) VALUES (clock_timestamp(), 2, 'apc-controller', 'rejected', 'r = 12: the pump is off');
          END IF;
          INSERT INTO apc.actual (id, seq, time, status, value, origin)
            SELECT 19, coalesce(max(seq), 0) + 1, clock_timestamp(), CASE habit WHEN 'refuses' THEN 2147483648 ELSE 0 END,
              CASE habit WHEN 'refuses' THEN 10 ELSE z.value END, z.seq FROM apc.actual WHERE id = 19;
          UPDATE public.seen SET seq = z.seq;
        END IF;
        COMMIT;
        PERFORM pg_sleep(0.03);
      END LOOP;
    END \$\$"
  ticks() { [ "$(sql 'SELECT count(*) > 0 FROM apc.tick WHERE id = 1')" = t ]; }
  until_true 60 ticks
}
