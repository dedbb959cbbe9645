/* SPDX-License-Identifier: BSD-3-Clause */
/* A database with a user of each role. */
#ifndef APC_TEST_ROLES_RIG_H
#define APC_TEST_ROLES_RIG_H

#include <stdio.h>
#include <string.h>

#include "apcshareddata.h"
#include "check.h"
#include "cluster.h"

static struct cluster *cluster;

/* Users are the whole server's, which other tests may share: this program's have its number in them. */
static void user_name(char name[64], const char *role)
{
    snprintf(name, 64, "u_%s_%s", role, cluster_database(cluster));
}

static const char *const roles[] = {"plant",     "client",   "controller", "scheduler", "alarms",
                                    "historian", "operator", "engineer",   "observer",  "nobody"};

/* The tables belong to a role that is no superuser, as docker-compose.yml and a hosted PostgreSQL have it. */
static int set_up(void **state)
{
    (void)state;
    char owner[64], own[300];
    user_name(owner, "owner");
    snprintf(own, sizeof own, "CREATE ROLE %s; CREATE SCHEMA apc AUTHORIZATION %s", owner, owner);
    cluster_query(cluster, own);
    struct apc_store *store = NULL;
    int err = apc_store_open(&store, cluster_uri(cluster), NULL, NULL);
    err = err ? err : apc_store_init(store);
    apc_store_close(store);
    cluster_query(cluster, "SET search_path TO apc");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql");
    cluster_query_file(cluster, APC_SQL_DIR "/roles.sql"); /* harmless to repeat */
    snprintf(own, sizeof own, "CREATE TABLE loot (who name); ALTER TABLE loot OWNER TO %s", owner);
    cluster_query(cluster, own);
    for (size_t i = 0; i < sizeof roles / sizeof roles[0]; i++) {
        char name[64], create[200];
        user_name(name, roles[i]);
        snprintf(create, sizeof create, "CREATE USER %s", name);
        cluster_query(cluster, create);
        if (strcmp(roles[i], "nobody") != 0) {
            snprintf(create, sizeof create, "GRANT apc_%s TO %s", roles[i], name);
            cluster_query(cluster, create);
        }
    }
    return err != 0;
}

static int tear_down(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof roles / sizeof roles[0]; i++) {
        char name[64], drop[200];
        user_name(name, roles[i]);
        snprintf(drop, sizeof drop, "DROP OWNED BY %s; DROP USER %s", name, name);
        cluster_query(cluster, drop);
    }
    char owner[64], drop[200];
    user_name(owner, "owner");
    snprintf(drop, sizeof drop, "DROP SCHEMA apc CASCADE; DROP OWNED BY %s; DROP ROLE %s", owner, owner);
    cluster_query(cluster, drop);
    return 0;
}

static struct apc_store *open_as(const char *role)
{
    char name[64], uri[600];
    user_name(name, role);
    snprintf(uri, sizeof uri, "postgresql://%s@/%s?host=%s", name, cluster_database(cluster),
             cluster_host(cluster));
    struct apc_store *store = NULL;
    struct apc_store_options options = {.size = sizeof options, .name = role, .timeout = 30 * APC_NS_PER_S};
    assert_int_equal(apc_store_open(&store, uri, &options, NULL), 0);
    return store;
}

static PGconn *connect_as(const char *role)
{
    char name[64];
    user_name(name, role);
    const char *const keywords[] = {"host", "user", "dbname", NULL};
    const char *const values[] = {cluster_host(cluster), name, cluster_database(cluster), NULL};
    PGconn *conn = PQconnectdbParams(keywords, values, 0);
    assert_int_equal(PQstatus(conn), CONNECTION_OK);
    return conn;
}

/* The SQLSTATE, "" when it was done. */
static const char *attempt(PGconn *conn, const char *sql)
{
    static char state[6];
    PGresult *result = PQexec(conn, sql);
    const char *said = PQresultErrorField(result, PG_DIAG_SQLSTATE);
    snprintf(state, sizeof state, "%s", said ? said : "");
    PQclear(result);
    return state;
}

/*
 * In the order of enum apc_table: sensor actuator setpoint dim opmode tuning manual state, actual estimate
 * alarm tick plan prediction.
 */
static const char letters[] = "sapdotm?cerlnh"; /* there is no table state */
struct right {
    const char *role, *reads, *appends, *claims;
};
static const struct right rights[] = {
    {"plant", "d", "", ""},
    {"client", "ad", "s", "s"},
    {"controller", "sapdotmceln", "sapmcelnh", "sapmcelnh"},
    {"scheduler", "pdo", "pn", "pn"},
    {"alarms", "sapdotmcerl", "crl", "crl"},
    {"historian", "sapdotmcerlnh", "potml", "potml"},
    {"operator", "sapdotmcerlnh", "potm", ""},
    {"engineer", "sapdotmcerlnh", "potm", ""},
    {"observer", "sapdotmcerlnh", "", ""},
};
/* Of a store that is a history. */
static const struct right rights_of_history[] = {
    {"plant", "d", "", ""},
    {"client", "ad", "", ""},
    {"controller", "sapdotmceln", "", ""},
    {"scheduler", "pdo", "", ""},
    {"alarms", "sapdotmcerl", "", ""},
    {"historian", "sapdotmcerlnh", "sapdotmcerlnh", "sapdotmcerlnh"},
    {"operator", "sapdotmcerlnh", "", ""},
    {"engineer", "sapdotmcerlnh", "", ""},
    {"observer", "sapdotmcerlnh", "", ""},
};

#endif
