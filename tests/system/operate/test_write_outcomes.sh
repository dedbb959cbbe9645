# SPDX-License-Identifier: BSD-3-Clause
# What becomes of a write is one sentence and one code wherever it comes from: write_outcomes.txt, asked of apc, the page, and a
# broker where there is one; of Python by test_python.sh, of OPC UA by test_opcua_writes.sh. The controller is one that does as it is told.
# Promise(run): What becomes of a write says the same by the command line, the page and a broker: applied, superseded,
#   refused and why, not confirmed, or that no controller applies it.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
# shellcheck source=tests/system/writes.sh
. "$APC_SOURCE_DIR/tests/system/writes.sh"
PATH=$PATH:/usr/sbin
export HOME=$work
fast_experiment
puppet_controller
asked 7 write_outcomes cli "$apc" postgresql:
page_of postgresql:
asked 7 write_outcomes http "$page" "$engineer" "$observer"
if broker_of postgresql:; then
  asked 6 write_outcomes mqtt "$broker" "$work/outcomes.log"
fi
