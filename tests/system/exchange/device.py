# SPDX-License-Identifier: BSD-3-Clause
"""A first-order plant (gain 10, 2 s) behind Modbus TCP that has the habit of the moment: device.py PORT HABIT_FILE LOG.

input 0: y, int16, 0.01; holding 0: u, uint16, 0.001. The habit is read with each request: "well"; "gone" closes the
connection instead of an answer; "busy" answers each seventh request by exception 6; "blind" cannot read its inputs. The
log has a line for each command that was taken: when, and u.
"""

import math
import socket
import struct
import sys
import threading
import time

port, habit_file, log = int(sys.argv[1]), sys.argv[2], open(sys.argv[3], "w", buffering=1)
lock, seen, y, last = threading.Lock(), 0, 0.0, time.monotonic()
holding, inputs = [0] * 16, [0] * 16


def habit():
    with open(habit_file) as f:
        return f.read().strip()


def step():
    global y, last
    now = time.monotonic()
    a = math.exp(-(now - last) / 2.0)
    last, y = now, a * y + (1 - a) * 0.01 * holding[0]
    inputs[0] = round(y * 100) & 0xFFFF


def answer(p, now):
    """The answer to the request @p p; b"": none."""
    global seen
    step()
    seen += 1
    code = p[0]
    if now == "gone":
        return b""
    if now == "busy" and seen % 7 == 0:
        return bytes([code | 0x80, 6])
    if code in (3, 4) and not (now == "blind" and code == 4):
        at, n = struct.unpack(">HH", p[1:5])
        words = (holding if code == 3 else inputs)[at : at + n]
        return struct.pack(">BB", code, 2 * n) + b"".join(struct.pack(">H", v) for v in words)
    if code == 16:
        at, n = struct.unpack(">HH", p[1:5])
        holding[at : at + n] = struct.unpack(">%dH" % n, p[6 : 6 + 2 * n])
        log.write("%.3f u %.3f\n" % (time.monotonic(), holding[0] * 0.001))
        return p[:5]
    return bytes([code | 0x80, 4 if now == "blind" else 1])


def get(c, n):
    got = b""
    while len(got) < n:
        more = c.recv(n - len(got))
        if not more:
            raise EOFError
        got += more
    return got


def serve(c):
    try:
        while True:
            number, _, length, unit = struct.unpack(">HHHB", get(c, 7))
            body = get(c, length - 1)
            with lock:
                reply = answer(body, habit())
            if not reply:
                return
            c.sendall(struct.pack(">HHHB", number, 0, len(reply) + 1, unit) + reply)
    except (EOFError, OSError):
        pass
    finally:
        c.close()


server = socket.create_server(("127.0.0.1", port))
while True:
    connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    threading.Thread(target=serve, args=(connection,), daemon=True).start()
