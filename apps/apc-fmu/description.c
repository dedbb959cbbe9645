/* SPDX-License-Identifier: BSD-3-Clause */
/* modelDescription.xml, of version 2.0 and 3.0: what a plant needs of it. */
#include "fmu.h"

#include <apcbase.h>
#include <expat.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VARIABLES_MAX 100000
#define STATES_MAX    1000 /* that anybody would make a matrix of */

/* Since 2.9 it is there, and the other one is deprecated. */
#if XML_MAJOR_VERSION == 2 && XML_MINOR_VERSION < 9
#define XML_GetCurrentLineNumber64 XML_GetCurrentLineNumber
#endif

struct declared { /* a type by its name */
    char *name, *unit;
    double low, high;
    struct label *label;
    size_t n_labels;
};

/* A number that may be a state, or the derivative of one. */
struct quantity {
    struct variable variable;
    size_t index; /* from 1, as version 2 counts */
    size_t of;    /* that it is the derivative of: an index in version 2, else a reference */
    bool has_of;
    size_t rank; /* among the derivatives, from 1, as the structure of the model says; 0: it is none */
};

struct reader {
    struct description *d;
    XML_Parser parser;
    struct declared *declared;
    size_t n_declared;
    char declaring[640];      /* of FMI 2: the name of the SimpleType around */
    struct variable variable; /* that is being read */
    char causality[24];
    struct quantity *quantity;
    size_t n_quantities, n_derivatives, index, of;
    bool has_of, in_variables, is_variable, in_derivatives, is_type; /* is_type: a type is being declared */
    char problem[200];
};

static const char *attribute(const char **a, const char *name)
{
    while (*a && strcmp(*a, name) != 0)
        a += 2;
    return *a ? a[1] : NULL;
}

static bool is_true(const char **a, const char *name)
{
    const char *const text = attribute(a, name);
    return text && (strcmp(text, "true") == 0 || strcmp(text, "1") == 0);
}

static char *keep_string(const char *text)
{
    char *const kept = strdup(text ? text : "");
    if (!kept)
        refuse_fmu("no memory");
    return kept;
}

/* Numbers as XML has them; a truth is one of 0 and 1. */
static double number_of_attribute(const char *text, double otherwise)
{
    char *rest;
    if (!text)
        return otherwise;
    if (strcmp(text, "true") == 0)
        return 1.0;
    const double value = strtod(text, &rest);
    return rest > text && value - value >= 0.0 ? value : otherwise; /* finite */
}

/* What a type holds; of 64 bits as far as a double can say. */
static void narrow_to_type(struct variable *v)
{
    static const double range[N_TYPES][2] = {[TYPE_FLOAT64] = {-APC_VALUE_MAX, APC_VALUE_MAX},
                                             [TYPE_INT32] = {INT32_MIN, INT32_MAX},
                                             [TYPE_BOOLEAN] = {0, 1},
                                             [TYPE_FLOAT32] = {-(double)FLT_MAX, (double)FLT_MAX},
                                             [TYPE_INT8] = {INT8_MIN, INT8_MAX},
                                             [TYPE_UINT8] = {0, UINT8_MAX},
                                             [TYPE_INT16] = {INT16_MIN, INT16_MAX},
                                             [TYPE_UINT16] = {0, UINT16_MAX},
                                             [TYPE_UINT32] = {0, UINT32_MAX},
                                             [TYPE_INT64] = {-0x1p63, 0x1.fffffffffffffp62},
                                             [TYPE_UINT64] = {0, 0x1.fffffffffffffp63}};

    double low = range[v->type][0], high = range[v->type][1];
    for (size_t i = 0; i < v->n_labels; i++) {
        low = i ? fmin(low, v->label[i].value) : v->label[i].value;
        high = i ? fmax(high, v->label[i].value) : v->label[i].value;
    }
    v->low = fmax(v->low, low);
    v->high = fmin(v->high, high);
}

static void stop(struct reader *r, const char *problem)
{
    snprintf(r->problem, sizeof r->problem, "%s", problem);
    XML_StopParser(r->parser, XML_FALSE);
}

static enum type type_of_element(const char *element)
{
    static const struct {
        const char *element;
        enum type type;
    } known[] = {{"Real", TYPE_FLOAT64},  {"Float64", TYPE_FLOAT64}, {"Integer", TYPE_INT32},
                 {"Int32", TYPE_INT32},   {"Boolean", TYPE_BOOLEAN}, {"Float32", TYPE_FLOAT32},
                 {"Int8", TYPE_INT8},     {"UInt8", TYPE_UINT8},     {"Int16", TYPE_INT16},
                 {"UInt16", TYPE_UINT16}, {"UInt32", TYPE_UINT32},   {"Int64", TYPE_INT64},
                 {"UInt64", TYPE_UINT64}, {"String", TYPE_STRING}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(known[i].element, element) == 0)
            return known[i].type;
    return TYPE_NONE;
}

/* ---- Elements -------------------------------------------------------------------------------- */

static void read_model(struct reader *r, const char **a)
{
    struct description *const d = r->d;
    const char *const version = attribute(a, "fmiVersion");

    d->version = version && strncmp(version, "2.", 2) == 0   ? 2
                 : version && strncmp(version, "3.", 2) == 0 ? 3
                                                             : 0;
    if (!d->version) {
        snprintf(r->problem, sizeof r->problem,
                 "it is made for FMI %.16s; 2.0 and 3.0 can be run: export it as one of these",
                 version ? version : "of no version");
        XML_StopParser(r->parser, XML_FALSE);
        return;
    }
    d->name = keep_string(attribute(a, "modelName"));
    d->description = keep_string(attribute(a, "description"));
    d->token = keep_string(attribute(a, d->version == 2 ? "guid" : "instantiationToken"));
    const double indicators = number_of_attribute(attribute(a, "numberOfEventIndicators"), 0.0);
    if (!(indicators >= 0.0 && indicators <= VARIABLES_MAX))
        stop(r, "its numberOfEventIndicators is no number of them");
    else
        d->n_indicators = (size_t)indicators;
}

static bool offers_derivatives(const struct description *d, const char **a)
{
    return is_true(a, d->version == 2 ? "providesDirectionalDerivative" : "providesDirectionalDerivatives");
}

/* One for co-simulation as well has its own solver. */
static void read_model_exchange(struct description *d, const char **a)
{
    d->model_exchange = true;
    d->exchange_identifier = keep_string(attribute(a, "modelIdentifier"));
    d->exchange_directional = offers_derivatives(d, a);
    if (d->co_simulation)
        return;
    d->identifier = keep_string(attribute(a, "modelIdentifier"));
    d->variable_step = true;
    d->needs_tool = is_true(a, "needsExecutionTool");
    d->directional = d->exchange_directional;
}

static void read_co_simulation(struct description *d, const char **a)
{
    free(d->identifier);
    d->identifier = keep_string(attribute(a, "modelIdentifier"));
    d->co_simulation = true;
    d->directional = offers_derivatives(d, a);
    d->variable_step = is_true(a, "canHandleVariableCommunicationStepSize");
    d->needs_tool = is_true(a, "needsExecutionTool");
    d->step = number_of_attribute(attribute(a, "fixedInternalStepSize"), d->step);
}

static void declare(struct reader *r, const char *name, const char **a)
{
    if (!name || r->n_declared == VARIABLES_MAX)
        return;
    r->declared = more_room(r->declared, r->n_declared + 1, sizeof *r->declared);
    r->declared[r->n_declared++] =
        (struct declared){.name = keep_string(name),
                          .unit = keep_string(attribute(a, "unit")),
                          .low = number_of_attribute(attribute(a, "min"), -APC_VALUE_MAX),
                          .high = number_of_attribute(attribute(a, "max"), APC_VALUE_MAX)};
    r->is_type = true;
}

/* Of the enumeration that is being declared. */
static void note_label(struct reader *r, const char **a)
{
    struct declared *const t = &r->declared[r->n_declared - 1];

    if (!attribute(a, "name") || t->n_labels == VARIABLES_MAX)
        return;
    t->label = more_room(t->label, t->n_labels + 1, sizeof *t->label);
    t->label[t->n_labels++] = (struct label){.name = keep_string(attribute(a, "name")),
                                             .value = number_of_attribute(attribute(a, "value"), 0.0)};
}

static void begin_variable(struct reader *r, const char **a)
{
    const char *const causality = attribute(a, "causality");

    r->variable = (struct variable){
        .name = keep_string(attribute(a, "name")),
        .description = keep_string(attribute(a, "description")),
        .reference = (uint32_t)strtoul(attribute(a, "valueReference") ? attribute(a, "valueReference") : "0",
                                       NULL, 10),
        .low = -APC_VALUE_MAX,
        .high = APC_VALUE_MAX};
    r->is_variable = true;
    r->has_of = false;
    r->index++;
    snprintf(r->causality, sizeof r->causality, "%s", causality ? causality : "local");
}

/* Without one it is a NAN: the model itself is asked. What is not finite by its own word stays as it is. */
static void read_start(struct variable *v, const char *text)
{
    char *rest = NULL;

    v->start = number_of_attribute(text, (double)NAN);
    const double written = text ? strtod(text, &rest) : 0.0;
    if (isnan(v->start) && rest > text && *rest == '\0' && !isfinite(written))
        v->text = keep_string("number that is not finite");
}

static void type_variable(struct reader *r, const char *element, const char **a)
{
    struct variable *const v = &r->variable;
    const char *const declared = attribute(a, "declaredType"), *const unit = attribute(a, "unit");

    v->type = type_of_element(element);
    if (strcmp(element, "Enumeration") == 0)
        v->type = r->d->version == 2 ? TYPE_INT32 : TYPE_INT64;
    for (size_t i = 0; declared && i < r->n_declared; i++)
        if (strcmp(r->declared[i].name, declared) == 0) {
            v->low = r->declared[i].low;
            v->high = r->declared[i].high;
            v->label = r->declared[i].label;
            v->n_labels = r->declared[i].n_labels;
            free(v->unit);
            v->unit = keep_string(r->declared[i].unit);
        }
    v->low = number_of_attribute(attribute(a, "min"), v->low);
    v->high = number_of_attribute(attribute(a, "max"), v->high);
    narrow_to_type(v);
    if (v->type == TYPE_STRING || v->type == TYPE_NONE)
        v->text = keep_string(v->type == TYPE_NONE ? element : attribute(a, "start"));
    else
        read_start(v, attribute(a, "start"));
    const char *const of = attribute(a, "derivative");
    r->has_of = of && v->type == TYPE_FLOAT64;
    r->of = r->has_of ? strtoul(of, NULL, 10) : 0;
    if (unit || !v->unit) {
        free(v->unit);
        v->unit = keep_string(unit);
    }
}

static struct variable copy_fmu_variable(const struct variable *v)
{
    struct variable made = *v;
    made.name = keep_string(v->name);
    made.unit = keep_string(v->unit);
    made.description = keep_string(v->description);
    made.text = NULL;
    return made;
}

static void drop_fmu_variable(struct variable *v)
{
    free(v->name);
    free(v->unit);
    free(v->description);
    free(v->text);
}

static void note_quantity(struct reader *r)
{
    const struct variable *const v = &r->variable;

    if (v->type != TYPE_FLOAT64 || r->n_quantities == VARIABLES_MAX)
        return;
    r->quantity = more_room(r->quantity, r->n_quantities + 1, sizeof *r->quantity);
    r->quantity[r->n_quantities++] = (struct quantity){
        .variable = copy_fmu_variable(v), .index = r->index, .of = r->of, .has_of = r->has_of};
}

/* Its structure says of which variables the model's states are made: each by its index or reference. */
static void note_derivative(struct reader *r, const char *text)
{
    const size_t at = text ? strtoul(text, NULL, 10) : 0;

    r->n_derivatives++;
    for (size_t i = 0; text && r->n_derivatives <= STATES_MAX && i < r->n_quantities; i++) {
        struct quantity *const q = &r->quantity[i];
        if (q->has_of && at == (r->d->version == 2 ? q->index : q->variable.reference))
            q->rank = r->n_derivatives;
    }
}

static void end_variable(struct reader *r)
{
    static const char *const kinds[N_KINDS] = {"input", "output", "parameter"};
    struct variable *const v = &r->variable;
    size_t k = 0;

    r->is_variable = false;
    note_quantity(r);
    while (k < KIND_STATE && strcmp(kinds[k], r->causality) != 0)
        k++;
    if (k == KIND_PARAMETER && v->text)
        k = v->type == TYPE_STRING ? KIND_TEXT : KIND_FIXED;
    if (k == KIND_STATE || (k < KIND_STATE && (v->type == TYPE_STRING || v->type == TYPE_NONE)) ||
        !v->name[0]) {
        drop_fmu_variable(v);
        return;
    }
    if (r->d->n[k] == VARIABLES_MAX) {
        stop(r, "it has more variables than can be taken");
        return;
    }
    r->d->of[k] = more_room(r->d->of[k], r->d->n[k] + 1, sizeof *v);
    r->d->of[k][r->d->n[k]++] = *v;
}

/* Among the definitions of types. */
static void begin_type(struct reader *r, const char *element, const char **a)
{
    const char *const ending = strlen(element) > 4 ? element + strlen(element) - 4 : "";

    if (strcmp(element, "SimpleType") == 0)
        snprintf(r->declaring, sizeof r->declaring, "%s", attribute(a, "name") ? attribute(a, "name") : "");
    else if (strcmp(element, "Item") == 0 && r->is_type)
        note_label(r, a);
    else if (r->d->version == 3 ? strcmp(ending, "Type") == 0
                                : r->declaring[0] && (type_of_element(element) != TYPE_NONE ||
                                                      strcmp(element, "Enumeration") == 0))
        declare(r, r->d->version == 2 ? r->declaring : attribute(a, "name"), a);
}

static void begin_element(void *ctx, const char *element, const char **a)
{
    struct reader *const r = ctx;

    if (r->problem[0])
        return;
    if (!r->d->version && strcmp(element, "fmiModelDescription") != 0) {
        stop(r, "it does not begin with fmiModelDescription");
    } else if (!r->d->version) {
        read_model(r, a);
    } else if (strcmp(element, "CoSimulation") == 0) {
        read_co_simulation(r->d, a);
    } else if (strcmp(element, "ModelExchange") == 0) {
        read_model_exchange(r->d, a);
    } else if (strcmp(element, "DefaultExperiment") == 0) {
        r->d->step = r->d->step > 0 ? r->d->step : number_of_attribute(attribute(a, "stepSize"), 0.0);
    } else if (strcmp(element, "ModelVariables") == 0) {
        r->in_variables = true;
    } else if (r->d->version == 2 && strcmp(element, "Derivatives") == 0) {
        r->in_derivatives = true;
    } else if (r->in_derivatives && strcmp(element, "Unknown") == 0) {
        note_derivative(r, attribute(a, "index"));
    } else if (r->d->version == 3 && strcmp(element, "ContinuousStateDerivative") == 0) {
        note_derivative(r, attribute(a, "valueReference"));
    } else if (r->d->version == 3 && strcmp(element, "EventIndicator") == 0) {
        r->d->n_indicators++;
    } else if (!r->in_variables) {
        begin_type(r, element, a);
    } else if (strcmp(element, "ScalarVariable") == 0) {
        begin_variable(r, a);
    } else if (r->d->version == 2 && r->is_variable) {
        if (r->variable.type == TYPE_NONE)
            type_variable(r, element, a);
    } else if (r->d->version == 3 && !r->is_variable && attribute(a, "valueReference")) {
        begin_variable(r, a);
        type_variable(r, element, a);
    } else if (r->is_variable && strcmp(element, "Dimension") == 0) {
        r->variable.type = TYPE_NONE;
        free(r->variable.text);
        r->variable.text = keep_string("array");
    } else if (r->is_variable && r->variable.type == TYPE_STRING && strcmp(element, "Start") == 0) {
        free(r->variable.text);
        r->variable.text = keep_string(attribute(a, "value"));
    }
}

static void end_element(void *ctx, const char *element)
{
    struct reader *const r = ctx;

    if (strcmp(element, "ModelVariables") == 0)
        r->in_variables = false;
    else if (strcmp(element, "Derivatives") == 0)
        r->in_derivatives = false;
    else if (strcmp(element, "SimpleType") == 0)
        r->declaring[0] = '\0';
    else if (strcmp(element, "TypeDefinitions") == 0)
        r->is_type = false;
    else if (r->in_variables && r->is_variable &&
             (r->d->version == 2
                  ? strcmp(element, "ScalarVariable") == 0
                  : type_of_element(element) != TYPE_NONE || strcmp(element, "Enumeration") == 0 ||
                        strcmp(element, "Binary") == 0 || strcmp(element, "Clock") == 0))
        end_variable(r);
}

/* Entities, and what they may do, begin with one. */
static void doctype(void *ctx, const char *name, const char *system, const char *public, int internal)
{
    (void)name;
    (void)system;
    (void)public;
    (void)internal;
    stop(ctx, "it declares a document type, which no FMU needs");
}

/* ---- States ---------------------------------------------------------------------------------- */

/* All of them with their derivatives, or none; in the order of the structure, which is that of the functions of
 * FMI for all states at once. */
static void find_states(struct reader *r)
{
    struct description *const d = r->d;
    const size_t wanted = r->n_derivatives <= STATES_MAX ? r->n_derivatives : 0;
    size_t n = 0;

    d->of[KIND_STATE] = room(wanted, sizeof(struct variable));
    d->derivative = room(wanted, sizeof(struct variable));
    for (size_t rank = 1; rank <= wanted; rank++) {
        const struct quantity *q = NULL, *state = NULL;
        for (size_t i = 0; i < r->n_quantities; i++)
            if (r->quantity[i].rank == rank)
                q = &r->quantity[i];
        for (size_t i = 0; q && i < r->n_quantities; i++)
            if (q->of == (d->version == 2 ? r->quantity[i].index : r->quantity[i].variable.reference))
                state = &r->quantity[i];
        if (!state)
            continue;
        d->of[KIND_STATE][n] = copy_fmu_variable(&state->variable);
        d->derivative[n++] = copy_fmu_variable(&q->variable);
    }
    d->n[KIND_STATE] = n == wanted ? n : 0;
    d->n_states = r->n_derivatives;
    for (size_t i = 0; i < r->n_quantities; i++)
        drop_fmu_variable(&r->quantity[i].variable);
    free(r->quantity);
}

/* ---- The whole ------------------------------------------------------------------------------- */

/* It becomes a file's name. */
static bool is_identifier(const char *text)
{
    return text && *text && strlen(text) < 200 &&
           strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == strlen(text);
}

static void check_description(const struct description *d)
{
    if (!d->co_simulation && !d->model_exchange)
        refuse_fmu("it is an FMU for neither co-simulation nor model exchange: export it for one of these");
    if (!is_identifier(d->identifier))
        refuse_fmu(
            "modelDescription.xml: \"%.40s\" is no modelIdentifier: letters, digits and _ are expected",
            d->identifier);
    if (d->n[KIND_OUTPUT] == 0)
        refuse_fmu("it has no output that is a number; a plant has one at least");
}

void description_read(struct description *d, const char *text, size_t length)
{
    struct reader r = {.d = d, .parser = XML_ParserCreate(NULL)};

    *d = (struct description){0};
    if (!r.parser || length > INT32_MAX)
        refuse_fmu("modelDescription.xml cannot be read: no memory");
    XML_SetUserData(r.parser, &r);
    XML_SetElementHandler(r.parser, begin_element, end_element);
    XML_SetStartDoctypeDeclHandler(r.parser, doctype);
    if (XML_Parse(r.parser, text, (int)length, XML_TRUE) != XML_STATUS_OK)
        refuse_fmu("modelDescription.xml, line %lu: %s", (unsigned long)XML_GetCurrentLineNumber64(r.parser),
                   r.problem[0] ? r.problem : XML_ErrorString(XML_GetErrorCode(r.parser)));
    XML_ParserFree(r.parser);
    find_states(&r);
    for (size_t i = 0; i < r.n_declared; i++) { /* its labels are the variables' */
        free(r.declared[i].name);
        free(r.declared[i].unit);
    }
    free(r.declared);
    if (!(d->step > 0.0 && d->step < 1e6))
        d->step = 0.0;
    check_description(d);
}

void description_prefer_exchange(struct description *d)
{
    if (!d->model_exchange || !is_identifier(d->exchange_identifier))
        return;
    free(d->identifier);
    d->identifier = keep_string(d->exchange_identifier);
    d->co_simulation = false;
    d->variable_step = true;
    d->directional = d->exchange_directional;
}

void description_library(const struct description *d, char *path, size_t size)
{
#if defined(__x86_64__)
    static const char *const platform[] = {"linux64", "x86_64-linux"};
#elif defined(__aarch64__)
    static const char *const platform[] = {"aarch64-linux", "aarch64-linux"};
#else
    static const char *const platform[] = {"linux32", "x86-linux"};
#endif
    snprintf(path, size, "binaries/%s/%s.so", platform[d->version == 3], d->identifier);
}
