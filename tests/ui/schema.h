/* SPDX-License-Identifier: BSD-3-Clause */
/* docs/openapi.json against answers: as much of JSON Schema as that file uses. */
#ifndef APC_TEST_SCHEMA_H
#define APC_TEST_SCHEMA_H

#include <jansson.h>

/* What is meant where it is "$ref" to a part of the document; else itself. */
const json_t *schema_resolve(const json_t *root, const json_t *one);

/* Fails the test, saying where, unless value is what the schema says. root: the whole document. */
void schema_check(const json_t *root, const json_t *schema, const json_t *value, const char *where);

#endif
