# SPDX-License-Identifier: BSD-3-Clause
# The notebooks of examples/notebooks, each from its beginning, with the package as it is installed: what they print is what
# stands in them. What runs them is big: scripts/peers notebooks.
# Promise(python): Each notebook runs from its beginning, draws, and prints what stands in it.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in ?*) echo "sanitized build: skipped"; exit 77 ;; esac
big_peers notebooks
python_user
export PYTHONPATH=$peers/python JUPYTER_PATH=$peers/python/share/jupyter IPYTHONDIR=$work/ipython MPLCONFIGDIR=$work \
  PATH=$user/bin:$PATH APC_SOURCES=$APC_SOURCE_DIR
"$user/bin/python" -c 'import numpy' || { echo "skipped: what scripts/peers fetched is not for this Python" >&2; exit 77; }
cp -r "$APC_SOURCE_DIR/examples/notebooks" "$work"
"$user/bin/python" "$APC_SOURCE_DIR/tests/peers/notebooks.py" "$work"/notebooks/*.ipynb >"$work/log" 2>&1 || fail "$(cat "$work/log")"
[ "$(grep -c 'figures$' "$work/log")" = "$(ls "$APC_SOURCE_DIR"/examples/notebooks/*.ipynb | wc -l)" ] || fail "not each was run: $(cat "$work/log")"
