/* SPDX-License-Identifier: BSD-3-Clause */
/* What predictive laws expected at an instant, over their horizons, beside what came of it. */
#ifndef APC_OUTLOOK_H
#define APC_OUTLOOK_H

#include <apcstore.h>

/* Of one measurement what was predicted, or of one output what was planned. */
struct outlook_course {
    char name[APC_TAG_LEN], unit[APC_TAG_LEN]; /* of the variable */
    enum apc_table table;                      /* the variable: of sensor, actuator or setpoint */
    int id;
    int prediction;    /* id of the row in table prediction */
    apc_ns made, step; /* when */
    apc_ns first;      /* after that: when the first value is for */
    apc_ns patience;   /* how long a row of the variable stands for what is */
    size_t n;
    double *expected, *came; /* [n]; came is NAN where nothing is on record, or it is Bad */
};

struct outlook {
    struct outlook_course *course;
    size_t n;
};

/* The variable of @p table that a name beside it is of: "y1.prediction" or, of several controllers,
 * "upper.y1.prediction" is of y1, with @p end ".prediction". NULL: of none that is there. */
const struct apc_tag *outlook_variable(const struct apc_tag *published, const char *end, enum apc_table table,
                                       const struct apc_tag *tag, size_t n);

/*
 * What stood at @p at: of each variable whose tag says that a law expects it, the newest row until then,
 * unless its horizon was over. The store's times are @p offset later. Nothing of what came is known yet.
 * Returns 0, APC_ENOMEM or the store's error; outlook_free() in either case.
 */
int outlook_load(struct outlook *o, struct apc_store *published, const struct apc_tag *tag, size_t n,
                 apc_ns at, apc_ns offset);
/* What came, from rows by time. */
void outlook_take(struct outlook *o, const struct apc_sample *rows, size_t n);
/* The same from a store's history until @p now, whose times are those of @p o. Returns 0, APC_ENOMEM or the
 * store's error. */
int outlook_take_store(struct outlook *o, struct apc_store *store, apc_ns now);
void outlook_free(struct outlook *o);

/* Of value @p k: how long after it was made. */
static inline double outlook_ahead(const struct outlook_course *c, size_t k)
{
    return apc_ns_to_s(c->first + c->step * (apc_ns)k);
}

#endif
