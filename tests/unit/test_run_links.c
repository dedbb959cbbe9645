/* SPDX-License-Identifier: BSD-3-Clause */
/* Between client and plant: which language they speak, who is who, and what a serial port leads to. */
#include "check.h"

#include <stdio.h>

#include "experiment/experiment_parts.h"
#include "scratch.h"

static struct apc_error why;

/* Of two inputs within 0 to 100; @p limits of the first instead. */
static int load(struct experiment *e, const char *limits, const char *plant, const char *client)
{
    char text[2000];
    snprintf(text, sizeof text,
             "name = \"links\"; duration = 10.0;\n"
             "measurements = ( { name = \"y1\"; }, { name = \"y2\"; } ); setpoints = ( { name = \"r1\"; }, { "
             "name = \"r2\"; } );\n"
             "outputs = ( { name = \"u1\"; %s }, { name = \"u2\"; low = 0.0; high = 100.0; } );\n"
             "plant = { %s period = 1.0; };\n"
             "client = { %s period = 1.0; };\n"
             "controller = { law = \"pi\"; period = 2.0; };\n",
             limits ? limits : "low = 0.0; high = 100.0;", plant, client);
    scratch_write("links.conf", text);
    return experiment_load(e, scratch_path("links.conf"), 0, NULL, &why);
}

#define LAB   "model = \"temperature-lab\"; "
#define OURS  "tls:plant:4840"
#define PLANT LAB "listen = \"" OURS "\"; "
#define LINK  "link = \"" OURS "\"; "

static void names_and_certificates_of_a_link_are_those_of_the_file(void **state)
{
    struct experiment e;
    (void)state;
    if (load(&e, NULL, PLANT "identity = \"plant.pem\"; clients = [\"control\", \"standby\", \"c\"];",
             LINK "identity = \"/etc/control.pem\";") < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.plant.identity, scratch_path("plant.pem")); /* from where the file is */
    assert_string_equal(e.client.identity, "/etc/control.pem");
    assert_int_equal(e.plant.n_clients, 3);
    assert_string_equal(e.plant.clients[0], "control");
    assert_string_equal(e.plant.clients[1], "standby");
    assert_string_equal(e.plant.clients[2], "c");
    experiment_free(&e);
    if (load(&e, NULL, PLANT, LINK) < 0)
        fail_msg("%s", why.text);
    assert_string_equal(e.plant.identity, "");
    assert_int_equal(e.plant.n_clients, 0);
    experiment_free(&e);
}

static void a_plant_of_ours_listens_in_the_language_of_its_client(void **state)
{
    static const struct {
        const char *plant, *client, *listen;
    } cases[] = {
        {LAB, "", "tcp:127.0.0.1:43051"},
        {LAB, "link = \"tcp:plant:4000\"; ", "tcp:127.0.0.1:43051"}, /* wherever it is reached */
        {LAB "listen = \"tcp:0.0.0.0:0\"; ", "link = \"tcp:plant:4000\"; ", "tcp:0.0.0.0:0"},
        {LAB, LINK, OURS},
        {LAB, "link = \"tls:[::1]:4840\"; ", "tls:[::1]:4840"},
        {LAB "listen = \"tls:0.0.0.0:65535\"; ", LINK, "tls:0.0.0.0:65535"},
        {LAB, "link = \"serial:/dev/lab\"; ", "serial:/dev/lab"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct experiment e;
        if (load(&e, NULL, cases[i].plant, cases[i].client) < 0)
            fail_msg("case %zu: %s", i, why.text);
        assert_string_equal(e.plant.listen, cases[i].listen);
        experiment_free(&e);
    }
}

static void a_mistake_of_a_link_is_refused_with_its_line_and_reason(void **state)
{
    static const struct {
        const char *limits, *plant, *client;
        int line;
        const char *reason;
    } cases[] = {
        {NULL, LAB "listen = \"tcp:127.0.0.1:4840\"; ", LINK, 4,
         "\"listen\" is \"tcp:127.0.0.1:4840\" and \"link\" of the client \"tls:plant:4840\": one language "
         "for both"},
        {NULL, LAB "listen = \"tls:127.0.0.1:4840\"; ", "", 4, "one language for both"},
        {NULL, LAB "listen = \"tcp:127.0.0.1:65536\"; ", "", 4, "must be tcp:HOST:PORT"},
        {NULL, LAB "listen = \"tcp:127.0.0.1:-1\"; ", "", 4, "must be tcp:HOST:PORT"},
        {NULL, LAB "listen = \"tcp:127.0.0.1:\"; ", "", 4, "must be tcp:HOST:PORT"},
        {NULL, LAB "listen = \"udp:127.0.0.1:4840\"; ", "", 4, "must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"tcp:127.0.0.1:0\"; ", 5,
         "\"link\" is \"tcp:127.0.0.1:0\": must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"tls:127.0.0.1:0\"; ", 5, "must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"tcp::4840\"; ", 5, "must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"tcp:plant:123456\"; ", 5, "must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"tcp:plant:48x\"; ", 5, "must be tcp:HOST:PORT"},
        {NULL, LAB, "link = \"serial:\"; ", 5, "or serial:PATH"},
        {NULL, LAB "identity = \"p.pem\"; ", "", 4,
         "\"identity\" is of a link tls:HOST:PORT; this one is \"tcp:127.0.0.1:43051\""},
        {NULL, LAB, "identity = \"c.pem\"; ", 5, "\"identity\" is of a link tls:HOST:PORT"},
        {NULL, PLANT "clients = [ ]; ", LINK, 4,
         "\"clients\" must be names in double quotes, as in [\"client\"]"},
        {NULL, PLANT "clients = \"control\"; ", LINK, 4, "\"clients\" must be names"},
        {NULL, PLANT "clients = [1, 2]; ", LINK, 4, "\"clients\" must be names"},
        {NULL, PLANT "clients = [\"control\", \"\"]; ", LINK, 4, "\"clients\" must be names"},
        {"low = -1.0; high = 100.0;", LAB, "link = \"serial:/dev/lab\"; ", 5,
         "output \"u1\" may be -1 to 100: a heater of a temperature control lab takes 0 to 100 %"},
        {"low = 0.0; high = 100.5;", LAB, "link = \"serial:/dev/lab\"; ", 5,
         "output \"u1\" may be 0 to 100.5: a heater"},
        {"", LAB, "link = \"serial:/dev/lab\"; ", 5,
         "a heater of a temperature control lab takes 0 to 100 %"},
        {"low = 0.0; high = 50.0; }, { name = \"u3\"; low = 0.0; high = 50.0;", LAB,
         "link = \"serial:/dev/lab\"; ", 5,
         "at a serial port is a temperature control lab: two heaters and two sensors at most"},
        {NULL, "external = true; listen = \"tcp:127.0.0.1:4840\"; ", "", 4,
         "\"listen\" of an external plant"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct experiment e;
        char line[300];
        if (load(&e, cases[i].limits, cases[i].plant, cases[i].client) == 0)
            fail_msg("case %zu is taken", i);
        snprintf(line, sizeof line, "links.conf:%d: ", cases[i].line);
        if (!strstr(why.text, line) || !strstr(why.text, cases[i].reason))
            fail_msg("case %zu: %s", i, why.text);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_and_certificates_of_a_link_are_those_of_the_file),
        cmocka_unit_test(a_plant_of_ours_listens_in_the_language_of_its_client),
        cmocka_unit_test(a_mistake_of_a_link_is_refused_with_its_line_and_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
