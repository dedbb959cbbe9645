# SPDX-License-Identifier: BSD-3-Clause
# A plant with algebraic equations is moved as CasADi's IDAS moves it, and its linear model is CasADi's.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
case "${APC_SANITIZE:-}" in # Python has no sanitizer in it
  ?*) echo "sanitized build: skipped" >&2; exit 77 ;;
esac
python_peers solvers.txt
# Promise(plants/algebraic-peer): A plant with algebraic equations follows CasADi's IDAS within 1e-8; so does its linear model.
expect 0 'linear model: ' env PYTHONPATH="$peers" python3 "$APC_SOURCE_DIR/tests/peers/dae_jury.py" "$APC_BUILD_DIR/lib/libapc.so" "$APC_BUILD_DIR/examples/flash.so"
