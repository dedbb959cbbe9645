# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# What the tests of writes share: the front ends of the plant in $work/fast.conf, and a controller that does with a write what it is
# told to, in the database of the test.

# asked N TABLE FRONT-END [ARGUMENT...]: so many rows of the table can be asked there; by the Python of python_user, if that was made
asked() {
  local n
  n=$("${user:+$user/bin/}python3" "$APC_SOURCE_DIR/tests/system/bad_writes.py" "$APC_SOURCE_DIR/tests/system/$2.txt" "${@:3}") || exit 1
  [ "$n" = "$1" ] || fail "$3: $n rows of $2 were asked instead of $1"
}

# confirms: a great step of r in $work/fast.conf, where it stays at 10, has to be confirmed, and each takes two persons
confirms() { sed -i -e 's/^setpoints *= ( { /&confirm = 15.0; second_person = 300.0; /' -e 's/sequence = (.*);/sequence = ( [10.0] );/' "$work/fast.conf"; }

# page_of STORE: a page, whose port is in $page and process in $page_pid, with the tokens $engineer and $observer
page_of() {
  printf 'apc-password\n' | "$apc" user add eve --users "$work/page" >/dev/null
  engineer=$("$apc" user token anna --role engineer --users "$work/page")
  observer=$("$apc" user token otto --users "$work/page")
  background page "$APC_BIN/apc-ui" --config "$work/fast.conf" --store "$1" --listen 127.0.0.1:0 --users "$work/page"
  page_pid=$pid
  until_true 60 grep -q 'serving http' "$work/page.log"
  page=$(sed -n 's/.*serving http:\/\/[^ ]*:\([0-9]*\) .*/\1/p' "$work/page.log")
  knows() {
    python3 -c 'import sys, urllib.request as u; sys.exit(b"tau_i" not in u.urlopen(u.Request(sys.argv[1], headers={"Authorization": sys.argv[2]})).read())' \
      "http://127.0.0.1:$page/api/plant" "Bearer $engineer"
  }
  until_true 60 knows
}

# broker_of STORE: a broker at port $broker, whose users anna and otto write; $work/outcomes.log has what became of it. False where
# there is none here.
broker_of() {
  command -v mosquitto mosquitto_sub mosquitto_pub >/dev/null && "$APC_BIN/apc-mqtt" --help | grep -q -- --store || return 1
  broker=$(free_port)
  printf '%s\n' "listener $broker 127.0.0.1" 'allow_anonymous true' >"$work/mosquitto.conf"
  background mosquitto mosquitto -c "$work/mosquitto.conf"
  listens() { (exec 3<>"/dev/tcp/127.0.0.1/$broker"); }
  until_true 20 listens
  local who signal allowed=()
  for who in anna:operator otto:observer; do
    printf 'apc-password\n' | "$apc" user add "${who%:*}" --role "${who#*:}" --users "$work/users" >/dev/null
  done
  background heard mosquitto_sub -p "$broker" -q 1 -t 'works/#' -F '%t %p'
  for signal in q setpoint.9 r u u.mode q.mode; do allowed+=(--allow "$signal"); done
  background mqtt "$APC_BIN/apc-mqtt" --broker "mqtt://127.0.0.1:$broker" --topic works/fast --config "$work/fast.conf" \
    --store "$1" --queue "sqlite:$work/mqtt.db" --users "$work/users" "${allowed[@]}"
  until_true 60 grep -q 'works/fast/status {"state":"online"' "$work/heard.log"
  background outcomes mosquitto_sub -p "$broker" -q 1 -t 'works/fast/outcome/#' -F '%t %p'
  answered() {
    mosquitto_pub -p "$broker" -t works/fast/command/anna/nonsense -m 1
    [ -s "$work/outcomes.log" ]
  }
  until_true 30 answered
}

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
