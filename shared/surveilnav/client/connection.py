"""Requests to the gateway, and what their answers mean. Every failure is a ``GatewayError``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from surveilnav import rest
from surveilnav.client.events import ServerEvent, follow
from surveilnav.errors import GatewayError

R = TypeVar("R", bound=BaseModel)
T = TypeVar("T")
#: The most items that are read of a list: the newest, where it has an order of time.
_MAX_ITEMS = 1000


class GatewayConnection:
    """The connections to the gateway at ``url``. The arguments are those of ``Client``. Thread-safe."""

    def __init__(self, url: str, timeout_s: float, transport: httpx.BaseTransport | None, api_key: str = "") -> None:
        self.url = url
        try:
            headers = {"Authorization": f"Bearer {api_key}"} if api_key else {}
            self._http = httpx.Client(base_url=url, timeout=timeout_s, transport=transport, headers=headers)
        except httpx.InvalidURL as error:
            raise self._unreachable(error) from error

    def close(self) -> None:
        """Closes its connections."""
        self._http.close()

    def one(self, model: type[R], method: str, path: str, **options: Any) -> R:
        """The resource that a request to a path below ``rest.ROOT`` is answered with."""
        return self.parsed(model, path, self.json(method, f"{rest.ROOT}/{path}", **options))

    def items(self, model: type[R], method: str, path: str, **options: Any) -> list[R]:
        """The list of resources that a request to a path below ``rest.ROOT`` is answered with."""
        if method == "GET":
            options["params"] = {"limit": _MAX_ITEMS, **options.get("params", {})}
        answer = self.json(method, f"{rest.ROOT}/{path}", **options)
        return self.parsed(rest.Items[model], path, answer).items  # type: ignore[valid-type]

    def content(self, path: str, **params: Any) -> bytes:
        """A file below ``rest.ROOT``."""
        return self.request("GET", f"{rest.ROOT}/{path}", params=params).content

    def download(self, path: str, to: Path) -> None:
        """Writes a file below ``rest.ROOT`` to the disk, piece by piece. Raises OSError as the disk does."""
        with self._http.stream("GET", f"{rest.ROOT}/{path}") as answer:
            if answer.is_error:
                answer.read()
                raise self._refusal(answer)
            with to.open("wb") as file:
                for piece in answer.iter_bytes():
                    file.write(piece)

    def parsed(self, model: type[R], path: str, answer: Any) -> R:
        """The resource in an answer from ``path``."""
        try:
            return model.model_validate(answer)
        except ValidationError as error:
            raise self._bad_answer(path, model.__name__, error) from error

    def _bad_answer(self, path: str, expected: str, error: ValidationError) -> GatewayError:
        wrong = error.errors()[0]
        where = ".".join(str(part) for part in wrong["loc"]) or "the answer"
        return GatewayError(
            "bad_answer",
            f"expected {expected} from {path} of {self.url}, got something else ({where}: {wrong['msg']}). The gateway may be of "
            "another version than this client.",
        )

    def json(self, method: str, path: str, **options: Any) -> Any:
        """The JSON that a request is answered with."""
        answer = self.request(method, path, **options)
        try:
            return answer.json()
        except ValueError:
            raise self._no_json(answer) from None

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        """The answer to a request, which is no error."""
        try:
            answer = self._http.request(method, path, **options)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise self._unreachable(error) from error
        if answer.is_error:
            raise self._refusal(answer)
        return answer

    def follow(self, path: str, last_id: str, parse: Callable[[str, dict[str, Any]], T]) -> Iterator[ServerEvent[T]]:
        """The events of a stream below ``rest.ROOT``, as ``parse`` makes them of their kind and data."""

        def parsed(kind: str, data: dict[str, Any]) -> T:
            try:
                return parse(kind, data)
            except ValidationError as error:
                raise self._bad_answer(path, f"an event ({kind})", error) from error

        return follow(self._http, f"{rest.ROOT}/{path}", last_id, parsed, self._refusal, self._unreachable)

    def _unreachable(self, error: Exception) -> GatewayError:
        return GatewayError(
            "no_gateway",
            f"no gateway answers at {self.url} ({error}). Start one with `surveilnav up` or `docker compose up`, or name its "
            "address with --url or SURVEILNAV_URL.",
        )

    def _refusal(self, answer: httpx.Response) -> GatewayError:
        """The problem that an error answer has (RFC 9457); errors of other servers go by their status."""
        try:
            problem = answer.json()
        except ValueError:
            return self._no_json(answer)
        problem = problem if isinstance(problem, dict) else {}
        name = str(problem.get("type", "")).rpartition(":")[2] or str(answer.status_code)
        return GatewayError(name, str(problem.get("detail") or problem.get("title") or answer.reason_phrase))

    def _no_json(self, answer: httpx.Response) -> GatewayError:
        what = f"{answer.url.path} answered {answer.status_code} without JSON"
        return GatewayError("no_gateway", f"{self.url} isn't a SurveilNav gateway: {what}")
