#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# A campaign as an array of jobs, as docs/simulate.md has it, on a cluster of one node of our own: the parts one after another are the
# campaign of one process, byte by byte. Slurm's daemons are the real ones (Debian's slurmctld and slurmd); they know nobody but us.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"

for program in slurmctld slurmd sbatch sinfo; do
  command -v $program >/dev/null || {
    echo "skipped: no $program here; scripts/setup --bench installs it"
    exit 77
  }
done
if ! python3 -c 'import socket; socket.getaddrinfo("127.0.0.1", 1, socket.AF_INET, flags=socket.AI_ADDRCONFIG)' 2>"$work/address"; then
  echo "skipped: Slurm resolves no name on a host that has no address but the loopback"
  exit 77
fi

# Whoever the test runs as is the user of both daemons. A node may say that it has more processors than there are: the document's job asks for 8.
mkdir "$work/state" "$work/spool" "$work/jobs"
cat >"$work/slurm.conf" <<END
ClusterName=apc
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/none
CredType=cred/none
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmdParameters=config_overrides
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=8
PartitionName=all Nodes=ALL Default=YES
END
export SLURM_CONF=$work/slurm.conf
slurmctld -D >"$work/slurmctld.log" 2>&1 &
slurmd -D -N "$(hostname -s)" >"$work/slurmd.log" 2>&1 &
idle() { sinfo --noheader --format %T | grep -qx idle; }
until_true 30 idle

# The document's script and its line, with fewer and shorter runs.
cd "$work/jobs"
cp "$APC_SOURCE_DIR/experiments/four-tank.conf" .
# Types(docs/simulate.md): awk
sed -n '/^#!\/bin\/bash/,/^```/p' "$APC_SOURCE_DIR/docs/simulate.md" | sed -e '/^```/d' -e 's/--runs 100/--duration 60 --runs 4/' >job
line=$(sed -n 's/.*`\(sbatch --array=\)1-9901:100`.*/\11-9:4 --wait job/p' "$APC_SOURCE_DIR/docs/simulate.md")
[ -n "$line" ] && grep -q -- '--runs 4' job || fail "docs/simulate.md shows no array of Slurm"
PATH=$(dirname "$apc"):$PATH
timeout 600 $line || fail "the array did not come to its end: $(tail -n 5 slurm-*.out)"
[ "$(ls part-*.csv | wc -l)" -eq 3 ] || fail "not three parts: $(ls)"
eval "$(grep '^awk .FNR > 1' "$APC_SOURCE_DIR/docs/simulate.md")"

"$apc" simulate four-tank.conf --duration 60 --runs 12 --jobs 1 --csv whole.csv >/dev/null
# Promise(run/array-jobs-docs)
cmp campaign.csv whole.csv || fail "a campaign of Slurm's jobs is another one than that of one process"
