/* SPDX-License-Identifier: BSD-3-Clause */
/* The log book as a page that prints well: what is in it somebody wrote, so it is text and never markup. */
#include <string.h>

#include "apc/common/print.h"
#include "base/text.h"
#include "operate.h"

struct log_page {
    FILE *out;
    size_t n;
};

static void put_html(FILE *out, const char *text)
{
    char clean[512];
    for (const char *c = text_cleaned(clean, text, sizeof clean, false); *c; c++)
        if (strchr("&<>\"", *c))
            fprintf(out, "&#%d;", *c);
        else
            putc(*c, out);
}

static int put_entry(void *ctx, const struct apc_event *event)
{
    struct log_page *page = ctx;
    const bool signs = !strcmp(event->kind, "handover");
    char time[PRINT_LEN];
    if (!signs && strcmp(event->kind, "log") != 0)
        return 0;
    fprintf(page->out, "<tr><td>%s</td><td>", print_second(event->time, time));
    put_html(page->out, event->source);
    fprintf(page->out, "</td><td>%s</td><td>", signs ? "handover" : "entry");
    put_html(page->out, event->text);
    fputs("</td></tr>\n", page->out);
    page->n++;
    return 0;
}

int log_html(struct apc_store *store, const char *plant, const struct apc_range *range, FILE *out)
{
    struct log_page page = {.out = out};
    char from[PRINT_LEN], to[PRINT_LEN];
    fputs("<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>Log book ", out);
    put_html(out, plant);
    fputs("</title>\n<style>\n"
          "body { font: 10pt/1.4 sans-serif; margin: 1.5cm; }\n"
          "table { border-collapse: collapse; width: 100%; }\n"
          "th, td { border-bottom: 1px solid #999; padding: 2pt 8pt 2pt 0; text-align: left; vertical-align: "
          "top; }\n"
          "td:not(:last-child) { white-space: nowrap; }\n"
          "td:last-child { overflow-wrap: anywhere; width: 100%; }\n"
          "thead { display: table-header-group; }\n" /* on each sheet */
          "tr { break-inside: avoid; }\n"
          "@page { margin: 1.5cm; }\n"
          "@media print { body { margin: 0; } }\n"
          "</style>\n</head>\n<body>\n<h1>Log book ",
          out);
    put_html(out, plant);
    fprintf(out, "</h1>\n<p>From %s to %s, UTC</p>\n<table>\n", print_second(range->since, from),
            print_second(range->until, to));
    fputs("<thead><tr><th>Time</th><th>Who</th><th>Kind</th><th>Message</th></tr></thead>\n<tbody>\n", out);
    const int rc = apc_store_events(store, range, put_entry, &page);
    fprintf(out, "</tbody>\n</table>\n<p>Entries: %zu</p>\n</body>\n</html>\n", page.n);
    return rc < 0 ? rc : 0;
}
