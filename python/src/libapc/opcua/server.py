# SPDX-License-Identifier: BSD-3-Clause
"""A store as an OPC UA server: what is measured and set, modes, alarms, and what operators do.

One thread reads the store on a grid; what is written waits for its outcome in threads of its own, each with a
connection of its own. All else is asyncio's thread.
"""

from __future__ import annotations

import asyncio
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from datetime import datetime, timezone
from importlib import import_module
from pathlib import Path
from typing import Any, Callable, NamedTuple, Optional

from ..alarms import Alarm
from ..errors import ConflictError, Error, InvalidError, LimitError, NotFoundError, RefusedError, StateError, TimedOut, no_number
from ..native import lib, shown, text, utf8, why
from ..store import Store, Tag
from ..values import Mode, Value
from . import history, services
from .address_space import READ, Space
from .users import ROLES, Users

OBSERVER, OPERATOR, ENGINEER = 1, 2, 3
_WRITERS = 8  # threads: so many writes wait for their outcome at once
_READERS = 2  # of history
_OUTCOME = ((LimitError, "BadOutOfRange"), ((RefusedError, StateError), "BadInvalidState"), (TimedOut, "BadTimeout"),
            (ConflictError, "BadOperationAbandoned"), (NotFoundError, "BadNodeIdUnknown"), (ValueError, "BadTypeMismatch"))
_KINDS = {"setpoint": lib.APC_OPERATION_SETPOINT, "actuator": lib.APC_OPERATION_OUTPUT, "tuning": lib.APC_OPERATION_TUNING}
_OPERATED = lib.APC_OPERATION_SETPOINT | lib.APC_OPERATION_OUTPUT
_ALL = _OPERATED | lib.APC_OPERATION_TUNING


class Options(NamedTuple):
    """Of the server. Certificates are DER or PEM, the key PEM."""

    listen: str = "opc.tcp://127.0.0.1:4840"
    period: float = 0.5  #: s: how often the store is read
    users: Optional[Path] = None  #: the file of `apc user`; None: nobody logs in
    anonymous: int = OBSERVER  #: what who does not log in may, as a place in ROLES
    certificate: Optional[Path] = None
    key: Optional[Path] = None
    trust: Optional[Path] = None  #: folder of the clients' certificates; None: whoever has one


class Seen(NamedTuple):
    """The store at one moment."""

    tags: list[Tag]
    values: dict[tuple[str, int], Value]
    alarms: list[Alarm]


def say(text: str) -> None:
    print(f"opcua: {shown(text)}", file=sys.stderr, flush=True)


def status_of(e: BaseException) -> str:
    """The name of the StatusCode for what went wrong."""
    return next((name for kind, name in _OUTCOME if isinstance(e, kind)), "BadNoCommunication")


class _Reader:
    """What the reading thread keeps."""

    def __init__(self, uri: str) -> None:
        self._store = Store(uri, "opcua")
        self._alarms = True

    def look(self) -> Seen:
        tags = [t for t in self._store.tags() if t.name]
        shown = [t for t in tags if t.table in READ]
        values = self._store._read(shown)
        return Seen(tags, {(t.table, t.id): v for t, v in zip(shown, values)}, self._read_alarms())

    def _read_alarms(self) -> list[Alarm]:
        try:
            found = self._store.alarms()
            self._alarms = True
            return found
        except (ConnectionError, TimeoutError):
            raise
        except Error as e:
            if self._alarms:
                say(f"the alarms cannot be read: {e}")
            self._alarms = False
            return []


class Server:
    """`await Server(uri, options).run(stop)`: until the event `stop`."""

    def __init__(self, uri: str, options: Options) -> None:
        self._uri, self._options = uri, options
        self._users = Users(options.users) if options.users else None
        self._ua = import_module("asyncua.ua")
        self._who: ContextVar[Any] = ContextVar("who")
        self._reader = ThreadPoolExecutor(1, "apc-read")
        self._writers = ThreadPoolExecutor(_WRITERS, "apc-write")
        self._historians = ThreadPoolExecutor(_READERS, "apc-history")
        self._own = threading.local()
        self._away = False

    # ---- Who ----------------------------------------------------------------------------------------------------

    def get_user(self, iserver: Any, username: Optional[str] = None, password: Optional[str] = None,
                 certificate: Any = None) -> Any:
        """What asyncua asks at each login; None: it is refused."""
        if username is None:
            rank: Optional[int] = self._options.anonymous
        else:
            rank = self._users.role(username, password or "") if self._users else None
            if rank is None:
                say(f"a login as {username[:32]!r} was refused")
        if not rank:
            return None
        rules = import_module("asyncua.crypto.permission_rules")
        user = rules.User(role=rules.UserRole.User, name=username or "opcua")
        user.rank = rank
        return user

    def _may(self, user: Any, rank: int) -> bool:
        return getattr(user, "rank", 0) >= rank

    # ---- What operators do --------------------------------------------------------------------------------------

    async def _do(self, what: str, user: Any, rank: int, do: Callable[[Store, str], Any]) -> tuple[Any, Any]:
        """The outcome: a StatusCode, and what is in force. Who is refused is told in an event as well, in the words of every
        other front end."""
        codes = self._ua.StatusCodes
        if not self._may(user, rank):
            reason = why()
            lib.apc_operation_role(utf8("user", user.name), ROLES[user.rank].encode(), ROLES[rank].encode(), reason)
            await self._space.say(f"{what}: {text(reason.text)}")
            return self._ua.StatusCode(codes.BadUserAccessDenied), None

        try:
            force = await self._with_store(self._writers, lambda store: do(store, user.name))
        except (Error, ValueError, OverflowError) as e:
            await self._space.say(str(e) if str(e).startswith(what) else f"{what}: {e}")
            return self._ua.StatusCode(getattr(codes, status_of(e))), None
        return self._ua.StatusCode(codes.Good), force

    async def _with_store(self, threads: ThreadPoolExecutor, do: Callable[[Store], Any]) -> Any:
        """In one of the threads, which have a store of their own each."""
        def work() -> Any:
            if not hasattr(self._own, "store"):
                self._own.store = Store(self._uri, "opcua")
            return do(self._own.store)

        return await asyncio.get_running_loop().run_in_executor(threads, work)

    async def set(self, user: Any, name: str, value: Any, table: str) -> tuple[Any, Any]:
        """Of that table alone; "": of those that this user may write."""
        kinds = _KINDS.get(table, _ALL if self._may(user, ENGINEER) else _OPERATED)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)

        def write(store: Store, who: str) -> float:
            if not is_number:
                raise no_number(value)
            try:
                return store._operate(name, float(value), kinds, who).value
            except InvalidError as e:  # NaN, infinite: of the right type all the same
                raise LimitError(str(e)) from e

        what = f"{name} = {value:.15g}" if is_number else f"{name} = {value!s:.60}"
        return await self._do(what, user, ENGINEER if table == "tuning" else OPERATOR, write)

    async def mode(self, user: Any, loop: str, mode: Any) -> tuple[Any, Any]:
        asked = f"{mode!s:.30}"
        return await self._do(f"{loop} mode = {asked}", user, OPERATOR, lambda s, who: Mode(s.mode(loop, asked, who)).name)

    async def _nothing(self, user: Any, item: Any) -> Any:
        """What is written where nothing can be."""
        codes, (table, name) = self._ua.StatusCodes, self._space.called(item.NodeId)

        def look(store: Store, who: str) -> None:
            why_not = store._missing(name, lib.APC_OPERATION_MODE if table == "opmode" else _ALL) if name else ""
            raise NotFoundError(why_not or "nothing is written there")

        code, _ = await self._do(f"{item.NodeId.to_string():.100}", user, OPERATOR, look)
        is_there = item.NodeId in self._server.iserver.aspace
        return self._ua.StatusCode(codes.BadNotWritable) if is_there and code.value == codes.BadNodeIdUnknown else code

    async def acknowledge(self, user: Any, alarm: str, comment: str, seen: int) -> tuple[Any, Any]:
        return await self._do(f"{alarm}: not acknowledged", user, OPERATOR,
                              lambda s, who: s.acknowledge(alarm, comment, who, seen).state)

    async def shelve(self, user: Any, alarm: str, seconds: float, comment: str = "", once: bool = False) -> tuple[Any, Any]:
        return await self._do(f"{alarm}: not shelved" if seconds else f"{alarm}: shelved as before", user, OPERATOR,
                              lambda s, who: s.shelve(alarm, seconds, once, comment, who).state)

    @property
    def period(self) -> float:
        """s: nothing is newer than that."""
        return self._options.period

    @property
    def caller(self) -> Any:
        """Who called the method that runs."""
        return self._who.get(None)

    async def _write(self, session: Any, params: Any) -> list[Any]:
        return [await self._write_one(session.user, item) for item in params.NodesToWrite]

    async def _write_one(self, user: Any, item: Any) -> Any:
        target = self._space.target(item.NodeId)
        if item.AttributeId != self._ua.AttributeIds.Value or target is None:
            return await self._nothing(user, item)
        table, name = target
        codes, status = self._ua.StatusCodes, item.Value.StatusCode
        if item.IndexRange or status is not None and not status.is_good():
            how = "in part" if item.IndexRange else f"as {status.name}, and what is in doubt does not come into force"
            await self._space.say(f"{name}: refused: it was written {how}")
            return self._ua.StatusCode(codes.BadWriteNotSupported)
        value = item.Value.Value.Value if item.Value.Value is not None else None
        do = self.mode(user, name, value) if table == "opmode" else self.set(user, name, value, table)
        code, force = await do
        if code.is_good():
            await self._space.put(item.NodeId, force)
        return code

    async def _history(self, session: Any, params: Any) -> list[Any]:
        return [await self._history_of(params, item) for item in params.NodesToRead]

    async def _history_of(self, params: Any, item: Any) -> Any:
        ua, codes, details = self._ua, self._ua.StatusCodes, params.HistoryReadDetails
        tag = self._space.historized(item.NodeId)

        def failed(code: int) -> Any:
            return ua.HistoryReadResult(StatusCode=ua.StatusCode(code))

        if params.ReleaseContinuationPoints:
            return ua.HistoryReadResult()  # they are all that there was
        if not isinstance(details, ua.ReadRawModifiedDetails) or details.IsReadModified or tag is None:
            return failed(codes.BadHistoryOperationUnsupported)
        try:
            what = history.asked(tag, details, item.ContinuationPoint)
        except ValueError:
            return failed(codes.BadContinuationPointInvalid if item.ContinuationPoint else codes.BadHistoryOperationInvalid)
        try:
            rows, place = await self._with_store(self._historians, lambda store: history.read(store, what))
        except Error as e:
            say(f"the history of {tag.name} cannot be read: {e}")
            return failed(codes.BadNoCommunication)
        data = ua.HistoryData(DataValues=history.values(rows))
        return ua.HistoryReadResult(StatusCode=ua.StatusCode(codes.Good if data.DataValues else codes.GoodNoData),
                                    ContinuationPoint=place, HistoryData=data)

    async def _call(self, session: Any, methods: list[Any]) -> list[Any]:
        self._who.set(session.user)
        done: list[Any] = await self._server.iserver.method_service.call(methods)
        return done

    # ---- Running ------------------------------------------------------------------------------------------------

    async def _make(self) -> None:
        asyncua, o = import_module("asyncua"), self._options
        self._server = asyncua.Server(user_manager=self)
        iserver = self._server.iserver
        iserver.bind_condition_methods = 100
        policies, ua = self._ua.SecurityPolicyType, self._ua
        self._server.product_uri, self._server.manufacturer_name = "urn:libapc", "libapc"
        await self._server.init()
        self._server.set_endpoint(o.listen)
        self._server.set_server_name("libapc")
        if o.certificate and o.key:
            await self._server.load_certificate(str(o.certificate))
            await self._server.load_private_key(str(o.key))
            await self._server.set_application_uri(_uri_of(iserver.certificate))
            self._server.set_security_policy([policies.Basic256Sha256_SignAndEncrypt,
                                              policies.Aes128Sha256RsaOaep_SignAndEncrypt,
                                              policies.Aes256Sha256RsaPss_SignAndEncrypt])
            await self._trust()
        else:
            await self._server.set_application_uri("urn:libapc:opcua")
            self._server.set_security_policy([policies.NoSecurity])
        self._server.set_identity_tokens(([ua.UserNameIdentityToken] if self._users else []) +
                                         ([ua.AnonymousIdentityToken] if o.anonymous else []))
        built = datetime.fromtimestamp(Path(import_module("libapc._apc").__file__ or "").stat().st_mtime, timezone.utc)
        version = text(lib.apc_version())
        await self._server.set_build_info("urn:libapc", "libapc", "libapc", version, version, built)
        self._space = Space(self._server, self)
        await self._space.init()

        def create_session(name: str, user: Any = None, external: bool = False) -> Any:
            session = made(name, external=external)
            session.write = lambda params: self._write(session, params)
            session.history_read = lambda params: self._history(session, params)
            session.call = lambda methods: self._call(session, methods)
            if external:
                services.own(iserver, session)
            return session

        made, iserver.create_session = iserver.create_session, create_session
        services.number(iserver)
        setattr(import_module("asyncua.server.binary_server_asyncio"), "UaProcessor", services.processor())

    async def _trust(self) -> None:
        validator, o = import_module("asyncua.crypto.validator"), self._options
        flags = validator.CertificateValidatorOptions
        if o.trust:
            store = import_module("asyncua.crypto.truststore").TrustStore([o.trust], [])
            await store.load()
            checked = flags.TRUSTED_VALIDATION | flags.PEER_CLIENT
            self._server.set_certificate_validator(validator.CertificateValidator(checked, store))
        else:
            checked = flags.BASIC_VALIDATION | flags.PEER_CLIENT
            self._server.set_certificate_validator(validator.CertificateValidator(checked))

    async def _look(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            seen = await loop.run_in_executor(self._reader, self._source.look)
        except Error as e:
            if not self._away:
                say(f"the store is offline: {e}")
                await self._space.away()
            self._away = True
            return
        if self._away:
            say("the store is back")
        self._away = False
        await self._space.show(seen)

    async def run(self, stop: asyncio.Event) -> None:
        """Serve until `stop`. OSError: it cannot listen there."""
        self._source = await asyncio.get_running_loop().run_in_executor(self._reader, _Reader, self._uri)
        await self._make()
        await self._look()
        async with self._server:
            say(f"{self._uri.split('@')[-1]} is at {self._options.listen}" + ("" if self._options.certificate else ", not encrypted"))
            while not stop.is_set():
                try:
                    await asyncio.wait_for(stop.wait(), self._options.period)
                except asyncio.TimeoutError:
                    await self._look()
        self._writers.shutdown(wait=False)
        self._historians.shutdown(wait=False)
        self._reader.shutdown()


def _uri_of(certificate: Any) -> str:
    """The application's URI, which clients compare with the certificate's."""
    x509 = import_module("cryptography.x509")
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uri: str = names.get_values_for_type(x509.UniformResourceIdentifier)[0]
    except (x509.ExtensionNotFound, IndexError):
        raise ValueError("the certificate has no URI of an application among its names: "
                         "python -m libapc.opcua certificate makes one that has") from None
    return uri
