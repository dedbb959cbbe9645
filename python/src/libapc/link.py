# SPDX-License-Identifier: BSD-3-Clause
"""The asking side of a link to a plant (apcsockets.h, apc-plant)."""

from __future__ import annotations

from time import time_ns
from types import TracebackType
from typing import Any, Optional, Sequence

from .columns import doubles
from .errors import error
from .native import Owned, check, ffi, lib, text, timeout_ns, utf8, why
from .values import Value, value_of

_MOST = 8192  # values of a frame


class Link:
    """To a plant at "tcp:HOST:PORT", or "tls:HOST:PORT" with the `identity` file that `apc cert` makes.

        with apc.Link("tcp:127.0.0.1:43051") as plant:
            y = plant.command([1.5])
    """

    def __init__(self, uri: str, timeout: float = 1.0, identity: Optional[str] = None) -> None:
        """`timeout` in s is of each exchange, connecting included. The first one connects."""
        out, reason, options = ffi.new("struct apc_link **"), why(), ffi.new("struct apc_link_options *")
        options.size, options.frame_max = ffi.sizeof(options[0]), lib.APC_FRAME_MAX
        self._identity: Any = None
        if identity is not None:
            made = ffi.new("struct apc_identity **")
            check(lib.apc_identity_load(made, utf8("identity", identity), reason), reason)
            self._identity = options.identity = ffi.gc(made[0], lib.apc_identity_free)
        check(lib.apc_link_create(out, utf8("uri", uri), options, reason), reason)
        self._owned = Owned("link", out[0], lib.apc_link_destroy)
        self._timeout = timeout_ns(timeout)
        self._id = 0

    def query(self) -> list[Value]:
        """What is measured now; the plant's input stays."""
        return self._ask(lib.APC_FRAME_QUERY, [])

    def command(self, u: Sequence[float]) -> list[Value]:
        """Give the plant its input `u` [nu], and take what is measured. RefusedError: it has not taken it."""
        return self._ask(lib.APC_FRAME_COMMAND, doubles("u", u, len(u)).tolist())

    def exchange(self, request: bytes) -> bytes:
        """Send a frame as it is, and take the reply."""
        with self._owned as link:
            return self._exchange(link, request, len(request))

    def _exchange(self, link: Any, request: Any, length: int) -> bytes:
        reply = ffi.new("char **")
        got = lib.apc_link_exchange(link, request, length, reply, lib.apc_clock_mono(ffi.NULL) + self._timeout)
        if got < 0:
            raise error(got, text(lib.apc_link_error(link)) or text(lib.apc_err_text(got)))
        return ffi.buffer(reply[0], got)[:]  # type: ignore[no-any-return]

    def _ask(self, kind: int, u: list[float]) -> list[Value]:
        frame, samples = ffi.new("struct apc_frame *"), ffi.new("struct apc_sample[]", _MOST)
        for sample, value in zip(samples, u):
            sample.time, sample.value = time_ns(), value
        self._id += 1
        frame.kind, frame.id, frame.n = kind, self._id, len(u)
        room = 256 + 96 * len(u)
        request, reason = ffi.new("char[]", room), why()
        length = check(lib.apc_frame_encode(request, room, frame, samples), reason)
        with self._owned as link:
            reply = self._exchange(link, request, length)
            code = lib.apc_frame_decode(reply, len(reply), frame, samples, _MOST)
            if code >= 0 and frame.kind == lib.APC_FRAME_VALUES and frame.id == 0 and kind == lib.APC_FRAME_COMMAND:
                raise error(lib.APC_EPERM, "the plant has not taken the command: a value is beyond what it can take, or it is an old one")
            if code < 0 or frame.kind != lib.APC_FRAME_VALUES or frame.id != self._id:
                lib.apc_link_reset(link)
                raise error(lib.APC_EPROTO, f"what answers is no plant: {reply[:60]!r}")
        return [value_of(sample) for sample in samples[0:frame.n]]

    def close(self) -> None:
        self._owned.close()

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, kind: Optional[type[BaseException]], raised: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        self.close()
