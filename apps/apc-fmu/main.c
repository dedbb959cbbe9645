/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * apc-fmu keeps or runs one FMU for a program that has it as its plant, and speaks with that one alone, over
 * its descriptor 3; src/plant/fmu.h says what. It ends when the other end is closed, however that came, and
 * also while the FMU hangs.
 */
#include "fmu.h"

#include <plant/fmu.h>

#include <dlfcn.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#define ASKER   3
#define MESSAGE (1 << 17)

static bool serving; /* else a person has called us */
bool fmu_spent;

/* ---- Words ----------------------------------------------------------------------------------- */

bool asker_gone(void)
{
    char byte;

    return recv(ASKER, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
}

/* What a stranger wrote stays on its line, and does nothing to a terminal. */
static void blank(char *text, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if ((unsigned char)text[i] < ' ' || text[i] == 127)
            text[i] = ' ';
}

static void tell_host(const char *text, size_t n)
{
    if (send(ASKER, text, n, MSG_NOSIGNAL) != (ssize_t)n) {
        archive_remove();
        _exit(EXIT_FAILURE);
    }
}

void refuse_fmu(const char *format, ...)
{
    char text[APC_FMU_TEXT] = "error\t";
    const size_t word = serving ? strlen(text) : 0;
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text + word, sizeof text - word, format, arguments);
    va_end(arguments);
    blank(text + word, strlen(text + word));
    if (serving)
        tell_host(text, strlen(text));
    else
        fprintf(stderr, "apc-fmu: %s\n", text);
    archive_remove();
    _exit(EXIT_FAILURE);
}

void *room(size_t n, size_t size)
{
    void *const memory = calloc(n ? n : 1, size);
    if (!memory)
        refuse_fmu("no memory");
    return memory;
}

void *more_room(void *memory, size_t n, size_t size)
{
    void *const more = reallocarray(memory, n, size);
    if (!more)
        refuse_fmu("no memory");
    return more;
}

/* ---- Keeping --------------------------------------------------------------------------------- */

/* One line, whatever a text in it holds. */
static void line(const char *kind, const char *const *field, size_t n)
{
    char text[4096];
    size_t used = (size_t)snprintf(text, sizeof text, "%s", kind);

    for (size_t i = 0; i < n; i++) {
        const size_t from = used + 1;
        used += (size_t)snprintf(text + used, sizeof text - used, "\t%.600s", field[i]);
        blank(text + from, used - from);
    }
    tell_host(text, used);
}

/* With what its numbers are called. */
static const char *described_with_names(const struct variable *v, char *text, size_t size)
{
    size_t used = (size_t)snprintf(text, size, "%s", v->description);

    for (size_t i = 0; i < v->n_labels && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%g %s%s",
                                 i                   ? ", "
                                 : v->description[0] ? " ("
                                                     : "(",
                                 v->label[i].value, v->label[i].name, i + 1 < v->n_labels ? "" : ")");
    return text;
}

static void describe_fmu(const struct description *d)
{
    static const char *const kinds[N_KINDS] = {"input", "output", "parameter", "state", "text", "fixed"};

    line("model", (const char *const[]){d->name[0] ? d->name : d->identifier, d->description}, 2);
    for (size_t k = 0; k < N_KINDS; k++)
        for (size_t i = 0; i < d->n[k]; i++) {
            const struct variable *const v = &d->of[k][i];
            char start[32], low[32], high[32], text[600];
            snprintf(start, sizeof start, "%.17g", v->start);
            snprintf(low, sizeof low, "%.17g", v->low);
            snprintf(high, sizeof high, "%.17g", v->high);
            if (k == KIND_TEXT || k == KIND_FIXED)
                line(kinds[k], (const char *const[]){v->name, v->description, v->text}, 3);
            else
                line(kinds[k],
                     (const char *const[]){v->name, v->unit, described_with_names(v, text, sizeof text),
                                           isnan(v->start) ? "" : start, low, high,
                                           v->n_labels                                          ? "label"
                                           : v->type == TYPE_BOOLEAN                            ? "truth"
                                           : v->type == TYPE_FLOAT64 || v->type == TYPE_FLOAT32 ? "real"
                                                                                                : "whole"},
                     7);
            for (size_t j = 0; j < v->n_labels && k < KIND_STATE; j++) {
                snprintf(start, sizeof start, "%.17g", v->label[j].value);
                line("label", (const char *const[]){v->label[j].name, start}, 2);
            }
        }
}

static int keep_fmu(const char *file)
{
    struct archive *const a = archive_open(file);
    struct description d;
    size_t length;
    char *const text = archive_text(a, "modelDescription.xml", &length), library[300], byte;

    /* It ends when its asker does: not before, with a whole service, and its folder left behind. */
    (void)signal(SIGTERM, SIG_IGN);
    (void)signal(SIGINT, SIG_IGN);
    (void)signal(SIGHUP, SIG_IGN);
    description_read(&d, text, length);
    description_library(&d, library, sizeof library);
    if (!archive_has(a, library)) {
        char platforms[200];
        archive_folders(a, "binaries/", platforms, sizeof platforms);
        refuse_fmu("it holds no %s, which this machine needs; there is: %s", library,
                   platforms[0] ? platforms : "no library at all");
    }
    char folder[300];
    snprintf(folder, sizeof folder, "%.*s", (int)(strrchr(library, '/') + 1 - library), library);
    const char *const path = archive_unpack(a, (const char *const[]){folder, "resources/"}, 2);
    archive_close(a);
    free(text);
    describe_fmu(&d);
    line("folder", &path, 1);
    while (recv(ASKER, &byte, 1, 0) > 0)
        ;
    archive_remove();
    return EXIT_SUCCESS;
}

/* ---- Running --------------------------------------------------------------------------------- */

static void *watch_host(void *ctx)
{
    struct pollfd asker = {.fd = ASKER, .events = POLLRDHUP};

    while (poll(&asker, 1, -1) < 0 || !(asker.revents & (POLLRDHUP | POLLHUP | POLLERR)))
        ;
    (void)ctx;
    if (getpgrp() == getpid()) /* what the FMU has started ends as well */
        (void)kill(0, SIGKILL);
    _exit(EXIT_SUCCESS);
}

static char *read_file(const char *path, size_t *length)
{
    FILE *const in = fopen(path, "re");
    char *text = NULL;
    size_t n = 0, used = 0;

    if (!in)
        refuse_fmu("%s cannot be read any more", path);
    do {
        text = more_room(text, (n += 65536) + 1, 1);
        used += fread(text + used, 1, n - used, in);
    } while (used == n);
    fclose(in);
    *length = used;
    return text;
}

bool status_well(int status, const char *what)
{
    static const char *const words[] = {"ok", "warning", "discarded", "error", "fatal error"};

    if (status == STATUS_OK || status == STATUS_WARNING)
        return true;
    fprintf(stderr, "%s: %s\n", what,
            status >= STATUS_DISCARD && status <= STATUS_FATAL ? words[status] : "not done");
    fmu_spent |= status == STATUS_ERROR || status == STATUS_FATAL;
    return false;
}

/* What is not linked to what it needs, as FMUs from Python are: their interpreter's library, by name. */
static void preload(void)
{
    const char *const named = getenv("APC_FMU_PRELOAD");
    if (named && *named && !dlopen(named, RTLD_NOW | RTLD_GLOBAL))
        refuse_fmu("APC_FMU_PRELOAD: %s", dlerror());
}

const char *find_entry_points(void *library, const struct entry_point *wanted)
{
    for (; wanted->name; wanted++) {
        void *const address = dlsym(library, wanted->name);
        if (!address)
            return wanted->name;
        memcpy(wanted->at, &address, sizeof address);
    }
    return NULL;
}

static void load_fmu(struct run *r, const char *folder)
{
    char path[600], within[300];

    description_library(&r->d, within, sizeof within);
    snprintf(path, sizeof path, "%s/%s", folder, within);
    void *const library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        const char *const said = dlerror();
        refuse_fmu("its library cannot be loaded: %s%s", said,
                   strstr(said, "undefined symbol: Py") || strstr(said, "undefined symbol: _Py")
                       ? ": name the interpreter's library in APC_FMU_PRELOAD, e.g. libpython3.11.so.1.0"
                   : strstr(said, "failed to map segment")
                       ? ": TMPDIR must name a folder that code can be run from, not one mounted noexec"
                       : "");
    }
    r->fmi = r->d.version == 2 ? &fmi2 : &fmi3;
    const char *const missing = r->fmi->load(library, &r->d);
    if (missing)
        refuse_fmu("its library does not export %s, which FMI %u.0 demands", missing, r->d.version);
}

/* The place that the asker means. */
static const struct variable *variable(const struct run *r, enum kind kind, double place)
{
    if (!(place >= 0.0 && place < (double)r->d.n[kind]))
        refuse_fmu("asked for a variable that it has not");
    return &r->d.of[kind][(size_t)place];
}

bool outputs(const struct run *r, double *y)
{
    if (r->y_float64)
        return r->fmi->get_float64(r->y_float64, r->ny, y);
    for (size_t i = 0; i < r->ny; i++)
        if (!r->fmi->get(r->y[i], &y[i]))
            return false;
    return true;
}

/* A call costs an FMU of Python tens of microseconds: what is all of one type is asked for in one. */
static void gather_outputs(struct run *r)
{
    size_t n = 0;

    while (n < r->ny && r->y[n]->type == TYPE_FLOAT64)
        n++;
    if (n < r->ny || n == 0)
        return;
    r->y_float64 = room(n, sizeof *r->y_float64);
    for (size_t i = 0; i < n; i++)
        r->y_float64[i] = r->y[i]->reference;
}

/* An input keeps its value until it is set. */
bool set_fmu_inputs(const struct run *r, const double *u)
{
    for (size_t i = 0; i < r->nu; i++)
        if (u[i] != r->given[i]) {
            if ((r->solver && !solver_announce(r->solver)) || !r->fmi->set(r->u[i], u[i]))
                return false;
            r->given[i] = u[i];
        }
    return true;
}

/* Texts as they stand behind the numbers: the place, the bytes with their 0, these. */
static bool set_texts(const struct run *r, const double *in, size_t n, size_t texts)
{
    for (size_t i = 0; i < texts; i++) {
        const size_t bytes = n > 2 ? (size_t)in[1] : 0, length = 2 + (bytes + 7) / 8;
        const char *const text = (const char *)(in + 2);
        if (bytes == 0 || length > n || text[bytes - 1] != '\0')
            refuse_fmu("asked to begin with texts that are none");
        if (!r->fmi->set_text(variable(r, KIND_TEXT, in[0]), text))
            return false;
        in += length;
        n -= length;
    }
    return true;
}

static bool begin_fmu(struct run *r, const char *folder, enum fmu_request how, const double *in, size_t n,
                      double *y)
{
    const double *const end = in + n;

    if (!r->fmi) {
        if (how == FMU_AHEAD)
            description_prefer_exchange(&r->d);
        load_fmu(r, folder);
    }
    if (n < 5 || !(in[0] + in[1] + 2 * in[2] + 5 <= (double)n))
        refuse_fmu("asked to begin with nothing");
    r->nu = (size_t)in[0];
    r->ny = (size_t)in[1];
    const size_t np = (size_t)in[2], texts = (size_t)in[3];
    r->length = r->d.step > 0.0 ? r->d.step : in[4];
    r->u = room(r->nu, sizeof(struct variable *));
    r->y = room(r->ny, sizeof(struct variable *));
    in += 5;
    for (size_t i = 0; i < r->nu; i++)
        r->u[i] = variable(r, KIND_INPUT, *in++);
    for (size_t i = 0; i < r->ny; i++)
        r->y[i] = variable(r, KIND_OUTPUT, *in++);
    gather_outputs(r);
    r->given = room(r->nu, sizeof *r->given);
    for (size_t i = 0; i < r->nu; i++)
        r->given[i] = (double)NAN;
    if (!r->fmi->instantiate(&r->d, folder)) {
        fprintf(stderr, "no instance of it can be made%s\n",
                r->d.needs_tool ? ": it needs the tool that made it (needsExecutionTool); is that here?"
                                : "");
        return false;
    }
    for (size_t i = 0; i < np; i++, in += 2)
        if (!r->fmi->set(variable(r, KIND_PARAMETER, in[0]), in[1]))
            return false;
    if (!set_texts(r, in, (size_t)(end - in), texts))
        return false;
    if (!r->fmi->enter() || (how == FMU_BEGIN && !r->fmi->leave()) || (how == FMU_AHEAD && !look_begin(r)))
        return false;
    if (how == FMU_BEGIN && !r->d.co_simulation && !(r->solver = solver_begin(r->fmi, &r->d)))
        return false;
    return outputs(r, y);
}

/* What a variable is by itself: its kind and place. */
static bool tell_start(const struct run *r, const double *in, size_t n, double *out)
{
    if (n != 2 || !(in[0] >= 0.0 && in[0] < (double)KIND_TEXT))
        refuse_fmu("asked for a value of its own with %zu numbers", n);
    return r->fmi->get(variable(r, (enum kind)in[0], in[1]), out);
}

#define EARLY 1e-6 /* of a step: where a sum of times comes as near as that to its end, it is taken */

/*
 * Where its steps are of one length, it goes as far as whole ones lead. They are counted, and the asker's
 * time is summed once more without rounding: a sum of either rounds by a step some day, and the FMU would lag
 * by one for good.
 */
static bool step_alike(struct run *r, double t, double dt)
{
    const bool follows = r->t + r->dt <= t && r->t + r->dt >= t;
    const double more = (follows ? r->dt : t - r->t) + r->rest, at = r->at + more;

    r->rest = more - (at - r->at);
    r->at = at;
    r->t = t;
    r->dt = dt;
    if (!(r->length > 0.0))
        r->length = dt;
    const double whole = floor((at + dt - r->time) / r->length + EARLY);
    while ((double)r->taken < whole) {
        const double from = r->time + (double)r->taken * r->length;
        double reached = from;
        if (!r->fmi->step(from, r->length, &reached)) {
            r->time = reached;
            r->taken = 0;
            return false;
        }
        r->taken++;
    }
    return true;
}

static bool step_fmu(struct run *r, const double *in, size_t n, double *y)
{
    if (n != 2 + r->nu)
        refuse_fmu("asked for a step with %zu numbers", n);
    const double t = in[0], dt = in[1], sliver = 1e-9 * dt, to = t + dt;

    if (!set_fmu_inputs(r, in + 2) || (!r->d.variable_step && !step_alike(r, t, dt)))
        return false;
    if (r->d.variable_step && r->time < to - sliver) {
        const double h = r->time > t + sliver || r->time < t - sliver ? to - r->time : dt;
        if (!(r->solver ? solver_step(r->solver, to, &r->time) : r->fmi->step(r->time, h, &r->time)))
            return false;
        r->time = to;
    }
    return outputs(r, y);
}

/* A request of @p n numbers, to @p out [*n_out]. */
static bool answer(struct run *r, const char *folder, uint32_t request, const double *in, size_t n,
                   double *out, size_t *n_out)
{
    const bool begins = request == FMU_BEGIN || request == FMU_LOOK || request == FMU_AHEAD;
    const size_t nx = r->d.n[KIND_STATE];

    if (!begins && !r->fmi)
        refuse_fmu("asked before it has begun");
    if ((request == FMU_POINT && n != nx + r->nu) || (request == FMU_SLOPES && n != nx + r->nu) ||
        (request == FMU_INTERVAL && n != nx + r->nu + 2) || (request >= FMU_SLOPES && !r->look))
        refuse_fmu("asked for a point with %zu numbers", n);
    const bool well = begins                    ? begin_fmu(r, folder, (enum fmu_request)request, in, n, out)
                      : request == FMU_POINT    ? look_point(r, in, in + nx, out)
                      : request == FMU_SLOPES   ? look_slopes(r, in, in + nx, out)
                      : request == FMU_INTERVAL ? look_interval(r, in, in + nx, in[n - 2], in[n - 1], out)
                      : request == FMU_OWN      ? tell_start(r, in, n, out)
                                                : step_fmu(r, in, n, out);

    *n_out = request == FMU_OWN        ? 1
             : request == FMU_POINT    ? nx + r->ny
             : request == FMU_SLOPES   ? (nx + r->ny) * (1 + nx + r->nu)
             : request == FMU_INTERVAL ? nx * (1 + nx + r->nu)
                                       : r->ny;
    return well;
}

static int run_fmu(const char *folder)
{
    struct run *const r = room(1, sizeof *r);
    double *const in = room(MESSAGE, 1), *const out = room(2, MESSAGE);
    struct fmu_header header;
    char path[600];
    pthread_t watcher;
    size_t length;
    ssize_t n;

    (void)setrlimit(RLIMIT_CORE, &(struct rlimit){0});
    if (pthread_create(&watcher, NULL, watch_host, NULL) != 0)
        refuse_fmu("no thread");
    snprintf(path, sizeof path, "%s/modelDescription.xml", folder);
    char *const text = read_file(path, &length);
    description_read(&r->d, text, length);
    free(text);
    preload();
    while ((n = recv(ASKER, in, MESSAGE, 0)) >= (ssize_t)sizeof header) {
        const double *const values = (const double *)(const void *)((const char *)in + sizeof header);
        const size_t n_values = ((size_t)n - sizeof header) / sizeof(double);
        double *const y = (double *)(void *)((char *)out + sizeof header);
        size_t n_out = 0;
        memcpy(&header, in, sizeof header);
        header.failed = !answer(r, folder, header.request, values, n_values, y, &n_out);
        header.spent = fmu_spent;
        fflush(NULL);
        memcpy(out, &header, sizeof header);
        tell_host((const char *)out, sizeof header + n_out * sizeof(double));
        if (fmu_spent)
            _exit(EXIT_FAILURE);
    }
    free(in);
    free(out);
    return EXIT_SUCCESS;
}

int main(int argc, char **argv)
{
    int type;
    socklen_t size = sizeof type;

    serving = getsockopt(ASKER, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_SEQPACKET;
    if (serving)
        (void)fcntl(ASKER, F_SETFD, FD_CLOEXEC); /* else what an FMU starts would hold it */
    if (serving && argc == 3 && strcmp(argv[1], "keep") == 0)
        return keep_fmu(argv[2]);
    if (serving && argc == 3 && strcmp(argv[1], "run") == 0)
        return run_fmu(argv[2]);
    if (argc == 2 && (strcmp(argv[1], "--version") == 0 || strcmp(argv[1], "-V") == 0))
        return puts("apc-fmu (libapc) " APC_VERSION) < 0;
    const int asked = argc == 2 && (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-?") == 0);
    fputs("Usage: apc-fmu [OPTION...]\nRun an FMU in a separate process. Programs whose plant is an FMU "
          "start it;\n"
          "do not start it yourself. `apc plants ./FILE.fmu` shows the content of a file.\n\n"
          "  -?, --help                 Give this help list\n  -V, --version              Print program "
          "version\n",
          asked ? stdout : stderr);
    return asked ? EXIT_SUCCESS : 2;
}
