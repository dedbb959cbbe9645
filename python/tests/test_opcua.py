# SPDX-License-Identifier: BSD-3-Clause
"""What of the gateways of OPC UA needs no OPC UA."""

import asyncio
from collections.abc import Callable
from datetime import datetime, timezone
from types import SimpleNamespace

import pytest

from libapc.opcua import __main__ as command
from libapc.opcua import history, plant, server, units

_S = 10**9
_T0 = 1_700_000_000 * _S


@pytest.mark.parametrize("year", [1601, 1969, 2262, 9999])
def test_a_time_that_says_that_there_is_none_is_none(year: int) -> None:
    when = datetime(year, 12, 31, tzinfo=timezone.utc)
    assert plant._ns(when) is None
    assert history._ns(when) == (0 if year < 1970 else 2**63 - 2)


def test_a_history_without_an_end_is_read_from_its_begin_on() -> None:
    begin = datetime(2026, 1, 1, tzinfo=timezone.utc)
    details = SimpleNamespace(StartTime=begin, EndTime=datetime(9999, 12, 31), NumValuesPerNode=0)
    asked = history.asked(SimpleNamespace(), details, None)
    assert asked.forwards and asked.since == 1767225600 * _S and asked.until == 2**63 - 2


@pytest.mark.parametrize("say", [plant.say, server.say])
def test_what_a_peer_says_is_told_in_one_line_that_shows_as_it_is(say: Callable[[str], None], capsys: pytest.CaptureFixture[str]) -> None:
    say("the server: no\nway \x1b[2J\x9b\u202e\u2028\udc80ä")
    assert capsys.readouterr().err == "opcua: the server: no way ?[2J?? ?ä\n"


def test_a_value_at_rest_is_looked_at_by_each_answer() -> None:
    seen = plant.Seen()
    # changed long before the first look: from then on by the server's clock
    assert seen.look(_T0 - 3600 * _S, _T0, 5) == _T0
    assert seen.look(_T0 - 3600 * _S, _T0 + 9, 7 + 5) == _T0 + 7
    # a change has its own time, and what stands goes on from there
    assert seen.look(_T0 + _S, _T0 + 50 * _S, 100) == _T0 + _S
    assert seen.look(_T0 + _S, _T0 - 50 * _S, 100 + _S) == _T0 + 2 * _S
    assert seen.look(_T0 + _S, _T0 - 50 * _S, 100 + 3 * _S) == _T0 + 4 * _S
    # a clock that was set back
    assert seen.look(_T0 - _S, _T0, 100 + 4 * _S) == _T0 - _S


def test_a_source_whose_clock_is_ahead_keeps_its_time_and_one_without_has_the_servers() -> None:
    seen = plant.Seen()
    assert seen.look(_T0 + 3600 * _S, _T0, 0) == _T0 + 3600 * _S
    assert seen.look(_T0 + 3600 * _S, _T0, 9) == _T0 + 3600 * _S + 9
    seen = plant.Seen()
    assert [seen.look(None, _T0 + k, k) for k in range(3)] == [_T0, _T0 + 1, _T0 + 2]


@pytest.mark.parametrize("kind,low,high", [("SByte", -128, 127), ("Byte", 0, 255), ("Int16", -32768, 32767), ("UInt16", 0, 65535),
                                           ("Int32", -2**31, 2**31 - 1), ("UInt32", 0, 2**32 - 1), ("Float", -3e38, 3e38),
                                           ("Double", -1e300, 1e300)])
def test_what_fits_a_node_is_within_its_type(kind: str, low: float, high: float) -> None:
    of = SimpleNamespace(name=kind)
    assert plant._fits(low, of) and plant._fits(high, of)
    if kind == "Float":
        assert not plant._fits(3.5e38, of)
    elif kind != "Double":
        assert plant._fits(high + 0.4, of) and not plant._fits(high + 1, of) and not plant._fits(low - 1, of)
        assert not plant._fits(1e300, of)


@pytest.mark.parametrize("text,node,safe", [
    ("ns=2;i=5", "ns=2;i=5", 0.0), ("ns=2;i=5=7", "ns=2;i=5", 7.0), ("i=85=-0.5", "i=85", -0.5), ("i=85", "i=85", 0.0),
    ("ns=3;s=Pump.Speed=0", "ns=3;s=Pump.Speed", 0.0), ("ns=3;s=Pump.Speed", "ns=3;s=Pump.Speed", 0.0), ("ns=3;s=5", "ns=3;s=5", 0.0),
    ("ns=3;s=a=b=1e2", "ns=3;s=a=b", 100.0), ("ns=3;s=a=b", "ns=3;s=a=b", 0.0), ("nsu=urn:plc;s=Pump=7", "nsu=urn:plc;s=Pump", 7.0),
    ("nsu=http://a.b/?c=d;i=5", "nsu=http://a.b/?c=d;i=5", 0.0), ("nonsense", "nonsense", 0.0)])
def test_an_outputs_safe_value_is_told_from_its_id(text: str, node: str, safe: float) -> None:
    assert command._output(text) == (node, safe)


def test_units_have_the_numbers_of_their_common_codes() -> None:
    # of the table that the OPC Foundation publishes
    assert [units.number(unit) for unit in ("degC", "°C", "%", "V", "cm", "m3/h", "l/min", "kPa", "mol/L", "N m")] == [
        4408652, 4408652, 20529, 5655636, 4410708, 5067080, 19506, 4935745, 4404024, 20053]
    assert units.number("") is None and units.number("mol%") is None


class _Peer:
    """An OPC UA server with two outputs and no measurement, which takes one node in a request and refuses some values."""

    def __init__(self) -> None:
        self.refuses: set[float] = set()
        self.given: dict[str, float] = {}

    async def write_attributes(self, nodes: list[str], values: list[float], attribute: None) -> list[SimpleNamespace]:
        assert len(nodes) == 1
        if values[0] in self.refuses:
            return [SimpleNamespace(name="BadOutOfRange", is_good=lambda: False)]
        self.given[nodes[0]] = values[0]
        return [SimpleNamespace(name="Good", is_good=lambda: True)]


# Promise(links/opcua-refused): An output that a server refuses costs no other: those are written, and have their safe
#   values only without new commands.
def test_an_output_that_is_refused_costs_no_other(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    ua = SimpleNamespace(AttributeIds=SimpleNamespace(Value=None), UaError=RuntimeError, Variant=lambda number, kind: number,
                         DataValue=lambda value, status: value)
    monkeypatch.setattr(plant, "import_module", lambda name: ua)
    now = 1000.0
    monkeypatch.setattr(plant, "monotonic", lambda: now)
    peer = _Peer()

    async def commanded(gateway: plant.Gateway, time: int, *u: float) -> bool:
        for sample, value in zip(gateway._samples, u):
            sample.value, sample.time, sample.status = value, time, 0
        return await gateway._command(len(u))

    async def run() -> None:
        nonlocal now
        gateway = plant.Gateway(plant.Options("opc.tcp://peer", "", 0, (), (("u", -1.0), ("v", -2.0))))
        gateway._client, gateway._writes = SimpleNamespace(uaclient=peer), 1
        gateway._output = [SimpleNamespace(nodeid=name) for name in "uv"]
        gateway._kinds = [SimpleNamespace(name="Double")] * 2
        assert await commanded(gateway, 1, 5.0, 6.0) and peer.given == {"u": 5.0, "v": 6.0}
        peer.refuses = {7.0}
        assert not await commanded(gateway, 2, 7.0, 8.0) and peer.given == {"u": 5.0, "v": 8.0}
        now += 4
        assert not await commanded(gateway, 3, 7.0, 9.0) and peer.given == {"u": 5.0, "v": 9.0}
        now += 4  # by now u has taken none for longer than the watchdog
        await gateway._safe("watchdog", now - 5)
        assert peer.given == {"u": -1.0, "v": 9.0}
        assert not await commanded(gateway, 3, 5.0, 9.0) and peer.given == {"u": -1.0, "v": 9.0}  # an old one brings nothing back
        assert await commanded(gateway, 4, 5.0, 9.0) and peer.given == {"u": 5.0, "v": 9.0}
        peer.refuses = {-1.0}  # and so it is with the safe values
        await gateway._safe("end", now)
        assert peer.given == {"u": 5.0, "v": -2.0}
        peer.refuses, peer.given = set(), {}
        await gateway._safe("end", now)
        assert peer.given == {"u": -1.0}

    asyncio.run(run())
    said = capsys.readouterr().err
    assert said.count("commands are refused: u: BadOutOfRange\n") == 1 and "watchdog: the safe values were written to u\n" in said
    assert "commands are taken again\n" in said and "end, and the safe values could not be written: u: BadOutOfRange\n" in said
