/* SPDX-License-Identifier: BSD-3-Clause */
/* `modbus` of the client: in which registers and coils of the plant its measurements and outputs are. */
#include "experiment_parts.h"

#include <stdlib.h>
#include <string.h>

static const char *const areas[] = {[APC_MODBUS_COIL] = "coil",
                                    [APC_MODBUS_DISCRETE] = "discrete",
                                    [APC_MODBUS_INPUT] = "input",
                                    [APC_MODBUS_HOLDING] = "holding"};
static const char *const types[] = {
    [APC_MODBUS_BIT] = "bit",    [APC_MODBUS_U16] = "uint16", [APC_MODBUS_S16] = "int16",
    [APC_MODBUS_U32] = "uint32", [APC_MODBUS_S32] = "int32",  [APC_MODBUS_U64] = "uint64",
    [APC_MODBUS_S64] = "int64",  [APC_MODBUS_FLAG] = "bit",   [APC_MODBUS_F32] = "float32",
    [APC_MODBUS_F64] = "float64"};
#define COUNT(array) (sizeof(array) / sizeof *(array))

/* Its place in a list that begins at 1; 0: it is not there. */
static size_t place_in_list(const char *const *list, size_t n, const char *text, size_t length)
{
    for (size_t i = 1; i < n; i++)
        if (strlen(list[i]) == length && !strncmp(list[i], text, length))
            return i;
    return 0;
}

/* "holding:12", or "holding:12.3", a bit of it */
static void read_place(struct settings *s, const config_setting_t *in, const char *name, bool written,
                       struct apc_modbus_point *p)
{
    char text[40] = "", *end = NULL;
    settings_text(s, in, name, REQUIRED, text, sizeof text);
    const char *colon = strchr(text, ':');
    size_t area = colon ? place_in_list(areas, COUNT(areas), text, (size_t)(colon - text)) : 0;
    long address = area && colon[1] >= '0' && colon[1] <= '9' ? strtol(colon + 1, &end, 10) : -1;
    if (s->failed)
        return;
    const bool flag = address >= 0 && *end == '.' && end[1] >= '0' && end[1] <= '9' &&
                      (area == APC_MODBUS_INPUT || area == APC_MODBUS_HOLDING);
    const long bit = flag ? strtol(end + 1, &end, 10) : 0;
    if (address < 0 || address > 65535 || *end || bit > 15)
        settings_fail(
            s, config_setting_get_member(in, name),
            "\"%s\" is \"%s\": must be coil, discrete, input or holding, a colon, and the address, 0 to "
            "65535, such as \"holding:0\"; of a register also a point and a bit, 0 to 15, such as "
            "\"input:10.3\"",
            name, text);
    else if (written && area != APC_MODBUS_COIL && area != APC_MODBUS_HOLDING)
        settings_fail(s, config_setting_get_member(in, name),
                      "\"%s\" is \"%s\": only coils and holding registers can be written", name, text);
    p->area = (enum apc_modbus_area)area;
    p->address = (unsigned)address;
    p->bit = (unsigned)bit;
    p->type = flag                                                     ? APC_MODBUS_FLAG
              : area == APC_MODBUS_COIL || area == APC_MODBUS_DISCRETE ? APC_MODBUS_BIT
                                                                       : APC_MODBUS_U16;
}

static void read_first(struct settings *s, const config_setting_t *in, const char *name, const char *what,
                       bool *low_first)
{
    char text[16] = "";
    settings_text(s, in, name, OPTIONAL, text, sizeof text);
    if (!s->failed && *text && strcmp(text, "low") != 0 && strcmp(text, "high") != 0)
        settings_fail(s, config_setting_get_member(in, name),
                      "\"%s\" is \"%s\": must be \"high\" or \"low\", the %s that comes first", name, text,
                      what);
    if (*text)
        *low_first = !strcmp(text, "low");
}

static void read_word_order(struct settings *s, const config_setting_t *in, struct apc_modbus_point *p)
{
    read_first(s, in, "word_order", "word", &p->low_word_first);
    read_first(s, in, "byte_order", "byte of each register", &p->low_byte_first);
}

/* As it stands in the registers: what is written as a whole number or in hexadecimal, with a sign or without. */
static void read_code(struct settings *s, const config_setting_t *code, struct apc_modbus_point *p)
{
    static const double unsigned_most[] = {[APC_MODBUS_U16] = 65535,
                                           [APC_MODBUS_S16] = 65535,
                                           [APC_MODBUS_U32] = 4294967295.0,
                                           [APC_MODBUS_S32] = 4294967295.0};
    const int type = config_setting_type(code);
    const bool whole = type == CONFIG_TYPE_INT || type == CONFIG_TYPE_INT64;
    const int64_t number = !whole ? 0
                           : type == CONFIG_TYPE_INT && config_setting_get_format(code) == CONFIG_FORMAT_HEX
                               ? (int64_t)(uint32_t)config_setting_get_int(code)
                               : config_setting_get_int64(code);
    const bool is_float = p->type == APC_MODBUS_F32 || p->type == APC_MODBUS_F64,
               wide = p->type == APC_MODBUS_U64 || p->type == APC_MODBUS_S64;
    const double value = type == CONFIG_TYPE_FLOAT ? config_setting_get_float(code) : (double)number;
    const struct apc_modbus_point raw = {.area = p->area,
                                         .type = p->type == APC_MODBUS_U16   ? APC_MODBUS_S16
                                                 : p->type == APC_MODBUS_U32 ? APC_MODBUS_S32
                                                                             : p->type};
    const float single = (float)value;
    uint32_t half;
    uint64_t *bits = &p->no_value[p->n_no_value];
    memcpy(&half, &single, sizeof half);
    if (p->type == APC_MODBUS_BIT || p->type == APC_MODBUS_FLAG)
        settings_fail(s, code, "\"no_value\" needs a register: each value of a bit, 0 or 1, is valid");
    else if (p->n_no_value == APC_MODBUS_CODES)
        settings_fail(s, code, "\"no_value\" has %d codes at most", APC_MODBUS_CODES);
    else if (!(whole || (is_float && type == CONFIG_TYPE_FLOAT)) ||
             (!wide && !apc_modbus_fits(&raw, value) &&
              (is_float || value < 0 || value > unsigned_most[p->type])))
        settings_fail(
            s, code,
            "\"no_value\" must be what can stand in a register of type %s, such as %s, before it is "
            "scaled",
            types[p->type], is_float ? "-9999.0" : "0x8000");
    else if (p->type == APC_MODBUS_F64)
        memcpy(bits, &value, sizeof *bits);
    else
        *bits = p->type == APC_MODBUS_F32                                ? half
                : wide                                                   ? (uint64_t)number
                : p->type == APC_MODBUS_U16 || p->type == APC_MODBUS_S16 ? (uint16_t)number
                                                                         : (uint32_t)number;
    p->n_no_value += !s->failed;
}

static void read_codes(struct settings *s, const config_setting_t *entry, bool written,
                       struct apc_modbus_point *p)
{
    const config_setting_t *code = config_setting_get_member(entry, "no_value");
    if (!code || s->failed)
        return;
    if (written)
        settings_fail(s, code, "an output has no \"no_value\", only a measurement: leave it out");
    if (!config_setting_is_aggregate(code))
        read_code(s, code, p);
    for (int i = 0; config_setting_is_aggregate(code) && i < config_setting_length(code) && !s->failed; i++)
        read_code(s, config_setting_get_elem(code, (unsigned)i), p);
}

static void read_type(struct settings *s, const config_setting_t *in, struct apc_modbus_point *p)
{
    const bool bit = p->area == APC_MODBUS_COIL || p->area == APC_MODBUS_DISCRETE;
    char text[16] = "";
    settings_text(s, in, "type", OPTIONAL, text, sizeof text);
    if (s->failed || !*text || (p->type == APC_MODBUS_FLAG && !strcmp(text, "bit")))
        return;
    const bool flag = p->type == APC_MODBUS_FLAG;
    p->type = (enum apc_modbus_type)place_in_list(types, COUNT(types), text, strlen(text));
    if (p->type == 0)
        settings_fail(
            s, config_setting_get_member(in, "type"),
            "\"type\" is \"%s\": must be bit, uint16, int16, uint32, int32, uint64, int64, float32 or "
            "float64",
            text);
    else if (flag)
        settings_fail(s, config_setting_get_member(in, "type"),
                      "\"type\" is \"%s\": one bit of a register is a bit", text);
    else if (bit != (p->type == APC_MODBUS_BIT))
        settings_fail(s, config_setting_get_member(in, "type"),
                      "\"type\" is \"%s\": coils and discrete inputs are bits, registers are not", text);
}

/* Of the signals the one that is called so, by name or by TABLE.ID; n: none. */
static size_t find_signal(const struct signal *signal, size_t n, const char *name)
{
    char address[APC_TAG_LEN + 16];
    for (size_t i = 0; i < n; i++) {
        snprintf(address, sizeof address, "%s.%zu", apc_table_name(signal[i].tag.table), i + 1);
        if (!strcmp(signal[i].tag.name, name) || !strcmp(address, name))
            return i;
    }
    return n;
}

/* Which point an entry of the map is of; NULL: of none, or of one that has its place already. */
static struct apc_modbus_point *point_of_entry(struct settings *s, const config_setting_t *entry,
                                               const struct experiment *e, bool *written)
{
    char name[APC_TAG_LEN + 16] = "";
    settings_text(s, entry, "name", REQUIRED, name, sizeof name);
    if (s->failed)
        return NULL;
    size_t u = find_signal(e->u, e->dim.nu, name), y = find_signal(e->y, e->dim.ny, name);
    const config_setting_t *at = config_setting_get_member(entry, "name");
    *written = u < e->dim.nu;
    if (u == e->dim.nu && y == e->dim.ny)
        settings_fail(s, at, "\"%s\" is neither a measurement nor an output", name);
    else if (u < e->dim.nu && y < e->dim.ny)
        settings_fail(s, at, "\"%s\" is a measurement and an output: call it sensor.%zu or actuator.%zu",
                      name, y + 1, u + 1);
    if (s->failed)
        return NULL;
    struct apc_modbus_point *p = *written ? &e->client.points[u] : &e->client.points[e->dim.nu + y];
    if (p->area)
        settings_fail(s, at, "the map names \"%s\" twice: leave one out", name);
    p->safe = *written ? e->u[u].safe : 0;
    return p;
}

/* What the loop may ask for can be written: a value that does not fit would fail every exchange while it
 * lasts. What a measurement is said to reach can be read. */
static void check_range(struct settings *s, const config_setting_t *entry, const struct experiment *e,
                        size_t i)
{
    const struct apc_modbus_point *p = &e->client.points[i];
    const bool written = i < e->dim.nu;
    const struct apc_tag *of = written ? &e->u[i].tag : &e->y[i - e->dim.nu].tag;
    if (!s->failed && ((!apc_modbus_fits(p, of->low) && (written || of->low > -APC_VALUE_MAX)) ||
                       (!apc_modbus_fits(p, of->high) && (written || of->high < APC_VALUE_MAX))))
        settings_fail(s, entry,
                      "%s \"%s\" has the limits %.15g to %.15g, which %s cannot hold: give it \"low\" and "
                      "\"high\" that fit",
                      written ? "output" : "measurement", of->name, of->low, of->high, types[p->type]);
}

/* A register that the two sides watch each other by. */
static const struct apc_modbus_point *read_sign(struct settings *s, const config_setting_t *in,
                                                const char *name, bool written, struct apc_modbus_point *p)
{
    if (!config_setting_get_member(in, name))
        return NULL;
    read_place(s, in, name, written, p);
    if (!s->failed && written && (p->area != APC_MODBUS_HOLDING || p->type != APC_MODBUS_U16))
        settings_fail(s, config_setting_get_member(in, name), "\"%s\" must be a holding register: it counts",
                      name);
    return p;
}

/* An output's own, which goes on while others are out of service. */
static void read_watchdog(struct settings *s, const config_setting_t *entry, struct experiment *e, size_t i,
                          bool written)
{
    const config_setting_t *at = config_setting_get_member(entry, "watchdog");
    struct apc_modbus_point *watchdogs = e->client.points + e->dim.nu + e->dim.ny + 2;

    if (at && !written)
        settings_fail(s, at,
                      "a measurement has no \"watchdog\", which counts writes of an output: leave it out");
    else if (at && read_sign(s, entry, "watchdog", true, &watchdogs[i])) {
        watchdogs[i].unit = e->client.points[i].unit;
        watchdogs[i].low_byte_first = e->client.points[i].low_byte_first;
        e->client.modbus.watchdogs = watchdogs;
    }
}

static void read_entry(struct settings *s, const config_setting_t *entry, struct experiment *e,
                       const struct apc_modbus_point *whole)
{
    static const char *const known[] = {"name",       "at",       "type", "scale",    "offset", "word_order",
                                        "byte_order", "watchdog", "unit", "no_value", NULL};
    bool written = false;
    int64_t unit = 0;
    if (!config_setting_is_group(entry)) {
        settings_fail(s, entry, "expected a group: { name = \"y\"; at = \"input:0\"; ... }");
        return;
    }
    settings_known(s, entry, known);
    struct apc_modbus_point *p = point_of_entry(s, entry, e, &written);
    if (!p || s->failed)
        return;
    p->low_word_first = whole->low_word_first;
    p->low_byte_first = whole->low_byte_first;
    p->scale = 1;
    settings_whole(s, entry, "unit", OPTIONAL, 1, 255, &unit);
    p->unit = (unsigned)unit;
    read_place(s, entry, "at", written, p);
    read_type(s, entry, p);
    read_word_order(s, entry, p);
    read_codes(s, entry, written, p);
    settings_number(s, entry, "scale", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &p->scale);
    settings_number(s, entry, "offset", OPTIONAL, -APC_VALUE_MAX, APC_VALUE_MAX, &p->offset);
    if (!s->failed && !(p->scale < 0) && !(p->scale > 0))
        settings_fail(s, config_setting_get_member(entry, "scale"), "\"scale\" must not be 0");
    check_range(s, entry, e, (size_t)(p - e->client.points));
    read_watchdog(s, entry, e, (size_t)(p - e->client.points), written);
}

static void check_whole(struct settings *s, const config_setting_t *list, const struct experiment *e)
{
    for (size_t i = 0; i < e->dim.nu + e->dim.ny && !s->failed; i++) {
        const bool output = i < e->dim.nu;
        if (!e->client.points[i].area)
            settings_fail(s, list, "%s \"%s\" has no place in the map", output ? "output" : "measurement",
                          output ? e->u[i].tag.name : e->y[i - e->dim.nu].tag.name);
    }
}

/* Each value goes in one request. */
static void check_requests(struct settings *s, const config_setting_t *group,
                           const struct apc_modbus_options *o, const struct apc_modbus_point *y,
                           const struct experiment *e)
{
    for (size_t i = 0; i < e->dim.nu + e->dim.ny && !s->failed; i++) {
        const bool output = i < e->dim.nu;
        const struct apc_modbus_point *p = output ? &o->u[i] : &y[i - e->dim.nu];
        const char *name = output ? e->u[i].tag.name : e->y[i - e->dim.nu].tag.name;
        const unsigned width = apc_modbus_registers(p->type);
        if (o->block > 0 && width > o->block)
            settings_fail(s, config_setting_get_member(group, "block"),
                          "\"block\" is %u: must be at least %u, the registers of \"%s\"", o->block, width,
                          name);
        else if (output && o->write_single && width > 1)
            settings_fail(
                s, config_setting_get_member(group, "write_single"),
                "\"write_single\": output \"%s\" has %u registers, which function 6 would leave half "
                "written: give it a type of 16 bits",
                name, width);
    }
}

/* Number @p i of all that is written: outputs, the watchdog, those of outputs. NULL: there is none. */
static const struct apc_modbus_point *written_point(const struct experiment *e, size_t i)
{
    const struct apc_modbus_options *o = &e->client.modbus;
    const size_t nu = e->dim.nu;
    const struct apc_modbus_point *p = i < nu         ? &o->u[i]
                                       : i == nu      ? o->watchdog
                                       : o->watchdogs ? &o->watchdogs[i - nu - 1]
                                                      : NULL;
    return p && p->area ? p : NULL;
}

static void name_written(const struct experiment *e, size_t i, char text[APC_TAG_LEN + 32])
{
    const size_t nu = e->dim.nu;
    if (i == nu)
        snprintf(text, APC_TAG_LEN + 32, "the watchdog");
    else
        snprintf(text, APC_TAG_LEN + 32, "%soutput \"%s\"", i < nu ? "" : "the watchdog of ",
                 e->u[i < nu ? i : i - nu - 1].tag.name);
}

static bool share_a_place(const struct apc_modbus_point *a, const struct apc_modbus_point *b, unsigned unit)
{
    return (a->unit ? a->unit : unit) == (b->unit ? b->unit : unit) && a->area == b->area &&
           a->address < b->address + apc_modbus_registers(b->type) &&
           b->address < a->address + apc_modbus_registers(a->type) &&
           (a->type != APC_MODBUS_FLAG || b->type != APC_MODBUS_FLAG || a->bit == b->bit);
}

/* Of two in one place the plant would take the one that happens to be written last. */
static void check_apart(struct settings *s, const config_setting_t *map, const struct experiment *e)
{
    const size_t n = 2 * e->dim.nu + 1;
    for (size_t i = 1; i < n && !s->failed; i++) {
        const struct apc_modbus_point *a = written_point(e, i), *b;
        for (size_t k = 0; a && k < i && !s->failed; k++)
            if ((b = written_point(e, k)) && share_a_place(a, b, e->client.modbus.unit)) {
                char one[APC_TAG_LEN + 32], other[APC_TAG_LEN + 32];
                name_written(e, k, one);
                name_written(e, i, other);
                settings_fail(s, map,
                              "%s and %s are both written to address %u: give each a place of its own", one,
                              other, a->address > b->address ? a->address : b->address);
            }
    }
}

void experiment_read_modbus(struct settings *s, const config_setting_t *client, struct experiment *e)
{
    static const char *const known[] = {"unit",  "word_order", "byte_order", "watchdog",
                                        "life",  "life_limit", "read_back",  "write_single",
                                        "block", "map",        NULL};
    const bool is = !strncmp(e->client.link, "modbus:", 7);
    const config_setting_t *group = settings_group(s, client, "modbus", is ? REQUIRED : OPTIONAL);
    struct apc_modbus_options *o = &e->client.modbus;
    struct apc_modbus_point whole = {0};
    int64_t unit = 1, block = 0;
    if (!group || s->failed)
        return;
    if (!is) {
        settings_fail(s, group, "\"modbus\" is only for a link that begins with modbus:");
        return;
    }
    settings_known(s, group, known);
    settings_whole(s, group, "unit", OPTIONAL, 0, 255, &unit);
    settings_whole(s, group, "block", OPTIONAL, 1, 2000, &block);
    read_word_order(s, group, &whole);
    settings_flag(s, group, "write_single", &o->write_single);
    settings_flag(s, group, "read_back", &o->read_back);
    const config_setting_t *map = settings_list(s, group, "map", REQUIRED);
    e->client.points = calloc(2 * e->dim.nu + e->dim.ny + 2, sizeof *e->client.points);
    if (!e->client.points && !s->failed)
        s->failed = apc_fail(s->why, APC_ENOMEM, "%s: out of memory", s->file);
    for (int i = 0; map && !s->failed && i < config_setting_length(map); i++)
        read_entry(s, config_setting_get_elem(map, (unsigned)i), e, &whole);
    if (s->failed)
        return;
    check_whole(s, map, e);
    struct apc_modbus_point *y = e->client.points + e->dim.nu, *signs = y + e->dim.ny;
    o->size = sizeof *o;
    o->unit = (unsigned)unit;
    o->block = (unsigned)block;
    o->u = e->client.points;
    o->y = y;
    o->watchdog = read_sign(s, group, "watchdog", true, &signs[0]);
    o->life = read_sign(s, group, "life", false, &signs[1]);
    signs[0].low_byte_first = signs[1].low_byte_first = whole.low_byte_first;
    check_requests(s, group, o, y, e);
    check_apart(s, map, e);
    if (o->life)
        settings_period(s, group, "life_limit", REQUIRED, &o->life_limit);
    else if (config_setting_get_member(group, "life_limit"))
        settings_fail(s, group, "\"life_limit\" needs \"life\", which is missing");
}
