# SPDX-License-Identifier: BSD-3-Clause
# The hair dryer's record of Debian's octave-control, fitted to the first half: as good on the second one as the best of
# Octave's arx and n4sid, judged by Octave; the subspace has the poles and the gain of Octave's.
# shellcheck source=lib.sh
. "$(dirname "$0")/lib.sh"
record=$(compgen -G '/usr/share/octave/packages/control-*/moen4.m') && command -v octave-cli >/dev/null || {
  echo "skipped: there is no Octave with its control package here (scripts/setup --bench, or apt install octave-control)" >&2
  exit 77
}
cd "$work"
awk '/^%! *Y = \[/ { on = 1 } on && /^%! DAT/ { exit } on { sub(/^%! ?/, ""); print }' "$record" >data.m
{
  echo time,u,y
  octave-cli --no-gui --quiet --eval 'source data.m; printf("%.2f,%.4f,%.4f\n", [(0:999) * 0.08; U.'"'"'; Y.'"'"'])' 2>octave.log
} >dryer.csv || true # Debian's Octave ends with an error where there is no display
[ "$(wc -l <dryer.csv)" = 1001 ] || fail "Octave did not print the record: $(cat octave.log)"

dryer=(identify dryer.csv --inputs u --outputs y --share 0.5)
for kind in arx subspace; do
  "$apc" "${dryer[@]}" --model $kind -o $kind.model >/dev/null
  { # its matrices, as Octave writes them
    sed -nE '/^  [ABCD] = /,/\);$/p' $kind.model | sed -E 's/= \( \[/= [/; s/\],$/;/; s/^ +\[/ /; s/\] \);/];/'
    sed -nE 's/^operating_point = \{ u = \[([^]]*)\]; y = \[([^]]*)\].*/u0 = \1; y0 = \2;/p' $kind.model
  } >ours-$kind.m
done
octave-cli --no-gui --quiet "$APC_SOURCE_DIR/tests/peers/hairdryer.m" >fits 2>>octave.log || true
[ "$(wc -l <fits)" = 6 ] || fail "Octave did not say how well they fit: $(cat fits octave.log)"
cat fits
"$apc" "${dryer[@]}" --csv >ours.csv
awk '
  FILENAME == "fits" && /^(poles|gain)/ { if ($2 > 0.01) bad = bad " " $1; n++; next }
  FILENAME == "fits" { if ($1 !~ /^ours/) { best = $2 > best ? $2 : best } else if ($2 < 85 || $2 < 0.99 * best) bad = bad " " $1; n++ }
  FILENAME == "ours.csv" && /^(transfer|arx|subspace),y,/ { split($0, f, ","); if (f[3] < 85 || f[3] < 0.99 * best) bad = bad " " f[1]; n++ }
  END { if (n != 9 || bad != "") { print "of " n ":" bad; exit 1 } }' fits ours.csv || fail "other than Octave, or worse on the second half: $(cat fits ours.csv)"
