# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# The table "What comes in" of docs/guarantees.md, a column of it, row by row: a plant gives what the row says, and status, loop,
# record and verdict are what the table says.

unset APC_STORE # each run has memory of its own
habits() { # WHAT: what the puppet calls what a row begins with
  case $1 in
    'a number well beyond '*) echo beyond ;;
    'not a number') echo nan ;;
    'infinite') echo inf ;;
    'a code for "no value"') echo code ;;
    'another type, such as text') echo text ;;
    'Bad') echo Bad ;;
    'Uncertain') echo Uncertain ;;
    'an error instead of an answer') echo refused ;;
    'no answer') echo silent ;;
    'a value at rest'*) echo rest ;;
    'a source time at rest'*) echo repeated ;;
    'a source time an hour ahead') echo ahead ;;
    'a source time an hour behind') echo behind ;;
    'a source time in 1970') echo 1970 ;;
    'no source time: '*) echo timeless ;;
    'each answer twice') echo twice ;;
    'more values than there are') echo more ;;
    "another request's answer") echo other ;;
    *) fail "no plant here gives \"$1\"" ;;
  esac
}
habit() { echo "$1" >"$work/habit.new" && mv "$work/habit.new" "$work/habit"; }
# newest VARIABLE [N]: its newest rows
newest() { "$apc" history "$1" --store "$out" --last "${2:-1}" --csv | tail -n +2; }
has_status() { newest "$1" | grep -q ",$2,"; }
good_since() { # TIME: the last five outputs are of later, and good
  local last
  last=$(newest u 5)
  [[ ${last%%,*} > $1 ]] && ! grep -vq ',Good,' <<<"$last"
}
controlled() { has_status y Good && has_status u Good; }
has_samples() { [ "$(newest y 6 | wc -l)" = 6 ]; }
recent() { # TIME: within a minute of now
  local apart=$(($(date +%s) - $(date -d "$1" +%s)))
  [ $apart -gt -60 ] && [ $apart -lt 60 ]
}

# comes_in COLUMN LINK [CLIENT]: a run for the rows of which the loop takes no notice, which ends with 0, and one for the others
comes_in() {
  local column=$1 link=$2 client=${3:-} loop what cell uses tried=0 status
  cat >"$work/in.all" <<END
name = "in"; duration = 60.0;
measurements = ( { name = "y"; low = -40.0; high = 150.0; } ); setpoints = ( { name = "r"; initial = 12.0; } );
outputs = ( { name = "u"; low = 0.0; high = 10.0; safe = 0.0; fault = 0.5; } );
plant = { external = true; };
client = { period = 0.1; link = "$link"; $client };
controller = { law = "pi"; period = 0.2; hold = @hold@; tuning = ( { Kp = 0.01; tau_i = 10.0; } ); };
END
  for loop in 'goes on' 'goes without'; do
    out=$work/${column// /-}-${loop#goes }
    # a loop that goes on is not opened by a busy machine; one that goes without is waited for
    sed "s/@hold@/$([ "$loop" = 'goes on' ] && echo 10.0 || echo 1.0)/" "$work/in.all" >"$work/in.conf"
    habit well
    background "${out##*/}" "$apc" run "$work/in.conf" --duration 0 --no-ui --out "$out"
    until_true 60 controlled
    while IFS='|' read -r what cell uses; do
      [ "$uses" = "$loop" ] && [ "$cell" != - ] || continue
      tried=$((tried + 1))
      habit "$(habits "$what")"
      if [ "$loop" = 'goes on' ]; then
        until_true 20 has_status y "$cell"
        until_true 30 good_since "$(newest y | cut -d, -f1)"
        until_true 20 has_status y "$cell"
        recent "$(newest y | cut -d, -f1)" || fail "$column, $what: the row is of $(newest y)"
      else
        until_true 30 has_status u UncertainSubstituteValue
        status=$(newest y | cut -d, -f4)
        case $cell in
          none) [ "$status" = Good ] && newest y | grep -Eq ',(9\.9|10)[0-9.]*$' || fail "$column, $what: it became a row: $(newest y)" ;;
          *) [ "$status" = "$cell" ] || fail "$column, $what: $status and not $cell" ;;
        esac
      fi
      habit well
      until_true 60 controlled
    done < <(awk -F ' *[|] *' -v head="$column" '/^\| what comes in /{for (i = 2; i < NF; i++) if ($i == head) at = i; next}
      at && !/^\|/{exit} at && !/^\|---/{gsub("`", "", $at); print $2 "|" $at "|" $(NF - 1)}' "$APC_SOURCE_DIR/docs/guarantees.md")
    until_true 30 has_samples
    status=0
    kill -INT "$pid"
    wait "$pid" || status=$?
    if [ "$loop" = 'goes on' ]; then
      [ $status -eq 0 ] || fail "$column: a run whose loop was closed ended with $status: $(tail -n 1 "$out.log")"
    else
      [ $status -eq 1 ] && tail -n 1 "$out.log" | grep -q 'the loop was open' || fail "$column: a run whose loop was open ended with $status: $(tail -n 1 "$out.log")"
    fi
    awk -F, 'NR > 1 && $2 == "sensor" {n++} END {exit n < 5}' "$out/samples.csv" || fail "$column: the record lacks its samples"
  done
  [ $tried -ge 5 ] || fail "$column: only $tried rows of the table were tried"
}
