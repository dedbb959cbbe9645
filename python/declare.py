# SPDX-License-Identifier: BSD-3-Clause
"""Write the C of the extension module `libapc._apc` from the library's public headers.

    declare.py COMPILER INCLUDE OUT

What the headers declare is declared once, there: the preprocessor takes comments and macros away, what came from another
folder than INCLUDE is left out, and cffi compiles the rest against the headers themselves, so no layout is assumed.
"""

import re
import subprocess
import sys
from pathlib import Path

from cffi import FFI

# Beside them what the package knows of its own C, and of the library's insides.
OWN = ("columns.h", "../src/record/samples_columns.h")

HEADERS = ("apcrun.h", "apcqp.h", "apcestimate.h", "apctimer.h", "apcsockets.h")

# What Python has no use for, or cffi no word: variadic functions, mutexes, what plug-ins define, the paper's functions.
LEFT_OUT = re.compile(r"\.\.\.|va_list|pthread_|sigval|timer_t|^extern|\b(pack|unpack)MultiMsg|\b(client|server)_\w+\(")

# Numbers that are macros.
MACROS = re.compile(r"^#define (APC_(?:GOOD|UNCERTAIN|BAD)\w*|APC_SEQ_ANY|APC_ELEMENTS_MAX|APC_FRAME_MAX)\b", re.M)


def declarations(compiler: str, include: Path) -> str:
    """All that the headers declare, as cffi's parser takes it."""
    source = "".join(f'#include "{header}"\n' for header in HEADERS)
    text = subprocess.run(
        [compiler, "-E", "-std=c11", "-D_GNU_SOURCE", "-D__attribute__(x)=", f"-I{include}", "-"],
        input=source, capture_output=True, text=True, check=True).stdout
    ours, kept = False, []
    for line in text.splitlines():
        marker = re.match(r'# \d+ "([^"]*)"', line)
        if marker:
            ours = Path(marker[1]).parent == include
        elif ours:
            kept.append(line)
    # Statement by statement: a brace that is open keeps its semicolons. What has a body is the header's own.
    statements, depth, begin, whole = [], 0, 0, "\n".join(kept)
    for i, c in enumerate(whole):
        depth += (c == "{") - (c == "}")
        if c == ";" and depth == 0:
            statements.append(whole[begin:i + 1].strip())
            begin = i + 1
        elif c == "}" and depth == 0 and whole[begin:i].lstrip().startswith("static inline"):
            begin = i + 1
    numbers = [f"#define {name} ..." for header in sorted(include.glob("apc*.h"))
               for name in MACROS.findall(header.read_text())]
    return "\n".join(numbers + [s for s in statements if not LEFT_OUT.search(s)])


def main() -> None:
    compiler, include, out = sys.argv[1], Path(sys.argv[2]).resolve(), sys.argv[3]
    here = Path(__file__).parent
    ffi = FFI()
    ffi.cdef(declarations(compiler, include))
    for header in OWN:
        ffi.cdef(re.sub(r"^#.*", "", (here / header).read_text(), flags=re.M))
    ffi.set_source("libapc._apc", "".join(f'#include "{header}"\n' for header in (*HEADERS, *OWN)))
    ffi.emit_c_code(out)


if __name__ == "__main__":
    main()
