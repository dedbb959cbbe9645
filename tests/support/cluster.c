/* SPDX-License-Identifier: BSD-3-Clause */
#include "cluster.h"

#include <fcntl.h>
#include <ftw.h>
#include <glob.h>
#include <poll.h>
#include <pwd.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

struct cluster {
    char dir[96];  /* "": the server is shared */
    char bin[200]; /* of initdb and postgres */
    char host[200], socket[256], database[64], uri[512];
    pid_t server; /* 0: not running, or shared */
    PGconn *admin;
    char answer[256];
    struct cluster *next;
};

/* Those to remove at exit, by the process that made them. */
static struct cluster *clusters;
static pid_t owner;

static void die(const char *fmt, ...) __attribute__((noreturn, format(printf, 1, 2)));

static void die(const char *fmt, ...)
{
    va_list args;
    va_start(args, fmt);
    fputs("cluster: ", stderr);
    vfprintf(stderr, fmt, args);
    fputc('\n', stderr);
    va_end(args);
    exit(1);
}

/* Between two looks at a condition. */
static void breathe(void)
{
    poll(NULL, 0, 10);
}

#define LOOKS 2000 /* 20 s */

/* ---- Processes ---------------------------------------------------------------------------- */

/* PostgreSQL refuses to run as root. */
static void drop_root(void)
{
    if (geteuid() != 0) {
        return;
    }
    const struct passwd *user = getpwnam("postgres");
    if (!user || setgid(user->pw_gid) != 0 || setuid(user->pw_uid) != 0) {
        _exit(126);
    }
}

/* Runs a shell command in the cluster's directory. */
static pid_t spawn(const struct cluster *c, const char *command)
{
    pid_t parent = getpid(), pid = fork();
    if (pid < 0) {
        die("cannot fork");
    }
    if (pid > 0) {
        return pid;
    }
    drop_root();
    prctl(PR_SET_PDEATHSIG, SIGQUIT); /* does not outlive the test, however that ends */
    if (getppid() != parent || chdir(c->dir) != 0) {
        _exit(126);
    }
    int log = open("log", O_WRONLY | O_CREAT | O_APPEND, 0600);
    if (log < 0) {
        _exit(126);
    }
    dup2(log, STDOUT_FILENO);
    dup2(log, STDERR_FILENO);
    execl("/bin/sh", "sh", "-c", command, (char *)NULL);
    _exit(127);
}

static void print_log(const struct cluster *c)
{
    char path[256], line[512];
    snprintf(path, sizeof path, "%s/log", c->dir);
    FILE *log = fopen(path, "r");
    while (log && fgets(line, sizeof line, log)) {
        fputs(line, stderr);
    }
    if (log) {
        fclose(log);
    }
}

/* ---- A private server ---------------------------------------------------------------------- */

static void find_programs(struct cluster *c)
{
    glob_t found;
    if (glob("/usr/lib/postgresql/*/bin/initdb", 0, NULL, &found) != 0 || found.gl_pathc == 0) {
        fputs("no PostgreSQL server is installed: skipped\n", stderr);
        exit(77);
    }
    snprintf(c->bin, sizeof c->bin, "%s", found.gl_pathv[found.gl_pathc - 1]);
    *strrchr(c->bin, '/') = '\0';
    globfree(&found);
}

static void make_directory(struct cluster *c)
{
    const char *tmp = getenv("TMPDIR");
    if (!tmp || strlen(tmp) > 60) {
        tmp = "/tmp"; /* a socket's path has 107 bytes */
    }
    snprintf(c->dir, sizeof c->dir, "%s/apcXXXXXX", tmp);
    if (!mkdtemp(c->dir)) {
        die("cannot make a directory in %s", tmp);
    }
    const struct passwd *user = geteuid() == 0 ? getpwnam("postgres") : NULL;
    if (user && chown(c->dir, user->pw_uid, user->pw_gid) != 0) {
        die("cannot give %s to user postgres", c->dir);
    }
}

static void must_run(struct cluster *c, const char *command)
{
    int status = -1;
    if (waitpid(spawn(c, command), &status, 0) < 0 || status != 0) {
        print_log(c);
        die("failed: %s", command);
    }
}

static void init_database(struct cluster *c)
{
    char line[512];
    snprintf(line, sizeof line,
             "exec '%s/initdb' -D data -A trust -U apc --no-sync --encoding=UTF8 --locale=C", c->bin);
    must_run(c, line);
}

void cluster_run(struct cluster *c)
{
    /* After a kill -9 the old server's children may still hold its memory for a moment: try again. */
    for (int i = 0; i < LOOKS; i++) {
        if (c->server == 0) {
            char line[512];
            snprintf(
                line, sizeof line,
                "exec '%s/postgres' -D data -k '%s' -c listen_addresses= -c fsync=off -c max_connections=60",
                c->bin, c->dir);
            c->server = spawn(c, line);
        }
        char info[300];
        snprintf(info, sizeof info, "host=%s user=apc dbname=postgres", c->host);
        if (PQping(info) == PQPING_OK) {
            return;
        }
        if (waitpid(c->server, NULL, WNOHANG) == c->server) {
            c->server = 0;
        }
        breathe();
    }
    print_log(c);
    die("the server does not start");
}

static void end_server(struct cluster *c, int signal_number)
{
    PQfinish(c->admin);
    c->admin = NULL;
    if (c->server > 0) {
        kill(c->server, signal_number);
        waitpid(c->server, NULL, 0);
        c->server = 0;
    }
}

void cluster_stop(struct cluster *c)
{
    end_server(c, SIGINT);
}

/* All its processes: a session that outlived the postmaster for a moment would still answer. */
void cluster_kill(struct cluster *c)
{
    char pids[sizeof c->answer];
    snprintf(pids, sizeof pids, "%s",
             cluster_query(
                 c, "SELECT string_agg(pid::text, ' ') FROM pg_stat_activity WHERE pid <> pg_backend_pid()"));
    kill(c->server, SIGSTOP); /* or it would see a child die and end the others in order */
    char *rest = NULL;
    for (char *word = strtok_r(pids, " ", &rest); word; word = strtok_r(NULL, " ", &rest)) {
        long pid = strtol(word, NULL, 10);
        if (pid > 1) /* an answer that is no number must not end this very group */
            kill((pid_t)pid, SIGKILL);
    }
    end_server(c, SIGKILL);
}

static int remove_one(const char *path, const struct stat *st, int flag, struct FTW *ftw)
{
    (void)st;
    (void)flag;
    (void)ftw;
    return remove(path);
}

/* ---- Life ---------------------------------------------------------------------------------- */

static void clean_up(void)
{
    if (getpid() == owner) {
        while (clusters) {
            cluster_destroy(clusters);
        }
    }
}

static struct cluster *new_cluster(void)
{
    struct cluster *c = calloc(1, sizeof *c);
    if (!c) {
        die("out of memory");
    }
    if (!owner) {
        owner = getpid();
        atexit(clean_up);
    }
    c->next = clusters;
    clusters = c;
    return c;
}

static void make_database(struct cluster *c)
{
    unsigned number = 0;
    for (const struct cluster *other = c->next; other; other = other->next) {
        number++;
    }
    snprintf(c->socket, sizeof c->socket, "%s/.s.PGSQL.5432", c->host);
    snprintf(c->database, sizeof c->database, "postgres");
    char name[64], sql[128];
    snprintf(name, sizeof name, "apc_test_%ld_%u", (long)getpid(), number);
    snprintf(sql, sizeof sql, "CREATE DATABASE %s TEMPLATE template0", name);
    cluster_query(c, sql);
    PQfinish(c->admin);
    c->admin = NULL;
    memcpy(c->database, name, sizeof name);
    snprintf(c->uri, sizeof c->uri, "postgresql://apc@/%s?host=%s", c->database, c->host);
}

struct cluster *cluster_start_private(void)
{
    struct cluster *c = new_cluster();
    find_programs(c);
    make_directory(c);
    snprintf(c->host, sizeof c->host, "%s", c->dir);
    init_database(c);
    cluster_run(c);
    make_database(c);
    return c;
}

struct cluster *cluster_start_standby(const struct cluster *primary)
{
    struct cluster *c = new_cluster();
    find_programs(c);
    make_directory(c);
    snprintf(c->host, sizeof c->host, "%s", c->dir);
    snprintf(c->socket, sizeof c->socket, "%s/.s.PGSQL.5432", c->host);
    snprintf(c->database, sizeof c->database, "%s", primary->database);
    snprintf(c->uri, sizeof c->uri, "postgresql://apc@/%s?host=%s", c->database, c->host);
    char line[512];
    snprintf(line, sizeof line, "exec '%s/pg_basebackup' -h '%s' -U apc -D data -R -c fast --no-sync", c->bin,
             primary->host);
    must_run(c, line);
    cluster_run(c);
    return c;
}

struct cluster *cluster_start(void)
{
    const char *host = getenv("APC_TEST_PGHOST");
    if (!host || !host[0]) {
        return cluster_start_private();
    }
    struct cluster *c = new_cluster();
    snprintf(c->host, sizeof c->host, "%s", host);
    make_database(c);
    return c;
}

void cluster_destroy(struct cluster *c)
{
    if (!c) {
        return;
    }
    for (struct cluster **at = &clusters; *at; at = &(*at)->next) {
        if (*at == c) {
            *at = c->next;
            break;
        }
    }
    if (c->dir[0]) {
        end_server(c, SIGQUIT);
        nftw(c->dir, remove_one, 16, FTW_DEPTH | FTW_PHYS);
    } else {
        char sql[128];
        snprintf(sql, sizeof sql, "DROP DATABASE IF EXISTS %s WITH (FORCE)", c->database);
        PQfinish(c->admin);
        c->admin = NULL;
        memcpy(c->database, "postgres", sizeof "postgres");
        cluster_query(c, sql);
        PQfinish(c->admin);
    }
    free(c);
}

const char *cluster_uri(const struct cluster *c)
{
    return c->uri;
}

const char *cluster_host(const struct cluster *c)
{
    return c->host;
}

const char *cluster_socket(const struct cluster *c)
{
    return c->socket;
}

const char *cluster_database(const struct cluster *c)
{
    return c->database;
}

/* ---- Questions ----------------------------------------------------------------------------- */

static void no_notice(void *ctx, const PGresult *result)
{
    (void)ctx;
    (void)result;
}

PGconn *cluster_connect(const struct cluster *c)
{
    const char *const keywords[] = {"host", "user", "dbname", NULL};
    const char *const values[] = {c->host, "apc", c->database, NULL};
    PGconn *conn = PQconnectdbParams(keywords, values, 0);
    if (PQstatus(conn) != CONNECTION_OK) {
        die("%s", PQerrorMessage(conn));
    }
    PQsetNoticeReceiver(conn, no_notice, NULL);
    return conn;
}

const char *cluster_query(struct cluster *c, const char *sql)
{
    if (!c->admin) {
        c->admin = cluster_connect(c);
    }
    PGresult *result = PQexec(c->admin, sql);
    if (PQresultStatus(result) != PGRES_COMMAND_OK && PQresultStatus(result) != PGRES_TUPLES_OK) {
        die("%s\n%s", sql, PQerrorMessage(c->admin));
    }
    bool any = PQntuples(result) > 0 && PQnfields(result) > 0;
    snprintf(c->answer, sizeof c->answer, "%s", any ? PQgetvalue(result, 0, 0) : "");
    PQclear(result);
    return c->answer;
}

void cluster_query_file(struct cluster *c, const char *path)
{
    FILE *file = fopen(path, "r");
    char *text = calloc(1, 1 << 16);
    if (!file || !text || fread(text, 1, (1 << 16) - 1, file) == 0 || !feof(file)) {
        die("cannot read %s", path);
    }
    fclose(file);
    cluster_query(c, text);
    free(text);
}

/* Commits wait once the checkpointer has read the settings anew, which it does before a checkpoint begins;
 * the first one may have begun already. */
bool cluster_need_standby(struct cluster *c, const char *name)
{
    char sql[100];
    snprintf(sql, sizeof sql, "ALTER SYSTEM SET synchronous_standby_names = '%s'", name);
    cluster_query(c, sql);
    cluster_query(c, "SELECT pg_reload_conf()");
    const bool read = cluster_await(c, "SHOW synchronous_standby_names", name);
    cluster_query(c, "CHECKPOINT");
    cluster_query(c, "CHECKPOINT");
    return read;
}

bool cluster_await(struct cluster *c, const char *sql, const char *expected)
{
    for (int i = 0; i < LOOKS; i++) {
        if (strcmp(cluster_query(c, sql), expected) == 0) {
            return true;
        }
        breathe();
    }
    return false;
}
