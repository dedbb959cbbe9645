# SPDX-License-Identifier: BSD-3-Clause
# Warnings and hardening, carried by the target apc_flags.
add_library(apc_flags INTERFACE)
target_compile_definitions(apc_flags INTERFACE _GNU_SOURCE)
target_compile_options(apc_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wcast-qual -Wvla -Wformat=2
  -Wdouble-promotion -Wstrict-prototypes -Wmissing-prototypes -Wwrite-strings -Wnull-dereference -Wundef
  # No a * b + c in one rounding where the source says two: a run's numbers are the same whatever compiled it.
  -ffp-contract=off
  # The library calls its own functions directly (src/CMakeLists.txt), so within a file they may be inlined.
  -fno-semantic-interposition
  -fstack-protector-strong)
# Hardening that is of one processor or compiler.
include(CheckCCompilerFlag)
foreach(flag -fstack-clash-protection -fcf-protection -mbranch-protection=standard)
  string(MAKE_C_IDENTIFIER "APC_HAS${flag}" has)
  if(CMAKE_C_COMPILER_ID STREQUAL GNU)
    check_c_compiler_flag(${flag} ${has})
  endif()
  if(${has})
    target_compile_options(apc_flags INTERFACE ${flag})
  endif()
endforeach()
target_link_options(apc_flags INTERFACE -Wl,-z,relro,-z,now)
if(APC_WERROR)
  target_compile_options(apc_flags INTERFACE -Werror)
endif()
if(APC_SANITIZE)
  target_compile_options(apc_flags INTERFACE -fsanitize=${APC_SANITIZE} -fno-omit-frame-pointer
                                             -fno-sanitize-recover=all)
  target_link_options(apc_flags INTERFACE -fsanitize=${APC_SANITIZE})
  if(CMAKE_C_COMPILER_ID STREQUAL GNU)
    target_compile_options(apc_flags INTERFACE -Wno-tsan) # it knows no fences: shm.h's stand beside atomic accesses
  endif()
elseif(NOT CMAKE_BUILD_TYPE STREQUAL "Debug")
  target_compile_definitions(apc_flags INTERFACE _FORTIFY_SOURCE=3)
endif()
