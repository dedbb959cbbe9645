/* SPDX-License-Identifier: BSD-3-Clause */
#include "zip.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "apc/folder/folder.h"

#define ENTRIES_MAX 100
#define VERSION     20         /* 2.0: folders in names */
#define DATE        0x21       /* 1980-01-01: the same entries are the same file at any time */
#define UTF8        0x800      /* names are */
#define LOCAL       0x04034b50 /* signatures, as APPNOTE.TXT of PKWARE has them */
#define CENTRAL     0x02014b50
#define END         0x06054b50

/* A number of @p n bytes, lowest first. */
static void put_bytes(FILE *out, uint32_t value, int n)
{
    for (; n > 0; n--, value >>= 8)
        fputc((int)(value & 0xff), out);
}

static uint32_t crc32_of(const unsigned char *data, size_t n)
{
    uint32_t table[256], crc = UINT32_MAX;
    for (uint32_t i = 0; i < 256; i++) {
        table[i] = i;
        for (int bit = 0; bit < 8; bit++)
            table[i] = table[i] >> 1 ^ (table[i] & 1 ? 0xedb88320u : 0);
    }
    for (size_t i = 0; i < n; i++)
        crc = crc >> 8 ^ table[(crc ^ data[i]) & 0xff];
    return ~crc;
}

/* What both headers of an entry have. */
static void put_about(FILE *out, const struct zip_entry *e, uint32_t crc)
{
    put_bytes(out, VERSION, 2);
    put_bytes(out, UTF8, 2);
    put_bytes(out, 0, 4); /* stored, at midnight */
    put_bytes(out, DATE, 2);
    put_bytes(out, crc, 4);
    put_bytes(out, e->size, 4);
    put_bytes(out, e->size, 4);
    put_bytes(out, (uint32_t)strlen(e->name), 2);
    put_bytes(out, 0, 2);
}

static void put_archive(FILE *out, const struct zip_entry *entry, size_t n)
{
    uint32_t crc[ENTRIES_MAX], at[ENTRIES_MAX], end = 0, size = 0;
    for (size_t i = 0; i < n; i++) {
        crc[i] = crc32_of(entry[i].data, entry[i].size);
        at[i] = end;
        put_bytes(out, LOCAL, 4);
        put_about(out, &entry[i], crc[i]);
        fputs(entry[i].name, out);
        fwrite(entry[i].data, 1, entry[i].size, out);
        end += 30 + (uint32_t)strlen(entry[i].name) + entry[i].size;
    }
    for (size_t i = 0; i < n; i++) {
        put_bytes(out, CENTRAL, 4);
        put_bytes(out, VERSION, 2);
        put_about(out, &entry[i], crc[i]);
        for (int k = 0; k < 5; k++) /* no comment, one disk, no attributes */
            put_bytes(out, 0, 2);
        put_bytes(out, at[i], 4);
        fputs(entry[i].name, out);
        size += 46 + (uint32_t)strlen(entry[i].name);
    }
    put_bytes(out, END, 4);
    put_bytes(out, 0, 4);
    put_bytes(out, (uint32_t)n, 2);
    put_bytes(out, (uint32_t)n, 2);
    put_bytes(out, size, 4);
    put_bytes(out, end, 4);
    put_bytes(out, 0, 2);
}

int zip_write(const char *file, const struct zip_entry *entry, size_t n, struct apc_error *why)
{
    const size_t size = strlen(file) + sizeof ".2147483647.part";
    char *const part = malloc(size);
    if (!part)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    snprintf(part, size, "%s.%ld.part", file, (long)getpid()); /* another one may write the same file */
    errno = 0;
    FILE *const out = fopen(part, "we");
    if (out)
        put_archive(out, entry, n);
    const bool failed = out && ferror(out);
    int rc = 0;
    if (!out || fclose(out) != 0 || failed) {
        rc = apc_fail(why, APC_ESYS, "%s cannot be written: %s", file, strerror(errno));
        if (out)
            remove(part);
    } else {
        rc = folder_replace(part, file, why);
    }
    free(part);
    return rc;
}
