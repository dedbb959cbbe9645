# SPDX-License-Identifier: BSD-3-Clause
"""postgres_history.py ROWS: a history of so many rows in a new schema of libpq's database is the same, bit for bit, by apc as by
psycopg, which nobody here wrote. It prints how long each took."""
import os
import sys
from time import monotonic, process_time

import numpy as np
import psycopg

import libapc as apc

TEXT = """
name = "loop"; duration = 60.0;
measurements = ( { name = "y"; unit = "V"; } );
setpoints = ( { name = "r"; unit = "V"; } );
outputs = ( { name = "u"; unit = "V"; } );
plant = { model = "first-order"; period = 0.2; };
client = { period = 0.5; };
controller = { law = "pi"; period = 2.0; };
"""

rows, schema = int(float(sys.argv[1])), f"history_{os.getpid()}"
with psycopg.connect("") as db, apc.Store(f"postgresql:#{schema}", timeout=600.0) as store, apc.Experiment("here.conf", TEXT) as e:
    store.init()
    e.provision(store)
    db.execute(f"SET search_path TO {schema}")
    db.execute("""INSERT INTO sensor (id, seq, time, status, value)
                  SELECT 1, i, now() - (%(rows)s - i) * interval '1 millisecond', CASE WHEN i %% 97 = 0 THEN 2147483648 ELSE 0 END,
                         (random() - 0.5) * 10.0 ^ (random() * 40 - 20) FROM generate_series(1, %(rows)s) AS i""", {"rows": rows})
    db.commit()
    begin, cpu = monotonic(), process_time()
    y = store.history("y")
    print(f"apc: {monotonic() - begin:.3f} s, {process_time() - cpu:.3f} s of CPU")
    begin, cpu, at = monotonic(), process_time(), 0
    with db.cursor("theirs", binary=True) as theirs:
        theirs.itersize = 100_000
        theirs.execute("""SELECT seq, (extract(epoch FROM time) * 1000000)::bigint, status, value FROM sensor
                          WHERE id = 1 ORDER BY seq""")
        while part := theirs.fetchmany(100_000):
            seq, time, status, value = (np.array(column) for column in zip(*part))
            here = slice(at, at + len(part))
            assert (y.seq[here] == seq).all() and (y.time[here].astype("i8") == time * 1000).all(), at
            assert (y.status[here] == status).all() and (y.value[here].view("i8") == value.view("i8")).all(), at
            at += len(part)
    print(f"psycopg: {monotonic() - begin:.3f} s, {process_time() - cpu:.3f} s of CPU")
    assert at == len(y.seq) == rows, (at, len(y.seq))
    db.execute(f"DROP SCHEMA {schema} CASCADE")
print(f"{rows} rows are the same")
