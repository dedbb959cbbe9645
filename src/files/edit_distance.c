/* SPDX-License-Identifier: BSD-3-Clause */
#include "files.h"

#include <stdint.h>
#include <string.h>

/* Levenshtein's distance; names are short. */
static size_t edits(const char *a, const char *b)
{
    size_t row[64], n = strlen(b);
    if (n >= sizeof row / sizeof *row)
        return SIZE_MAX;
    for (size_t j = 0; j <= n; j++)
        row[j] = j;
    for (size_t i = 1; a[i - 1]; i++) {
        size_t corner = row[0];
        row[0] = i;
        for (size_t j = 1; j <= n; j++) {
            size_t change = corner + (a[i - 1] != b[j - 1]),
                   least = row[j] < row[j - 1] ? row[j] : row[j - 1];
            corner = row[j];
            row[j] = least + 1 < change ? least + 1 : change;
        }
    }
    return row[n];
}

void nearest_look(struct nearest *nearest, const char *name)
{
    const size_t n = edits(nearest->wanted, name), length = strlen(name);
    if (n > 1 + length / 3 || n >= length || (nearest->name && n >= nearest->edits))
        return;
    nearest->name = name;
    nearest->edits = n;
}
