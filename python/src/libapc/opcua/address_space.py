# SPDX-License-Identifier: BSD-3-Clause
"""The nodes: Objects/Plant with a folder for each kind of variable, the alarms as conditions, and the methods.

A node's id is "TABLE.NAME" in the namespace urn:libapc:plant: "sensor.y", "setpoint.r", "opmode.u", "alarm.y.high".
"""

from __future__ import annotations

import asyncio
from datetime import datetime, timezone
from importlib import import_module
from time import time_ns
from typing import TYPE_CHECKING, Any, Optional

from ..alarms import Alarm
from ..native import lib
from ..store import Tag
from ..values import Mode, Value
from . import units

if TYPE_CHECKING:
    from .server import Seen, Server

NAMESPACE = "urn:libapc:plant"
_FOLDERS = {"sensor": "Measurements", "estimate": "Estimates", "setpoint": "Setpoints", "actuator": "Outputs",
            "opmode": "Modes", "tuning": "Parameters", "alarm": "Alarms"}
READ = {*_FOLDERS, "actual"} - {"alarm"}  #: tables whose newest rows are shown
_NUMBERS = ("setpoint", "actuator", "tuning")  # that may be written
_WRITTEN = (*_NUMBERS, "opmode")
_SEVERITY = (0, 900, 700, 500, 300)  # by priority
#: of a condition, in this order, those with parts of their own before these; by its event
_CONDITION = (
    ("EventId", "ByteString"), ("EventType", "NodeId"), ("SourceNode", "NodeId"), ("SourceName", "String"), ("Time", "DateTime"),
    ("ReceiveTime", "DateTime"), ("Message", "LocalizedText"), ("Severity", "UInt16"), ("ConditionClassId", "NodeId"),
    ("ConditionClassName", "LocalizedText"), ("ConditionName", "String"), ("BranchId", "NodeId"), ("Retain", "Boolean"),
    ("ClientUserId", "String"), ("InputNode", "NodeId"), ("SuppressedOrShelved", "Boolean"),
    ("Quality", "StatusCode"), ("LastSeverity", "UInt16"), ("Comment", "LocalizedText"),
    ("Quality/SourceTimestamp", "DateTime"), ("LastSeverity/SourceTimestamp", "DateTime"), ("Comment/SourceTimestamp", "DateTime"),
    ("EnabledState", "LocalizedText"), ("AckedState", "LocalizedText"), ("ActiveState", "LocalizedText"),
    ("SuppressedState", "LocalizedText"), ("OutOfServiceState", "LocalizedText"),
    ("EnabledState/Id", "Boolean"), ("AckedState/Id", "Boolean"), ("ActiveState/Id", "Boolean"), ("SuppressedState/Id", "Boolean"),
    ("OutOfServiceState/Id", "Boolean"))
_STATEFUL = {path.partition("/")[0] for path, _ in _CONDITION if "/" in path}
_NEVER = datetime(1601, 1, 1, tzinfo=timezone.utc)  # how OPC UA says that there is no time
_SWITCHES = 65536  # ids of table opmode from here on are no loops


class Space:
    """What clients see. On asyncio's thread alone."""

    def __init__(self, server: Any, operator: "Server") -> None:
        self._server, self._operator = server, operator
        self._ua = import_module("asyncua.ua")
        self._events = import_module("asyncua.common.event_objects")
        self._plant: Any = None
        self._tags: list[Tag] = []
        self._alarms: dict[str, Alarm] = {}
        self._shown: dict[Any, Any] = {}  # what a node has
        self._targets: dict[Any, tuple[str, str]] = {}  # what may be written
        self._historized: dict[Any, Tag] = {}

    async def init(self) -> None:
        ua = self._ua
        self._ns = await self._server.register_namespace(NAMESPACE)
        self._said = await self._server.get_event_generator(ua.ObjectIds.BaseEventType, ua.ObjectIds.Server)
        self._opmode = lib.apc_table_parse(b"opmode")
        for method, do in ((ua.ObjectIds.AcknowledgeableConditionType_Acknowledge, self._acknowledge),
                           (ua.ObjectIds.ShelvedStateMachineType_TimedShelve, self._timed_shelve),
                           (ua.ObjectIds.ShelvedStateMachineType_OneShotShelve, self._one_shot_shelve),
                           (ua.ObjectIds.ShelvedStateMachineType_Unshelve, self._unshelve),
                           (ua.ObjectIds.ConditionType_Enable, self._enable), (ua.ObjectIds.ConditionType_Disable, self._disable),
                           (ua.ObjectIds.ConditionType_AddComment, self._disable)):
            self._server.link_method(self._server.get_node(ua.NodeId(method)), do)

    def _id(self, text: str) -> Any:
        return self._ua.NodeId(text, self._ns)

    def target(self, node: Any) -> Optional[tuple[str, str]]:
        """Table and name of what is written by a node; None: nothing is."""
        return self._targets.get(node)

    def called(self, node: Any) -> tuple[str, str]:
        """Table and name of the variable that a node's id speaks of, whether there is one or not; "", "": of none."""
        table, _, name = str(node.Identifier).partition(".")
        return (table, name) if node.NamespaceIndex == self._ns and table in _FOLDERS else ("", "")

    def historized(self, node: Any) -> Optional[Tag]:
        """The variable whose numbers have a history; None: the node is none."""
        return self._historized.get(node)

    async def say(self, text: str) -> None:
        """An event of the server, for its subscribers."""
        self._said.event.Severity = 400
        await self._said.trigger(message=text)

    # ---- Making -------------------------------------------------------------------------------------------------

    async def _build(self, tags: list[Tag], alarms: list[Alarm]) -> None:
        ua = self._ua
        if self._plant is not None:
            await self._server.delete_nodes([self._plant], recursive=True)
        self._shown.clear()
        self._targets.clear()
        self._historized.clear()
        self._plant = await self._server.nodes.objects.add_object(self._id("plant"), ua.QualifiedName("Plant", self._ns))
        folders: dict[str, Any] = {}
        for tag in tags:
            if tag.table in _FOLDERS and tag.table != "alarm" and not (tag.table == "opmode" and not _is_loop(tag)):
                await self._add(await self._folder(folders, tag.table), tag)
        for alarm in alarms:
            await self._add_alarm(await self._folder(folders, "alarm"), alarm)
            await asyncio.sleep(0)  # hundreds of them take seconds, and who asks meanwhile is answered
        await self._add_methods()

    async def _folder(self, folders: dict[str, Any], table: str) -> Any:
        if table not in folders:
            name = _FOLDERS[table]
            folders[table] = await self._plant.add_folder(self._id(name), self._ua.QualifiedName(name, self._ns))
        return folders[table]

    async def _add(self, folder: Any, tag: Tag) -> None:
        ua, of = self._ua, self._id(f"{tag.table}.{tag.name}")
        if of in self._shown:
            return
        first = ua.Variant("", ua.VariantType.String) if tag.table == "opmode" else ua.Variant(0.0, ua.VariantType.Double)
        node = await folder.add_variable(of, ua.QualifiedName(tag.name, self._ns), first)
        self._shown[of] = None
        await self._attribute(node, "Description", ua.LocalizedText(tag.description), ua.VariantType.LocalizedText)
        await self._attribute(node, "MinimumSamplingInterval", 1000.0 * self._operator.period, ua.VariantType.Double)
        if tag.table != "opmode":
            await self._make_analog(node, tag)
            self._historized[of] = tag
            for attribute in (ua.AttributeIds.AccessLevel, ua.AttributeIds.UserAccessLevel):
                await node.set_attr_bit(attribute, ua.AccessLevel.HistoryRead)
            await node.write_attribute(ua.AttributeIds.Historizing, ua.DataValue(True))
        if tag.table in _WRITTEN and tag.controller or tag.table == "setpoint":
            self._targets[of] = (tag.table, tag.name)
            await node.set_writable()

    async def _attribute(self, node: Any, name: str, value: Any, kind: Any) -> None:
        ua = self._ua
        await node.write_attribute(getattr(ua.AttributeIds, name), ua.DataValue(ua.Variant(value, kind)))

    async def _make_analog(self, node: Any, tag: Tag) -> None:
        """Part 8: a number with a range, a unit, both or neither."""
        ua, of, ranged = self._ua, f"{tag.table}.{tag.name}", tag.low is not None and tag.high is not None
        if tag.unit:
            code, text = units.number(tag.unit), ua.LocalizedText(tag.unit)
            unit = ua.EUInformation(NamespaceUri=units.NAMESPACE if code is not None else NAMESPACE, DisplayName=text, Description=text,
                                    UnitId=code if code is not None else -1)
            await node.add_property(self._id(f"{of}/unit"), "0:EngineeringUnits", unit)
        if ranged:
            await node.add_property(self._id(f"{of}/range"), "0:EURange", ua.Range(Low=tag.low, High=tag.high))
        await self._is_a(node, ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.AnalogItemType if ranged else
                         ua.ObjectIds.AnalogUnitType if tag.unit else ua.ObjectIds.DataItemType)

    async def _is_a(self, node: Any, was: int, kind: int) -> None:
        ua = self._ua
        await node.delete_reference(ua.NodeId(was), ua.ObjectIds.HasTypeDefinition, True)
        await node.add_reference(ua.NodeId(kind), ua.ObjectIds.HasTypeDefinition)

    async def _add_alarm(self, folder: Any, alarm: Alarm) -> None:
        ua, of = self._ua, f"alarm.{alarm.name}"
        node = await folder.add_object(self._id(of), ua.QualifiedName(alarm.name, self._ns))
        await self._is_a(node, ua.ObjectIds.BaseObjectType, ua.ObjectIds.AlarmConditionType)
        await self._attribute(node, "Description", ua.LocalizedText(alarm.message), ua.VariantType.LocalizedText)
        for name, first in (("State", alarm.state), ("Consequence", alarm.consequence), ("Response", alarm.response)):
            await node.add_variable(self._id(f"{of}/{name}"), ua.QualifiedName(name, self._ns), first)
        await self._add_condition(node, of, self._event(alarm))
        for method in (ua.ObjectIds.ConditionType_Enable, ua.ObjectIds.ConditionType_Disable, ua.ObjectIds.ConditionType_AddComment,
                       ua.ObjectIds.AcknowledgeableConditionType_Acknowledge):
            await node.add_reference(ua.NodeId(method), ua.ObjectIds.HasComponent)
        shelving = await node.add_object(self._id(f"{of}/ShelvingState"), "0:ShelvingState")
        await self._is_a(shelving, ua.ObjectIds.BaseObjectType, ua.ObjectIds.ShelvedStateMachineType)
        state = await shelving.add_variable(self._id(f"{of}/ShelvingState/CurrentState"), "0:CurrentState", ua.LocalizedText("Unshelved"))
        await self._is_a(state, ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.FiniteStateVariableType)
        await state.add_property(self._id(f"{of}/ShelvingState/CurrentState/Id"), "0:Id", self._shelving_id("Unshelved"))
        await shelving.add_property(self._id(f"{of}/ShelvingState/UnshelveTime"), "0:UnshelveTime", 0.0,
                                    datatype=ua.NodeId(ua.ObjectIds.Duration))
        for method in (ua.ObjectIds.ShelvedStateMachineType_TimedShelve, ua.ObjectIds.ShelvedStateMachineType_OneShotShelve,
                       ua.ObjectIds.ShelvedStateMachineType_Unshelve):
            await shelving.add_reference(ua.NodeId(method), ua.ObjectIds.HasComponent)
        self._shown[self._id(of)] = None

    async def _add_condition(self, node: Any, of: str, event: Any) -> None:
        """What a condition has to have, as its events tell it."""
        ua, made = self._ua, {"": node}
        for path, kind in _CONDITION:
            above, _, name = path.rpartition("/")
            variant = ua.Variant(getattr(event, path), ua.VariantType[kind])
            part = path in _STATEFUL
            add = made[above].add_variable if part else made[above].add_property
            made[path] = await add(self._id(f"{of}/{path}"), f"0:{name}", variant,
                                   datatype=ua.NodeId(ua.ObjectIds.UtcTime) if kind == "DateTime" else None)
            if part:
                await self._is_a(made[path], ua.ObjectIds.BaseDataVariableType, ua.ObjectIds.TwoStateVariableType
                                 if path.endswith("State") else ua.ObjectIds.ConditionVariableType)

    def _shelving_id(self, state: str) -> Any:
        return self._ua.NodeId(getattr(self._ua.ObjectIds, f"ShelvedStateMachineType_{state}"))

    async def _add_methods(self) -> None:
        kind, array = self._ua.VariantType, self._argument
        for name, do, inputs, output in (
                ("Set", self._set, [array("Name", kind.String), array("Value", kind.Double)], array("InForce", kind.Double)),
                ("SetMode", self._mode, [array("Loop", kind.String), array("Mode", kind.String)], array("InForce", kind.String)),
                ("Acknowledge", self._acknowledge_by_name, [array("Alarm", kind.String), array("Comment", kind.String)],
                 array("State", kind.String)),
                ("Shelve", self._shelve, [array("Alarm", kind.String), array("Seconds", kind.Double),
                                          array("Comment", kind.String)], array("State", kind.String))):
            await self._plant.add_method(self._id(name), self._ua.QualifiedName(name, self._ns), do, inputs, [output])

    def _argument(self, name: str, kind: Any) -> Any:
        return self._ua.Argument(Name=name, DataType=self._ua.NodeId(kind.value), ValueRank=-1)

    # ---- Methods ------------------------------------------------------------------------------------------------

    def _result(self, code: Any, force: Any, kind: Any) -> Any:
        result = self._ua.CallMethodResult()
        result.StatusCode = code
        result.OutputArguments = [self._ua.Variant(force, kind)] if code.is_good() else []
        return result

    def _wrong(self) -> Any:
        return self._ua.CallMethodResult(StatusCode=self._ua.StatusCode(self._ua.StatusCodes.BadInvalidArgument))

    async def _set(self, parent: Any, *given: Any) -> Any:
        if not _are(given, str, object):
            return self._wrong()
        name = given[0].Value
        table = next((t.table for t in self._tags if t.table in _NUMBERS and name in (t.name, f"{t.table}.{t.id}")), "")
        done = await self._operator.set(self._operator.caller, name, given[1].Value, table)
        return self._result(*done, self._ua.VariantType.Double)

    async def _mode(self, parent: Any, *given: Any) -> Any:
        if not _are(given, str, object):
            return self._wrong()
        done = await self._operator.mode(self._operator.caller, given[0].Value, given[1].Value)
        return self._result(*done, self._ua.VariantType.String)

    async def _shelve(self, parent: Any, *given: Any) -> Any:
        if not _are(given, str, float, str):
            return self._wrong()
        done = await self._operator.shelve(self._operator.caller, *(g.Value for g in given))
        return self._result(*done, self._ua.VariantType.String)

    async def _acknowledge_by_name(self, parent: Any, *given: Any) -> Any:
        if not _are(given, str, str):
            return self._wrong()
        done = await self._operator.acknowledge(self._operator.caller, given[0].Value, given[1].Value, 0)
        return self._result(*done, self._ua.VariantType.String)

    async def _acknowledge(self, parent: Any, *given: Any) -> Any:
        """Part 9: of a condition, the event that was seen."""
        ua = self._ua
        if len(given) != 2 or not isinstance(given[0].Value, bytes):
            return self._wrong()
        name, _, seq = given[0].Value.decode("utf-8", "replace").rpartition(":")
        if parent != self._id(f"alarm.{name}") or name not in self._alarms or not seq.isdecimal() or len(seq) > 18:
            return ua.StatusCode(ua.StatusCodes.BadEventIdUnknown)
        alarm, comment = self._alarms[name], given[1].Value
        if alarm.seq == int(seq) and not alarm.unacknowledged and "Latched" not in alarm.state:
            return ua.StatusCode(ua.StatusCodes.BadConditionBranchAlreadyAcked)
        text = getattr(comment, "Text", None) or ""
        code, _ = await self._operator.acknowledge(self._operator.caller, name, text, int(seq))
        return code

    def _alarm_of(self, parent: Any) -> Optional[Alarm]:
        """Of a condition, or of its ShelvingState."""
        name = str(parent.Identifier).removeprefix("alarm.").removesuffix("/ShelvingState")
        return self._alarms.get(name) if parent.NamespaceIndex == self._ns else None

    async def _shelve_condition(self, parent: Any, seconds: float, once: bool = False) -> Any:
        codes, alarm = self._ua.StatusCodes, self._alarm_of(parent)
        if alarm is None:
            return self._ua.StatusCode(codes.BadNodeIdUnknown)
        if (alarm.shelved != 0) == (seconds > 0):
            return self._ua.StatusCode(codes.BadConditionAlreadyShelved if seconds else codes.BadConditionNotShelved)
        if seconds > alarm.shelve_max:
            return self._ua.StatusCode(codes.BadShelvingTimeOutOfRange)
        code, _ = await self._operator.shelve(self._operator.caller, alarm.name, seconds, once=once)
        return code

    async def _timed_shelve(self, parent: Any, *given: Any) -> Any:
        if not _are(given, float):
            return self._wrong()
        ms = given[0].Value
        if not ms >= 1000:
            return self._ua.StatusCode(self._ua.StatusCodes.BadShelvingTimeOutOfRange)
        return await self._shelve_condition(parent, ms / 1000)

    async def _one_shot_shelve(self, parent: Any, *given: Any) -> Any:
        alarm = self._alarm_of(parent)
        return await self._shelve_condition(parent, alarm.shelve_max if alarm else 1.0, once=True)

    async def _unshelve(self, parent: Any, *given: Any) -> Any:
        return await self._shelve_condition(parent, 0.0)

    async def _enable(self, parent: Any, *given: Any) -> Any:
        """All are, always."""
        return self._ua.StatusCode(self._ua.StatusCodes.BadConditionAlreadyEnabled)

    async def _disable(self, parent: Any, *given: Any) -> Any:
        """Nor is there a comment but that of an acknowledgement or a shelving."""
        return self._ua.StatusCode(self._ua.StatusCodes.BadNotSupported)

    # ---- Showing ------------------------------------------------------------------------------------------------

    async def show(self, seen: "Seen") -> None:
        """As it is now: nodes whose values are other ones, and an event for each alarm that has moved."""
        names = {a.name: a for a in seen.alarms}
        if seen.tags != self._tags or names.keys() != self._alarms.keys():
            await self._build(seen.tags, seen.alarms)
            self._tags, self._alarms = seen.tags, {}
        for tag in seen.tags:
            of = self._id(f"{tag.table}.{tag.name}")
            value = self._value_of(tag, seen) if of in self._shown else None
            if value is not None:
                await self._put(of, value)
        for name, alarm in names.items():
            await self._show_alarm(alarm, self._alarms.get(name))
        self._alarms = names

    def _value_of(self, tag: Tag, seen: "Seen") -> Optional[Value]:
        if tag.table != "opmode":
            return seen.values.get((tag.table, tag.id))
        actual = seen.values.get(("actual", lib.apc_variable_number(self._opmode, tag.id)))
        return actual if actual and actual.time else seen.values.get((tag.table, tag.id))

    async def _put(self, of: Any, value: Value) -> None:
        ua = self._ua
        now = (value.time, value.status, repr(value.value))
        if self._shown[of] == now:
            return
        self._shown[of] = now
        if self._is_mode(of):
            variant = ua.Variant(Mode(int(value.value)).name if value.value in list(Mode) else "", ua.VariantType.String)
        else:
            variant = ua.Variant(value.value, ua.VariantType.Double)
        await self._server.write_attribute_value(of, ua.DataValue(
            variant, ua.StatusCode(int(value.status)), SourceTimestamp=_when(value.time),
            ServerTimestamp=datetime.now(timezone.utc)))

    def _is_mode(self, of: Any) -> bool:
        return bool(of.Identifier.startswith("opmode."))

    async def put(self, of: Any, force: Any) -> None:
        """What has just been written and is in force."""
        kind = self._ua.VariantType.String if self._is_mode(of) else self._ua.VariantType.Double
        await self._server.write_attribute_value(of, self._ua.DataValue(
            self._ua.Variant(force, kind), SourceTimestamp=datetime.now(timezone.utc)))

    async def away(self) -> None:
        """The store does not answer: what was known last, with a status that says so."""
        ua = self._ua
        for of in self._shown:
            if not of.Identifier.startswith("alarm."):
                last = self._server.read_attribute_value(of).Value
                await self._server.write_attribute_value(of, ua.DataValue(
                    last, ua.StatusCode(ua.StatusCodes.BadNoCommunication), SourceTimestamp=datetime.now(timezone.utc)))
                self._shown[of] = None

    async def _show_alarm(self, alarm: Alarm, before: Optional[Alarm]) -> None:
        ua, of = self._ua, f"alarm.{alarm.name}"
        if before is None or alarm.shelved or before.shelved:
            await self._server.write_attribute_value(self._id(f"{of}/ShelvingState/UnshelveTime"), ua.DataValue(
                ua.Variant(max(0.0, (alarm.shelved - time_ns()) / 1e6) if alarm.shelved else 0.0, ua.VariantType.Double)))
        if before == alarm:
            return
        shelving = _shelving(alarm)
        event, when = self._event(alarm), _when(alarm.time)
        for name, value in [("State", ua.Variant(alarm.state)), ("ShelvingState/CurrentState", ua.Variant(ua.LocalizedText(shelving))),
                            ("ShelvingState/CurrentState/Id", ua.Variant(self._shelving_id(shelving))),
                            *((path, ua.Variant(getattr(event, path), ua.VariantType[kind])) for path, kind in _CONDITION)]:
            await self._server.write_attribute_value(self._id(f"{of}/{name}"), ua.DataValue(value, SourceTimestamp=when))
        if alarm.seq and (before is None or before.seq != alarm.seq) and (before is not None or alarm.state != "Normal"):
            await self._server.iserver.subscription_service.trigger_event(event)

    def _event(self, alarm: Alarm) -> Any:
        ua, of = self._ua, self._id(f"alarm.{alarm.name}")
        event = self._events.AlarmCondition()
        event.emitting_node = ua.NodeId(ua.ObjectIds.Server)
        event.add_property("NodeId", of, ua.VariantType.NodeId)
        event.EventId = f"{alarm.name}:{alarm.seq}".encode()
        event.SourceNode, event.SourceName, event.ConditionName = of, alarm.name, alarm.name
        event.Time, event.ReceiveTime = _when(alarm.time) or _NEVER, datetime.now(timezone.utc)
        event.Severity = _SEVERITY[alarm.priority]
        event.Message = ua.LocalizedText(alarm.message or alarm.name)
        event.ConditionClassId = ua.NodeId(ua.ObjectIds.ProcessConditionClassType)
        event.ConditionClassName = ua.LocalizedText("ProcessConditionClassType")
        event.BranchId, event.ClientUserId = ua.NodeId(), alarm.author
        event.Retain = alarm.active or alarm.unacknowledged or "Latched" in alarm.state
        event.Quality, event.LastSeverity = ua.StatusCode(), _SEVERITY[alarm.priority]
        event.Comment, event.InputNode = ua.LocalizedText(""), ua.NodeId()
        for name in ("Quality", "LastSeverity", "Comment"):
            setattr(event, f"{name}/SourceTimestamp", event.Time)
        masked = alarm.state.split(",")[0] in ("Shelved", "One-shot Shelved", "Suppressed by Design", "Out of Service")
        for name, is_, yes, no in (("EnabledState", True, "Enabled", "Disabled"),
                                   ("ActiveState", alarm.active, "Active", "Inactive"),
                                   ("AckedState", not alarm.unacknowledged, "Acknowledged", "Unacknowledged"),
                                   ("SuppressedState", alarm.state.startswith("Suppressed"), "Suppressed", "Unsuppressed"),
                                   ("OutOfServiceState", alarm.state.startswith("Out of"), "Out of Service", "In Service")):
            setattr(event, name, ua.LocalizedText(yes if is_ else no))
            setattr(event, f"{name}/Id", is_)
        event.SuppressedOrShelved = masked
        event.add_property("ShelvingState/CurrentState", ua.LocalizedText(_shelving(alarm)), ua.VariantType.LocalizedText)
        return event


def _shelving(alarm: Alarm) -> str:
    """As Part 9 calls it."""
    return "Unshelved" if not alarm.shelved else "OneShotShelved" if "One-shot" in alarm.state else "TimedShelved"


def _is_loop(tag: Tag) -> bool:
    return 0 < tag.id < _SWITCHES and bool(tag.controller)


def _are(given: Any, *kinds: type) -> bool:
    return len(given) == len(kinds) and all(isinstance(g.Value, k) for g, k in zip(given, kinds))


def _when(time: int) -> Optional[datetime]:
    if time <= 0:
        return None
    return datetime.fromtimestamp(time // 10**9, timezone.utc).replace(microsecond=time % 10**9 // 1000)
