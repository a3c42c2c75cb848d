"""Queries: served from a bounded queue on threads of their own, and asked with a time limit."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote, unquote

import zenoh

from surveilnav.bus.connection import (
    CONGESTION,
    PRIORITY,
    Connection,
    Received,
    bus_errors,
    bytes_of,
    check_size,
    encoding_of,
    handed_in,
    schema_in,
)
from surveilnav.bus.correlation import (
    attach_request_id,
    attached_request_id,
    bound_request_id,
    has_no_message,
    request_id,
)
from surveilnav.bus.handover import MIN_BYTES
from surveilnav.bus.wire import Refused, Unanswered, clock_ns, decode, encode
from surveilnav.contract import Stream
from surveilnav.errors import SurveilNavError, WireError
from surveilnav.messages import ErrorReply
from surveilnav.messages.base import Message

#: The parameter by which an asker tells the token of its ``HandoverFolder``.
_HANDOVER = "handover"
#: Name of the error when the queue is full.
BUSY = "busy"
#: Pause before a query is repeated whose answer was left out.
_RETRY_S = 0.05
#: Time within which the router reports who serves a key; it takes 5 ms on one machine.
_DISCOVERY_MS = 200


@dataclass(frozen=True, slots=True)
class Request:
    """A query to answer.

    Attributes:
        ids: the ids in its key, by field.
        parameters: its parameters by name.
        message: the stream's request message; None if the stream has none.
        payload: raw bytes beside the message.
        received_ns: when it arrived, in nanoseconds since the epoch.
    """

    ids: dict[str, str]
    parameters: dict[str, str]
    message: Any
    payload: bytes
    received_ns: int


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a query: a message, raw bytes beside it, and the ids of its own key if the query's key had wildcards."""

    message: Message
    payload: bytes = b""
    ids: dict[str, str] = field(default_factory=dict)


Answers = Answer | list[Answer]
Handler = Callable[[Request], Answers | Future[Answers]]
#: When a query that was refused as busy may be repeated [ms]; None: nobody knows.
RetryAfterMs = int | Callable[[], int] | None


class QueryServer:
    """Answers the queries to one key with ``handler``, on ``workers`` threads of their own; see ``Node.serve``.

    A handler that returns a future occupies no thread until it answers, and isn't counted in ``capacity``.
    """

    def __init__(
        self,
        connection: Connection,
        stream: Stream,
        key: str,
        handler: Handler,
        *,
        workers: int,
        capacity: int,
        retry_after_ms: RetryAfterMs = None,
    ) -> None:
        self._connection, self._stream, self._key, self._handler = connection, stream, key, handler
        self._retry_after_ms = retry_after_ms
        self._waiting: queue.Queue[Any] = queue.Queue(maxsize=capacity)
        connection.keep(connection.session_for(stream).declare_queryable(key, self._on_query))
        for i in range(workers):
            connection.start_thread(self._work, f"serve-{stream.name}-{i}")

    def _on_query(self, query: Any) -> None:
        try:
            self._waiting.put_nowait((query, clock_ns()))
        except queue.Full:
            n, after_ms = self._waiting.maxsize, self._retry_after_ms
            message = f"{n} queries are waiting already: ask again later or ask another"
            self._refuse(query, BUSY, message, after_ms() if callable(after_ms) else after_ms)

    def _work(self) -> None:
        while not self._connection.stopping.is_set():
            try:
                query, received_ns = self._waiting.get(timeout=0.2)
            except queue.Empty:
                continue
            self._answer(query, received_ns)

    def _answer(self, query: Any, received_ns: int) -> None:
        if self._is_meant_for_another(query):
            query.drop()
            return
        id = attached_request_id(bytes_of(query.attachment))
        with bound_request_id(id):
            try:
                answers = self._handler(self._request(query, received_ns))
            except Exception as error:
                self._fail(query, error)
                return
            if not isinstance(answers, Future):
                self._send(query, answers)
                return
        answers.add_done_callback(lambda done: self._send_result(query, done, id))

    def _send_result(self, query: Any, done: Future[Answers], request_id: str) -> None:
        """Answers a query whose handler returned a future."""
        with bound_request_id(request_id):
            self._send_or_fail(query, done)

    def _send_or_fail(self, query: Any, done: Future[Answers]) -> None:
        try:
            answers = done.result()
        except Exception as error:
            self._fail(query, error)
        else:
            self._send(query, answers)

    def _is_meant_for_another(self, query: Any) -> bool:
        """Whether a query with wildcards is for another stream, whose keys match this one's: then it carries no request."""
        if self._stream.request is None or "*" not in str(query.key_expr):
            return False
        return not bytes_of(query.payload) and has_no_message(bytes_of(query.attachment))

    def _send(self, query: Any, answers: Answers) -> None:
        try:
            for answer in answers if isinstance(answers, list) else [answers]:
                self._reply(query, answer)
        except zenoh.ZError as error:
            self._connection.warn_seldom("reply failed", stream=self._stream.name, error=str(error))
        except Exception as error:
            self._fail(query, error)
        finally:
            query.drop()  # otherwise the caller waits until its timeout

    def _fail(self, query: Any, error: Exception) -> None:
        """Answers with an error. A bug in a handler must not end the service, nor go unnoticed."""
        if isinstance(error, WireError):
            self._connection.reject(self._stream.name, str(error))
            self._refuse(query, "bad_message", str(error))
        elif isinstance(error, Refused):
            self._refuse(query, error.name, str(error), error.retry_after_ms)
        elif isinstance(error, SurveilNavError):
            self._refuse(query, "failed", str(error))
        else:
            self._connection.error_seldom("query failed", self._stream.name, error)
            self._refuse(query, "internal", f"{type(error).__name__}: {error}")

    def _request(self, query: Any, received_ns: int) -> Request:
        """Decodes and checks a query. Raises WireError."""
        stream, key = self._stream, str(query.key_expr)
        payload, attachment = bytes_of(query.payload), bytes_of(query.attachment)
        self._connection.traffic.count(key, "delivered", len(payload) + len(attachment) + len(key))
        message = None
        if stream.request is not None:
            if not (attachment or payload):
                raise WireError(f"expected a {stream.request.__name__}, got a query without a payload")
            data, payload = (attachment, payload) if attachment else (payload, b"")
            message = decode(stream.request, data, schema_in(query.encoding))
        ids = stream.ids_of(key) or {}
        if not ids and stream.allows_wildcard:  # everyone is asked, each for its own
            ids = stream.ids_of(self._key) or {}
        if stream.kind == "query" and stream.request is not None and not ids:
            raise WireError(f"expected a key like {stream.key} without wildcards, got {key!r:.120}")
        parameters = {name: value for name, value in _parameters(query).items() if name != _HANDOVER}
        return Request(ids, parameters, message, payload, received_ns)

    def _reply(self, query: Any, answer: Answer) -> None:
        key = str(query.key_expr)
        if "*" in key:  # everyone is asked, and each answers on its own key
            key = self._key if "*" not in self._key else self._connection.key(self._stream, **answer.ids)
            if not query.key_expr.intersects(zenoh.KeyExpr(key)):
                return  # the query was for another stream, whose keys match this one's
        header = encode(answer.message)
        check_size(key, header, answer.payload)
        handed = self._handed(query, answer.payload)
        payload = b"" if handed else answer.payload
        encoding = encoding_of(type(answer.message), handed=handed)
        # the reply has the query's priority and congestion control
        if self._stream.payload:
            query.reply(key, payload, attachment=header, encoding=encoding)
        else:
            query.reply(key, header, encoding=encoding)
        self._connection.traffic.count(key, "offered", len(header) + len(payload) + len(key))

    def _handed(self, query: Any, payload: bytes) -> str:
        """The name under which a payload was left for the asker; empty if it has to be sent."""
        folder = self._connection.handover
        if len(payload) < MIN_BYTES or not folder.token or _parameters(query).get(_HANDOVER) != folder.token:
            return ""
        return folder.put(payload)

    def _refuse(self, query: Any, name: str, message: str, retry_after_ms: int | None = None) -> None:
        error = ErrorReply(stamp_ns=clock_ns(), name=name, message=message, retry_after_ms=retry_after_ms)
        try:
            query.reply_err(encode(error), encoding=encoding_of(ErrorReply))
        except zenoh.ZError as failure:
            self._connection.warn_seldom("refusal failed", error=str(failure))
        finally:
            query.drop()


@dataclass(frozen=True, slots=True)
class Question:
    """A query to a key of a stream. ``is_sent``: the answer must not be handed over in a folder."""

    connection: Connection
    stream: Stream
    key: str
    request: Message | None = None
    payload: bytes = b""
    parameters: dict[str, str] | None = None
    is_sent: bool = False

    def ask(self, timeout_s: float) -> Received[Any]:
        """Sends it and returns its one answer. If answers of the stream may be left out, it is repeated until one arrives.

        Raises:
            Refused: the answer is an error.
            Unanswered: nobody serves the key, or (``timed_out``) not in time.
        """
        until_s = time.monotonic() + timeout_s
        with self._one_large_answer_at_a_time(timeout_s):
            while (left_s := until_s - time.monotonic()) > 0:
                if received := self._ask_once(left_s):
                    return received
                if self.stream.when_full == "wait" or not self._is_served():
                    raise Unanswered(f"no answer from {self.key}: nobody is there", timed_out=False)
                if self.connection.stopping.wait(_RETRY_S):
                    break
        raise Unanswered(f"no answer from {self.key}: a link on its way is full", timed_out=True)

    def ask_all(self, timeout_s: float) -> list[Received[Any]]:
        """Sends it to all who serve the key, and returns the answers that arrive in time, without errors."""
        replies = (reply.ok for reply in replace(self, is_sent=True)._replies(timeout_s) if reply.ok is not None)
        answers = [self.connection.decode(self.stream, reply) for reply in replies]
        return [answer for answer in answers if answer is not None]

    @contextmanager
    def _one_large_answer_at_a_time(self, timeout_s: float) -> Iterator[None]:
        """Has a process wait for only one answer that may be left out: on a slow link, two would crowd out each other.

        Raises:
            Unanswered: another one took too long.
        """
        if self.stream.when_full == "wait":
            yield
            return
        if not self.connection.large_answer.acquire(timeout=timeout_s):
            why = f"this process waited {timeout_s:g} s for others"
            raise Unanswered(f"no answer from {self.key}: {why}", timed_out=True)
        try:
            yield
        finally:
            self.connection.large_answer.release()

    def _ask_once(self, timeout_s: float) -> Received[Any] | None:
        """The answer; None if none came and none will. Raises Refused or Unanswered."""
        refused: Refused | None = None
        timed_out = unreadable = is_lost = False
        until_s = time.monotonic() + timeout_s
        for reply in self._replies(timeout_s):
            if reply.ok is not None:
                if received := self.connection.decode(self.stream, reply.ok):
                    if whole := self._with_payload(received, handed_in(reply.ok.encoding)):
                        return whole
                    is_lost = True
                else:
                    unreadable = True
            elif (refused := _refusal(reply.err)) is None:
                timed_out = True
        if is_lost and not self.is_sent and (left_s := until_s - time.monotonic()) > 0:
            return replace(self, is_sent=True)._ask_once(left_s)
        unreadable |= is_lost
        if refused:
            raise refused
        if timed_out or unreadable:
            why = f"not within {timeout_s:.3g} s" if timed_out else "what came can't be read"
            raise Unanswered(f"no answer from {self.key}: {why}", timed_out=timed_out)
        return None

    def _with_payload(self, received: Received[Any], handed: str) -> Received[Any] | None:
        """An answer with the payload that was left for it in the folder; None: it isn't there any more."""
        if not handed:
            return received
        payload = self.connection.handover.get(handed)
        return None if payload is None else replace(received, payload=payload)

    def _is_served(self) -> bool:
        """Whether somebody serves the key. Without asking, an answer that was left out looks as if nobody did."""
        with bus_errors(self.key):
            querier = self.connection.session_for(self.stream).declare_querier(self.key)
            try:
                for _ in range(_DISCOVERY_MS // 10):
                    if querier.matching_status.matching:  # type: ignore[attr-defined]
                        return True
                    time.sleep(0.01)
                return False
            finally:
                querier.undeclare()  # type: ignore[no-untyped-call]

    def _replies(self, timeout_s: float) -> Iterator[Any]:
        options: dict[str, Any] = {}
        payload, header = self.payload, b""
        if self.request is not None:
            header = encode(self.request)
            options["encoding"] = encoding_of(type(self.request))
        if payload or request_id():
            attachment = attach_request_id(header)
        else:
            payload, attachment = header, b""
        check_size(self.key, attachment, payload)
        selector: Any = self.key
        parameters = dict(self.parameters or {})
        if self.stream.payload and not self.is_sent and (token := self.connection.handover.token):
            parameters[_HANDOVER] = token
        if parameters:
            selector = f"{self.key}?" + ";".join(f"{quote(k)}={quote(v)}" for k, v in parameters.items())
        self.connection.traffic.count(self.key, "offered", len(attachment) + len(payload) + len(self.key))
        with bus_errors(self.key):
            replies = self.connection.session_for(self.stream).get(
                selector,
                timeout=timeout_s,
                payload=payload or None,
                attachment=attachment or None,
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=PRIORITY[self.stream.priority],
                congestion_control=CONGESTION[self.stream.when_full],
                **options,
            )
        yield from replies


def _refusal(err: Any) -> Refused | None:
    """The error in an error reply; None if it is Zenoh's own timeout."""
    try:
        error = decode(ErrorReply, err.payload.to_bytes(), schema_in(err.encoding))
    except WireError:
        return None
    return Refused(error.name, error.message, error.retry_after_ms)


def _parameters(query: Any) -> dict[str, str]:
    pairs = (part.partition("=") for part in str(query.parameters).split(";") if part)
    return {unquote(name): unquote(value) for name, _, value in pairs}
