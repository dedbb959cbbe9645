/* SPDX-License-Identifier: BSD-3-Clause */
/* Each mistake in an experiment file is refused with its line and reason, as experiment.refusals has it. */
#include "check.h"

#include <stdio.h>
#include <stdlib.h>

#include "experiment/experiment.h"

#define GOLDEN APC_SOURCE_DIR "/tests/unit/experiment/experiment.refusals"
#define NEW    "experiment.refusals.new" /* where the test runs */

enum { LINES = 32, WIDE = 1024 };

/* A file that is right, and the texts that are put into its lines. */
struct mistake {
    char file[64], line[LINES][WIDE], text[LINES][WIDE];
    bool put[LINES];
    int lines, at; /* at: the line that was last put in, 0: none */
};

/* One line more, without its indentation. */
static void add(char *to, const char *line)
{
    const size_t used = strlen(to);

    assert_true(used + strlen(line) + 2 < WIDE);
    snprintf(to + used, WIDE - used, "%s%s", used ? "\n" : "", line);
}

static void make(const struct mistake *m, char text[LINES * WIDE])
{
    size_t used = 0;

    for (int i = 0; i < m->lines; i++) {
        const char *put = m->put[i] ? m->text[i] : "", *hole = strchr(m->line[i], '%');
        const int before = hole ? (int)(hole - m->line[i]) : m->put[i] ? 0 : (int)strlen(m->line[i]);

        used += (size_t)snprintf(text + used, LINES * WIDE - used, "%.*s%s%s\n", before, m->line[i], put,
                                 hole ? hole + 1 : "");
        assert_true(used < LINES * WIDE);
    }
}

/* What is said of it; it leaves nothing behind. */
static void say(const struct mistake *m, char said[WIDE])
{
    char text[LINES * WIDE] = "";
    struct experiment e;
    struct apc_error why = {""};

    make(m, text);
    if (experiment_parse(&e, &(struct experiment_source){.file = m->file, .text = text},
                         EXPERIMENT_MODEL | EXPERIMENT_LAW, NULL, &why) >= 0)
        fail_msg("taken: %s, line %d: %s", m->file, m->at, m->text[m->at - 1]);
    assert_null(e.y);
    assert_null(e.alarm);
    assert_null(e.scheduler.sequence);
    snprintf(said, WIDE, ": %s", why.text);
}

/* Takes a line of the golden file in; true: it has the answer to @p m. */
static bool answers(struct mistake *m, const char *line)
{
    if (line[0] == ':')
        return true;
    if (!strncmp(line, "file ", 5)) {
        *m = (struct mistake){.lines = 0};
        snprintf(m->file, sizeof m->file, "%s", line + 5);
    } else if (!strncmp(line, "    ", 4) && m->at) {
        add(m->text[m->at - 1], line + 4);
    } else if (!strncmp(line, "    ", 4)) {
        assert_true(m->lines < LINES);
        add(m->line[m->lines++], line + 4);
    } else if (line[0] && line[0] != '#') {
        char *end;

        m->at = (int)strtol(line, &end, 10);
        assert_in_range(m->at, 1, m->lines);
        m->put[m->at - 1] = true;
        m->text[m->at - 1][0] = '\0';
        add(m->text[m->at - 1], *end ? end + 1 : end);
    }
    return false;
}

/*
 * Promise(experiment/misspelled-missing-name): A misspelled or missing name, a value outside its limits:
 *   file, line, reason; nothing is started.
 * Promise(incoming/scale-code-unit): A scale, code or unit that cannot be is refused with its line.
 * Promise(experiment/actions-taken-time)
 * Promise(experiment/area-scale-period)
 * Promise(experiment/several-controllers)
 * Promise(links/types-word-order)
 */
static void a_mistake_is_refused_with_its_line_and_reason(void **state)
{
    static struct mistake m;
    char line[WIDE], said[WIDE];
    int refused = 0, others = 0, at = 0;
    FILE *golden = fopen(GOLDEN, "r"), *out = fopen(NEW, "w");

    (void)state;
    assert_non_null(golden);
    assert_non_null(out);
    while (at++, fgets(line, sizeof line, golden)) {
        line[strcspn(line, "\n")] = '\0';
        if (answers(&m, line)) {
            refused++;
            say(&m, said);
            memset(m.put, 0, sizeof m.put);
            if (strcmp(line, said) != 0)
                print_error("experiment.refusals:%d:\n%s\n%s\n", at, line, said), others++;
            snprintf(line, sizeof line, "%s", said);
        }
        fprintf(out, "%s\n", line);
    }
    fclose(golden);
    assert_int_equal(fclose(out), 0);
    assert_true(refused > 450);
    if (others)
        fail_msg("%d sentences are others; if they are meant: cp " NEW " " GOLDEN, others);
    remove(NEW);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mistake_is_refused_with_its_line_and_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
