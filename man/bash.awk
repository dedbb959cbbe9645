# SPDX-License-Identifier: BSD-3-Clause
# The tables of completion.bash, from those of all programs (options.awk), each after a line `program NAME`.
BEGIN { FS = "\t" }
function put() {
  if (program == "") return
  printf "_apc_option[%s]=\" %s\"\n_apc_argument[%s]=\"%s\"\n", program, options, program, arguments
}
$1 == "program" {
  put()
  program = $2
  options = arguments = ""
}
$1 == "argument" { arguments = arguments (arguments == "" ? "" : " ") $2 }
$1 == "option" {
  options = options "--" $3 ($5 == "required" ? "=" : "") " "
  if ($5 != "required") next
  if ($2 != "-") options = options "-" $2 "= "
  if ($6 != "-") {
    printf "_apc_value[%s --%s]=\"%s\"\n", program, $3, $6
    if ($2 != "-") printf "_apc_value[%s -%s]=\"%s\"\n", program, $2, $6
  }
}
END { put() }
