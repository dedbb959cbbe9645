/* SPDX-License-Identifier: BSD-3-Clause */
#include "locked_memory.h"

#include <stdio.h>

#define MB_PER_KB (1024 / 1e6)

/* Of each mapping come its lines `Rss`, `Private_Clean`, `Private_Dirty` and, behind those, `Locked`. */
struct locked_memory locked_memory(void)
{
    struct locked_memory m = {0};
    FILE *file = fopen("/proc/self/smaps", "re");
    char line[512];
    double kb = 0, resident = 0, own = 0;

    while (file && fgets(line, sizeof line, file)) {
        if (sscanf(line, "Rss: %lf", &kb) == 1) {
            resident = kb;
            own = 0;
        } else if (sscanf(line, "Private_%*[^:]: %lf", &kb) == 1) {
            own += kb;
        } else if (sscanf(line, "Locked: %lf", &kb) == 1 && kb > 0) {
            m.own += own * MB_PER_KB;
            m.shared += (resident - own) * MB_PER_KB;
        }
    }
    if (file)
        fclose(file);
    return m;
}
