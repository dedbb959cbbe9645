/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The store in shared memory: what the plant is, and who writes what people write. Tags and the catalogue's
 * text have their two versions together. A name stays where it is: readers go by how many there are.
 */
#include <stdlib.h>

#include "shareddata/shm/shm.h"

/* ---- Tags and catalogue ----------------------------------------------------------------------- */

/* The text of a version, which is @p length bytes; @p size bytes of it with its terminator. */
static void get_version_text(const apc_word *from, char *text, size_t size, size_t length)
{
    for (size_t i = 0; size > 0 && i <= length && i < size; i += 8) {
        char word[8] = {0};
        if (i < length) {
            apc_words_get(word, &from[i / 8], 1);
        }
        memcpy(text + i, word, size - i < 8 ? size - i : 8);
    }
    if (size > 0) {
        text[length < size ? length : size - 1] = '\0';
    }
}

static void put_version_text(apc_word *to, const char *text, size_t length)
{
    for (size_t i = 0; i < length; i += 8) {
        char word[8] = {0};
        memcpy(word, text + i, length - i < 8 ? length - i : 8);
        apc_words_put(&to[i / 8], word, 1);
    }
}

static bool same_words(const apc_word *a, const apc_word *b, size_t length)
{
    size_t i = 0;
    while (i < (length + 7) / 8 && apc_word_get(&a[i]) == apc_word_get(&b[i])) {
        i++;
    }
    return i == (length + 7) / 8;
}

/* In a transaction, in version @p to; @p from is the one so far. NULL: it stays. */
static void write_text(struct apc_shm *shm, int from, int to, const char *text)
{
    struct apc_shm_header *h = shm->header;
    const bool there = from >= 0 && apc_word_get(&h->text_length[from]) < shm->text_size;
    const uint64_t revision = there ? apc_word_get(&h->revision[from]) : 0;
    const size_t was = there ? (size_t)apc_word_get(&h->text_length[from]) : 0;
    const size_t length = text ? strlen(text) : was;
    if (text) {
        put_version_text(shm->text[to], text, length);
    } else if (there) {
        for (size_t i = 0; i < (was + 7) / 8; i++) {
            apc_word_put(&shm->text[to][i], apc_word_get(&shm->text[from][i]));
        }
    }
    const bool same =
        !text || (revision > 0 && length == was && same_words(shm->text[from], shm->text[to], was));
    apc_word_put(&h->text_length[to], length);
    apc_word_put(&h->revision[to], revision + !same);
}

int apc_shm_describe(struct apc_store *store, const struct apc_tag *tags, size_t n, const char *catalogue)
{
    struct apc_shm *shm = apc_shm_of(store);
    struct apc_shm_write w;
    struct apc_tag *sorted = NULL;
    int err = apc_tags_sort(store, tags, n, &sorted);
    if (!err) {
        err = apc_shm_ready(shm);
    }
    if (!err && n > shm->tags) {
        err = apc_shm_too_small(shm, "holds %zu tags at most, not %zu", shm->tags, n);
    }
    if (!err && catalogue && strlen(catalogue) >= shm->text_size) {
        err = apc_shm_too_small(shm, "holds a catalogue of less than %zu bytes, not %zu", shm->text_size,
                                strlen(catalogue));
    }
    if (!err) {
        err = apc_shm_begin(shm, &w);
    }
    if (!err) {
        int from, to = apc_shm_version(&w, shm->header->tags_mark, &from);
        apc_words_put(shm->tag[to], sorted, n * sizeof *sorted / 8);
        apc_word_put(&shm->header->n_tags[to], n);
        write_text(shm, from, to, catalogue);
        apc_shm_commit(&w);
    }
    free(sorted);
    return err ? err : (int)n;
}

int apc_shm_catalogue(struct apc_store *store, char *text, size_t size, int64_t *revision)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (err) {
        return err;
    }
    const uint64_t g = apc_shm_generation(shm);
    for (int tries = 0; tries < APC_SHM_TRIES; tries++) {
        const struct apc_shm_header *h = shm->header;
        uint64_t was;
        const int current = apc_shm_current(h->tags_mark, apc_shm_generation(shm), &was);
        if (current < 0) {
            continue;
        }
        const uint64_t length = apc_word_get(&h->text_length[current]);
        *revision = (int64_t)apc_word_get(&h->revision[current]);
        if (length >= shm->text_size) {
            continue;
        }
        get_version_text(shm->text[current], text, size, (size_t)length);
        if (apc_shm_unchanged(&h->tags_mark[current], was)) {
            return (int)length;
        }
    }
    return apc_shm_lost(shm, g);
}

int apc_shm_get_tags(struct apc_store *store, struct apc_tag *tags, size_t capacity)
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (err) {
        return err;
    }
    const uint64_t g = apc_shm_generation(shm);
    for (int tries = 0; tries < APC_SHM_TRIES; tries++) {
        const apc_word *marks = shm->header->tags_mark;
        uint64_t was;
        const int current = apc_shm_current(marks, apc_shm_generation(shm), &was);
        if (current < 0) {
            continue;
        }
        const uint64_t n = apc_word_get(&shm->header->n_tags[current]);
        const size_t some = n < capacity ? (size_t)n : capacity;
        if (n > shm->tags) {
            continue;
        }
        apc_words_get(tags, shm->tag[current], some * sizeof *tags / 8);
        if (apc_shm_unchanged(&marks[current], was)) {
            return (int)n;
        }
    }
    return apc_shm_lost(shm, g);
}

/* ---- Authors ---------------------------------------------------------------------------------- */

static uint64_t authors(const struct apc_shm *shm)
{
    const uint64_t n = atomic_load_explicit(&shm->header->authors, memory_order_acquire);
    return n < APC_SHM_AUTHORS ? n : APC_SHM_AUTHORS;
}

/* The number of a name among @p n; 0: it has none. */
static int number_of_author(const struct apc_shm *shm, uint64_t n, const char name[APC_AUTHOR_LEN])
{
    char known[APC_AUTHOR_LEN];
    for (uint64_t i = 0; i < n; i++) {
        apc_words_get(known, shm->header->author[i], APC_AUTHOR_LEN / 8);
        if (memcmp(known, name, APC_AUTHOR_LEN) == 0) {
            return (int)i + 1;
        }
    }
    return 0;
}

/* The lock is held. */
static int add_author(struct apc_shm *shm, const char name[APC_AUTHOR_LEN])
{
    const uint64_t n = authors(shm);
    const int number = number_of_author(shm, n, name);
    if (number > 0) {
        return number;
    }
    if (n == APC_SHM_AUTHORS) {
        return apc_fail(&shm->base.why, APC_ESTORE, "shm:%s holds the names of %d authors, and no more",
                        shm->name, APC_SHM_AUTHORS);
    }
    apc_words_put(shm->header->author[n], name, APC_AUTHOR_LEN / 8);
    atomic_store_explicit(&shm->header->authors, n + 1, memory_order_release);
    return (int)n + 1;
}

int apc_shm_author(struct apc_store *store, const char *name)
{
    struct apc_shm *shm = apc_shm_of(store);
    int number = apc_shm_ready(shm);
    if (number == 0) {
        number = number_of_author(shm, authors(shm), name);
    }
    if (number == 0) {
        number = apc_shm_lock(shm);
        if (number == 0) {
            number = add_author(shm, name);
            apc_shm_unlock(shm);
        }
    }
    return number;
}

int apc_shm_author_name(struct apc_store *store, uint32_t number, char name[APC_AUTHOR_LEN])
{
    struct apc_shm *shm = apc_shm_of(store);
    int err = apc_shm_ready(shm);
    if (!err && number > authors(shm)) {
        err = APC_ENOTFOUND;
    }
    if (!err) {
        apc_words_get(name, shm->header->author[number - 1], APC_AUTHOR_LEN / 8);
        name[APC_AUTHOR_LEN - 1] = '\0';
    }
    return err;
}
