# SPDX-License-Identifier: BSD-3-Clause
"""What asyncua's server does otherwise than clients need it: requests of a connection that wait hold up no others, and a
subscription that is not there, or another session's, is said to be none (Part 4)."""

from __future__ import annotations

import asyncio
import secrets
from importlib import import_module
from typing import Any

_WAITING = 64  # requests of a connection that may wait: one more holds up the others


def processor() -> Any:
    """The class of what serves a connection. Writes and calls wait for the controller, reads of history for the store, each in
    the order in which they came, and meanwhile everything else is answered."""
    ua, base = import_module("asyncua.ua"), import_module("asyncua.server.uaprocessor").UaProcessor
    first = import_module("asyncua.ua.ua_binary").nodeid_from_binary
    ids = ua.ObjectIds
    queue_of = {ua.NodeId(ids.WriteRequest_Encoding_DefaultBinary): 0, ua.NodeId(ids.CallRequest_Encoding_DefaultBinary): 0,
                ua.NodeId(ids.HistoryReadRequest_Encoding_DefaultBinary): 1}

    class Processor(base):  # type: ignore[misc, valid-type]
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self._waits: set[asyncio.Task[None]] = set()
            self._turn = (asyncio.Lock(), asyncio.Lock())

        async def process_message(self, seqhdr: Any, body: Any) -> Any:
            queue = queue_of.get(first(body.copy()))
            if queue is None or len(self._waits) >= _WAITING:
                return await super().process_message(seqhdr, body)
            task = asyncio.create_task(self._wait(self._turn[queue], seqhdr, body))
            self._waits.add(task)
            task.add_done_callback(self._waits.discard)
            return True

        async def _wait(self, turn: asyncio.Lock, seqhdr: Any, body: Any) -> None:
            async with turn:
                if await super().process_message(seqhdr, body) is False:
                    self._transport.close()

        async def close(self) -> None:
            for task in self._waits:
                task.cancel()
            await super().close()

    return Processor


def number(iserver: Any) -> None:
    """Subscriptions by numbers that no former life of the server gave out: what a client still has from there is nobody's."""
    iserver.subscription_service._sub_id_counter = secrets.randbelow(2**30) + 2**29


def own(iserver: Any, session: Any) -> None:
    """A session's services by which a client learns that a subscription is gone, or another's; and its token, which is its
    alone, in other lives of the server as well."""
    ua = import_module("asyncua.ua")
    fault, service, publish = import_module("asyncua.common.utils").ServiceError, session.subscription_service, session.publish

    def republish(params: Any) -> Any:
        found = service.subscriptions.get(params.SubscriptionId)
        if found is None or found.session_id != session.session_id:
            raise fault(ua.StatusCodes.BadSubscriptionIdInvalid)
        kept = found._not_acknowledged_results.get(params.RetransmitSequenceNumber)
        if kept is None:
            raise fault(ua.StatusCodes.BadMessageNotAvailable)
        return kept.NotificationMessage

    def publish_own(acks: Any = None) -> Any:
        if not any(s.session_id == session.session_id for s in service.subscriptions.values()):
            raise fault(ua.StatusCodes.BadNoSubscription)
        return publish(acks)

    session.republish, session.publish = republish, publish_own
    iserver.unregister_external_session(session)
    session.auth_token = ua.NodeId(secrets.token_bytes(32), 0, ua.NodeIdType.ByteString)
    iserver.register_external_session(session)
