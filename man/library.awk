# SPDX-License-Identifier: BSD-3-Clause
# A page of Doxygen's as man(7) wants it. Variables: date, version.
function flush(   i) {
  for (i = 1; i <= n_held; i++) print held[i]
  n_held = 0
}
/^\.TH / {
  NAME = $2
  gsub(/"/, "", NAME)
  print ".TH " $2 " 3 " date " \"libapc " version "\""
  next
}
/^\.so / {
  print
  next
}
# A paragraph that begins where there is nothing before it, or nothing in it, is none.
/^\.(PP|br|sp)/ {
  if (!fresh) {
    n_held = 1
    held[1] = /^\.PP|^\.sp/ ? ".PP" : $0
  }
  next
}
/^ *$/ { next }
{ gsub(/\\fC/, "\\fB") }
/^\.SH NAME/ { named = NR }
named == NR - 1 && !/ \\- / { $0 = $0 " \\- a struct of libapc" }
# Of a header: how it is included, where Doxygen has what it includes.
/^(\\fB)?#include/ {
  if (!included++ && NAME ~ /\.h$/) {
    flush()
    fresh = 0
    print "\\fB#include <" NAME ">\\fR"
  }
  if (NAME ~ /\.h$/) next
}
/^\.SH "?Author/ { exit }
/^\.(SH|SS)/ {
  n_held = 0
  fresh = 1
  print
  next
}
{
  flush()
  fresh = 0
  sub(/^ +/, "")
  if (/^'/) $0 = "\\&" $0
  print
}
