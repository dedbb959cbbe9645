# SPDX-License-Identifier: BSD-3-Clause
"""python -m libapc.opcua serve STORE, plant URL, certificate FOLDER: docs/opcua.md."""

from __future__ import annotations

import argparse
import asyncio
import logging
import re
import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import Any, Awaitable, Callable, Optional
from urllib.parse import urlparse

from ..errors import Error
from . import users

_NODE = re.compile("(ns=[0-9]+;|nsu=[^;]+;)?(i=[0-9]+|[sgb]=.+)", re.DOTALL)
_LOOPBACK = ("127.0.0.1", "localhost", "::1")


def _parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(prog="python -m libapc.opcua", description="OPC UA for libapc: docs/opcua.md")
    commands = top.add_subparsers(dest="command", required=True)
    serve = commands.add_parser("serve", help="serve a store by OPC UA")
    serve.add_argument("store", metavar="STORE", help="URI of the store")
    serve.add_argument("--listen", default="opc.tcp://127.0.0.1:4840", metavar="URL", help="default: %(default)s")
    serve.add_argument("--period", type=float, default=0.5, metavar="S", help="time between two reads of the store, in s; default: %(default)s")
    serve.add_argument("--users", type=Path, metavar="FILE", help="users, made by apc user; default: the page's file, if it exists")
    serve.add_argument("--anonymous", choices=users.ROLES, metavar="ROLE",
                       help="role of clients without a login: none, observer, operator, engineer; default: observer, on "
                       "other addresses than loopback none")
    _identity(serve)
    serve.add_argument("--trust", type=Path, metavar="FOLDER", help="folder of the trusted clients' certificates; default: all are trusted")
    plant = commands.add_parser("plant", help="make an OPC UA server a plant, for the link of apc-client")
    plant.add_argument("url", metavar="URL", help="address of the server, opc.tcp://HOST:PORT")
    plant.add_argument("--listen", default="tcp:127.0.0.1:43051", metavar="LINK", help="address for apc-client; default: %(default)s")
    plant.add_argument("--measure", action="append", default=[], metavar="NODE", help="a measurement, in the experiment's order")
    plant.add_argument("--output", action="append", default=[], metavar="NODE[=SAFE]",
                       help="an output, in the experiment's order, and its safe value; default: 0")
    plant.add_argument("--watchdog", type=float, default=5.0, metavar="S",
                       help="time without a new command after which the safe values are written, in s; default: %(default)s")
    plant.add_argument("--timeout", type=float, default=1.0, metavar="S", help="time limit of an exchange, in s; default: %(default)s")
    plant.add_argument("--user", metavar="NAME", help="user name at the server")
    plant.add_argument("--password-file", type=Path, metavar="FILE", help="file with mode 0600 whose first line is the password")
    _identity(plant)
    plant.add_argument("--server-certificate", type=Path, metavar="FILE", help="certificate of the server to trust; with --certificate")
    certificate = commands.add_parser("certificate", help="make a key and a self-signed certificate")
    certificate.add_argument("folder", type=Path, metavar="FOLDER", help="folder for certificate.der and key.pem")
    certificate.add_argument("--host", default="localhost", help="host name in the certificate; default: %(default)s")
    return top


def _identity(command: argparse.ArgumentParser) -> None:
    command.add_argument("--certificate", type=Path, metavar="FILE", help="own certificate, DER or PEM; all traffic is then encrypted")
    command.add_argument("--key", type=Path, metavar="FILE", help="its private key, PEM, without a password")


class _Refused(Exception):
    pass


def _check_identity(args: Any) -> None:
    if (args.certificate is None) != (args.key is None):
        raise _Refused("--certificate and --key go together")
    for file in (args.certificate, args.key):
        if file is not None and not file.is_file():
            raise _Refused(f"{file}: there is no such file")
    if args.key is not None and args.key.stat().st_mode & 0o077:
        raise _Refused(f"{args.key}: others may read it: chmod 600 it")


def _serve(args: Any) -> Callable[[asyncio.Event], Awaitable[None]]:
    server = import_module(".server", __package__)
    _check_identity(args)
    at = urlparse(args.listen)
    try:
        if at.scheme != "opc.tcp" or not at.hostname or not at.port:
            raise ValueError
    except ValueError:
        raise _Refused(f"--listen {args.listen}: expected opc.tcp://HOST:PORT") from None
    here = at.hostname in _LOOPBACK
    anonymous = args.anonymous or ("observer" if here else "none")
    if not here and not args.certificate:
        raise _Refused(f"{at.hostname} is not loopback: give --certificate and --key (python -m libapc.opcua certificate)")
    if not here and anonymous in users.ROLES[2:]:
        raise _Refused(f"--anonymous {anonymous}: on other addresses than loopback, clients without a login may at most observe")
    if not 0.01 <= args.period <= 3600:
        raise _Refused(f"--period {args.period:g}: expected 0.01 to 3600 s")
    file: Optional[Path] = args.users or users.default()
    if args.users is None and file is not None and not file.exists():
        file = None
    if file is None and anonymous == "none":
        raise _Refused("nobody could connect: make a user (apc user add NAME --role operator), or give --anonymous observer")
    options = server.Options(args.listen, args.period, file, users.ROLES.index(anonymous), args.certificate, args.key, args.trust)
    run: Callable[[asyncio.Event], Awaitable[None]] = server.Server(args.store, options).run
    return run


def _plant(args: Any) -> Callable[[asyncio.Event], Awaitable[None]]:
    plant = import_module(".plant", __package__)
    _check_identity(args)
    if args.certificate and not args.server_certificate:
        raise _Refused("--certificate needs --server-certificate: else the server is not authenticated")
    scheme, _, where = args.listen.partition(":")
    host, _, port = where.rpartition(":")
    if scheme != "tcp" or not port.isdecimal() or host.strip("[]") not in _LOOPBACK:
        raise _Refused(f"--listen {args.listen}: expected tcp:127.0.0.1:PORT: the link is not encrypted, so it stays on this host")
    if not args.measure:
        raise _Refused("a plant has measurements: --measure NODE, once for each")
    outputs = [_output(text) for text in args.output]
    for node in (*args.measure, *(node for node, _ in outputs)):
        _check_node(node)
    password = None
    if args.password_file:
        if args.password_file.stat().st_mode & 0o077:
            raise _Refused(f"{args.password_file}: others may read it: chmod 600 it")
        password = args.password_file.read_text().splitlines()[0]
    options = plant.Options(args.url, host.strip("[]"), int(port), tuple(args.measure), tuple(outputs), args.watchdog, args.timeout,
                            args.user, password, args.certificate, args.key, args.server_certificate)
    run: Callable[[asyncio.Event], Awaitable[None]] = plant.Gateway(options).run
    return run


def _check_node(text: str) -> None:
    ua = import_module("asyncua.ua")
    try:
        if not _NODE.fullmatch(text):
            raise ValueError
        ua.NodeId.from_string(text)
    except (ua.UaError, ValueError):
        raise _Refused(f"{text}: expected a node's id, as ns=2;s=NAME, ns=2;i=NUMBER or nsu=URI;s=NAME, of an output with its safe value "
                       "behind it, as ns=2;i=NUMBER=0") from None


def _output(text: str) -> tuple[str, float]:
    """NODE[=SAFE]. An id has a = of its own: what stands before SAFE is an id by itself."""
    node, _, safe = text.rpartition("=")
    return (node, float(safe)) if _NODE.fullmatch(node) and _is_number(safe) else (text, 0.0)


def _is_number(text: str) -> bool:
    try:
        return abs(float(text)) < 1e300
    except ValueError:
        return False


def _certificate(args: Any) -> Callable[[asyncio.Event], Awaitable[None]]:
    async def make(stop: asyncio.Event) -> None:
        import os

        generate = import_module("asyncua.crypto.cert_gen")
        use = import_module("cryptography.x509.oid").ExtendedKeyUsageOID
        args.folder.mkdir(parents=True, exist_ok=True)
        key, made = args.folder / "key.pem", args.folder / "certificate.der"
        for file in (key, made):
            if file.exists():
                raise _Refused(f"{file}: is there already")
        os.umask(0o077)
        await generate.setup_self_signed_certificate(key, made, f"urn:{args.host}:libapc:opcua", args.host,
                                                     [use.CLIENT_AUTH, use.SERVER_AUTH], {"organizationName": "libapc"})
        made.chmod(0o644)
        print(f"{made} and {key}")

    return make


async def _run(make: Callable[[asyncio.Event], Awaitable[None]]) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await make(stop)


def main() -> int:
    """The exit code: 0, 1: it failed, 2: the arguments make no sense."""
    args = _parser().parse_args()
    logging.basicConfig(level=logging.ERROR, format="opcua: %(name)s: %(message)s")
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    try:
        import_module("asyncua")
    except ImportError as e:
        print(f"opcua: {e}: OPC UA takes asyncua and Python 3.10: pip install 'libapc[opcua]'", file=sys.stderr)
        return 1
    try:
        asyncio.run(_run({"serve": _serve, "plant": _plant, "certificate": _certificate}[args.command](args)))
    except _Refused as e:
        print(f"opcua: {e}", file=sys.stderr)
        return 2
    except (Error, OSError, ValueError) as e:
        print(f"opcua: {e}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
