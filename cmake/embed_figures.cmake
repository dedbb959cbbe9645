# SPDX-License-Identifier: BSD-3-Clause
# Turns FILES (NAME.gp) into C, a text figure_NAME each. Called with -P.
set(out "/* SPDX-License-Identifier: BSD-3-Clause */\n/* Made from apps/apc/report/ by cmake/embed_figures.cmake. */\n")
string(APPEND out "#include \"apc/report/gnuplot.h\"\n")
foreach(file IN LISTS FILES)
  get_filename_component(name ${file} NAME_WE)
  file(READ ${file} hex HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${hex}")
  string(APPEND out "\nconst char figure_${name}[] = {${bytes}0};\n")
endforeach()
file(WRITE ${OUT} "${out}")
