# SPDX-License-Identifier: BSD-3-Clause
"""Clients of a plant over tls: who commands it. rivals.py PORT FOLDER ONE OTHER STRANGER, identities in FOLDER by their names."""

import datetime
import socket
import ssl
import sys

port, folder, one, other, stranger = int(sys.argv[1]), *sys.argv[2:]


class Unheard(Exception):
    """A busy machine takes longer for a handshake than the plant waits: once more."""


class Client:
    def __init__(self, name):
        context = ssl.create_default_context(cafile=f"{folder}/authority.pem")
        context.load_cert_chain(f"{folder}/{name}.pem")
        self.link = context.wrap_socket(socket.create_connection(("127.0.0.1", port), timeout=60), server_hostname="127.0.0.1")
        self.number = 0

    def commands(self, value):
        """Does the plant take it?"""
        self.number += 1
        now = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        try:
            self.link.sendall(f"apc1 command {self.number} 1;{now},Good,{value};\n".encode())
            return self.link.recv(4096).startswith(f"apc1 values {self.number} 1;".encode())
        except (ssl.SSLError, OSError):
            return False


def heard(name, value):
    try:
        client = Client(name)
    except (ssl.SSLError, OSError) as why:
        raise Unheard(f"{name}: {why}") from why
    if not client.commands(value):
        raise Unheard(name)
    return client


def newest_wins(first, second):
    a = heard(first, 1)
    b = heard(second, 2)
    assert not a.commands(1), f"{first} commands beside {second}, who came later"
    again = heard(first, 1)
    assert not b.commands(2), f"{second} commands beside {first}, who came anew"
    return again


def at_last(first, second):
    for _ in range(9):
        try:
            return newest_wins(first, second)
        except Unheard as why:
            last = why
    raise last


at_last(one, other).link.close()
rightful = at_last(one, one)
for _ in range(5):
    try:
        refused = not Client(stranger).commands(9)
    except (ssl.SSLError, OSError):
        refused = True
    assert refused, "a stranger is heard"
    assert rightful.commands(1), "a stranger took the plant from who may command"
