# SPDX-License-Identifier: BSD-3-Clause
"""HistoryRead of raw values: the rows of the store, so many at a time. A continuation point says where the next ones begin,
so that the server keeps nothing of who asks."""

from __future__ import annotations

from datetime import datetime, timezone
from importlib import import_module
from typing import Any, NamedTuple, Optional

from ..store import History, Store, Tag, range_of

_MOST = 10_000  # values of an answer
_SECOND = 10**9
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_END = 2**63 - 2  # the end of int64; "9999" is how clients say that there is none


class Asked(NamedTuple):
    """Raw values of a variable with since <= time < until, in ns of Unix time; 0: no bound."""

    tag: Tag
    since: int
    until: int
    forwards: bool
    most: int
    after: int = 0  #: forwards: the seq of the last one that was given before


def asked(tag: Tag, details: Any, continuation: Optional[bytes]) -> Asked:
    """What a request means. ValueError: it makes no sense, or the continuation point is none of ours."""
    start, end, most = _ns(details.StartTime), _ns(details.EndTime), details.NumValuesPerNode
    if (start > 0) + (end > 0) + (most > 0) < 2:
        raise ValueError("two of start, end and number")
    place = int(continuation.decode()) if continuation else 0
    if not 0 <= place < 2**63:
        raise ValueError(place)
    most = min(most or _MOST, _MOST)
    if start and not 0 < end < start:
        return Asked(tag, start, start + 1 if start == end else end, True, most, place)
    return Asked(tag, end + 1 if start and end else 0, (place or start or end) + 1, False, most)


def read(store: Store, a: Asked) -> tuple[History, Optional[bytes]]:
    """The rows, from the newest on where it goes backwards, and the continuation point; None: that was all."""
    rows = store._rows(a.tag, range_of(a.since, a.until, 0 if a.forwards else a.most + 1, a.after), a.most + 1)
    place = None
    if len(rows.seq) > a.most:
        place = str(rows.seq[a.most - 1] if a.forwards else rows.time[0].astype("i8")).encode()
    rest = slice(0, a.most) if a.forwards else slice(None, -a.most - 1, -1)
    return History(rows.tag, rows.seq[rest], rows.time[rest], rows.value[rest], rows.status[rest], rows.origin[rest]), place


def values(rows: History) -> list[Any]:
    ua = import_module("asyncua.ua")
    return [ua.DataValue(ua.Variant(value, ua.VariantType.Double), ua.StatusCode(status), SourceTimestamp=_when(time))
            for time, value, status in zip(rows.time.astype("i8").tolist(), rows.value.tolist(), rows.status.tolist())]


def _ns(time: Optional[datetime]) -> int:
    """Of what asyncua reads; what lies before 1970 is how nothing is said."""
    if time is None:
        return 0
    since = (time if time.tzinfo else time.replace(tzinfo=timezone.utc)) - _EPOCH
    return min(max(0, (since.days * 86400 + since.seconds) * _SECOND + since.microseconds * 1000), _END)


def _when(time: int) -> datetime:
    return datetime.fromtimestamp(time // _SECOND, timezone.utc).replace(microsecond=time % _SECOND // 1000)
