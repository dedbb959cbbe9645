/* SPDX-License-Identifier: BSD-3-Clause */
/* The archive that an FMU is: a description, the experiment file, and the library that runs it (apps/fmu-controller). */
#include "fmu_archive.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <openssl/evp.h>

#include "files/files.h"
#include "zip.h"

#define LIBRARY       "apc_controller" /* in the FMU, a name of C */
#define PATH_MAX_B    4096
#define LIBRARY_MAX_B (1 << 30)

/* ---- Its description -------------------------------------------------------------------------- */

static void put_attribute(FILE *out, const char *name, const char *value)
{
    fprintf(out, " %s=\"", name);
    for (; *value; value++)
        if (strchr("<>&\"", *value))
            fprintf(out, "&#%d;", *value);
        else
            fputc((unsigned char)*value < ' ' ? ' ' : *value, out);
    fputc('"', out);
}

static void put_xml_number(FILE *out, const char *name, double value)
{
    char text[DECIMAL_LEN];
    put_attribute(out, name, decimal_shortest(value, 6, text));
}

static void put_xml_reference(FILE *out, const char *name, size_t reference)
{
    fprintf(out, " %s=\"%zu\"", name, reference);
}

static void put_units(FILE *out, const struct standalone_variable *v, size_t n)
{
    bool any = false;
    for (size_t i = 0; i < n; i++) {
        size_t before = 0;
        while (before < i && strcmp(v[before].tag.unit, v[i].tag.unit) != 0)
            before++;
        if (before < i || !v[i].tag.unit[0])
            continue;
        fputs(any ? "    <Unit" : "  <UnitDefinitions>\n    <Unit", out);
        put_attribute(out, "name", v[i].tag.unit);
        fputs("/>\n", out);
        any = true;
    }
    if (any)
        fputs("  </UnitDefinitions>\n", out);
}

/* What a Float64 or Int32, Real or Integer, has of its own. A measurement may lie outside its range: it is Bad then. */
static void put_type(FILE *out, const struct standalone_variable *v)
{
    const bool measured = v->kind == STANDALONE_INPUT && v->tag.table == APC_SENSOR;
    if (v->tag.unit[0] && v->kind != STANDALONE_MODE)
        put_attribute(out, "unit", v->tag.unit);
    if (!measured && v->tag.low > -APC_VALUE_MAX)
        put_xml_number(out, "min", v->tag.low);
    if (!measured && v->tag.high < APC_VALUE_MAX)
        put_xml_number(out, "max", v->tag.high);
    if (v->kind != STANDALONE_OUTPUT)
        put_xml_number(out, "start", v->start);
}

static void put_variable(FILE *out, const struct standalone_variable *v, size_t reference, unsigned version)
{
    static const char *const causality[] = {[STANDALONE_INPUT] = "input",
                                            [STANDALONE_OUTPUT] = "output",
                                            [STANDALONE_PARAMETER] = "parameter",
                                            [STANDALONE_MODE] = "parameter"},
                             *const variability[] = {[STANDALONE_INPUT] = "continuous",
                                                     [STANDALONE_OUTPUT] = "discrete",
                                                     [STANDALONE_PARAMETER] = "tunable",
                                                     [STANDALONE_MODE] = "tunable"};
    const bool mode = v->kind == STANDALONE_MODE;
    const char *const type = version == 2 ? (mode ? "Integer" : "Real") : mode ? "Int32" : "Float64";

    fprintf(out, "    <%s", version == 2 ? "ScalarVariable" : type);
    put_attribute(out, "name", v->tag.name);
    put_xml_reference(out, "valueReference", reference);
    if (v->tag.description[0])
        put_attribute(out, "description", v->tag.description);
    put_attribute(out, "causality", causality[v->kind]);
    put_attribute(out, "variability", variability[v->kind]);
    if (v->kind == STANDALONE_OUTPUT)
        put_attribute(out, "initial", "calculated");
    if (version == 2)
        fprintf(out, "><%s", type);
    put_type(out, v);
    fputs(version == 2 ? "/></ScalarVariable>\n" : "/>\n", out);
}

static void put_fmu_outputs(FILE *out, const struct standalone_variable *v, size_t n, const char *element,
                            const char *attribute)
{
    for (size_t i = 0; i < n; i++)
        if (v[i].kind == STANDALONE_OUTPUT) {
            fprintf(out, "    <%s", element);
            put_xml_reference(out, attribute, i + 1);
            fputs("/>\n", out);
        }
}

static void put_description(FILE *out, const struct standalone *s, const char *token, unsigned version)
{
    const struct experiment *const e = standalone_experiment(s);
    const struct controller *const c = standalone_controller(s);
    const double period = apc_ns_to_s(c->rhythm.period);
    size_t n;
    const struct standalone_variable *const v = standalone_variables(s, &n);

    fprintf(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"%s\"",
            version == 2 ? "2.0" : "3.0");
    put_attribute(out, "modelName", e->name);
    put_attribute(out, version == 2 ? "guid" : "instantiationToken", token);
    put_attribute(out, "description", e->title);
    fprintf(out, " generationTool=\"libapc %s\"", apc_version());
    fputs(" variableNamingConvention=\"flat\">\n  <CoSimulation modelIdentifier=\"" LIBRARY
          "\" canHandleVariableCommunicationStepSize=\"false\"",
          out);
    if (version == 3)
        put_xml_number(out, "fixedInternalStepSize", period);
    fputs("/>\n", out);
    put_units(out, v, n);
    fputs("  <LogCategories>\n    <Category name=\"logAll\"/>\n    <Category name=\"logStatusWarning\"/>\n"
          "    <Category name=\"logStatusError\"/>\n  </LogCategories>\n  <DefaultExperiment startTime=\"0\"",
          out);
    if (e->duration > 0)
        put_xml_number(out, "stopTime", e->duration);
    put_xml_number(out, "stepSize", period);
    fputs("/>\n  <ModelVariables>\n", out);
    if (version == 3)
        fputs("    <Float64 name=\"time\" valueReference=\"0\" causality=\"independent\" "
              "variability=\"continuous\"/>\n",
              out);
    for (size_t i = 0; i < n; i++)
        put_variable(out, &v[i], i + 1, version);
    fputs("  </ModelVariables>\n  <ModelStructure>\n", out);
    if (version == 2) {
        fputs("    <Outputs>\n", out);
        put_fmu_outputs(out, v, n, "Unknown", "index");
        fputs("    </Outputs>\n    <InitialUnknowns>\n", out);
        put_fmu_outputs(out, v, n, "Unknown", "index");
        fputs("    </InitialUnknowns>\n", out);
    } else {
        put_fmu_outputs(out, v, n, "Output", "valueReference");
        put_fmu_outputs(out, v, n, "InitialUnknown", "valueReference");
    }
    fputs("  </ModelStructure>\n</fmiModelDescription>\n", out);
}

/* ---- Its parts -------------------------------------------------------------------------------- */

/* The file that @p symbol was loaded from. */
static bool find_library(const char *symbol, char path[PATH_MAX_B])
{
    Dl_info about;
    void *const at = dlsym(RTLD_DEFAULT, symbol);
    return at && dladdr(at, &about) && about.dli_fname &&
           (size_t)snprintf(path, PATH_MAX_B, "%s", about.dli_fname) < PATH_MAX_B;
}

/* Below the folder of libapc. */
static int find_controller_library(char path[PATH_MAX_B], struct apc_error *why)
{
    static const char below[] = "/apc/apc-fmu-controller.so";
    char *const slash = find_library("apc_version", path) ? strrchr(path, '/') : NULL;
    if (!slash || (size_t)(slash - path) + sizeof below > PATH_MAX_B)
        return apc_fail(why, APC_ESYS, "the file of libapc, which goes into the FMU, cannot be found");
    memcpy(slash, below, sizeof below);
    return 0;
}

static void make_token(const struct standalone *s, const char *text, unsigned version, char token[80])
{
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned length = 0;
    EVP_MD_CTX *const sha = EVP_MD_CTX_new();
    const char *const parts[] = {apc_version(), version == 2 ? "2" : "3", standalone_controller(s)->name,
                                 text};

    if (sha && EVP_DigestInit_ex(sha, EVP_sha256(), NULL) == 1)
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
            (void)EVP_DigestUpdate(sha, parts[i], strlen(parts[i]) + 1);
    if (sha && EVP_DigestFinal_ex(sha, digest, &length) != 1)
        length = 0;
    EVP_MD_CTX_free(sha);
    token[0] = '\0';
    for (unsigned i = 0; i < length && i < 32; i++)
        snprintf(token + (size_t)2 * i, 3, "%02x", digest[i]);
}

/* A file as an entry, whose data is to be freed. Returns 0 or a negative error. */
static int read_library(const char *path, struct zip_entry *entry, struct apc_error *why)
{
    FILE *const in = fopen(path, "re");
    const long size = in && fseek(in, 0, SEEK_END) == 0 ? ftell(in) : -1;
    char *data = size >= 0 && size <= LIBRARY_MAX_B ? malloc((size_t)size + 1) : NULL;
    const bool read = data && fseek(in, 0, SEEK_SET) == 0 && fread(data, 1, (size_t)size, in) == (size_t)size;

    if (in)
        fclose(in);
    if (!read) {
        free(data);
        return apc_fail(why, APC_ENOTFOUND,
                        "%s, which goes into the FMU, cannot be read: it is installed with apc, but not with "
                        "the Python package",
                        path);
    }
    entry->data = data;
    entry->size = (uint32_t)size;
    return 0;
}

/* The library and, beside it, libconfig, as @p name [2]; data to be freed. */
static int read_libraries(struct zip_entry library[2], char name[2][PATH_MAX_B], unsigned version,
                          struct apc_error *why)
{
#if defined(__x86_64__)
    const char *const folder = version == 2 ? "binaries/linux64" : "binaries/x86_64-linux";
#else
    const char *const folder = "binaries/aarch64-linux";
    (void)version;
#endif
    char path[PATH_MAX_B];
    int rc = find_controller_library(path, why);

    snprintf(name[0], PATH_MAX_B, "%s/" LIBRARY ".so", folder);
    if (rc == 0)
        rc = read_library(path, &library[0], why);
    if (rc == 0 && !find_library("config_init", path))
        rc = apc_fail(why, APC_ENOTFOUND, "libconfig, which goes into the FMU, is not loaded from a file");
    if (rc == 0) {
        const char *const slash = strrchr(path, '/');
        snprintf(name[1], PATH_MAX_B, "%s/%.200s", folder, slash ? slash + 1 : path);
        rc = read_library(path, &library[1], why);
    }
    return rc;
}

/* Texts that the archive is made of; to be freed. */
static int make_texts(const struct standalone *s, const char *text, unsigned version, char *made[2],
                      struct apc_error *why)
{
    char token[80];
    size_t size;
    bool well = true;

    make_token(s, text, version, token);
    for (int i = 0; i < 2 && well; i++) {
        FILE *const out = open_memstream(&made[i], &size);
        if (out && i == 0)
            put_description(out, s, token, version);
        else if (out)
            fprintf(out, "%s\n%s\n", token, standalone_controller(s)->name);
        well = out && fclose(out) == 0 && token[0];
    }
    return well ? 0 : apc_fail(why, APC_ENOMEM, "out of memory");
}

int fmu_archive_write(const char *file, const struct standalone *s, const char *text, unsigned version,
                      struct apc_error *why)
{
    char *made[2] = {NULL, NULL}, name[2][PATH_MAX_B];
    struct zip_entry library[2] = {{.name = name[0]}, {.name = name[1]}};
    int rc = make_texts(s, text, version, made, why);

    if (rc == 0)
        rc = read_libraries(library, name, version, why);
    if (rc == 0) {
        const struct zip_entry all[] = {{"modelDescription.xml", made[0], (uint32_t)strlen(made[0])},
                                        {"resources/controller", made[1], (uint32_t)strlen(made[1])},
                                        {"resources/experiment.conf", text, (uint32_t)strlen(text)},
                                        library[0],
                                        library[1]};
        rc = zip_write(file, all, sizeof all / sizeof *all, why);
    }
    free((void *)(uintptr_t)library[0].data);
    free((void *)(uintptr_t)library[1].data);
    free(made[0]);
    free(made[1]);
    return rc;
}
