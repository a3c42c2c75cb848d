"""What every backend of perception can do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import TrueInstances, ViewPerception


class Backend(Protocol):
    """Detects, segments and embeds; one instance serves one thread at a time.

    Attributes:
        name: the backend's name in messages and reports.
        why: one sentence for people: what runs, and why this one.
        embedding_dim: D of every embedding.
        needs_truth: it must be told what each pixel shows (simulation only).
    """

    name: str
    why: str
    embedding_dim: int
    needs_truth: bool

    def perceive(
        self,
        rgb: NDArray[np.uint8],
        depth_m: NDArray[np.float32],
        camera: Pinhole,
        *,
        prompts: Sequence[str] = (),
        truth: TrueInstances | None = None,
        key: tuple[object, ...] = (),
    ) -> ViewPerception:
        """What is seen in a registered RGB-D view.

        Args:
            rgb: (height, width, 3) uint8.
            depth_m: (height, width) float32 [m], 0 where there is none.
            camera: intrinsics of both.
            prompts: class names an open-vocabulary detector should look for; closed-set ones ignore them.
            truth: only for backends that need it.
            key: names the view (source, view, seq): what a backend draws by chance depends on nothing else.

        Raises:
            PerceptionError: the backend can't answer.
        """
        ...

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Unit embeddings (N, D) float32 of texts.

        Raises:
            TargetError: a text that this backend can't embed.
        """
        ...
