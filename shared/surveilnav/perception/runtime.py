"""On which device and with how many threads networks run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Runtime:
    """Settings of every network of a backend.

    Attributes:
        device: "auto" (a GPU if there is one), "cpu", "cuda", "cuda:1".
        threads: number of threads of a network on the CPU.
        compiled: whether PyTorch compiles networks, on a GPU only. The first pictures of each size then take minutes.
    """

    device: str = "auto"
    threads: int = 1
    compiled: bool = False
