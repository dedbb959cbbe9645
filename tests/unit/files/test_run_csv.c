/* SPDX-License-Identifier: BSD-3-Clause */
/* The one reader of CSV: what RFC 4180 allows is read, what may mean two things is refused. */
/*
 * Promise(incoming/csv): CSV is read by RFC 4180: as pandas, a spreadsheet and a logger write it, it is
 *   the same record; what is in doubt is refused with line and column; rows that come late or early bias
 *   nothing.
 */
#include "check.h"
#include "files/files.h"
#include "scratch.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static struct apc_error why;

static struct csv *open_text(const char *text, size_t n)
{
    struct csv *csv;
    FILE *out = fopen(scratch_path("t.csv"), "w");

    assert_non_null(out);
    assert_int_equal(fwrite(text, 1, n, out), n);
    fclose(out);
    csv_open(&csv, scratch_path("t.csv"), &why);
    return csv;
}

/* All fields of all rows, each field within <>, each row with a line of its own; or the reason. */
static const char *rows_of(const char *text, size_t n)
{
    static char all[2000];
    size_t at = 0;
    struct csv *csv = open_text(text, n);
    int rc = csv ? 1 : -1;

    all[0] = '\0';
    for (size_t i = 0; csv && i < csv_columns(csv); i++)
        at += (size_t)snprintf(all + at, sizeof all - at, "<%s>", csv_name(csv, i));
    while (csv && (rc = csv_next(csv, &why)) > 0) {
        at += (size_t)snprintf(all + at, sizeof all - at, "\n%zu", csv_line(csv));
        for (size_t i = 0; i < csv_columns(csv); i++)
            at += (size_t)snprintf(all + at, sizeof all - at, "<%s>", csv_text(csv, i));
    }
    csv_close(csv);
    return rc < 0 ? strrchr(why.text, '/') + 1 : all;
}

#define ROWS(text) rows_of("" text, sizeof text - 1)

static void what_the_rfc_allows_is_read(void **state)
{
    (void)state;
    assert_string_equal(ROWS("a,b\n1,2\n3,4\n"), "<a><b>\n2<1><2>\n3<3><4>");
    assert_string_equal(ROWS("a,b\r\n1,2\r\n3,4"), "<a><b>\n2<1><2>\n3<3><4>");
    assert_string_equal(ROWS("a,b\r1,2\r3,4\r"), "<a><b>\n2<1><2>\n3<3><4>");
    assert_string_equal(ROWS("\xef\xbb\xbf\"a\",b\n\"1,5\",\"say \"\"x\"\"\"\n"),
                        "<a><b>\n2<1,5><say \"x\">");
    assert_string_equal(ROWS("a,b\n\"one\r\ntwo\",\"\"\n3,4\n"), "<a><b>\n2<one\r\ntwo><>\n4<3><4>");
    assert_string_equal(ROWS(" a , \"b\" ,c d\n 1 , \" 2 \" ,\n"), "<a><b><c d>\n2<1>< 2 ><>");
    assert_string_equal(ROWS("a;b\n1,5;2\n"), "<a><b>\n2<1,5><2>");
    assert_string_equal(ROWS("a\tb\n1 2\t\n"), "<a><b>\n2<1 2><>");
    assert_string_equal(ROWS("\"a;c\",b\n1,2\n"), "<a;c><b>\n2<1><2>");
    assert_string_equal(ROWS("a\n1\n"), "<a>\n2<1>");
    assert_string_equal(ROWS("T in \xc2\xb0"
                             "C,b\n1,2\n"),
                        "<T in \xc2\xb0"
                        "C><b>\n2<1><2>");
}

/* Spreadsheets have headings in two lines; and nobody's text drives the terminal that it is shown in. */
/* Promise(incoming/text-of-others) */
static void a_name_is_one_line(void **state)
{
    (void)state;
    assert_string_equal(ROWS("\"T\nin K\",\x1b[2Jb\n1,2\n"), "<T in K><?[2Jb>\n3<1><2>");
    assert_has(ROWS("a\n\x1b[2J,1\n"), "2 fields under 1 names");
}

/* What is written is read, as what it shows. */
/* Promise(incoming/text-of-others) */
static void a_field_that_is_written_is_one_field(void **state)
{
    static const char *const texts[][2] = {{"plain", "plain"},
                                           {"a,b", "a,b"},
                                           {"say \"x\"", "say \"x\""},
                                           {" x", " x"},
                                           {"", ""},
                                           {"two\nlines", "two lines"},
                                           {"\x1b[2J\xc2\x9b\xe2\x80\xae\xff", "?[2J???"}};

    (void)state;
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        FILE *out = fopen(scratch_path("w.csv"), "w");
        struct csv *csv;

        assert_non_null(out);
        fputs("a,b,c\n", out);
        csv_put(out, texts[i][0]);
        fputc(',', out);
        csv_put_quoted(out, texts[i][0]);
        fputs(",last\n", out);
        fclose(out);
        assert_int_equal(csv_open(&csv, scratch_path("w.csv"), &why), 0);
        assert_int_equal(csv_next(csv, &why), 1);
        assert_string_equal(csv_text(csv, 0), texts[i][1]);
        assert_string_equal(csv_text(csv, 1), texts[i][1]);
        assert_int_equal(csv_next(csv, &why), 0);
        csv_close(csv);
    }
}

static void rows_without_anything_are_passed_over(void **state)
{
    struct csv *csv;

    (void)state;
    assert_string_equal(ROWS("\n\na,b\n\n1,2\n,\n \t\n\"\",\n3,4\n\n\n"), "<a><b>\n5<1><2>\n9<3><4>");
    assert_string_equal(ROWS("a,b\n1,2,,\n"), "<a><b>\n2<1><2>");
    csv = open_text("a,b\n1,2\n,\n\n3,4\n", 16);
    assert_non_null(csv);
    assert_int_equal(csv_next(csv, &why), 1);
    assert_int_equal(csv_passed(csv), 0);
    assert_int_equal(csv_next(csv, &why), 1);
    assert_int_equal(csv_passed(csv), 2);
    assert_true(csv_ended(csv));
    csv_close(csv);
}

static void what_is_no_table_is_refused_with_its_place(void **state)
{
    (void)state;
    assert_string_equal(ROWS(""), "t.csv:1: it is empty; expected a row of names");
    assert_string_equal(ROWS("\n \n"), "t.csv:1: it is empty; expected a row of names");
    assert_string_equal(ROWS("a,b;c\n"),
                        "t.csv:1: \",\" and \";\" are both in the row of names: put names that "
                        "have one of them in quotes");
    assert_string_equal(ROWS("a,b\n1,2\n3\n"), "t.csv:3: 1 fields under 2 names: is the row cut off?");
    assert_has(ROWS("a,b\n1,2,3\n"), "t.csv:2: 3 fields under 2 names");
    assert_string_equal(ROWS("a,b\n1,\"2\n3,4\n"), "t.csv:2: column \"b\": a quote is opened and not closed");
    assert_has(ROWS("a,b\n1,\"2\" x\n"), "t.csv:2: column \"b\": \"x\" follows the closing quote");
    assert_has(ROWS("a,b\n1,2\"x\n"), "t.csv:2: column \"b\": a quote stands within a field");
    assert_has(ROWS("a,b\n1,\xb0\n"), "t.csv:2: the byte 0xB0 is not UTF-8: save the file in UTF-8");
    assert_has(ROWS("\xff\xfe"
                    "a\0,\0b\0"),
               "t.csv:1: it begins as UTF-16 does: save the file in UTF-8");
    assert_has(ROWS("a\0,b\n"), "t.csv:1: a byte 0 is in it");
    assert_has(ROWS("\xef\xbb"
                    "a,b\n"),
               "t.csv:1: it begins as no UTF-8 does");
    scratch_write("file", "");
    assert_null(open_text("", 0));
    struct csv *csv;
    assert_int_equal(csv_open(&csv, scratch_path("none.csv"), &why), APC_ENOTFOUND);
    assert_has(why.text, "none.csv: No such file");
    assert_int_equal(csv_open(&csv, scratch_path("file/none.csv"), &why), APC_ESYS);
}

/* The sum of all numbers in the file; NAN: refused. */
static double sum_of(const char *text)
{
    struct csv *csv = open_text(text, strlen(text));
    double sum = 0.0;
    int rc;

    assert_non_null(csv);
    while ((rc = csv_next(csv, &why)) > 0)
        for (size_t i = 0; i < csv_columns(csv) && rc > 0; i++) {
            double value = 0.0;

            if (!csv_missing(csv, i) && csv_number(csv, i, &value, &why) < 0) {
                csv_close(csv);
                return (double)NAN;
            }
            sum += value;
        }
    csv_close(csv);
    return rc < 0 ? (double)NAN : sum;
}

/* Promise(incoming/other-ways) */
static void numbers_have_a_point_or_throughout_a_comma(void **state)
{
    static const struct {
        const char *text;
        double sum;
    } good[] = {
        {"a,b\n1.5,-2e-1\n\"3.25\",NaN\n", 4.55},
        {"a,b\n1,\"2,8\"\n2,\"0,125\"\n", 5.925},
        {"a,b\n1,\"2,125\"\n2,\"0,125\"\n", 5.25}, /* what begins with 0 has no thousands */
        {"a,b\n1,\"2,125\"\n2,\"1234,125\"\n", 1239.25},
        {"a;b\n1;2,125\n2;,5\n", 5.625},
        {"a;b\n1;2.125\n2;3.5\n", 8.625},
        {"a\tb\n1\t2,5\n2\t3,5e1\n", 40.5},
        {"a,b\n\" 1.5 \",nan\n", 1.5},
    };
    static const struct {
        const char *text, *reason;
    } bad[] = {
        {"a,b\n1,\"1,234.5\"\n", "t.csv:2: column \"b\": \"1,234.5\" is no number: write it without commas"},
        {"a;b\n1;1.234,5\n", "\"1.234,5\" is no number"},
        {"a,b\n1,\"1,234,567\"\n", "\"1,234,567\" is no number"},
        {"a,b\n1,\"2,8\"\n2,0.5\n", "t.csv:3: column \"b\": \"0.5\" has a point, a number in line 2 a comma"},
        {"a;b\n1.5;2,8\n", "t.csv:2: column \"b\": \"2,8\" has a comma, a number in line 2 a point"},
        {"a,b\n998,1\n\"1,003\",2\n\"1,007\",3\n",
         "t.csv:3: column \"a\": \"1,003\" may have decimals or thousands, as each comma"},
        {"a,b\n1,0x10\n", "\"0x10\" is no number"},
        {"a,b\n1,inf\n", "\"inf\" is no number"},
        {"a,b\n1,1 000\n", "\"1 000\" is no number"},
        {"a,b\n1,5 V\n", "\"5 V\" is no number"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        const double sum = sum_of(good[i].text);

        if (isnan(sum))
            fail_msg("%s: %s", good[i].text, why.text);
        assert_near(sum, good[i].sum, 1e-12);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (!isnan(sum_of(bad[i].text)))
            fail_msg("taken: %s", bad[i].text);
        assert_has(why.text, bad[i].reason);
    }
}

static void files_of_our_own_have_the_names_that_they_must(void **state)
{
    struct csv *csv = open_text("time,id\n0,1\n", 12);

    (void)state;
    assert_int_equal(csv_expect(csv, "time,id", &why), 0);
    assert_int_equal(csv_expect(csv, "time,id,value", &why), APC_EPROTO);
    assert_has(why.text, "t.csv:1: expected the columns time,id,value");
    assert_int_equal(csv_expect(csv, "time", &why), APC_EPROTO);
    assert_int_equal(csv_expect(csv, "time,table", &why), APC_EPROTO);
    csv_close(csv);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_the_rfc_allows_is_read),
        cmocka_unit_test(a_name_is_one_line),
        cmocka_unit_test(a_field_that_is_written_is_one_field),
        cmocka_unit_test(rows_without_anything_are_passed_over),
        cmocka_unit_test(what_is_no_table_is_refused_with_its_place),
        cmocka_unit_test(numbers_have_a_point_or_throughout_a_comma),
        cmocka_unit_test(files_of_our_own_have_the_names_that_they_must),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
