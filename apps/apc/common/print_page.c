/* SPDX-License-Identifier: BSD-3-Clause */
#include "print_page.h"

#include <string.h>

#include "base/text.h"

void page_text(FILE *out, const char *text)
{
    char clean[512];
    for (const char *c = text_cleaned(clean, text, sizeof clean, false); *c; c++)
        if (strchr("&<>\"", *c))
            fprintf(out, "&#%d;", *c);
        else
            putc(*c, out);
}

void page_begin(FILE *out, const char *what, const char *name)
{
    fprintf(out, "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>%s ", what);
    page_text(out, name);
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
          "</style>\n</head>\n<body>\n",
          out);
    fprintf(out, "<h1>%s ", what);
    page_text(out, name);
    fputs("</h1>\n", out);
}

int page_table(FILE *out, struct print_table *table)
{
    const bool failed = table->failed;
    fputs(table->n > 0 ? "<table>\n<thead><tr>" : "", out);
    for (size_t i = 0; i < table->n_columns && table->n > 0; i++) {
        fputs("<th>", out);
        page_text(out, table->columns[i].heading);
        fputs("</th>", out);
    }
    for (size_t i = 0; i < table->n; i++) {
        fputs(i > 0 && i % table->n_columns > 0 ? "<td>"
              : i > 0                           ? "</tr>\n<tr><td>"
                                                : "</tr></thead>\n<tbody>\n<tr><td>",
              out);
        page_text(out, table->cells[i].text);
        fputs("</td>", out);
    }
    fputs(table->n > 0 ? "</tr>\n</tbody>\n</table>\n" : "", out);
    print_table_close(table);
    return failed ? APC_ENOMEM : 0;
}
