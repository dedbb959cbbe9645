/* SPDX-License-Identifier: BSD-3-Clause */
/* The log book as a page. */
#include <string.h>

#include "apc/common/print.h"
#include "operate.h"

struct log_page {
    FILE *out;
    size_t n;
};

static int put_entry(void *ctx, const struct apc_event *event)
{
    struct log_page *page = ctx;
    const bool signs = !strcmp(event->kind, "handover");
    char time[PRINT_LEN];
    if (!signs && strcmp(event->kind, "log") != 0)
        return 0;
    fprintf(page->out, "<tr><td>%s</td><td>", print_second(event->time, time));
    page_text(page->out, event->source);
    fprintf(page->out, "</td><td>%s</td><td>", signs ? "handover" : "entry");
    page_text(page->out, event->text);
    fputs("</td></tr>\n", page->out);
    page->n++;
    return 0;
}

int log_html(struct apc_store *store, const char *plant, const struct apc_range *range, FILE *out)
{
    struct log_page page = {.out = out};
    char from[PRINT_LEN], to[PRINT_LEN];
    page_begin(out, "Log book", plant);
    fprintf(out, "<p>From %s to %s, UTC</p>\n<table>\n", print_second(range->since, from),
            print_second(range->until, to));
    fputs("<thead><tr><th>Time</th><th>Who</th><th>Kind</th><th>Message</th></tr></thead>\n<tbody>\n", out);
    const int rc = apc_store_events(store, range, put_entry, &page);
    fprintf(out, "</tbody>\n</table>\n<p>Entries: %zu</p>\n</body>\n</html>\n", page.n);
    return rc < 0 ? rc : 0;
}
