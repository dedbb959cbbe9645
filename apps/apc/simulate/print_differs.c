/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_differs.h"

#include <math.h>

#include "apc/common/print.h"

static const char *differing_number(double value, char text[PRINT_LEN])
{
    if (isnan(value))
        text[0] = '\0';
    else
        print_exact(value, text);
    return text;
}

/* "  law: P 0.2 -> 0.6, I 1.5", those that are not 0; once where it is the same, or known of one alone. */
static void print_differing_terms(const struct differs *d, FILE *out)
{
    const char *before = "  law: ";
    char a[PRINT_LEN], b[PRINT_LEN];
    for (size_t i = 0; i < d->n_terms; i++) {
        const struct differs_term *term = &d->term[i];
        const bool both =
            !isnan(term->recorded) && !isnan(term->replayed) && term->recorded != term->replayed;
        const double one = isnan(term->replayed) ? term->recorded : term->replayed;
        if (!both && (one == 0 || isnan(one)))
            continue;
        fputs(before, out);
        print_clean(out, term->name);
        fputs(term->of[0] ? " of " : "", out);
        print_clean(out, term->of);
        fprintf(out, " %s%s%s", differing_number(both ? term->recorded : one, a), both ? " -> " : "",
                both ? differing_number(term->replayed, b) : "");
        before = ", ";
    }
    if (*before == ',')
        putc('\n', out);
}

static int print_differing_causes(const struct differs *d, FILE *out)
{
    static const struct print_column columns[] = {{"cause", PRINT_LEFT},     {"", PRINT_LEFT},
                                                  {"recorded", PRINT_RIGHT}, {"replayed", PRINT_RIGHT},
                                                  {"effect", PRINT_POINT},   {"%", PRINT_RIGHT}};
    const double whole = d->replayed - d->recorded;
    struct print_table table;
    char text[PRINT_LEN];
    if (d->n == 0)
        return 0;
    print_table_open(&table, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i <= d->n; i++) {
        const struct differs_cause together = {.name = "(together)",
                                               .recorded = (double)NAN,
                                               .replayed = (double)NAN,
                                               .kind = "not one alone",
                                               .effect = d->together},
                                   *cause = i < d->n ? &d->cause[i] : &together;
        if (i == d->n && fabs(d->together) <= 1e-12 * (fabs(d->recorded) + fabs(d->replayed)))
            continue;
        print_cell(&table, PRINT_PLAIN, "%s", cause->name);
        print_cell(&table, PRINT_PLAIN, "%s", cause->kind);
        print_cell(&table, PRINT_PLAIN, "%s", differing_number(cause->recorded, text));
        print_cell(&table, PRINT_PLAIN, "%s", differing_number(cause->replayed, text));
        print_cell(&table, PRINT_PLAIN, "%+.4g", cause->effect);
        if (whole < 0 || whole > 0)
            print_cell(&table, PRINT_PLAIN, "%.0f", 100 * cause->effect / whole + 0.0);
        else
            print_cell(&table, PRINT_PLAIN, "%s", "");
    }
    return print_table_end(&table, out, false, 0);
}

int print_differs(const struct differs *d, const char *when, FILE *out)
{
    char a[PRINT_LEN], b[PRINT_LEN];
    if (*when) {
        print_clean(out, d->output);
        fprintf(out, ": the first that differs: %s: %s on record, %s replayed\n", when,
                differing_number(d->recorded, a), differing_number(d->replayed, b));
    }
    print_differing_terms(d, out);
    const int rc = print_differing_causes(d, out);
    if (d->unknown[0])
        fprintf(out, "  %s\n", d->unknown);
    return rc;
}

void put_differs_json(const struct differs *d, struct text *t)
{
    if (!d->time) {
        json_add(t, "%jd", (intmax_t)JSON_NONE);
        return;
    }
    json_add(t, "{time:%.6jd, output:%-s, recorded:%g, replayed:%g, together:%g, reason:%-s, terms:[",
             (intmax_t)d->time, d->output, d->recorded, d->replayed, d->together, d->unknown);
    for (size_t i = 0; i < d->n_terms; i++)
        json_add(t, "{term:%s, of:%-s, recorded:%g, replayed:%g}", d->term[i].name, d->term[i].of,
                 d->term[i].recorded, d->term[i].replayed);
    json_add(t, "], causes:[");
    for (size_t i = 0; i < d->n; i++)
        json_add(t, "{cause:%s, kind:%s, recorded:%g, replayed:%g, effect:%g}", d->cause[i].name,
                 d->cause[i].kind, d->cause[i].recorded, d->cause[i].replayed, d->cause[i].effect);
    json_add(t, "]}");
}
