/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Columns as the Arrow C data and stream interfaces have them, in a PyCapsule: whoever knows Arrow takes them
 * without a copy, and without this package knowing him. The structs are those of the Arrow specification,
 * which are an ABI.
 *
 * Numbers, texts and descriptions are the owner's, a Python object. Each schema and each batch is a block of
 * memory with a reference to it, which goes with the last of the parts that point into it: a consumer may
 * take parts out of the whole, and may release them on any thread, also after the interpreter has ended.
 */
#include <Python.h>
#include <apcstore.h>
#include <errno.h>
#include <stdlib.h>

#include "columns.h"

struct ArrowSchema {
    const char *format, *name, *metadata;
    int64_t flags, n_children;
    struct ArrowSchema **children, *dictionary;
    void (*release)(struct ArrowSchema *);
    void *private_data;
};

struct ArrowArray {
    int64_t length, null_count, offset, n_buffers, n_children;
    const void **buffers;
    struct ArrowArray **children, *dictionary;
    void (*release)(struct ArrowArray *);
    void *private_data;
};

struct ArrowArrayStream {
    int (*get_schema)(struct ArrowArrayStream *, struct ArrowSchema *out);
    int (*get_next)(struct ArrowArrayStream *, struct ArrowArray *out);
    const char *(*get_last_error)(struct ArrowArrayStream *);
    void (*release)(struct ArrowArrayStream *);
    void *private_data;
};

#define NULLABLE 2
#define STREAM   "arrow_array_stream"

static void keep(PyObject *owner)
{
    const PyGILState_STATE state = PyGILState_Ensure();

    Py_INCREF(owner);
    PyGILState_Release(state);
}

static void let_go(PyObject *owner)
{
    if (!Py_IsInitialized())
        return;
    const PyGILState_STATE state = PyGILState_Ensure();

    Py_DECREF(owner);
    PyGILState_Release(state);
}

/* ---- A schema, a batch: a block with a count of the parts that point into it ----------------- */

struct block {
    PyObject *owner;
    size_t parts;
};

static void leave(struct block *block)
{
    if (__atomic_sub_fetch(&block->parts, 1, __ATOMIC_ACQ_REL) > 0)
        return;
    let_go(block->owner);
    free(block);
}

static void release_schema(struct ArrowSchema *schema)
{
    for (int64_t i = 0; i < schema->n_children; i++)
        if (schema->children[i]->release)
            schema->children[i]->release(schema->children[i]);
    if (schema->dictionary && schema->dictionary->release)
        schema->dictionary->release(schema->dictionary);
    schema->release = NULL;
    leave(schema->private_data);
}

static void release_array(struct ArrowArray *array)
{
    for (int64_t i = 0; i < array->n_children; i++)
        if (array->children[i]->release)
            array->children[i]->release(array->children[i]);
    if (array->dictionary && array->dictionary->release)
        array->dictionary->release(array->dictionary);
    array->release = NULL;
    leave(array->private_data);
}

/* ---- The stream ------------------------------------------------------------------------------ */

struct source {
    PyObject *owner;
    const struct apc_arrow_column *column;
    size_t n_columns;
    int64_t n;
    bool given;
};

struct schemas {
    struct block block;
    struct column_schema {
        struct ArrowSchema own, words, *pointer;
    } column[];
};

static int get_schema(struct ArrowArrayStream *stream, struct ArrowSchema *out)
{
    const struct source *const s = stream->private_data;
    struct schemas *const all =
        calloc(1, sizeof *all + s->n_columns * (sizeof *all->column + sizeof(void *)));

    if (!all)
        return ENOMEM;
    struct ArrowSchema **const children = (void *)&all->column[s->n_columns];

    for (size_t i = 0; i < s->n_columns; i++) {
        const struct apc_arrow_column *const c = &s->column[i];
        struct column_schema *const to = &all->column[i];

        to->own = (struct ArrowSchema){.format = c->format,
                                       .name = c->name,
                                       .flags = NULLABLE,
                                       .dictionary = c->end ? &to->words : NULL,
                                       .release = release_schema,
                                       .private_data = all};
        if (c->end)
            to->words = (struct ArrowSchema){
                .format = "u", .name = "", .release = release_schema, .private_data = all};
        all->block.parts += c->end ? 2 : 1;
        children[i] = &to->own;
    }
    all->block.parts++;
    all->block.owner = s->owner;
    keep(s->owner);
    *out = (struct ArrowSchema){.format = "+s",
                                .name = "",
                                .n_children = (int64_t)s->n_columns,
                                .children = children,
                                .release = release_schema,
                                .private_data = all};
    return 0;
}

struct batch {
    struct block block;
    const void *none[1]; /* of the whole: all rows are valid */
    struct column_batch {
        struct ArrowArray own, words;
        const void *buffer[2], *text[3];
    } column[];
};

static int get_next(struct ArrowArrayStream *stream, struct ArrowArray *out)
{
    struct source *const s = stream->private_data;

    *out = (struct ArrowArray){0};
    if (s->given)
        return 0;
    struct batch *const all = calloc(1, sizeof *all + s->n_columns * (sizeof *all->column + sizeof(void *)));

    if (!all)
        return ENOMEM;
    struct ArrowArray **const children = (void *)&all->column[s->n_columns];

    for (size_t i = 0; i < s->n_columns; i++) {
        const struct apc_arrow_column *const c = &s->column[i];
        struct column_batch *const to = &all->column[i];

        to->buffer[0] = c->valid;
        to->buffer[1] = c->data;
        to->text[1] = c->end;
        to->text[2] = c->texts;
        to->own = (struct ArrowArray){.length = s->n,
                                      .null_count = c->nulls,
                                      .n_buffers = 2,
                                      .buffers = to->buffer,
                                      .dictionary = c->end ? &to->words : NULL,
                                      .release = release_array,
                                      .private_data = all};
        if (c->end)
            to->words = (struct ArrowArray){.length = c->n_texts,
                                            .n_buffers = 3,
                                            .buffers = to->text,
                                            .release = release_array,
                                            .private_data = all};
        all->block.parts += c->end ? 2 : 1;
        children[i] = &to->own;
    }
    all->block.parts++;
    all->block.owner = s->owner;
    keep(s->owner);
    s->given = true;
    *out = (struct ArrowArray){.length = s->n,
                               .n_buffers = 1,
                               .buffers = all->none,
                               .n_children = (int64_t)s->n_columns,
                               .children = children,
                               .release = release_array,
                               .private_data = all};
    return 0;
}

static const char *get_last_error(struct ArrowArrayStream *stream)
{
    (void)stream;
    return "out of memory";
}

static void release_stream(struct ArrowArrayStream *stream)
{
    struct source *const s = stream->private_data;

    let_go(s->owner);
    free(s);
    stream->release = NULL;
}

/* Who took the stream out of the capsule has left it released. */
static void end_capsule(PyObject *capsule)
{
    struct ArrowArrayStream *const stream = PyCapsule_GetPointer(capsule, STREAM);

    if (stream && stream->release)
        stream->release(stream);
    free(stream);
}

static int put_capsule(PyObject *list, struct ArrowArrayStream *stream)
{
    const PyGILState_STATE state = PyGILState_Ensure();
    PyObject *const capsule = PyCapsule_New(stream, STREAM, end_capsule);
    const int rc = capsule ? PyList_Append(list, capsule) : -1;

    if (!capsule) {
        stream->release(stream);
        free(stream);
    }
    Py_XDECREF(capsule);
    if (rc < 0)
        PyErr_Clear();
    PyGILState_Release(state);
    return rc < 0 ? APC_ENOMEM : 0;
}

int apc_arrow_export(void *list, const struct apc_arrow_column *column, size_t n_columns, int64_t n,
                     void *owner)
{
    struct ArrowArrayStream *const stream = calloc(1, sizeof *stream);
    struct source *const s = calloc(1, sizeof *s);

    if (!stream || !s) {
        free(stream);
        free(s);
        return APC_ENOMEM;
    }
    *s = (struct source){.owner = owner, .column = column, .n_columns = n_columns, .n = n};
    *stream = (struct ArrowArrayStream){.get_schema = get_schema,
                                        .get_next = get_next,
                                        .get_last_error = get_last_error,
                                        .release = release_stream,
                                        .private_data = s};
    keep(owner);
    return put_capsule(list, stream);
}
