# SPDX-License-Identifier: BSD-3-Clause
# What bash and zsh offer behind `apc` and its daemons is what the programs take.
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
completion=$APC_BUILD_DIR/man/completion
export PATH=$APC_BIN:$PATH
unset APC_STORE
cd "$work"
mkdir folder
touch file.conf
# shellcheck source=/dev/null
. "$completion/apc"

# offers EXPECTED WORD...: the last word is being typed
offers() {
  local expected=$1
  shift
  COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=()
  _apc "$1" || true
  [ "${COMPREPLY[*]-}" = "$expected" ] || fail "behind \"$*\" bash offers \"${COMPREPLY[*]-}\" instead of \"$expected\""
}
offers simulate apc sim
offers 'maintain' apc mai
offers '--since= --statistics --store=' apc history --s
offers 'man' apc mode ma
offers 'transfer arx subspace fir' apc identify --model = ''
offers 'subspace' apc identify --model = su
offers 'deadline' apc run -t d
offers 'error warn info debug' apc-plant --log-level = ''
offers 'list add remove token revoke' apc user ''
offers 'folder' apc run --out = fo
offers 'file.conf' apc run fi
offers 'folder' apc replay ''
offers '' apc get y --store = sqlite:none ''
offers '' apc nonsense ''
first=$("$apc" plants | awk 'NR == 2 {print $1}')
offers "$first" apc plants "${first:0:-1}"
fast_experiment
"$apc" init fast.conf --store sqlite:s.db >"$work/init.log"
offers 'Kp' apc tune --store = sqlite:s.db K
APC_STORE=sqlite:s.db offers 'y' apc get y

# Every command, and every option of each, is offered.
# Promise(docs/bash-zsh-complete): bash and zsh complete commands, options, their values, and names in a store that
#   is here.
COMP_WORDS=(apc '') COMP_CWORD=1 COMPREPLY=()
_apc apc
[ "${COMPREPLY[*]}" = "$("$apc" help | sed -nE 's/^  ([a-z]+) .*/\1/p' | xargs)" ] || fail "offered: ${COMPREPLY[*]}"
for command in "${COMPREPLY[@]}"; do
  [ "$(grep -oE -- '--[a-z-]+' <<<"${_apc_option[apc $command]}")" = \
    "$("$apc" "$command" --help | sed -nE 's/^ {2,6}(-., )?(--[a-z-]+).*/\2/p' | grep -vx -- --usage)" ] ||
    fail "of apc $command: ${_apc_option[apc $command]}"
done

# On a real terminal, by the shells themselves.
# Promise(docs/bash-zsh-complete)
types() { python3 "$(dirname "${BASH_SOURCE[0]}")/complete.py" "$@"; }
bash_says() { types "$1" "$2" bash --norc --noprofile -i <<<". '$completion/apc'"; }
bash_says 'apc simulate ' 'apc simu\t'
bash_says '--model=subspace' 'apc identify --model=su\t'
bash_says '--hold-latency' 'apc-plant --hol\t'
if ! command -v zsh >/dev/null; then
  echo "skipped: zsh, which is not there (scripts/setup --dev)"
  exit 0
fi
zsh_says() {
  types "$1" "$2" zsh -f -i <<END
fpath=('$completion' \$fpath)
autoload -U compinit
compinit -D -u
unsetopt zle_bracketed_paste 2>/dev/null
END
}
zsh_says 'simulate ' 'apc simu\t'
zsh_says 'subspace' 'apc identify --model=su\t'
zsh_says '--hold-latency' 'apc-plant --hol\t'
zsh_says 'Kp' 'apc tune --store=sqlite:s.db K\t'
