# SPDX-License-Identifier: BSD-3-Clause
# The branches of completion.zsh, from the tables of all programs (options.awk), each after a line `program NAME`.
BEGIN { FS = "\t" }
# Text within the brackets of a specification that stands in single quotes.
function quoted(text) {
  gsub(/\[|\]|:|\\/, "\\\\&", text)
  gsub(/'/, "'\\''", text)
  return text
}
function action(values,   word, n, i, words, out) {
  n = split(values, word, " ")
  for (i = 1; i <= n; i++) {
    if (word[i] == "@file") out = out " _files;"
    else if (word[i] == "@directory") out = out " _files -/;"
    else if (word[i] ~ /^@/) out = out " _apc_names " substr(word[i], 2) ";"
    else if (word[i] != "-") words = words " " word[i]
  }
  if (words != "") out = " compadd --" words ";" out
  return out == "" ? " " : "{" out " }"
}
function put() {
  if (program == "" || program == "apc") return
  printf "    '%s') _arguments%s", program, options
  if (arguments != "") printf " \\\n      '*:argument:%s'", action(arguments)
  print " ;;"
}
$1 == "program" {
  put()
  program = $2
  options = arguments = ""
}
$1 == "argument" { arguments = arguments " " $2 }
$1 == "option" {
  what = "[" quoted($7) "]" ($5 == "none" ? "" : ($5 == "optional" ? "::" : ":") quoted($4) ":" action($6))
  sign = $5 == "required" ? "=" : ($5 == "optional" ? "=-" : "")
  if ($2 == "-") options = options " \\\n      '*--" $3 sign what "'"
  else options = options " \\\n      '*-" $2 ($5 == "required" ? "+" : "") what "' '*--" $3 sign what "'"
}
END { put() }
