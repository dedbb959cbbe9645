/* SPDX-License-Identifier: BSD-3-Clause */
/* What came of scenarios: for people, as TAP and as JUnit's XML. */
#include "check_print.h"

#include <math.h>
#include <string.h>

#include "apc/common/print.h"
#include "check_session.h"

const struct check_trial *checked_trial(const struct checked *c, unsigned run)
{
    return (const struct check_trial *)(const void *)(c->trials + run * c->stride);
}

/* ---- Outcomes ------------------------------------------------------------------------------- */

/* What is said of one run. */
static void say_run(const struct checked *c, const struct check_outcome *o, size_t i, char *text, size_t size)
{
    const struct check_trial *t = o->trial;
    if (!o->verdict) {
        snprintf(text, size, "%s", t && t->made ? t->end.why : "the run was not made");
        return;
    }
    check_words(&c->scenario.expect[i], o->verdict, &c->scenario.sources, text, size);
    if (o->verdict->is == CHECK_UNKNOWN && t->end.rc < 0 && !o->verdict->why[0])
        snprintf(text, size, "cannot be judged: the run ended at %.10g s: %s", t->end.ended, t->end.why);
}

struct check_outcome checked_outcome(const struct checked *c, size_t expectation)
{
    struct check_outcome o = {.runs = c->scenario.runs};
    char text[300];
    for (unsigned run = 0; run < o.runs; run++) {
        const struct check_trial *t = checked_trial(c, run);
        const struct check_verdict *v = t->made && t->rc == 0 ? &t->verdict[expectation] : NULL;
        const bool held = v && v->is == CHECK_HELD;
        /* the first that failed, or the first one */
        if (run == 0 || (!held && o.n_held == run)) {
            o.trial = t;
            o.verdict = v;
            o.seed = c->scenario.seed + run;
        }
        o.n_held += held;
    }
    const double least = check_share_least(o.n_held, o.runs);
    o.held = o.runs > 1 && c->scenario.share < 1 ? least >= c->scenario.share : o.n_held == o.runs;
    say_run(c, &o, expectation, text, sizeof text);
    if (o.runs == 1) {
        snprintf(o.text, sizeof o.text, "%s", text);
        return o;
    }
    int used = snprintf(o.text, sizeof o.text, "in %u of %u runs", o.n_held, o.runs);
    if (c->scenario.share < 1 || o.n_held == o.runs)
        used += snprintf(o.text + used, sizeof o.text - (size_t)used,
                         ", with 95 %% confidence in %.4g %% or more", floor(1e4 * least) / 100);
    if (o.n_held < o.runs)
        snprintf(o.text + used, sizeof o.text - (size_t)used, "; seed %llu: %s", (unsigned long long)o.seed,
                 text);
    return o;
}

void checked_near(const struct checked *c, const struct check_outcome *o, size_t expectation, char *text,
                  size_t size)
{
    const struct check_verdict *v = o->verdict;
    const struct check_source *of = &c->scenario.sources.at[c->scenario.expect[expectation].trajectory];
    size_t used = 0;
    *text = '\0';
    if (!v || v->is == CHECK_HELD || v->n_near == 0 || of->table == APC_ALARM || of->table == APC_ACTUAL)
        return;
    used = (size_t)snprintf(text, size, "%s%s:", of->plant ? "plant " : "", of->name);
    for (size_t i = 0; i < v->n_near && used < size; i++)
        used +=
            (size_t)snprintf(text + used, size - used, "%s %.6g%s at %.10g s", i ? "," : "", v->near[i].value,
                             v->near[i].known ? "" : " (Bad)", apc_ns_to_s(v->near[i].t));
}

static const char *checked_reason(const struct checked *c, size_t expectation)
{
    return c->why && c->why[expectation] ? c->why[expectation] : "";
}

/* ---- For people ----------------------------------------------------------------------------- */

static void print_scenario(const struct checked *c)
{
    const struct scenario *of = &c->scenario;
    print_clean(stdout, of->file);
    fputs(": ", stdout);
    print_clean(stdout, of->title);
    if (c->session) {
        fputs("; session ", stdout);
        print_clean(stdout, checked_session_folder(c));
        fputs(", operated by ", stdout);
        print_clean(stdout, checked_session_who(c));
    }
    if (of->runs > 1)
        printf("; %u runs of %.10g s, seeds %llu to %llu\n", of->runs, of->e.duration,
               (unsigned long long)of->seed, (unsigned long long)of->seed + of->runs - 1);
    else
        printf("; %.10g s, seed %llu\n", of->e.duration, (unsigned long long)of->seed);
}

/* Line by line below what it is of. */
static void print_reason(const char *why)
{
    for (size_t n = 0; *why; why += n + (why[n] == '\n')) {
        n = strcspn(why, "\n");
        printf("%*s%.*s\n", n > 0 ? 12 : 0, "", (int)n, why);
    }
}

static void print_check_line(const struct checked *c, size_t i, const struct check_outcome *o)
{
    char near[400];
    printf("  %-7s ", o->held ? "held" : "failed");
    print_clean(stdout, c->scenario.expect[i].text);
    fputs(": ", stdout);
    print_clean(stdout, o->text);
    putchar('\n');
    checked_near(c, o, i, near, sizeof near);
    if (!o->held && *near) {
        fputs("            ", stdout);
        print_clean(stdout, near);
        putchar('\n');
    }
    print_reason(checked_reason(c, i));
}

/* ---- TAP ------------------------------------------------------------------------------------ */

#define CLEAN_LEN 600

/* As people may see it. */
static void clean_text(const char *text, char clean[CLEAN_LEN])
{
    clean[0] = '\0'; /* of an empty text nothing is written */
    FILE *out = fmemopen(clean, CLEAN_LEN, "w");
    if (!out)
        return;
    print_clean(out, text);
    fclose(out);
    clean[CLEAN_LEN - 1] = '\0';
}

/* A # would begin a directive, a \ escapes. */
static void put_tap_text(const char *text)
{
    char clean[CLEAN_LEN];
    clean_text(text, clean);
    for (const char *at = clean; *at; at++) {
        if (*at == '#' || *at == '\\')
            putchar('\\');
        putchar(*at);
    }
}

static void put_yaml_text(const char *name, const char *text)
{
    struct text t = {.out = stdout};
    printf("  %s: ", name);
    json_add(&t, "%s", text); /* a text of JSON is one of YAML */
    putchar('\n');
}

static void print_tap(const struct checked *c, size_t i, const struct check_outcome *o, size_t number)
{
    char near[400];
    printf("%sok %zu - ", o->held ? "" : "not ", number);
    put_tap_text(c->scenario.file);
    fputs(": ", stdout);
    put_tap_text(c->scenario.expect[i].text);
    putchar('\n');
    puts("  ---");
    put_yaml_text("message", o->text);
    checked_near(c, o, i, near, sizeof near);
    if (!o->held && *near)
        put_yaml_text("near", near);
    if (*checked_reason(c, i))
        put_yaml_text("why", checked_reason(c, i));
    puts("  ...");
}

/* ---- JUnit ---------------------------------------------------------------------------------- */

static void put_xml(const char *text)
{
    for (const char *at = text; *at; at++)
        if (*at == '&')
            fputs("&amp;", stdout);
        else if (*at == '<')
            fputs("&lt;", stdout);
        else if (*at == '>')
            fputs("&gt;", stdout);
        else if (*at == '"')
            fputs("&quot;", stdout);
        else
            putchar(*at);
}

static void put_xml_text(const char *text)
{
    char clean[CLEAN_LEN];
    clean_text(text, clean);
    put_xml(clean);
}

static void print_junit_case(const struct checked *c, size_t i, const struct check_outcome *o)
{
    char near[400];
    fputs("    <testcase classname=\"", stdout);
    put_xml_text(c->scenario.file);
    fputs("\" name=\"", stdout);
    put_xml_text(c->scenario.expect[i].text);
    fputs("\">\n      <", stdout);
    fputs(o->held ? "system-out>" : "failure message=\"", stdout);
    put_xml_text(o->text);
    checked_near(c, o, i, near, sizeof near);
    if (!o->held) {
        fputs("\">", stdout);
        put_xml_text(near);
        fputs(*near && *checked_reason(c, i) ? "\n" : "", stdout);
        put_xml(checked_reason(c, i));
    }
    printf("</%s>\n    </testcase>\n", o->held ? "system-out" : "failure");
}

static size_t count_failed(const struct checked *c)
{
    size_t failed = 0;
    for (size_t i = 0; i < c->scenario.n_expect; i++)
        failed += !checked_outcome(c, i).held;
    return failed;
}

/* ---- A page --------------------------------------------------------------------------------- */

static void begin_check_page(const struct checked *c)
{
    page_begin(stdout, c->session ? "Training record" : "Acceptance report", c->scenario.title);
    fputs("<p>", stdout);
    page_text(stdout, c->scenario.file);
    if (c->session) {
        fputs("; session ", stdout);
        page_text(stdout, checked_session_folder(c));
        fputs(", operated by ", stdout);
        page_text(stdout, checked_session_who(c));
    }
    printf("; %.10g s, runs: %u from seed %llu on; libapc %s</p>\n", c->scenario.e.duration, c->scenario.runs,
           (unsigned long long)c->scenario.seed, apc_version());
}

static size_t print_check_page(const struct checked *c)
{
    static const struct print_column columns[] = {
        {"expectation", PRINT_LEFT}, {"", PRINT_LEFT}, {"", PRINT_LEFT}};
    struct print_table t;
    size_t failed = 0;
    begin_check_page(c);
    print_table_open(&t, columns, sizeof columns / sizeof *columns);
    for (size_t i = 0; i < c->scenario.n_expect; i++) {
        const struct check_outcome o = checked_outcome(c, i);
        failed += !o.held;
        print_cell(&t, PRINT_PLAIN, "%s", c->scenario.expect[i].text);
        print_cell(&t, PRINT_PLAIN, "%s", o.held ? "held" : "failed");
        print_cell(&t, PRINT_PLAIN, "%s", o.text);
    }
    if (page_table(stdout, &t) < 0 || (c->session && checked_session_show(c, stdout, page_table) < 0))
        fputs("<p>out of memory</p>\n", stdout);
    fputs("<p>Date, name, signature:</p>\n</body>\n</html>\n", stdout);
    return failed;
}

/* ---- JSON ----------------------------------------------------------------------------------- */

static size_t add_checks(struct text *t, const struct checked *c)
{
    size_t failed = 0;
    json_add(t, "expectations:[");
    for (size_t i = 0; i < c->scenario.n_expect; i++) {
        const struct check_outcome o = checked_outcome(c, i);
        char near[400];
        checked_near(c, &o, i, near, sizeof near);
        failed += !o.held;
        json_add(t, "{expectation:%s, held:%i, message:%s, near:%-s, why:%-s}", c->scenario.expect[i].text,
                 o.held, o.text, o.held ? "" : near, checked_reason(c, i));
    }
    json_add(t, "]");
    return failed;
}

static size_t print_check_json(const struct checked *c, size_t n)
{
    struct text t = {.out = stdout};
    size_t failed = 0;
    json_add(&t, "[");
    for (size_t k = 0; k < n; k++) {
        const struct scenario *of = &c[k].scenario;
        json_add(&t, "{scenario:%s, title:%s, duration_s:%g, runs:%u, seed:%ju,", of->file, of->title,
                 of->e.duration, of->runs, (uintmax_t)of->seed);
        failed += add_checks(&t, &c[k]);
        if (c[k].session)
            checked_session_json(&c[k], &t);
        json_add(&t, "}");
    }
    json_add(&t, "]");
    putchar('\n');
    return failed;
}

/* ---- All of it ------------------------------------------------------------------------------ */

static void begin_check_format(const struct checked *c, size_t n, enum check_format format)
{
    size_t expected = 0;
    for (size_t k = 0; k < n; k++)
        expected += c[k].scenario.n_expect;
    if (format == CHECK_FORMAT_TAP)
        printf("TAP version 13\n1..%zu\n", expected);
    else if (format == CHECK_FORMAT_JUNIT)
        puts("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>");
}

static void begin_check_scenario(const struct checked *c, enum check_format format)
{
    if (format == CHECK_FORMAT_TEXT)
        print_scenario(c);
    if (format != CHECK_FORMAT_JUNIT)
        return;
    fputs("  <testsuite name=\"", stdout);
    put_xml_text(c->scenario.title);
    printf("\" tests=\"%zu\" failures=\"%zu\">\n", c->scenario.n_expect, count_failed(c));
}

static int put_check_table(FILE *out, struct print_table *table)
{
    putc('\n', out);
    return print_table_end(table, out, false, 0);
}

static void show_session(const struct checked *c)
{
    if (checked_session_show(c, stdout, put_check_table) < 0)
        fputs("out of memory", stdout);
    putchar('\n');
}

size_t checked_print(const struct checked *c, size_t n, enum check_format format)
{
    size_t number = 0, failed = 0;
    if (format == CHECK_FORMAT_HTML)
        return print_check_page(c);
    if (format == CHECK_FORMAT_JSON)
        return print_check_json(c, n);
    begin_check_format(c, n, format);
    for (size_t k = 0; k < n; k++) {
        begin_check_scenario(&c[k], format);
        for (size_t i = 0; i < c[k].scenario.n_expect; i++) {
            const struct check_outcome o = checked_outcome(&c[k], i);
            failed += !o.held;
            number++;
            if (format == CHECK_FORMAT_TAP)
                print_tap(&c[k], i, &o, number);
            else if (format == CHECK_FORMAT_JUNIT)
                print_junit_case(&c[k], i, &o);
            else
                print_check_line(&c[k], i, &o);
        }
        if (format == CHECK_FORMAT_JUNIT)
            puts("  </testsuite>");
        else if (format == CHECK_FORMAT_TEXT && c[k].session)
            show_session(&c[k]);
    }
    if (format == CHECK_FORMAT_JUNIT)
        puts("</testsuites>");
    else if (format == CHECK_FORMAT_TEXT)
        printf("%zu of %zu expectations held\n", number - failed, number);
    return failed;
}
