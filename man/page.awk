# SPDX-License-Identifier: BSD-3-Clause
# A man page of one program's table (options.awk). Variables: name ("apc mode"), section, line (what it is, in a few words),
# date, version, codes (a file: the exit codes of all programs), list (a file: the commands, of the page of `apc` itself), also (pages to
# see, beside those that are named).
function escaped(text) {
  gsub(/\\/, "\\e", text)
  gsub(/\^/, "\\(ha", text)
  gsub(/~/, "\\(ti", text)
  gsub(/-/, "\\-", text)
  text = hyphenated(text)
  return text
}
# A minus sign within a word is a hyphen.
function hyphenated(text,   out) {
  out = ""
  while (match(text, /[A-Za-z]\\-[A-Za-z]/)) {
    out = out substr(text, 1, RSTART) "-"
    text = substr(text, RSTART + 3)
  }
  return out text
}
# Prose: what stands in backticks is bold, and names other pages.
function prose(text,   part, n, i, word, out, first) {
  n = split(text, part, "`")
  out = ""
  for (i = 1; i <= n; i++) {
    first = escaped(part[i])
    if (i % 2) out = out first
    else {
      out = out "\\fB" first "\\fR"
      if (match(part[i], /^apc [a-z]+/)) refer("apc-" substr(part[i], 5, RLENGTH - 4) "(1)")
    }
  }
  while (match(text, /\[APC_[A-Z_]+/)) {
    word = substr(text, RSTART + 1, RLENGTH - 1)
    if (!(word in variable)) {
      variable[word]
      variables[++n_variables] = word
    }
    text = substr(text, RSTART + RLENGTH)
  }
  return out
}
function refer(page) {
  if (page != me && !(page in see)) {
    see[page]
    sees[++n_sees] = page
  }
}
# Lines of at most 78 characters, none of which roff takes for a request.
function put(text,   word, n, i, at) {
  n = split(text, word, " ")
  at = ""
  for (i = 1; i <= n; i++) {
    if (at != "" && length(at) + length(word[i]) > 77) {
      line_out(at)
      at = ""
    }
    at = at (at == "" ? "" : " ") word[i]
    if (word[i] ~ /[a-z)\]][.?!]$/ && word[i + 1] ~ /^[A-Z]/) {
      line_out(at)
      at = ""
    }
  }
  if (at != "") line_out(at)
}
function line_out(text) { print (text ~ /^[.']/ ? "\\&" : "") text }
function literal(text) { gsub(/-/, "\\-", text); return text }
function bold(text) { return "\\fB" literal(text) "\\fR" }

BEGIN {
  FS = "\t"
  page = name
  gsub(/ /, "-", page)
  me = page "(" section ")"
  printf ".\\\" Made from what %s --help says.\n", name
  printf ".TH %s %s %s \"libapc %s\"\n", toupper(page), section, date, version
  print ".SH NAME"
  put(literal(page) " \\- " escaped(line))
  print ".SH SYNOPSIS"
}
$1 == "usage" {
  if (synopses++) print ".br"
  rest = $2
  gsub(/[^A-Za-z0-9_. \[\]|=:@-]/, "", rest)
  put(bold(name) (name == "apc" ? " \\fICOMMAND\\fR" : "") " [\\fIOPTION\\fR...] " escaped(rest))
}
$1 == "doc" {
  if (!docs++) print ".SH DESCRIPTION"
  put(prose($2))
}
$1 == "option" {
  if (!options++) print ".SH OPTIONS"
  print ".TP"
  value = $4 == "-" ? "" : "=\\fI" escaped($4) "\\fR"
  if ($5 == "optional") value = "[" value "]"
  print ($2 == "-" ? "" : bold("-" $2) ", ") bold("--" $3) value
  put(prose($7))
}
END {
  if (list) {
    print ".SH COMMANDS"
    print "Each has a page of its own: that of \\fBapc mode\\fR is"
    print ".BR apc\\-mode (1)."
    while ((getline text <list) > 0) {
      split(text, of, "\t")
      print ".TP\n" bold(of[1])
      put(prose(of[2]))
    }
  }
  print ".SH EXIT STATUS"
  while ((getline text <codes) > 0) {
    split(text, of, "\t")
    print ".TP\n" bold(of[1])
    put(escaped(of[2]))
  }
  if (n_variables) {
    print ".SH ENVIRONMENT"
    put("Where an option above that names one of these is not given, it stands for it:")
    for (i = 1; i <= n_variables; i++) print ".BR " variables[i] (i < n_variables ? " ," : " .")
  }
  if (name != "apc") refer("apc(1)")
  n = split(also, word, " ")
  for (i = 1; i <= n; i++) refer(word[i])
  print ".SH SEE ALSO"
  for (i = 1; i <= n_sees; i++) {
    at = index(sees[i], "(")
    print ".BR " literal(substr(sees[i], 1, at - 1)) " " substr(sees[i], at) (i < n_sees ? "," : "")
  }
}
