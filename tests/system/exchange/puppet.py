# SPDX-License-Identifier: BSD-3-Clause
"""A plant of one measurement that gives whatever the moment asks for: puppet.py LINK HABIT_FILE, LINK tcp:PORT,
modbus:PORT, gateway:PORT (Modbus: only unit 2 has the habit), opcua:PORT (with the package asyncua; ns=2;s=y, ns=2;s=u) or serial:PATH, a pseudo-terminal of that name.

The habit is read with each request. "well" is a value that moves a little around 10, of now.
"""

import datetime
import math
import os
import pty
import socket
import struct
import sys
import threading
import time
import tty

link, habit_file = sys.argv[1:3]
lock, count, kept = threading.Lock(), 0, None


def habit():
    with open(habit_file) as f:
        return f.read().strip()


def moved():
    global count
    count += 1
    return 10 + 0.01 * math.sin(count)


def stamp(s):
    return datetime.datetime.fromtimestamp(s, datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def measured(now):
    """Time, status and value of habit @p now."""
    global kept
    t, status, value = time.time(), "Good", round(moved(), 6)
    t += {"ahead": 3600, "behind": -3600, "1970": 100 - t}.get(now, 0)
    if now in ("beyond", "nan", "inf", "rest"):
        value = {"beyond": 180.0, "nan": math.nan, "inf": math.inf, "rest": 10.0}[now]
    elif now in ("Bad", "Uncertain"):
        status = now
    if now != "repeated" or not kept:
        kept = t, status, value
    return kept


def frames(c):
    for line in c.makefile("r"):
        number = int(line.split(" ")[2])
        now = habit()
        if now == "silent":
            continue
        with lock:
            t, status, value = measured(now)
        n = 2 if now == "more" else 1
        one = "%s,%s,%s;" % ("" if now == "timeless" else stamp(t), status, value)
        answer = "apc1 values %d %d;%s\n" % (number + (now == "other"), n, n * one)
        c.sendall((answer * (2 if now == "twice" else 1)).encode())


def serve(port, handle):
    with socket.create_server(("127.0.0.1", port)) as listening:
        while True:
            c, _ = listening.accept()

            def one(c=c):
                try:
                    handle(c)
                except OSError:
                    pass
                finally:
                    c.close()

            threading.Thread(target=one, daemon=True).start()


def registers(c, units=range(256)):
    """Input 0 and 1: y, float32. Holding 0 and 1: u. Other than these @p units are well."""
    stream = c.makefile("rb")
    while header := stream.read(7):
        number, _, length, unit = struct.unpack(">HHHB", header)
        request = stream.read(length - 1)
        now = habit() if unit in units else "well"
        if now == "silent":
            continue
        with lock:
            value = -9999.0 if now == "code" else measured(now)[2]
        if now == "refused":
            answer = bytes([request[0] | 0x80, 4])
        elif request[0] == 16:
            answer = request[:5]
        else:
            answer = struct.pack(">BBf", request[0], 4, value)
            answer = answer if now != "more" else struct.pack(">BBff", request[0], 8, value, value)
        answer = struct.pack(">HHHB", number + (now == "other"), 0, len(answer) + 1, unit) + answer
        c.sendall(answer * (2 if now == "twice" else 1))


def lines(path):
    """A Temperature Control Lab."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.symlink(os.ttyname(theirs), path)
    for line in os.fdopen(os.dup(ours), "rb", buffering=0):
        word, *rest = line.decode().split() or [""]
        now = habit()
        if now == "silent":
            continue
        answer = {"VER": "TCLab", "T1": "?" if now == "refused" else str(measured(now)[2])}.get(word, rest[0] if rest else "0")
        os.write(ours, ((answer + "\r\n") * (2 if now == "twice" else 1)).encode())


async def nodes(port):
    import asyncio

    from asyncua import Server, ua

    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:%d" % port)
    space = await server.register_namespace("urn:puppet")
    y = await server.nodes.objects.add_variable(ua.NodeId("y", space), "y", 10.0)
    u = await server.nodes.objects.add_variable(ua.NodeId("u", space), "u", 0.0)
    await u.set_writable()
    last = None

    def read(node, attribute):
        nonlocal last
        while (now := habit()) == "silent":
            time.sleep(0.01)
        t, status, value = measured(now)
        if last is None or now != "rest":
            when = datetime.datetime.fromtimestamp(t, datetime.timezone.utc).replace(tzinfo=None)
            code = getattr(ua.StatusCodes, "BadNotReadable" if now == "refused" else status)
            variant = ua.Variant("10") if now == "text" else ua.Variant(value)
            last = ua.DataValue(variant, ua.StatusCode(code), None if now == "timeless" else when)
        return last

    server.set_attribute_value_callback(y.nodeid, read)
    async with server:
        await asyncio.Event().wait()


kind, where = link.split(":", 1)
if kind == "serial":
    lines(where)
elif kind == "opcua":
    import asyncio

    asyncio.run(nodes(int(where)))
else:
    serve(int(where), {"tcp": frames, "modbus": registers, "gateway": lambda c: registers(c, [2])}[kind])
