/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * The other side of serial: the firmware of a Temperature Control Lab, over a plant of ours. Pure: a line in,
 * a line out. As with the board itself any line is a sign of life, and nothing that is out of range is an
 * error: it is brought into range, and the answer says what it is.
 */
#include "apcexchange.h"
#include "base/base_internal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHANNELS 2
#define NAME     "TCLab Firmware 1.4.3 libapc"

struct apc_tclab {
    struct apc_tclab_options o;
    double u[CHANNELS];
    struct apc_value y[CHANNELS];
    bool commanded;
};

/* "Q1 50.5": its channel, from 0 on, and what comes behind the blank; -1: none of this letter. */
static int channel_of(const char *line, char letter, const char **rest)
{
    const bool is =
        line[0] == letter && (line[1] == '1' || line[1] == '2') && (line[2] == ' ' || line[2] == '\0');

    *rest = line + 2 + (is && line[2] == ' ');
    return is ? line[1] - '1' : -1;
}

static void heat(struct apc_tclab *b, size_t i, double percent)
{
    double u[CHANNELS];

    memcpy(u, b->u, sizeof(u));
    u[i] = fmin(fmax(percent, 0.0), 100.0);
    if (i < b->o.nu && b->o.command(b->o.ctx, u, true) == 0) {
        memcpy(b->u, u, sizeof(u));
        b->commanded = true;
    }
}

static double celsius(struct apc_tclab *b, size_t i)
{
    if (i >= b->o.ny)
        return 0.0;
    (void)b->o.measure(b->o.ctx, b->y);
    return apc_status_severity(b->y[i].status) == APC_SEVERITY_BAD ? -50.0 : b->y[i].value; /* as at 0 V */
}

/* With two digits behind the point, whatever the locale. */
static int format_tclab_number(char *reply, size_t size, double value)
{
    const long hundredths = lround(value * 100.0);

    return snprintf(reply, size, "%s%ld.%02ld\r\n", hundredths < 0 ? "-" : "", labs(hundredths) / 100,
                    labs(hundredths) % 100);
}

static int answer_tclab_line(struct apc_tclab *b, const char *line, char *reply, size_t size)
{
    const char *rest;
    double value = 0.0;
    int i;

    if ((i = channel_of(line, 'T', &rest)) >= 0)
        return format_tclab_number(reply, size, celsius(b, (size_t)i));
    if ((i = channel_of(line, 'R', &rest)) >= 0)
        return format_tclab_number(reply, size, b->u[i]);
    if ((i = channel_of(line, 'P', &rest)) >= 0)
        return format_tclab_number(reply, size, i ? 100 : 200); /* of 255: the powers that the model has */
    if ((i = channel_of(line, 'Q', &rest)) >= 0) {
        if (apc_number_parse(rest, &value) == 0) /* else it stays */
            heat(b, (size_t)i, value);
        return format_tclab_number(reply, size, b->u[i]);
    }
    if (!strncmp(line, "LED", 3) && (!line[3] || line[3] == ' ')) {
        (void)apc_number_parse(line[3] ? line + 4 : "", &value);
        return format_tclab_number(reply, size, fmin(fmax(value, 0.0), 100.0));
    }
    if (!strcmp(line, "X")) {
        heat(b, 0, 0.0);
        heat(b, 1, 0.0);
        return snprintf(reply, size, "Stop\r\n");
    }
    return snprintf(reply, size, "%s\r\n", !strcmp(line, "VER") ? NAME : "?");
}

int apc_tclab_answer(struct apc_tclab *tclab, const char *line, size_t length, char *reply, size_t size)
{
    char text[64] = "";

    while (length > 0 && (line[length - 1] == '\n' || line[length - 1] == '\r' || line[length - 1] == ' '))
        length--;
    if (length == 0)
        return 0;
    if (length < sizeof(text) && !memchr(line, '\0', length))
        memcpy(text, line, length); /* none of its lines is as long */
    if (tclab->commanded)
        (void)tclab->o.command(tclab->o.ctx, tclab->u, true);
    const int n = answer_tclab_line(tclab, text, reply, size);
    return n > 0 && (size_t)n < size ? n : APC_ERANGE;
}

int apc_tclab_create(struct apc_tclab **tclab, const struct apc_tclab_options *options, struct apc_error *why)
{
    struct apc_tclab_options o = {0};
    int rc;

    if (!tclab)
        return apc_fail(why, APC_EINVAL, "apc_tclab_create: tclab must not be NULL");
    *tclab = NULL;
    rc = apc_options_copy(&o, sizeof(o), options, "apc_tclab_options", why);
    if (rc < 0)
        return rc;
    if (!o.nu || o.nu > CHANNELS || !o.ny || o.ny > CHANNELS || !o.command || !o.measure)
        return apc_fail(why, APC_EINVAL,
                        "a temperature control lab has one or two heaters and sensors, not %zu and "
                        "%zu; command and measure are required",
                        o.nu, o.ny);
    *tclab = calloc(1, sizeof(**tclab));
    if (!*tclab)
        return apc_fail(why, APC_ENOMEM, "no memory");
    (*tclab)->o = o;
    return 0;
}

void apc_tclab_destroy(struct apc_tclab *tclab)
{
    free(tclab);
}
