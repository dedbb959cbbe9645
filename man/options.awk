# SPDX-License-Identifier: BSD-3-Clause
# What argp's --help says of one program, on lines as long as they like, as a table, with tabs between:
#   usage ARGUMENTS        once for each form
#   argument VALUES        what its arguments may be
#   doc TEXT
#   option SHORT LONG ARGUMENT optional|required|none VALUES TEXT     (- for no short one, no argument)
# VALUES, with blanks between, are words, and @file, @directory, @NAME for what is found when it is asked for; or -.
BEGIN { OFS = "\t" }

# "KIND: transfer, arx (default) or fir; default: ..." are words to choose from.
function choice(text,   word, n, i, out) {
  sub(/^[A-Z][a-z ]+: /, "", text)
  sub(/[.;[].*/, "", text)
  gsub(/ \([^)]*default[^)]*\)/, "", text)
  sub(/ +$/, "", text)
  n = split(text, word, /, | or /)
  if (n < 2) return "-"
  for (i = 1; i <= n; i++) {
    if (word[i] !~ /^[a-z]+$/) return "-"
    out = out (i > 1 ? " " : "") word[i]
  }
  return out
}
function values(argument, text) {
  if (argument ~ /^FILE/ || text ~ /\.\/file/) return "@file"
  if (argument ~ /^(DIR|RUN)/) return "@directory"
  return choice(text)
}
# Of an argument list: what is written in small letters is meant as it stands, what is large stands for something.
function arguments(text,   word, n, i, out) {
  gsub(/--[a-z]+ [A-Z.=]+/, "", text)
  gsub(/[][|.]+/, " ", text)
  n = split(text, word, " ")
  for (i = 1; i <= n; i++) {
    if (word[i] ~ /^[a-z]+$/ && word[i] != "csv") out = word[i]
    else if (word[i] == "FILE") out = "@file"
    else if (word[i] ~ /^(DIR|RUN)$/) out = "@directory"
    else if (word[i] ~ /^(VARIABLE|LOOP|SETPOINT|NAME=VALUE|PLANT|TASK)$/) out = "@" word[i]
    else continue
    sub(/=VALUE/, "", out)
    if (!(out in known)) {
      known[out]
      print "argument", out
    }
  }
}

/^(Usage:|  or: )/ {
  sub(/^(Usage:|  or: ) *[a-z-]+( [a-z]+)?/, "")
  sub(/^ *(COMMAND )?\[OPTION\.\.\.\] */, "")
  sub(/ +$/, "")
  print "usage", $0
  arguments($0)
  next
}
/^ +(-., )?--/ {
  short = "-"
  if (match($0, /^ +-., /)) short = substr($0, RLENGTH - 2, 1)
  sub(/^ +(-., )?--/, "")
  name = text = $0
  sub(/ .*/, "", name)
  sub(/^[^ ]+ +/, "", text)
  argument = "-"
  how = "none"
  if (at = index(name, "=")) {
    argument = substr(name, at + 1)
    name = substr(name, 1, at - 1)
    how = "required"
    if (sub(/\[$/, "", name)) {
      how = "optional"
      sub(/\]$/, "", argument)
    }
  }
  if (name != "usage") print "option", short, name, argument, how, how == "none" ? "-" : values(argument, text), text
  next
}
/./ { print "doc", $0 }
