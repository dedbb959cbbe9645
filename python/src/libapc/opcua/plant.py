# SPDX-License-Identifier: BSD-3-Clause
"""An OPC UA server as a plant: what apc-client asks by frames is read and written there.

Each exchange reads every measurement; a command writes every output first. Whatever fails there closes the client's
connection without an answer, so that nothing old is taken for new. An output that is refused costs no other: the plant is
read, and the client learns that its command was not taken. An output that takes no new command has its safe value
written, if it had one of ours before.
"""

from __future__ import annotations

import asyncio
import math
import sys
from datetime import datetime, timezone
from importlib import import_module
from pathlib import Path
from time import monotonic, monotonic_ns, time_ns
from typing import Any, Iterable, NamedTuple, Optional

from ..errors import Error
from ..native import check, ffi, lib, shown, why

_LONGEST = 5.0  # s between two attempts to connect
_MOST = 8192  # values of a frame
_PER_CLAIM, _CLAIMED = 1024, 1 << 50  # of a frame's id: apcsockets.h
_AHEAD = 60 * 10**6  # µs that a claim's number, which is a time, may be ahead
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_END = 9_214_646_400 * 10**9  # of what a frame can say: 2262-01-01


class Options(NamedTuple):
    """Of the gateway. Outputs are node and safe value."""

    url: str
    host: str
    port: int
    measure: tuple[str, ...]
    output: tuple[tuple[str, float], ...]
    watchdog: float = 5.0  #: s
    timeout: float = 1.0  #: s
    user: Optional[str] = None
    password: Optional[str] = None
    certificate: Optional[Path] = None
    key: Optional[Path] = None
    server_certificate: Optional[Path] = None


def say(text: str) -> None:
    print(f"opcua: {shown(text)}", file=sys.stderr, flush=True)


class Seen:
    """When a measurement was last known to be what it is. A frame's time says when the plant looked, and a server's source
    time may be that of the last change (Part 4, DataValue): while that stands still each answer of the server is a new look,
    so much later by this host's monotonic clock. All times are by the clock of the source, so that none goes back."""

    def __init__(self) -> None:
        self._source: Optional[int] = None
        self._time = self._at = 0

    def look(self, source: Optional[int], utc: int, at: int) -> int:
        """The time of what was answered at `at` (monotonic), `utc` by the server's clock."""
        if source is None:
            self._time = utc
        elif self._source is None:
            self._time = max(source, utc)  # it may have changed long ago
        elif source != self._source:
            self._time = source
        else:
            self._time += at - self._at
        self._source, self._at = source, at
        return self._time


class Gateway:
    """`await Gateway(options).run(stop)`: until the event `stop`, then the outputs are at their safe values."""

    def __init__(self, options: Options) -> None:
        self._o = options
        self._ua = import_module("asyncua.ua")
        self._client: Any = None
        self._lock = asyncio.Lock()
        self._newest = 0  # time that the last command bears
        self._fed: list[Optional[float]] = [None] * len(options.output)  # when each took a new one; None: none, or its safe value
        self._seen = [Seen() for _ in options.measure]
        self._ahead = 0  # ns: the server's clock of ours
        self._refuses: set[int] = set()  # outputs of the last command
        self._fences = False  # a command of another claim, and that was said
        self._claim = 0  # the highest that commands; 0: none has a number
        self._reads = self._writes = _MOST  # nodes in one request
        self._unsafe = ""  # why the safe values were not written, as it was said
        self._room = 256 + 96 * len(options.measure)
        self._samples = ffi.new("struct apc_sample[]", _MOST)

    # ---- The server ---------------------------------------------------------------------------------------------

    async def _connect(self) -> None:
        asyncua, o = import_module("asyncua"), self._o
        client = asyncua.Client(o.url, timeout=max(o.timeout, 1.0))
        if o.user:
            client.set_user(o.user)
            client.set_password(o.password or "")
        if o.certificate:
            policy = import_module("asyncua.crypto.security_policies").SecurityPolicyBasic256Sha256
            await client.set_security(policy, str(o.certificate), str(o.key), server_certificate=str(o.server_certificate))
        await client.connect()
        try:
            self._measure = [await _node(client, node) for node in o.measure]
            self._output = [await _node(client, node) for node, _ in o.output]
            self._reads, self._writes = [await self._limit(client, limit) for limit in ("Read", "Write")]
            self._kinds = [await node.read_data_type_as_variant_type() for node in self._output]
            for kind, (node, safe) in zip(self._kinds, o.output):
                if not self._ua.VariantType.Boolean.value < kind.value <= self._ua.VariantType.Double.value:
                    raise ValueError(f"{node} is no number but {kind.name}")
                if not _fits(safe, kind):
                    raise ValueError(f"{node}: its safe value {safe:g} does not fit its type, {kind.name}: --output NODE=SAFE")
            self._ahead = await self._clock_of(client)
        except BaseException:
            await client.disconnect()
            raise
        self._client = client

    async def _limit(self, client: Any, service: str) -> int:
        """Nodes that the server takes in one request (Part 5, OperationLimitsType); where it says none, as many as we have."""
        number = getattr(self._ua.ObjectIds, f"Server_ServerCapabilities_OperationLimits_MaxNodesPer{service}")
        (data,) = await client.read_attributes([client.get_node(self._ua.NodeId(number))])
        limit = data.Value.Value if data.Value is not None else None
        return limit if isinstance(limit, int) and limit > 0 else _MOST

    async def _clock_of(self, client: Any) -> int:
        status = client.get_node(self._ua.NodeId(self._ua.ObjectIds.Server_ServerStatus_CurrentTime))
        (data,) = await client.read_attributes([status])
        when = _ns(data.Value.Value) if data.Value is not None and isinstance(data.Value.Value, datetime) else None
        return when - time_ns() if when is not None else 0

    async def _keep(self) -> None:
        """Connected, as long as that is possible; what goes wrong is said once."""
        pause, said = 0.1, ""
        while True:
            if self._client is None:
                try:
                    await asyncio.wait_for(self._connect(), 10)
                    say(f"connected to {self._o.url}")
                    pause, said = 0.1, ""
                except (OSError, asyncio.TimeoutError, ValueError, self._ua.UaError) as e:
                    if said != str(e):
                        say(f"{self._o.url}: {str(e) or type(e).__name__}; trying again")
                    said, pause = str(e), min(2 * pause, _LONGEST)
            await asyncio.sleep(pause)

    async def _drop(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            try:
                await asyncio.wait_for(client.disconnect(), 1)
            except Exception:  # it is away: whatever asyncua says of that
                pass

    async def _write(self, u: dict[int, float]) -> dict[int, str]:
        """To these outputs. Returns which were refused, and why."""
        refused = {i: f"{self._o.output[i][0]} is to be {number:g}, which does not fit its type, {self._kinds[i].name}: low and high "
                      "of the experiment's output are to lie within" for i, number in u.items() if not _fits(number, self._kinds[i])}
        go = [i for i in u if i not in refused]
        for at in range(0, len(go), self._writes):
            some = go[at:at + self._writes]
            codes = await self._client.uaclient.write_attributes(
                [self._output[i].nodeid for i in some], [_written(self._ua, u[i], self._kinds[i]) for i in some],
                self._ua.AttributeIds.Value)
            refused.update((i, f"{self._o.output[i][0]}: {code.name}") for i, code in zip(some, codes) if not code.is_good())
        return refused

    async def _read(self) -> None:
        read: list[Any] = []
        for at in range(0, len(self._measure), self._reads):
            read += await self._client.read_attributes(self._measure[at:at + self._reads])
        at, utc = monotonic_ns(), time_ns() + self._ahead
        for sample, seen, data in zip(self._samples, self._seen, read):
            value = data.Value.Value if data.Value is not None else None
            number = float(value) if isinstance(value, (int, float)) else math.nan
            good = math.isfinite(number)
            code = data.StatusCode.value if data.StatusCode is not None else 0
            sample.value = number if good else 0.0
            if not good and not code & 0x80000000:  # a number that is none, or no number
                code = self._ua.StatusCodes.BadSensorFailure if isinstance(value, float) else self._ua.StatusCodes.BadTypeMismatch
            sample.status = code
            sample.time = seen.look(_ns(data.SourceTimestamp), utc, at)

    # ---- The client's frames ------------------------------------------------------------------------------------

    async def _answer(self, request: bytes) -> bytes:
        frame, reason = ffi.new("struct apc_frame *"), why()
        check(lib.apc_frame_decode(request, len(request), frame, self._samples, _MOST), reason)
        if frame.kind == lib.APC_FRAME_COMMAND:
            if not (self._may(frame.id) and await self._command(frame.n)):
                frame.id = 0  # the client knows by that
        elif frame.kind != lib.APC_FRAME_QUERY:
            raise ValueError("a plant is asked by command and query alone")
        await self._read()
        frame.kind, frame.n = lib.APC_FRAME_VALUES, len(self._o.measure)
        reply = ffi.new("char[]", self._room)
        return bytes(ffi.buffer(reply, check(lib.apc_frame_encode(reply, self._room, frame, self._samples), reason)))

    def _may(self, number: int) -> bool:
        """False: another client has taken this one's place since. Their claims are forgotten where none commands any more."""
        claim = number // _PER_CLAIM if number >= _CLAIMED else 0
        if claim and (claim < self._claim or claim > time_ns() // 1000 + _AHEAD):
            if not self._fences:
                say("commands are refused of a client " + ("whose place another one has taken, by a newer claim: stop it" if claim < self._claim else
                                                           "whose claim is of a time to come: its store's clock is wrong"))
            self._fences = True
            return False
        self._fences = self._fences and claim <= self._claim
        self._claim = max(self._claim, claim)
        return True

    async def _command(self, n: int) -> bool:
        """Was it taken?"""
        if n != len(self._o.output):
            raise ValueError(f"{n} outputs were commanded, and there are {len(self._o.output)}: --output, once for each")
        u, stamp = [s.value for s in self._samples[0:n]], max((s.time for s in self._samples[0:n]), default=0)
        if any(s.status & 0x80000000 for s in self._samples[0:n]):
            return False
        new, fed = stamp != self._newest, list(self._fed)
        go = {i: number for i, number in enumerate(u) if new or fed[i] is not None}  # an old one brings none back from its safe value
        for i in go:
            self._fed[i] = fed[i] or monotonic()  # what fails on the way may have come there
        refused = await self._write(go)
        if refused.keys() - self._refuses:
            say(f"commands are refused: {_some(refused.values())}")
        elif self._refuses and not refused:
            say("commands are taken again")
        self._refuses = set(refused)
        for i in go:
            self._fed[i] = fed[i] if i in refused else monotonic() if new else self._fed[i]
        self._newest = stamp
        return len(go) == n and not refused

    async def _exchange(self, request: bytes) -> Optional[bytes]:
        """The reply; None: there is none, and what went wrong is said."""
        async with self._lock:
            if self._client is None:
                return None
            try:
                return await asyncio.wait_for(self._answer(request), self._o.timeout)
            except (Error, ValueError) as e:
                say(f"an exchange failed: {e}")
            except (OSError, asyncio.TimeoutError, self._ua.UaError) as e:
                say(f"an exchange with {self._o.url} failed: {str(e) or type(e).__name__}")
                await self._drop()
            return None

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while (request := await reader.readline()).endswith(b"\n"):
                reply = await self._exchange(request)
                if reply is None:
                    return
                writer.write(reply)
                await asyncio.wait_for(writer.drain(), self._o.timeout)
        except (OSError, ValueError, asyncio.TimeoutError, asyncio.CancelledError):
            pass  # the client has gone, or sends what has no end; or the gateway ends
        finally:
            writer.close()

    # ---- Running ------------------------------------------------------------------------------------------------

    async def _safe(self, because: str, before: float) -> None:
        """To outputs that have a command of ours, the newest of before then, and no others: what somebody else has written
        is his."""
        async with self._lock:
            which = {i: self._o.output[i][1] for i, fed in enumerate(self._fed) if fed is not None and fed <= before}
            if not which or self._client is None:
                return
            try:
                refused = await asyncio.wait_for(self._write(which), self._o.timeout)
            except (ValueError, OSError, asyncio.TimeoutError, self._ua.UaError) as e:
                reason = str(e) or type(e).__name__
                await self._drop()
            else:
                reason = _some(refused.values()) if refused else ""
                done = [i for i in which if i not in refused]
                for i in done:
                    self._fed[i] = None
                if not any(self._fed):
                    self._claim = 0
                if done:
                    where = "" if len(done) == len(self._fed) else f" to {_some(self._o.output[i][0] for i in done)}"
                    say(f"{because}: the safe values were written{where}")
            if reason and self._unsafe != reason:
                say(f"{because}, and the safe values could not be written: {reason}")
            self._unsafe = reason

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(self._o.watchdog / 10)
            await self._safe(f"no new command for {self._o.watchdog:g} s", monotonic() - self._o.watchdog)

    async def run(self, stop: asyncio.Event) -> None:
        """Serve until `stop`. OSError: it cannot listen there."""
        server = await asyncio.start_server(self._talk, self._o.host, self._o.port, limit=lib.APC_FRAME_MAX)
        tasks = [asyncio.ensure_future(self._keep()), asyncio.ensure_future(self._watch())]
        say(f"a plant at tcp:{self._o.host}:{self._o.port}")
        waits = asyncio.ensure_future(stop.wait())
        await asyncio.wait([waits, *tasks], return_when=asyncio.FIRST_COMPLETED)
        server.close()
        for task in tasks:
            if task.done() and task.exception() is not None:
                say(f"{task.exception()!r}")
            task.cancel()
        await self._safe("it ends", math.inf)
        await self._drop()


async def _node(client: Any, text: str) -> Any:
    """By "nsu=URI;..." too: of a namespace only its URI is the same in each session (Part 6, 5.3.1.11)."""
    if not text.startswith("nsu="):
        return client.get_node(text)
    uri, _, identifier = text[len("nsu="):].partition(";")
    uris = await client.get_namespace_array()
    if uri not in uris:
        raise ValueError(f"{text}: the server has no such namespace, but {', '.join(uris[1:])}")
    return client.get_node(f"ns={uris.index(uri)};{identifier}")


def _some(texts: Iterable[str]) -> str:
    """The first ones of them, in one line."""
    every = list(texts)
    return ", ".join(every[:3]) + (f", and {len(every) - 3} more" if len(every) > 3 else "")


def _written(ua: Any, number: float, kind: Any) -> Any:
    """The value alone: a server may refuse one that comes with a status or a time, even a Good one (BadWriteNotSupported)."""
    return ua.DataValue(ua.Variant(number if _is_real(kind) else round(number), kind), None)


def _is_real(kind: Any) -> bool:
    name: str = kind.name
    return name in ("Double", "Float")


def _fits(number: float, kind: Any) -> bool:
    """Can a node of this type take it? Rounded, where it is whole."""
    if kind.name == "Double":
        return True
    if kind.name == "Float":
        return abs(number) < 3.4028235677973366e38  # what rounds to the largest there is
    name: str = kind.name
    bits = {"SByte": 8, "Byte": 8, "Int16": 16, "UInt16": 16, "Int32": 32, "UInt32": 32, "Int64": 64, "UInt64": 64}[name]
    signed = name in ("SByte", "Int16", "Int32", "Int64")
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return bool(low <= round(number) <= high)


def _ns(when: Optional[datetime]) -> Optional[int]:
    """None: there is none; or one of before 1970 or beyond 2261, which is how that is said (Part 6, DateTime)."""
    if when is None:
        return None
    since = (when if when.tzinfo else when.replace(tzinfo=timezone.utc)) - _EPOCH
    ns = ((since.days * 86400 + since.seconds) * 10**6 + since.microseconds) * 1000
    return ns if 0 < ns < _END else None
