/* SPDX-License-Identifier: BSD-3-Clause */
/* unit_ROOM TEST: the tests of one file of a room. TESTS has T(NAME) for each file; CMake calls its main
 * NAME. */
#include <stdio.h>
#include <string.h>

#define T(name) int name(void);
TESTS
#undef T

#define T(name) {#name, name},
static const struct {
    const char *name;
    int (*run)(void);
} tests[] = {TESTS};

int main(int argc, char **argv)
{
    const size_t n = sizeof tests / sizeof *tests;

    for (size_t i = 0; i < n; i++) {
        if (argc == 2 && !strcmp(argv[1], tests[i].name)) {
            return tests[i].run();
        }
    }
    fprintf(stderr, "usage: %s TEST, which is one of\n", argv[0]);
    for (size_t i = 0; i < n; i++) {
        fprintf(stderr, "  %s\n", tests[i].name);
    }
    return 2;
}
