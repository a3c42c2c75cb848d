"""Asks a language model over HTTP, by chat completions as in OpenAI's interface, which most servers of models have.

Every question is kept in a file with its answer, its tokens and the seconds that it took. The file is the cache, so that a run
that was killed gets the same answers again, and it says what the run cost.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import httpx
import msgspec
from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.benchmark import journal
from surveilnav.errors import ConfigError

ANSWERS_FILE = "answers.jsonl"
_MAX_BYTES = 1 << 20
_T = TypeVar("_T")
#: answered, or known from the cache; no answer in time; an HTTP status of failure; no server; no chat completion; an answer that
#: can't be used.
Outcome = Literal["answered", "cached", "timed_out", "refused", "unreachable", "malformed", "unusable"]
FAILURES: tuple[str, ...] = get_args(Outcome)[2:]
_Tokens = Annotated[int, msgspec.Meta(ge=0, le=10**9)]


class LanguageModelSettings(BaseSettings):
    """Where the language model is that the benchmark's policy ``llm`` asks. Which model it is, is a setting of the run."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_LLM__", extra="ignore")

    url: str = Field(
        default="",
        description="the address below which a server answers `/chat/completions` as OpenAI's does, such as "
        "`http://127.0.0.1:8000/v1`; empty: there is none, and the policy `llm` can't be played",
    )
    key: str = Field(default="", repr=False, description="its API key; empty: it needs none")
    timeout_s: float = Field(
        default=20.0, gt=0, le=600, description="an answer that takes longer is given up; that decision is then ours"
    )

    @classmethod
    def of_environment(cls) -> LanguageModelSettings:
        """ConfigError: no server is named, or a setting can't be."""
        try:
            settings = cls()
        except ValidationError as error:
            raise ConfigError(f"these settings of the language model can't be: {error}") from error
        if not settings.url.startswith(("http://", "https://")):
            raise ConfigError(
                "the policy 'llm' asks a language model: set SURVEILNAV_LLM__URL to the address of a server with OpenAI's "
                f"interface, such as http://127.0.0.1:8000/v1; it is {settings.url!r}"
            )
        if not (settings.key.isascii() and settings.key.isprintable()):
            raise ConfigError(
                "SURVEILNAV_LLM__KEY has characters that can't be sent: expected letters, digits and signs of ASCII"
            )
        return settings


class Question(msgspec.Struct, frozen=True, kw_only=True):
    """A question as it is kept. ``key``: a hash of model and prompt. ``text``: the answer, empty if there is none."""

    key: str
    outcome: Outcome
    text: str = ""
    prompt_tokens: int = 0
    completion_tokens: int = 0
    seconds: float = 0.0


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """What questions cost. ``asked``: how many were sent; ``cached``: how many were known. ``failed``: of those sent, by
    ``FAILURES``. ``seconds``: waited for answers. Tokens are as the server counts them, 0 if it doesn't."""

    asked: int
    cached: int
    failed: dict[str, int]
    prompt_tokens: int
    completion_tokens: int
    seconds: float

    @classmethod
    def of(cls, questions: Iterable[Question]) -> Cost:
        """The sum."""
        every = list(questions)
        outcomes = Counter(q.outcome for q in every)
        return cls(
            asked=len(every) - outcomes["cached"],
            cached=outcomes["cached"],
            failed={name: outcomes[name] for name in FAILURES if outcomes[name]},  # type: ignore[index]
            prompt_tokens=sum(q.prompt_tokens for q in every),
            completion_tokens=sum(q.completion_tokens for q in every),
            seconds=round(sum(q.seconds for q in every), 3),
        )

    def __str__(self) -> str:
        why = f" ({', '.join(f'{n} {name}' for name, n in self.failed.items())})" if self.failed else ""
        mean_s = self.seconds / self.asked if self.asked else 0.0
        return (
            f"{self.asked} questions asked, {self.cached} known from the cache, {sum(self.failed.values())} without an answer "
            f"that could be used{why}; {self.prompt_tokens} prompt and {self.completion_tokens} completion tokens; "
            f"{self.seconds:.1f} s waited, {mean_s:.2f} s a question"
        )


def kept_questions(folder: Path) -> list[Question]:
    """All questions of a run in the order in which they were asked. ConfigError: the file can't be read."""
    path = folder / ANSWERS_FILE
    try:
        return [msgspec.json.decode(line, type=Question) for line in journal.lines(path)] if path.exists() else []
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{path} can't be read: {error}; move it away, and all questions are asked again") from error


class _Message(msgspec.Struct):
    content: str


class _Choice(msgspec.Struct):
    message: _Message


class _Usage(msgspec.Struct):
    prompt_tokens: _Tokens = 0
    completion_tokens: _Tokens = 0


class _Completion(msgspec.Struct):
    """Of a chat completion what is read."""

    choices: Annotated[list[_Choice], msgspec.Meta(min_length=1)]
    usage: _Usage | None = None


class LanguageModel:
    """A model on a server. Several processes may ask for the same run."""

    def __init__(self, model: str, settings: LanguageModelSettings, folder: Path) -> None:
        """``model``: its name on the server. ``folder``: of the run, there already. ConfigError: what is kept can't be read."""
        self._model, self._settings, self._path = model, settings, folder / ANSWERS_FILE
        self._known = {q.key: q for q in kept_questions(folder) if q.outcome == "answered"}
        headers = {"Authorization": f"Bearer {settings.key}"} if settings.key else {}
        self._http = httpx.Client(timeout=settings.timeout_s, headers=headers)

    def ask(self, system: str, text: str, parse: Callable[[str], _T | None]) -> _T | None:
        """The parsed answer to a prompt, known or asked for; None: no answer came in time, or none that can be parsed.

        Args:
            system, text: the system's and the user's message.
            parse: None for an answer that can't be used; such an answer is asked for again the next time.
        """
        body = {
            "model": self._model,
            "messages": [{"role": "system", "content": system}, {"role": "user", "content": text}],
            "temperature": 0,
        }
        key = hashlib.sha256(msgspec.json.encode(body)).hexdigest()[:32]
        if (known := self._known.get(key)) and (parsed := parse(known.text)) is not None:
            self._keep(Question(key=key, outcome="cached"))
            return parsed
        began_s = time.monotonic()
        outcome, completion = self._completion(body)
        seconds = round(time.monotonic() - began_s, 3)
        if completion is None:
            self._keep(Question(key=key, outcome=outcome, seconds=seconds))
            return None
        answer, usage = completion.choices[0].message.content, completion.usage or _Usage()
        parsed = parse(answer)
        question = Question(
            key=key,
            outcome="unusable" if parsed is None else "answered",
            text=answer,
            prompt_tokens=usage.prompt_tokens,
            completion_tokens=usage.completion_tokens,
            seconds=seconds,
        )
        self._keep(question)
        if parsed is not None:
            self._known[key] = question
        return parsed

    def _completion(self, body: dict[str, Any]) -> tuple[Outcome, _Completion | None]:
        """What the server answers; None, and why: nothing that is one."""
        url, until_s = f"{self._settings.url.rstrip('/')}/chat/completions", time.monotonic() + self._settings.timeout_s
        content = b""
        try:
            with self._http.stream("POST", url, json=body) as answer:
                for part in answer.iter_bytes():
                    content += part
                    if time.monotonic() > until_s:  # httpx waits so long for each part
                        return "timed_out", None
                    if len(content) > _MAX_BYTES:
                        return "malformed", None
            if answer.status_code != httpx.codes.OK:
                return "refused", None
            return "answered", msgspec.json.decode(content, type=_Completion)
        except httpx.TimeoutException:
            return "timed_out", None
        except (httpx.HTTPError, httpx.InvalidURL):
            return "unreachable", None
        except (msgspec.DecodeError, UnicodeDecodeError):
            return "malformed", None

    def _keep(self, question: Question) -> None:
        try:
            journal.append(self._path, msgspec.json.encode(question).decode())
        except OSError as error:
            raise ConfigError(f"{self._path} can't be written: {error}; is the disk full or read-only?") from error
