# SPDX-License-Identifier: BSD-3-Clause
# shellcheck shell=bash
# Completion of apc and its daemons for bash. The tables are made from what the programs' --help says:
#   _apc_option[PROGRAM]            its long options, with = behind those that want an argument
#   _apc_value[PROGRAM OPTION]      what that may be; _apc_argument[PROGRAM]: what the program's arguments may be:
#                                   words, @file, @directory, or @NAME for names that are asked for
declare -gA _apc_option _apc_value _apc_argument
@TABLES@

# Names in the shared data that the command line or APC_STORE names; not of a server that would have to be waited for.
_apc_names() {
  local i store=${APC_STORE:-}
  for ((i = 1; i < COMP_CWORD; i++)); do
    case ${COMP_WORDS[i]} in
      -s) store=${COMP_WORDS[i + 1]} ;;
      --store) [ "${COMP_WORDS[i + 1]}" = = ] && store=${COMP_WORDS[i + 2]} || store=${COMP_WORDS[i + 1]} ;;
    esac
  done
  case $1 in
    @PLANT) timeout 1 apc plants ;;
    *)
      [ -n "$store" ] || return
      case $1 in
        @VARIABLE | @SETPOINT) timeout 1 apc get --store "$store" ;;
        @LOOP) timeout 1 apc mode --store "$store" ;;
        @NAME) timeout 1 apc tune --store "$store" ;;
        @TASK) timeout 1 apc timing --store "$store" --csv | tr , ' ' ;;
      esac
      ;;
  esac 2>/dev/null | awk 'NR > 1 && !seen[$1]++ {print $1}'
}

# _apc_offer VALUES: those that begin as $current does
_apc_offer() {
  local value
  for value in $1; do
    case $value in
      @file | @directory)
        compopt -o filenames 2>/dev/null
        mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen "$([ "$value" = @file ] && echo -f || echo -d)" -- "$current")
        ;;
      @*) mapfile -t -O ${#COMPREPLY[@]} COMPREPLY < <(compgen -W "$(_apc_names "$value")" -- "$current") ;;
      *) [[ $value != "$current"* ]] || COMPREPLY+=("$value") ;;
    esac
  done
}

_apc() {
  local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} program=${1##*/} option=
  COMPREPLY=()
  if [ "$program" = apc ]; then
    if [ "$COMP_CWORD" -eq 1 ]; then
      _apc_offer "${_apc_argument[apc]}"
      return
    fi
    program="apc ${COMP_WORDS[1]}"
  fi
  # bash has cut --option=value into three
  if [ "$current" = = ]; then
    current=
    option=$before
  elif [ "$before" = = ]; then
    option=${COMP_WORDS[COMP_CWORD - 2]}
  elif [[ $before == -* && ${_apc_option[$program]:-} == *" $before= "* ]]; then
    option=$before
  fi
  if [[ $option == -* ]]; then
    _apc_offer "${_apc_value["$program $option"]:-}"
  elif [[ $current == -* ]]; then
    _apc_offer "${_apc_option[$program]:-}"
    [[ ${COMPREPLY[0]:-} != *= ]] || compopt -o nospace 2>/dev/null
  else
    _apc_offer "${_apc_argument[$program]:-}"
  fi
}
complete -F _apc @PROGRAMS@
