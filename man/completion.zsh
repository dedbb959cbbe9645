#compdef @PROGRAMS@
# SPDX-License-Identifier: BSD-3-Clause
# Completion of apc and its daemons for zsh, made from what the programs' --help says.

# Names in the shared data that the command line or APC_STORE names; not of a server that would have to be waited for.
_apc_names() {
  local store=${APC_STORE:-} given=${words[(r)--store=*]}
  [[ -z $given ]] || store=${given#--store=}
  (( ${words[(i)(-s|--store)]} <= $#words )) && store=$words[${words[(i)(-s|--store)]}+1]
  [[ -n $store || $1 == PLANT ]] || return 1
  local -a names=(${(f)"$(case $1 in
    PLANT) timeout 1 apc plants ;;
    VARIABLE | SETPOINT) timeout 1 apc get --store $store ;;
    LOOP) timeout 1 apc mode --store $store ;;
    NAME) timeout 1 apc tune --store $store ;;
    TASK) timeout 1 apc timing --store $store --csv | tr , ' ' ;;
  esac 2>/dev/null | awk 'NR > 1 && !seen[$1]++ {print $1}')"})
  compadd -a names
}

_apc() {
  local program=$service
  if [[ $service == apc ]]; then
    if (( CURRENT == 2 )); then
      local -a commands=(
@COMMANDS@
      )
      _describe command commands
      return
    fi
    program="apc $words[2]"
    shift words
    (( CURRENT-- ))
  fi
  case $program in
@BRANCHES@
  esac
}
_apc "$@"
