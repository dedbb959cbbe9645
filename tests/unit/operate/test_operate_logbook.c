/* SPDX-License-Identifier: BSD-3-Clause */
/* What people enter in the log book: what is taken, once, and what a signature has to know of. */
#include <string.h>

#include "operated_plant.h"

static struct known_plant plant;
static struct apc_event last;
static int entries;

static int set_up(void **state)
{
    (void)state;
    open_operated_plant();
    return known_load(&plant, store);
}

static int tear_down(void **state)
{
    (void)state;
    known_free(&plant);
    apc_store_close(store);
    return 0;
}

static int take_entry(void *ctx, const struct apc_event *event)
{
    (void)ctx;
    entries += !strcmp(event->kind, "log") || !strcmp(event->kind, "handover");
    last = *event;
    return 0;
}

static int count_entries(void)
{
    entries = 0;
    assert_true(apc_store_events(store, &(struct apc_range){0}, take_entry, NULL) >= 0);
    return entries;
}

/* Returns as logbook_add(), or the error. */
static int enters(struct logbook_entry entry, apc_ns seen, struct change_fault *why)
{
    struct apc_event event;
    const int rc = logbook_make(&plant.view, &entry, &event, why);
    return rc < 0 ? rc : logbook_add(store, seen, &event, why);
}

/* Promise(page/log-book): An entry of the log book is an event with author and time; two presses make one. */
static void an_entry_is_an_event_and_two_presses_make_one(void **state)
{
    const struct logbook_entry entry = {
        .author = "anna", .signal = "y", .text = "<b>filter</b> gereinigt: ä"};
    struct change_fault why;
    (void)state;
    assert_int_equal(enters(entry, -1, &why), 1);
    assert_int_equal(enters(entry, -1, &why), 0);
    assert_int_equal(count_entries(), 1);
    assert_string_equal(last.kind, "log");
    assert_string_equal(last.source, "anna");
    assert_string_equal(last.text, "y: <b>filter</b> gereinigt: ä");
    assert_int_equal(
        enters((struct logbook_entry){.author = "otto", .signal = "y", .text = entry.text}, -1, &why), 1);
    assert_int_equal(count_entries(), 2);
}

static void what_is_no_line_of_text_is_refused(void **state)
{
    char longest[LOGBOOK_TEXT + 2];
    const char *const bad[] = {"", "   ", "two\nlines", "\x1b[31m", "\xff", "\xc3", "a\xe2\x80\xae-"};
    struct change_fault why;
    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(enters((struct logbook_entry){.author = "anna", .text = bad[i]}, -1, &why),
                         APC_EINVAL);
        assert_string_equal(why.code, "value");
    }
    memset(longest, 'x', sizeof longest);
    longest[LOGBOOK_TEXT + 1] = '\0';
    assert_int_equal(enters((struct logbook_entry){.author = "anna", .text = longest}, -1, &why), APC_EINVAL);
    assert_string_equal(why.text, "an entry must have at most 180 bytes with its signal, not 181");
    longest[LOGBOOK_TEXT] = '\0';
    assert_int_equal(enters((struct logbook_entry){.author = "anna", .text = longest}, -1, &why), 1);
    assert_int_equal(enters((struct logbook_entry){.author = "anna", .signal = "q", .text = "?"}, -1, &why),
                     APC_ENOTFOUND);
    assert_string_equal(why.text, "there is no signal \"q\" of which to write");
    assert_int_equal(count_entries(), 1);
}

/* Promise(page/handover-signed): A handover is signed by who has read the newest entry, and by no other. */
static void who_signs_has_read_the_newest_entry(void **state)
{
    const struct logbook_entry sign = {.author = "otto", .text = "taken over", .signs = true};
    struct change_fault why;
    (void)state;
    assert_int_equal(enters((struct logbook_entry){.author = "anna", .text = "pump is loud"}, -1, &why), 1);
    count_entries();
    const apc_ns seen = last.time;
    assert_int_equal(enters(sign, seen - APC_NS_PER_S, &why), APC_ECONFLICT);
    assert_string_equal(why.code, "stale");
    assert_string_equal(why.text, "anna has entered \"pump is loud\" meanwhile: read it, then sign");
    assert_int_equal(enters(sign, 0, &why), APC_ECONFLICT);
    assert_int_equal(enters(sign, seen, &why), 1);
    assert_int_equal(enters(sign, seen, &why), 0); /* pressed twice */
    assert_int_equal(count_entries(), 2);
    assert_string_equal(last.kind, "handover");
}

#define T(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        T(an_entry_is_an_event_and_two_presses_make_one),
        T(what_is_no_line_of_text_is_refused),
        T(who_signs_has_read_the_newest_entry),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
