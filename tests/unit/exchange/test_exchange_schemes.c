/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * What every scheme of a plant must do, each test once a scheme. The plant is on the other side of the wire
 * and does what it is told, good or bad.
 */
#include "check.h"

#include "apcexchange.h"
#include "modbus_peer.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#ifdef APC_TLS
#include "apc/admin/authority.h"
#endif

#define PATIENCE (20 * APC_NS_PER_S)  /* a hang is a failure, not a hung test */
#define SHORT    (30 * APC_NS_PER_MS) /* for a reply that does not come before */
#define T0       (INT64_C(1700000000) * APC_NS_PER_S)

enum behaviour { PROPER, UNNUMBERED, GARBAGE, FEW, MANY, ANOTHERS, NOT_VALUES, CLOSES, LATE };

struct plant {
    const struct scheme *scheme;
    struct apc_exchange *x;
    size_t nu, ny;
    bool begun; /* the last exchange: there is an end to it */

    pthread_mutex_t mutex; /* of what follows: it may have a thread of its own */
    enum behaviour behaviour;
    struct apc_value *u, *y;
    struct apc_sample *samples;
    unsigned asked, commanded; /* how often */
    uint64_t id;               /* of the last request, behind frames */

    struct apc_server *server;       /* tcp:, tls: */
    struct apc_identity *its, *ours; /* tls: */
    sem_t released;
    struct apc_executive *executive; /* inproc: */
    struct modbus_peer *peer;        /* modbus: */
    struct {
        char link[40]; /* the name of the port, whatever port that is */
        int port, kept, wake[2];
        pthread_t thread;
    } board; /* serial: */
};

struct scheme {
    const char *name;
    void (*open)(struct plant *p);
    int (*exchange)(struct plant *p, const struct apc_value *u, apc_ns patience, struct apc_value *y);
    void (*close)(struct plant *p);
    void (*look)(struct plant *p); /* at u and the counts, where the plant has them in a way of its own */
    bool bare;                     /* it knows values only: no status, no time, and takes them one by one */
    bool coarse; /* two values at most, 0 to 100, in hundredths; a lost port is looked for once a second */
    double safe; /* of output 1; of output 2 it is 1 less; of one that watches its client itself: 0 */
};

static void open_exchange(struct plant *p, const char *uri, const struct apc_inproc_options *inproc,
                          const struct apc_modbus_options *modbus)
{
    const double safe[] = {p->scheme->safe, p->scheme->safe - 1.0};
    const struct apc_exchange_options options = {.size = sizeof(options),
                                                 .nu = p->nu,
                                                 .ny = p->ny,
                                                 .inproc = inproc,
                                                 .modbus = modbus,
                                                 .safe = p->scheme->coarse ? safe : NULL,
                                                 .identity = p->ours};
    struct apc_error why;

    if (apc_exchange_open(&p->x, uri, &options, &why) < 0)
        fail_msg("%s", why.text);
}

/* Of a scheme that waits by itself. */
static int waiting_exchange(struct plant *p, const struct apc_value *u, apc_ns patience, struct apc_value *y)
{
    int rc = apc_exchange_begin(p->x, u, apc_clock_mono(NULL) + patience);

    p->begun = rc == 0;
    return rc < 0 ? rc : apc_exchange_finish(p->x, y);
}

/* ---- A plant behind frames ------------------------------------------------------------------ */

static int reply(const struct plant *p, enum behaviour behaviour, uint64_t id, char *text, size_t size)
{
    struct apc_frame frame = {.kind = APC_FRAME_VALUES, .id = id, .n = p->ny};

    if (behaviour == CLOSES)
        return APC_EPROTO;
    if (behaviour == GARBAGE)
        return snprintf(text, size, "7\n");
    if (behaviour == NOT_VALUES)
        frame.kind = APC_FRAME_COMMAND;
    frame.n += (behaviour == MANY) - (size_t)(behaviour == FEW);
    frame.id += behaviour == ANOTHERS;
    if (behaviour == UNNUMBERED)
        frame.id = 0;
    for (size_t i = 0; i < frame.n; i++) {
        const struct apc_value *y = &p->y[i < p->ny ? i : 0];

        p->samples[i] = (struct apc_sample){.value = y->value, .status = y->status, .time = y->time};
    }
    return apc_frame_encode(text, size, &frame, p->samples);
}

static int serve(void *ctx, uint64_t connection, const char *request, size_t length, char *text, size_t size)
{
    struct plant *p = ctx;
    struct apc_frame frame;
    int n;

    (void)connection;
    pthread_mutex_lock(&p->mutex);
    n = apc_frame_decode(request, length, &frame, p->samples, p->nu);
    const enum behaviour behaviour = n < 0 ? CLOSES : p->behaviour;
    p->asked++;
    p->commanded += frame.kind == APC_FRAME_COMMAND;
    p->id = frame.id;
    for (size_t i = 0; i < frame.n; i++)
        p->u[i] = (struct apc_value){p->samples[i].value, p->samples[i].status, p->samples[i].time};
    n = reply(p, behaviour, frame.id, text, size);
    pthread_mutex_unlock(&p->mutex);
    while (behaviour == LATE && p->server && sem_wait(&p->released) < 0)
        ;
    return n;
}

static void tcp_open(struct plant *p)
{
    const struct apc_server_options options = {.size = sizeof(options),
                                               .frame_max = APC_FRAME_ROOM(p->nu > p->ny ? p->nu : p->ny)};
    char uri[64];

    assert_int_equal(apc_server_create(&p->server, "tcp:127.0.0.1:0", &options, serve, p, NULL), 0);
    snprintf(uri, sizeof(uri), "tcp:127.0.0.1:%d", apc_server_port(p->server));
    open_exchange(p, uri, NULL, NULL);
}

static void tcp_close(struct plant *p)
{
    apc_server_destroy(p->server);
}

#ifdef APC_TLS
static char certificates[] = "/tmp/apc-schemes-XXXXXX";

static struct apc_identity *identity_of(const char *name, enum authority_role role)
{
    static const char *const hosts[] = {"127.0.0.1"};
    const struct authority_request request = {.name = name,
                                              .role = role,
                                              .hosts = hosts,
                                              .n_hosts = role == ROLE_PLANT,
                                              .from = time(NULL) - 60,
                                              .until = time(NULL) + 3600};
    struct apc_identity *identity;
    char path[64];

    if (role == ROLE_AUTHORITY) {
        assert_int_equal(authority_create(certificates, &request, NULL), 0);
        return NULL;
    }
    snprintf(path, sizeof(path), "%s/%s.pem", certificates, name);
    if (access(path, R_OK) != 0)
        assert_int_equal(authority_issue(certificates, &request, NULL), 0);
    assert_int_equal(apc_identity_load(&identity, path, NULL), 0);
    return identity;
}

static void tls_open(struct plant *p)
{
    static const char *const clients[] = {"client"};
    struct apc_server_options options = {.size = sizeof(options),
                                         .frame_max = APC_FRAME_ROOM(p->nu > p->ny ? p->nu : p->ny),
                                         .clients = clients,
                                         .n_clients = 1};
    char uri[64];

    if (strstr(certificates, "XXXXXX")) {
        assert_non_null(mkdtemp(certificates));
        (void)identity_of("ours", ROLE_AUTHORITY);
    }
    options.identity = p->its = identity_of("plant", ROLE_PLANT);
    p->ours = identity_of("client", ROLE_CLIENT);
    assert_int_equal(apc_server_create(&p->server, "tls:127.0.0.1:0", &options, serve, p, NULL), 0);
    snprintf(uri, sizeof(uri), "tls:127.0.0.1:%d", apc_server_port(p->server));
    open_exchange(p, uri, NULL, NULL);
}

static void tls_close(struct plant *p)
{
    apc_server_destroy(p->server);
    apc_identity_free(p->its);
    apc_identity_free(p->ours);
}

static int remove_certificates(void **state)
{
    char command[64];
    (void)state;
    snprintf(command, sizeof(command), "rm -rf %s", certificates);
    return system(command);
}
#else
#define remove_certificates NULL
#endif

static void inproc_open(struct plant *p)
{
    struct apc_inproc_options options = {.size = sizeof(options),
                                         .network.delay = {.kind = APC_CONSTANT, .a = 0.02},
                                         .serve = serve,
                                         .serve_ctx = p}; /* there and back: longer than SHORT */

    assert_int_equal(apc_executive_create(&p->executive, "virtual", NULL, NULL), 0);
    options.executive = p->executive;
    open_exchange(p, "inproc:", &options, NULL);
}

static int inproc_exchange(struct plant *p, const struct apc_value *u, apc_ns patience, struct apc_value *y)
{
    const apc_ns deadline = apc_clock_mono(apc_executive_clock(p->executive)) + patience;
    int rc = apc_exchange_begin(p->x, u, deadline);

    p->begun = rc == 0;
    if (rc < 0)
        return rc;
    assert_int_equal(apc_exchange_finish(p->x, y), APC_EBUSY);
    assert_true(apc_virtual_run(p->executive, deadline) > 0);
    return apc_exchange_finish(p->x, y);
}

static void inproc_close(struct plant *p)
{
    apc_executive_destroy(p->executive);
}

/* ---- A plant of registers: u and y as doubles, one next to the other ------------------------ */

static void modbus_open(struct plant *p)
{
    struct apc_modbus_options options = {.size = sizeof(options), .unit = 7};
    struct apc_modbus_point *u = calloc(p->nu, sizeof(*u)), *y = calloc(p->ny, sizeof(*y));
    char uri[64];

    for (size_t i = 0; i < p->nu; i++)
        u[i] = (struct apc_modbus_point){.area = APC_MODBUS_HOLDING,
                                         .type = APC_MODBUS_F64,
                                         .address = 4 * (unsigned)i,
                                         .safe = -1.0 - (double)i};
    for (size_t i = 0; i < p->ny; i++)
        y[i] = (struct apc_modbus_point){
            .area = APC_MODBUS_INPUT, .type = APC_MODBUS_F64, .address = 4 * (unsigned)i};
    options.u = u;
    options.y = y;
    p->peer = calloc(1, sizeof(*p->peer));
    assert_non_null(p->peer);
    modbus_peer_start(p->peer);
    snprintf(uri, sizeof(uri), "modbus:127.0.0.1:%d", p->peer->port);
    open_exchange(p, uri, NULL, &options);
    free(u);
    free(y);
}

static void modbus_close(struct plant *p)
{
    modbus_peer_stop(p->peer);
    free(p->peer);
}

static double of_registers(const uint16_t *r)
{
    const uint64_t bits = (uint64_t)r[0] << 48 | (uint64_t)r[1] << 32 | (uint64_t)r[2] << 16 | r[3];
    double value;

    memcpy(&value, &bits, sizeof(value));
    return value;
}

/* What it is told and shows goes there, what it has been given comes from there. */
static void modbus_look(struct plant *p)
{
    static const enum modbus_behaviour as[] = {
        [PROPER] = MODBUS_PROPER, [GARBAGE] = MODBUS_GARBAGE,   [FEW] = MODBUS_FEW,
        [MANY] = MODBUS_MANY,     [ANOTHERS] = MODBUS_ANOTHERS, [NOT_VALUES] = MODBUS_OTHER,
        [CLOSES] = MODBUS_CLOSES, [LATE] = MODBUS_LATE};

    pthread_mutex_lock(&p->peer->mutex);
    p->peer->behaviour = as[p->behaviour];
    p->asked = p->peer->reads;
    p->commanded = p->peer->writes;
    for (size_t i = 0; i < p->nu; i++)
        p->u[i].value = of_registers(&p->peer->holding[4 * i]);
    for (size_t i = 0; i < p->ny; i++) {
        uint64_t bits;

        memcpy(&bits, &p->y[i].value, sizeof(bits));
        for (size_t k = 0; k < 4; k++)
            p->peer->input[4 * i + k] = (uint16_t)(bits >> (48 - 16 * k));
    }
    pthread_mutex_unlock(&p->peer->mutex);
}

/* ---- A plant of lines, written after what the board's own firmware does ------------------------ */

static void plug_in(struct plant *p)
{
    char name[64];
    struct termios how;

    p->board.port = posix_openpt(O_RDWR | O_NOCTTY);
    assert_true(p->board.port >= 0 && grantpt(p->board.port) == 0 && unlockpt(p->board.port) == 0);
    assert_int_equal(ptsname_r(p->board.port, name, sizeof(name)), 0);
    p->board.kept = open(name, O_RDWR | O_NOCTTY);
    assert_int_equal(tcgetattr(p->board.kept, &how), 0);
    cfmakeraw(&how);
    assert_int_equal(tcsetattr(p->board.kept, TCSANOW, &how), 0);
    (void)unlink(p->board.link);
    assert_int_equal(symlink(name, p->board.link), 0);
}

/* Its answer to a line, in @p reply; false: it goes away instead. */
static bool answer_line(struct plant *p, const char *line, char reply[200])
{
    static const char *const instead[] = {
        [GARBAGE] = "\x01x7\r\n", [FEW] = "\r\n", [ANOTHERS] = "TCLab\r\n", [NOT_VALUES] = "?\r\n"};
    const size_t i = line[0] && line[1] == '2';
    const bool measured = line[0] == 'T', given = line[0] == 'Q';

    if (given)
        p->u[i].value = strtod(line + 2, NULL);
    p->commanded += given;
    p->asked += measured && i == 0;
    if (measured || given)
        snprintf(reply, 200, "%.2f\r\n", measured ? p->y[i].value : p->u[i].value);
    else
        snprintf(reply, 200, "TCLab of the test\r\n");
    if (line[0] == 'V' || p->behaviour == PROPER || p->behaviour == LATE)
        return true;
    if (p->behaviour == MANY)
        snprintf(reply + strlen(reply), 200 - strlen(reply), "77.00\r\n");
    else if (p->behaviour != CLOSES)
        snprintf(reply, 200, "%s", instead[p->behaviour]);
    return p->behaviour != CLOSES;
}

static void hear_line(struct plant *p, const char *line)
{
    char reply[200];

    pthread_mutex_lock(&p->mutex);
    const bool late = p->behaviour == LATE && line[0] != 'V', stays = answer_line(p, line, reply);
    pthread_mutex_unlock(&p->mutex);
    while (late && sem_wait(&p->released) < 0)
        ;
    if (stays) {
        assert_int_equal(write(p->board.port, reply, strlen(reply)), strlen(reply));
        return;
    }
    close(p->board.kept);
    close(p->board.port);
    plug_in(p);
}

static void *be_board(void *arg)
{
    struct plant *p = arg;
    char bytes[1000], *end;
    size_t have = 0;

    for (;;) {
        struct pollfd wait[2] = {{.fd = p->board.wake[0], .events = POLLIN},
                                 {.fd = p->board.port, .events = POLLIN}};
        if (poll(wait, 2, -1) < 0 || wait[0].revents)
            return NULL;
        const ssize_t n = read(p->board.port, bytes + have, sizeof(bytes) - have);
        have += n > 0 ? (size_t)n : 0;
        while ((end = memchr(bytes, '\n', have))) {
            *end = '\0';
            hear_line(p, bytes);
            have -= (size_t)(end + 1 - bytes);
            memmove(bytes, end + 1, have);
        }
    }
}

static void serial_open(struct plant *p)
{
    char uri[64];
    int fd;

    snprintf(p->board.link, sizeof(p->board.link), "/tmp/apc-board-XXXXXX");
    fd = mkstemp(p->board.link); /* a name that nobody else has */
    assert_true(fd >= 0);
    close(fd);
    plug_in(p);
    assert_int_equal(pipe(p->board.wake), 0);
    assert_int_equal(pthread_create(&p->board.thread, NULL, be_board, p), 0);
    snprintf(uri, sizeof(uri), "serial:%s", p->board.link);
    open_exchange(p, uri, NULL, NULL);
}

static void serial_close(struct plant *p)
{
    assert_int_equal(write(p->board.wake[1], "", 1), 1);
    pthread_join(p->board.thread, NULL);
    close(p->board.wake[0]);
    close(p->board.wake[1]);
    close(p->board.port);
    close(p->board.kept);
    unlink(p->board.link);
}

/* A port that was lost is looked for once a second: until then it is. */
static int serial_exchange(struct plant *p, const struct apc_value *u, apc_ns patience, struct apc_value *y)
{
    const apc_ns until = apc_clock_mono(NULL) + patience;
    int rc;

    while ((rc = waiting_exchange(p, u, patience, y)) == APC_ECONN &&
           strstr(apc_exchange_error(p->x), "once a second") && apc_clock_mono(NULL) < until)
        (void)poll(NULL, 0, 10);
    return rc;
}

static struct scheme schemes[] = {
    {"tcp:", tcp_open, waiting_exchange, tcp_close, NULL, false, false, 0.0},
#ifdef APC_TLS
    {"tls:", tls_open, waiting_exchange, tls_close, NULL, false, false, 0.0},
#endif
    {"inproc:", inproc_open, inproc_exchange, inproc_close, NULL, false, false, 0.0},
    {"modbus:", modbus_open, waiting_exchange, modbus_close, modbus_look, true, false, -1.0},
    {"serial:", serial_open, serial_exchange, serial_close, NULL, true, true, 6.0}};

/* ---- What both sides do --------------------------------------------------------------------- */

/* The plant's side and this one, of what is the same to both. */
static void look(struct plant *p)
{
    if (p->scheme->look)
        p->scheme->look(p);
}

static struct plant *make(const struct scheme *scheme, size_t nu, size_t ny)
{
    struct plant *p = calloc(1, sizeof(*p));

    assert_non_null(p);
    p->scheme = scheme;
    p->nu = nu;
    p->ny = ny;
    p->u = calloc(nu, sizeof(*p->u));
    p->y = calloc(ny, sizeof(*p->y));
    p->samples = calloc((nu > ny ? nu : ny) + 1, sizeof(*p->samples));
    for (size_t i = 0; i < ny; i++)
        p->y[i] = (struct apc_value){.value = scheme->coarse ? 20.25 + (double)i : 1.0 / (double)(i + 3),
                                     .time = T0};
    pthread_mutex_init(&p->mutex, NULL);
    sem_init(&p->released, 0, 0);
    scheme->open(p);
    look(p);
    return p;
}

static void unmake(struct plant *p)
{
    apc_exchange_close(p->x);
    sem_post(&p->released);
    p->scheme->close(p);
    sem_destroy(&p->released);
    pthread_mutex_destroy(&p->mutex);
    free(p->u);
    free(p->y);
    free(p->samples);
    free(p);
}

/* What the plant has been given. */
static struct apc_value given(struct plant *p, size_t i)
{
    pthread_mutex_lock(&p->mutex);
    look(p);
    const struct apc_value value = p->u[i];
    pthread_mutex_unlock(&p->mutex);
    return value;
}

static unsigned commanded(struct plant *p)
{
    pthread_mutex_lock(&p->mutex);
    look(p);
    const unsigned n = p->commanded;
    pthread_mutex_unlock(&p->mutex);
    return n;
}

static unsigned asked(struct plant *p)
{
    pthread_mutex_lock(&p->mutex);
    look(p);
    const unsigned n = p->asked;
    pthread_mutex_unlock(&p->mutex);
    return n;
}

static void behave(struct plant *p, enum behaviour behaviour)
{
    pthread_mutex_lock(&p->mutex);
    p->behaviour = behaviour;
    look(p);
    pthread_mutex_unlock(&p->mutex);
}

static void show(struct plant *p, double value)
{
    pthread_mutex_lock(&p->mutex);
    p->y[0].value = value;
    look(p);
    pthread_mutex_unlock(&p->mutex);
}

/* What stood in y was meant to be this. */
static void assert_came(struct plant *p, const struct apc_value *y)
{
    for (size_t i = 0; i < p->ny; i++)
        assert_near(y[i].value, p->y[i].value, 0.0);
}

/* A failed exchange: nothing of y is to be believed, and it is said why. */
static void assert_nothing_came(struct plant *p, int rc, int expected, const struct apc_value *y)
{
    assert_int_equal(rc, expected);
    for (size_t i = 0; i < p->ny && p->begun; i++)
        assert_int_equal(y[i].status, APC_BAD_NO_COMMUNICATION);
    assert_true(strlen(apc_exchange_error(p->x)) > 0);
}

static int set_up(void **state)
{
    const struct scheme *scheme = *state;
    *state = make(scheme, 2, scheme->coarse ? 2 : 3);
    return 0;
}

static int tear_down(void **state)
{
    unmake(*state);
    return 0;
}

/* ---- What must hold ------------------------------------------------------------------------- */

static void what_is_given_arrives_and_what_is_there_is_answered(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.5, APC_GOOD, T0 + 1000},
                                  {p->scheme->coarse ? 2.5 : -2.5, APC_UNCERTAIN_SUBSTITUTE, T0 + 2000}};
    struct apc_value y[3];

    if (!p->scheme->coarse) {
        p->y[0] = (struct apc_value){1.0 / 3.0, APC_GOOD, T0 + 3000};
        p->y[1] = (struct apc_value){-1e-300, APC_UNCERTAIN_LAST_USABLE, T0 - 3600 * APC_NS_PER_S};
        p->y[2] = (struct apc_value){7.0, APC_BAD_SENSOR_FAILURE, T0};
    }
    look(p);
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    assert_string_equal(apc_exchange_error(p->x), "");
    for (size_t i = 0; i < 2; i++)
        assert_near(given(p, i).value, u[i].value, 0.0);
    assert_came(p, y);
    for (size_t i = 0; i < p->ny && p->scheme->bare; i++) {
        assert_int_equal(y[i].status, APC_GOOD);
        assert_true(apc_clock_utc(NULL) - y[i].time < PATIENCE); /* when it came */
    }
    for (size_t i = 0; i < 2 && !p->scheme->bare; i++) {
        assert_int_equal(given(p, i).status, u[i].status);
        assert_int_equal(given(p, i).time, u[i].time);
    }
    for (size_t i = 0; i < 3 && !p->scheme->bare; i++) {
        assert_int_equal(y[i].status, p->y[i].status);
        assert_int_equal(y[i].time, p->y[i].time);
    }
}

static void who_only_asks_writes_nothing(void **state)
{
    struct plant *p = *state;
    struct apc_value y[3];

    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_came(p, y);
    assert_int_equal(commanded(p), 0);
}

/*
 * Promise(links/whatever-scheme-plant): Whatever the scheme, a plant is given only what is fresh, Good or
 *   Uncertain, and finite; a reply that is late, another's, or no reply is none.
 */
static void what_is_bad_or_not_finite_is_not_written(void **state)
{
    struct plant *p = *state;
    const struct apc_value bad[] = {{1.0, APC_BAD_NO_DATA, T0},
                                    {1.0, APC_BAD_OUT_OF_SERVICE, T0},
                                    {(double)NAN, APC_GOOD, T0},
                                    {(double)INFINITY, APC_GOOD, T0},
                                    {-1e301, APC_GOOD, T0}};
    struct apc_value y[3];

    for (size_t i = 0; i < 2 * sizeof(bad) / sizeof(bad[0]); i++) {
        struct apc_value u[] = {{2.0, APC_GOOD, T0}, {3.0, APC_GOOD, T0}};

        u[i % 2] = bad[i / 2];
        assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0); /* y comes all the same */
        assert_came(p, y);
        assert_near(given(p, i % 2).value, 0.0, 0.0);
        if (p->scheme->bare)
            assert_near(given(p, 1 - i % 2).value, 2.0 + (double)(1 - i % 2), 0.0); /* the other is */
        else
            assert_int_equal(commanded(p), 0); /* behind frames a vector goes whole or not at all */
        if (p->scheme->coarse) {
            pthread_mutex_lock(&p->mutex);
            memset(p->u, 0, p->nu * sizeof(*p->u));
            pthread_mutex_unlock(&p->mutex);
        } else if (p->peer) {
            pthread_mutex_lock(&p->peer->mutex);
            memset(p->peer->holding, 0, sizeof(p->peer->holding));
            pthread_mutex_unlock(&p->peer->mutex);
        }
    }
}

/* Promise(links/whatever-scheme-plant) */
static void a_reply_that_is_late_is_none_and_never_the_next_ones(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.0, APC_GOOD, T0}, {1.0, APC_GOOD, T0}};
    struct apc_value y[3];

    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    behave(p, LATE);
    show(p, 5.0);
    assert_nothing_came(p, p->scheme->exchange(p, u, SHORT, y), APC_ETIMEDOUT, y);
    behave(p, PROPER);
    show(p, 6.0);
    sem_post(p->peer ? &p->peer->released : &p->released); /* now it comes */
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_near(y[0].value, 6.0, 0.0);
    assert_string_equal(apc_exchange_error(p->x), "");
}

/* Promise(links/whatever-scheme-plant) */
static void what_does_not_answer_is_refused_and_the_next_exchange_is_another(void **state)
{
    static const struct {
        enum behaviour behaviour;
        int rc;
    } cases[] = {{GARBAGE, APC_EPROTO},  {FEW, APC_EPROTO},        {MANY, APC_EPROTO},
                 {ANOTHERS, APC_EPROTO}, {NOT_VALUES, APC_EPROTO}, {CLOSES, APC_ECONN}};
    struct plant *p = *state;
    struct apc_value y[3];

    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        behave(p, cases[i].behaviour);
        memset(y, 0, sizeof(y));
        assert_nothing_came(p, p->scheme->exchange(p, NULL, PATIENCE, y), cases[i].rc, y);
        behave(p, PROPER);
        assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
        assert_came(p, y);
    }
}

/* By frames alone. */
/* Promise(links/opcua-at-rest) */
static void a_plant_can_say_that_it_has_not_taken_a_command_and_is_read_all_the_same(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.0, APC_GOOD, T0}, {1.0, APC_GOOD, T0}};
    struct apc_value y[3];

    if (p->scheme->bare || p->scheme->coarse)
        return;
    behave(p, UNNUMBERED); /* as the paper's peer */
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    assert_true(apc_exchange_taken(p->x));
    behave(p, PROPER);
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    assert_true(apc_exchange_taken(p->x));
    behave(p, UNNUMBERED);
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    assert_came(p, y);
    assert_false(apc_exchange_taken(p->x));
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_true(apc_exchange_taken(p->x));
}

/* Promise(links/whatever-scheme-plant) */
static void what_went_wrong_is_not_written_again(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.0, APC_GOOD, T0}, {1.0, APC_GOOD, T0}};
    struct apc_value y[3];

    behave(p, CLOSES);
    assert_nothing_came(p, p->scheme->exchange(p, u, PATIENCE, y), APC_ECONN, y);
    assert_int_equal(commanded(p), 1);
    behave(p, PROPER);
    for (int i = 0; i < 3; i++)
        assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_int_equal(commanded(p), 1);
}

/* Who slept with a command in his hand, until the tick that it belonged to was over. */
/* Promise(modes/client-slept-took) */
static void what_is_too_late_to_go_out_never_does(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.0, APC_GOOD, T0}, {1.0, APC_GOOD, T0}};
    struct apc_value y[3];

    if (p->executive) /* nobody sleeps in virtual time */
        return;
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_int_equal(apc_exchange_begin(p->x, u, apc_clock_mono(NULL)), APC_ETIMEDOUT);
    assert_true(strlen(apc_exchange_error(p->x)) > 0);
    for (int i = 0; i < 3; i++)
        assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_int_equal(commanded(p), 0);
}

static uint64_t last_id(struct plant *p)
{
    pthread_mutex_lock(&p->mutex);
    const uint64_t id = p->id;
    pthread_mutex_unlock(&p->mutex);
    return id;
}

/* Promise(modes/client-slept-took) */
static void requests_are_numbered_by_the_claim_where_they_have_numbers(void **state)
{
    struct plant *p = *state;
    const uint64_t claim = UINT64_C(1700000000000000);
    struct apc_value y[3];

    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_true(last_id(p) < APC_FRAME_CLAIMED);
    apc_exchange_claim(p->x, claim);
    apc_exchange_claim(p->x, claim - 1); /* it is the newest that counts */
    apc_exchange_claim(p->x, 0);
    for (int i = 0; i < 3; i++) {
        const uint64_t before = last_id(p);
        assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
        if (p->server) {
            assert_true(last_id(p) / APC_FRAME_PER_CLAIM == claim && last_id(p) != before);
        }
    }
    apc_exchange_claim(p->x, claim + 7);
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_true(!p->server || last_id(p) / APC_FRAME_PER_CLAIM == claim + 7);
}

static void there_is_one_exchange_at_a_time(void **state)
{
    struct plant *p = *state;
    struct apc_value y[3];
    const apc_ns far = apc_clock_mono(p->executive ? apc_executive_clock(p->executive) : NULL) + PATIENCE;

    assert_int_equal(apc_exchange_finish(p->x, y), APC_EINVAL);
    assert_int_equal(apc_exchange_begin(p->x, NULL, far), 0);
    assert_int_equal(apc_exchange_begin(p->x, NULL, far), APC_EBUSY);
    if (p->executive)
        assert_true(apc_virtual_run(p->executive, far) > 0);
    assert_int_equal(apc_exchange_finish(p->x, y), 0);
    assert_int_equal(apc_exchange_finish(p->x, y), APC_EINVAL);
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_int_equal(asked(p), 2);
}

static void as_many_values_go_as_may_be(void **state)
{
    static struct apc_value u[APC_EXCHANGE_VALUES], y[APC_EXCHANGE_VALUES];
    const struct scheme *scheme = *state;
    const size_t most = scheme->coarse ? 2 : APC_EXCHANGE_VALUES;
    struct plant *p = make(scheme, most, most);

    for (size_t i = 0; i < most; i++) { /* the longest that there are */
        u[i] = (struct apc_value){-1.2345678901234567e-300 - 1e-308 * (double)i, 0x40DEADBE,
                                  T0 + 1000 * (apc_ns)i};
        if (scheme->coarse)
            u[i].value = 99.99 - 99.99 * (double)i;
    }
    pthread_mutex_lock(&p->mutex);
    memcpy(p->y, u, most * sizeof(*u));
    pthread_mutex_unlock(&p->mutex);
    look(p);
    for (int k = 0; k < 2; k++) {
        assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
        look(p); /* nothing is under way */
        for (size_t i = 0; i < most; i++) {
            assert_memory_equal(&p->u[i].value, &u[i].value, sizeof(double)); /* bit for bit */
            assert_memory_equal(&y[i].value, &u[i].value, sizeof(double));
            if (p->scheme->bare)
                continue;
            assert_int_equal(p->u[i].time, u[i].time);
            assert_int_equal(y[i].time, u[i].time);
            assert_int_equal(y[i].status, u[i].status);
        }
    }
    unmake(p);
}

static void leave(struct plant *p, const bool *spared)
{
    assert_int_equal(apc_exchange_safe(p->x, spared, apc_clock_mono(NULL) + PATIENCE), 0);
}

/* Of what it has commanded, and of that what is not spared. */
/*
 * Promise(links/client-looked-leaves): A client that only looked leaves no safe values behind, nor does it
 *   in what is out of service.
 * Promise(links/plant-behind-modbus)
 */
static void who_leaves_gives_safe_values_where_the_plant_does_not_watch_him(void **state)
{
    static const bool second[] = {false, true};
    struct plant *p = *state;
    const struct apc_value u[] = {{20.0, APC_GOOD, T0}, {30.0, APC_GOOD, T0}};
    struct apc_value y[3];

    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    leave(p, NULL);
    assert_int_equal(commanded(p), 0); /* who only looked */
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), 0);
    const unsigned before = commanded(p);
    leave(p, second);
    assert_near(given(p, 0).value, p->scheme->bare ? p->scheme->safe : 20.0, 0.0);
    assert_near(given(p, 1).value, 30.0, 0.0);
    leave(p, NULL);
    assert_near(given(p, 1).value, p->scheme->bare ? p->scheme->safe - 1.0 : 30.0, 0.0);
    assert_true(p->scheme->bare ? commanded(p) > before : commanded(p) == before);
}

/* ---- Of none in particular ------------------------------------------------------------------ */

static void what_makes_no_sense_is_refused(void **state)
{
    static const struct {
        const char *uri;
        size_t nu, ny;
        const char *why;
    } cases[] = {{"tcp:127.0.0.1:80", 0, 1, "nu is 0, ny is 1"},
                 {"tcp:127.0.0.1:80", 1, 8193, "nu is 1, ny is 8193"},
                 {"tcp:127.0.0.1:80", 8193, 1, "must be 1 to 8192"},
                 {"tcp:127.0.0.1:80", 1, 0, "ny is 0"},
                 {"tcp:127.0.0.1:0", 1, 1, "port must be 1..65535"},
                 {"tcp:127.0.0.1", 1, 1, "tcp:"},
                 {"udp:127.0.0.1:80", 1, 1, "plant \"udp:127.0.0.1:80\": unknown scheme"},
                 {"", 1, 1, "unknown scheme"},
                 {NULL, 1, 1, "unknown scheme"},
                 {"tls:127.0.0.1:80", 1, 1, "needs an identity"},
                 {"modbus:127.0.0.1:80", 1, 1, "u and y are required"},
                 {"inproc:", 1, 1, "required"}};
    struct apc_exchange_options o = {.size = sizeof(o)};
    struct apc_exchange *x;
    struct apc_error why;

    (void)state;
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        o.nu = cases[i].nu;
        o.ny = cases[i].ny;
        assert_int_equal(apc_exchange_open(&x, cases[i].uri, &o, &why), APC_EINVAL);
        assert_null(x);
        if (!strstr(why.text, cases[i].why))
            fail_msg("\"%s\" says nothing of \"%s\"", why.text, cases[i].why);
    }
    assert_int_equal(apc_exchange_open(&x, "tcp:127.0.0.1:80", NULL, &why), APC_EINVAL);
    assert_int_equal(apc_exchange_open(NULL, "tcp:127.0.0.1:80", &o, &why), APC_EINVAL);
    o.ny = 1;
    assert_int_equal(apc_exchange_open(&x, "tcp:127.0.0.1:80", &o, &why), 0);
    struct apc_inproc_stats stats = {.size = sizeof stats, .exchanges = 1};
    apc_inproc_stats(x, &stats);
    assert_int_equal(stats.exchanges, 0);
    apc_exchange_close(x);
    apc_exchange_close(NULL);
}

/* A time that no frame can say. */
static void what_frames_cannot_say_is_not_written(void **state)
{
    struct plant *p = *state;
    const struct apc_value u[] = {{1.0, APC_GOOD, INT64_MIN}, {1.0, APC_GOOD, T0}};
    struct apc_value y[3];

    if (p->scheme->bare)
        return;
    assert_int_equal(p->scheme->exchange(p, u, PATIENCE, y), APC_EINVAL);
    assert_non_null(strstr(apc_exchange_error(p->x), "1678"));
    assert_int_equal(p->scheme->exchange(p, NULL, PATIENCE, y), 0);
    assert_int_equal(p->asked, 1);
}

#define EACH(test, up, down)                                                                                 \
    {                                                                                                        \
#test, test, up, down                                                                                \
    }

int main(void)
{
    static const struct {
        const char *name;
        CMUnitTestFunction test;
        CMFixtureFunction up, down;
    } each[] = {
        EACH(what_is_given_arrives_and_what_is_there_is_answered, set_up, tear_down),
        EACH(who_only_asks_writes_nothing, set_up, tear_down),
        EACH(what_is_bad_or_not_finite_is_not_written, set_up, tear_down),
        EACH(a_reply_that_is_late_is_none_and_never_the_next_ones, set_up, tear_down),
        EACH(what_does_not_answer_is_refused_and_the_next_exchange_is_another, set_up, tear_down),
        EACH(a_plant_can_say_that_it_has_not_taken_a_command_and_is_read_all_the_same, set_up, tear_down),
        EACH(what_went_wrong_is_not_written_again, set_up, tear_down),
        EACH(what_is_too_late_to_go_out_never_does, set_up, tear_down),
        EACH(requests_are_numbered_by_the_claim_where_they_have_numbers, set_up, tear_down),
        EACH(there_is_one_exchange_at_a_time, set_up, tear_down),
        EACH(as_many_values_go_as_may_be, NULL, NULL),
        EACH(who_leaves_gives_safe_values_where_the_plant_does_not_watch_him, set_up, tear_down),
        EACH(what_frames_cannot_say_is_not_written, set_up, tear_down),
    };
    enum { EACHES = sizeof(each) / sizeof(each[0]), SCHEMES = sizeof(schemes) / sizeof(schemes[0]) };
    static char names[SCHEMES * EACHES][100];
    struct CMUnitTest tests[SCHEMES * EACHES + 1] = {cmocka_unit_test(what_makes_no_sense_is_refused)};

    for (size_t i = 0; i < SCHEMES * EACHES; i++) {
        snprintf(names[i], sizeof(names[i]), "%s %s", schemes[i / EACHES].name, each[i % EACHES].name);
        tests[i + 1] = (struct CMUnitTest){names[i], each[i % EACHES].test, each[i % EACHES].up,
                                           each[i % EACHES].down, &schemes[i / EACHES]};
    }
    return cmocka_run_group_tests(tests, NULL, remove_certificates);
}
