/* SPDX-License-Identifier: BSD-3-Clause */
/* What came with a request; apart, so that tests can ask the handlers without a connection. */
#include "http.h"

const char *request_query(const struct request *r, const char *name)
{
    return MHD_lookup_connection_value(r->connection, MHD_GET_ARGUMENT_KIND, name);
}

const char *request_header(const struct request *r, const char *name)
{
    return MHD_lookup_connection_value(r->connection, MHD_HEADER_KIND, name);
}
