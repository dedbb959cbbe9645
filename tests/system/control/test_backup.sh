# SPDX-License-Identifier: BSD-3-Clause
# A law that answers as it is told, and its backup law, in real time: shed, killed while shed, and back.
# Promise(modes/law-act-gives)
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cat >"$work/moody.c" <<'EOF'
#include <apccontrol.h>
#include <string.h>
static const struct apc_param tuning[] = {{"Kp", "", "", 0.2, -10.0, 10.0}, {"mood", "", "", 0.0, 0.0, 4.0}};
static size_t n_state(const struct apc_dim *d) { (void)d; return 1; }
static int compute(struct apc_law_call *c)
{
    c->u[0] = c->tuning[0] * (c->z[0] - c->y[0]) + c->x[0];
    if (c->tuning[1] > 0)
        strcpy(c->why, "is in no mood");
    return (int)c->tuning[1];
}
static void track(struct apc_law_call *c) { c->x[0] = c->u[0] - c->tuning[0] * (c->z[0] - c->y[0]); }
static void update(struct apc_law_call *c) { track(c); c->x[0] += 0.04 * (c->z[0] - c->y[0]); }
APC_LAW_EXPORT(.name = "moody", .n_tuning = 2, .tuning = tuning, .n_state = n_state, .compute = compute,
               .update = update, .track = track);
EOF
"${CC:-cc}" -shared -fPIC -I"$APC_SOURCE_DIR/include" -o "$work/moody.so" "$work/moody.c"
cat >"$work/backup.conf" <<CONF
name = "backup"; duration = 600.0;
measurements = ( { name = "y"; unit = "V"; low = -100.0; high = 100.0; } );
setpoints = ( { name = "r"; unit = "V"; low = -100.0; high = 100.0; initial = 5.0; } );
outputs = ( { name = "u"; unit = "V"; low = -20.0; high = 20.0; } );
plant = { model = "first-order"; parameters = { tau = 1.0; }; period = 0.02; listen = "tcp:127.0.0.1:$port"; };
client = { period = 0.05; link = "tcp:127.0.0.1:$port"; };
controller = { law = "./moody.so"; period = 0.2; hold = 60.0; shed_after = 3;
               backup = { law = "pi"; tuning = ( { Kp = 0.2; tau_i = 1.0; } ); }; };
CONF
export APC_CONFIG=$work/backup.conf
"$apc" init "$work/backup.conf" >/dev/null
newest() { sql "SELECT $3 FROM apc.$1 WHERE id = $2 ORDER BY seq DESC LIMIT 1"; }
actual() { "$apc" mode u --json | grep -q "$1"; }
said() { [ "$(sql "SELECT count(*) FROM apc.event WHERE source = 'apc-controller' AND severity = $1 AND text LIKE '$2%'")" -ge 1 ]; }
near() { awk -v a="$1" -v b="$2" -v t="$3" 'BEGIN {d = a - b; exit !(d < t && d > -t)}'; }
settled() { near "$(newest sensor 1 value)" "$1" 0.02 && near "$(newest actuator 1 value)" "$(newest sensor 1 value)e-1" 0.005; }
background apc-plant "$APC_BIN/apc-plant" --store postgresql:
background apc-client "$APC_BIN/apc-client"
background apc-controller "$APC_BIN/apc-controller"
until_true 30 settled 5

backup='the backup law acts: law moody: is in no mood'
"$apc" tune mood=3 >/dev/null
until_true 20 actual "\"actual\":\"Auto\",\"reason\":\"$backup"
expect 0 "^mode +target Auto, actual Auto: $backup" "$apc" status
expect 0 '^r: the backup law acts$' "$apc" get r
expect 0 '"entry":{"code":"backup","text":"the backup law acts"}' "$apc" status --json
until_true 20 said 2 "$backup"
expect 0 'r: 5 -> 8 \(applied\)' "$apc" set r 8
until_true 30 settled 8
expect 0 'backup.Kp: 0.2 -> 0.3 \(applied\)' "$apc" tune backup.Kp=0.3
expect 4 'backup.Kp = 5000000000 lies outside its limits' "$apc" tune backup.Kp=5e9

# killed in it, it goes on in it
kill -9 "$pid"
seq=$(newest actuator 1 seq)
background apc-controller "$APC_BIN/apc-controller"
more() { [ "$(newest actuator 1 seq)" -gt "$1" ]; }
until_true 20 more $((seq + 5))
actual "$backup" || fail "it is not in Backup any more"
until_true 30 settled 8

"$apc" tune mood=0 >/dev/null
until_true 20 actual '"actual":"Auto","reason":null'
until_true 30 settled 8
sql "SELECT count(*) FROM (SELECT value - lag(value) OVER (ORDER BY seq) AS step FROM apc.actuator WHERE id = 1
     AND seq > $seq) AS s WHERE abs(step) > 0.3" | grep -qx 0 || fail "a bump"
until_true 20 said 1 'the law acts again after'
