/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * PostgreSQL's binary format of arrays, both ways: big-endian; the number of dimensions, whether there
 * are NULLs, the element type, the number of elements, the lower bound; then of each element its length
 * (-1: NULL) and its bytes. (array_send() and array_recv() in PostgreSQL's arrayfuncs.c.)
 */
#include <assert.h>
#include <endian.h>
#include <stdlib.h>
#include <string.h>

#include "shareddata/postgresql/postgresql.h"

/* 2000-01-01 in Unix time: PostgreSQL's origin. */
#define ORIGIN (INT64_C(946684800) * APC_NS_PER_S)

static void put32(char *bytes, uint32_t value)
{
    value = htobe32(value);
    memcpy(bytes, &value, 4);
}

void apc_pg_put_int8(char bytes[8], int64_t value)
{
    uint64_t big = htobe64((uint64_t)value);
    memcpy(bytes, &big, 8);
}

void apc_pg_put_float8(char bytes[8], double value)
{
    int64_t bits;
    memcpy(&bits, &value, 8);
    apc_pg_put_int8(bytes, bits);
}

int32_t apc_pg_get_int4(const char *bytes)
{
    uint32_t big;
    memcpy(&big, bytes, 4);
    return (int32_t)be32toh(big);
}

int64_t apc_pg_get_int8(const char *bytes)
{
    uint64_t big;
    memcpy(&big, bytes, 8);
    return (int64_t)be64toh(big);
}

double apc_pg_get_float8(const char *bytes)
{
    int64_t bits = apc_pg_get_int8(bytes);
    double value;
    memcpy(&value, &bits, 8);
    return value;
}

int64_t apc_pg_cell(const PGresult *result, int row, int column)
{
    return PQgetlength(result, row, column) == 8 ? apc_pg_get_int8(PQgetvalue(result, row, column)) : 0;
}

int apc_pg_array_begin(struct apc_pg_array *a, uint32_t oid, size_t n)
{
    size_t need = APC_PG_ARRAY_SIZE(n, 8);
    if (need > a->capacity) {
        char *data = realloc(a->data, need);
        if (!data) {
            return APC_ENOMEM;
        }
        a->data = data;
        a->capacity = need;
    }
    put32(a->data, 1);
    put32(a->data + 4, 0);
    put32(a->data + 8, oid);
    put32(a->data + 12, (uint32_t)n);
    put32(a->data + 16, 1);
    a->length = 20;
    return 0;
}

static char *element(struct apc_pg_array *a, size_t width)
{
    assert(a->length + 4 + width <= a->capacity);
    char *bytes = a->data + a->length;
    put32(bytes, (uint32_t)width);
    a->length += 4 + width;
    return bytes + 4;
}

void apc_pg_array_int4(struct apc_pg_array *a, int32_t value)
{
    put32(element(a, 4), (uint32_t)value);
}

void apc_pg_array_int8(struct apc_pg_array *a, int64_t value)
{
    apc_pg_put_int8(element(a, 8), value);
}

void apc_pg_array_float8(struct apc_pg_array *a, double value)
{
    apc_pg_put_float8(element(a, 8), value);
}

void apc_pg_array_null(struct apc_pg_array *a)
{
    put32(element(a, 0) - 4, UINT32_MAX);
    put32(a->data + 4, 1);
}

/* How many elements of 8 bytes, or APC_EPROTO. */
static int count_elements(const char *bytes, size_t length, int32_t oid)
{
    if (length < 12 || apc_pg_get_int4(bytes + 8) != oid) {
        return APC_EPROTO;
    }
    if (apc_pg_get_int4(bytes) == 0) {
        return 0; /* an empty array has no dimension */
    }
    if (length < 20 || apc_pg_get_int4(bytes) != 1) {
        return APC_EPROTO;
    }
    int32_t n = apc_pg_get_int4(bytes + 12);
    if (n < 0 || length != APC_PG_ARRAY_SIZE((size_t)n, 8)) {
        return APC_EPROTO; /* also when there are NULLs, which are shorter */
    }
    return n;
}

int apc_pg_get_int8_array(const char *bytes, size_t length, int64_t *out, size_t capacity)
{
    int n = count_elements(bytes, length, APC_PG_INT8);
    for (size_t i = 0; n > 0 && i < (size_t)n && i < capacity; i++) {
        out[i] = apc_pg_get_int8(bytes + APC_PG_ARRAY_SIZE(i, 8) + 4);
    }
    return n;
}

int apc_pg_get_float8_array(const char *bytes, size_t length, double *out, size_t capacity)
{
    int n = count_elements(bytes, length, APC_PG_FLOAT8);
    for (size_t i = 0; n > 0 && i < (size_t)n && i < capacity; i++) {
        out[i] = apc_pg_get_float8(bytes + APC_PG_ARRAY_SIZE(i, 8) + 4);
    }
    return n;
}

int64_t apc_pg_time(apc_ns utc)
{
    int64_t us = utc / APC_NS_PER_US;
    if (utc % APC_NS_PER_US < 0) {
        us--; /* down, not towards zero: before 1970 as after */
    }
    return us - ORIGIN / APC_NS_PER_US;
}

apc_ns apc_pg_time_ns(int64_t pg)
{
    if (pg > (INT64_MAX - ORIGIN) / APC_NS_PER_US) {
        return INT64_MAX;
    }
    if (pg < INT64_MIN / APC_NS_PER_US) {
        return INT64_MIN; /* loses the 30 years before 1708, which no plant has records of */
    }
    return pg * APC_NS_PER_US + ORIGIN;
}
