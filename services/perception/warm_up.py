"""Checks a backend before it gets requests: it looks at a probe picture."""

from __future__ import annotations

from surveilnav.errors import PerceptionError
from surveilnav.perception.backend import Backend
from surveilnav.services.perception.core import probe
from surveilnav.services.perception.embedding import EmbeddingStage


def check_backend(backend: Backend, embedding: EmbeddingStage, n_views: int) -> None:
    """Has a backend process ``n_views`` probe pictures at once, and embed a word.

    Raises:
        PerceptionError: the backend fails, or its answer is malformed.
    """
    tasks = [probe.probe_task() for _ in range(n_views)]
    try:
        for stage in backend.stages:
            stage.run(tasks)
        problems = [probe.find_problem(task.result, backend.embedding_dim) for task in tasks]
        problems.append(embedding.find_problem(probe.PROMPTS))
    except Exception as error:  # a model's library may raise anything
        problems = [f"{type(error).__name__}: {error}"]
    if problem := next(filter(None, problems), ""):
        raise PerceptionError(f"{backend.name} doesn't answer a probe picture rightly: {problem}")
