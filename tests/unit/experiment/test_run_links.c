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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_and_certificates_of_a_link_are_those_of_the_file),
        cmocka_unit_test(a_plant_of_ours_listens_in_the_language_of_its_client),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
