/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The SQLite store: a rollback journal that is another file's.
 *
 * FILE-journal belongs to FILE by its name alone. Where a file was put in FILE's place while a journal of the
 * former one was left there, as after a kill, SQLite would roll pages of the former one into it. But a
 * journal of ours has page 1 as it was before the transaction (APC_SQLITE_MARK), with the count of changes,
 * which each transaction raises by one: the file is the one that the journal is of only where its count is
 * that one or the next. In a journal of another program's transaction page 1 may not be yet, which then
 * stands unchanged in the file, with as many pages as the journal's header says.
 */
#include <endian.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "shareddata/sqlite/sqlite.h"

#define HEADER   32 /* bytes of a journal's header, and of a file's, as far as they are looked at */
#define COUNT_AT 24 /* of changes, in page 1 */
#define PAGES_AT 28 /* of the file, in page 1 */
#define LOOKS    5  /* at what does not fit: it may be a transaction that has just ended */
#define PAUSE    (5 * APC_NS_PER_MS)

static uint32_t number_at(const unsigned char *bytes, size_t at)
{
    uint32_t big;
    memcpy(&big, bytes + at, sizeof big);
    return be32toh(big);
}

struct journal {
    bool there, found;            /* there is one; it has page 1 */
    uint32_t nonce, pages, count; /* of the file before its transaction */
};

static bool read_journal_at(int fd, void *to, size_t n, off_t at)
{
    return pread(fd, to, n, at) == (ssize_t)n;
}

/* SQLite's file format, section 3: a header, then pages with their numbers, in a sector's multiple again and
 * again. */
static void check_journal_pages(int fd, struct journal *j)
{
    static const unsigned char magic[8] = {0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7};
    unsigned char header[HEADER], page[4 + COUNT_AT + 4];
    for (off_t at = 0;
         !j->found && read_journal_at(fd, header, sizeof header, at) && !memcmp(header, magic, 8);) {
        const uint32_t records = number_at(header, 8), sector = number_at(header, 20),
                       size = number_at(header, 24);
        if (sector < 32 || sector > 65536 || size < 512 || size > 65536) {
            return;
        }
        at += sector;
        j->there = j->there || records > 0;
        j->nonce = number_at(header, 12);
        j->pages = number_at(header, 16);
        for (uint32_t i = 0; i < records && !j->found && read_journal_at(fd, page, 4, at);
             i++, at += 8 + (off_t)size) {
            j->found = number_at(page, 0) == 1 && read_journal_at(fd, page, sizeof page, at);
            j->count = j->found ? number_at(page, 4 + COUNT_AT) : 0;
        }
        at = (at + sector - 1) / sector * sector;
    }
}

static struct journal read_journal(const struct apc_sqlite *sq)
{
    char path[PATH_MAX + 8];
    struct journal j = {0};
    snprintf(path, sizeof path, "%s-journal", sq->path);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd >= 0) {
        check_journal_pages(fd, &j);
        close(fd);
    }
    return j;
}

/* Can it be of the file whose page 1 begins so? A file whose count is 0 was not made by SQLite alone. */
static bool journal_fits_file(const struct journal *j, const unsigned char page[HEADER])
{
    const uint32_t count = number_at(page, COUNT_AT), pages = number_at(page, PAGES_AT);
    return count == 0 || (j->found ? count == j->count || count == j->count + 1 : pages == j->pages);
}

/* Through SQLite: to close a descriptor of ours would take away the locks of this process. A transaction that
 * is under way has its journal with it. */
static bool read_page(sqlite3_file *file, unsigned char page[HEADER])
{
    int under_way = 0;
    return file && file->pMethods && file->pMethods->xCheckReservedLock(file, &under_way) == SQLITE_OK &&
           !under_way && file->pMethods->xRead(file, page, HEADER, 0) == SQLITE_OK;
}

/* As it was opened, before anything is read: SQLite would roll the journal back first of all. */
int apc_sqlite_check_journal(struct apc_sqlite *sq)
{
    sqlite3_file *file = NULL;
    unsigned char page[HEADER];
    uint32_t nonce = 0;
    sqlite3_file_control(sq->db, "main", SQLITE_FCNTL_FILE_POINTER, &file);
    for (int look = 0; look < LOOKS; look++) {
        const struct journal j = read_journal(sq);
        if (!j.there || !read_page(file, page) || journal_fits_file(&j, page) ||
            (look > 0 && j.nonce != nonce)) {
            return 0;
        }
        nonce = j.nonce;
        nanosleep(&(struct timespec){.tv_nsec = PAUSE}, NULL);
    }
    return apc_fail(
        &sq->base.why, APC_ESTORE,
        "%s-journal is of another file that had this name, and would spoil this one: move it away; "
        "`apc restore` puts a backup in a file's place",
        sq->given);
}
