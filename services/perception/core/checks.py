"""What a request must contain. Checked on arrival, before anything is decoded or queued."""

from __future__ import annotations

from surveilnav.errors import TargetError, WireError
from surveilnav.messages import InferRequest
from surveilnav.sensing.packing import check_rgbd
from surveilnav.services.perception.core.refusal import Refusal
from surveilnav.words import MAX_WORDS, validate_word

MAX_TEXTS, MAX_TEXT_CHARS = 256, 500


def check_view(request: InferRequest, payload: bytes, *, needs_prompts: bool) -> None:
    """Checks a request about a view. ``needs_prompts``: whether the backend finds only what it is asked for.

    Raises:
        WireError: there is no picture, or its header and its bytes don't fit each other.
        Refusal: "bad_prompt", "no_prompt", or "too_late" if the deadline has passed.
    """
    if request.camera is None or request.image is None or request.depth is None:
        raise WireError("a picture needs camera, image and depth in its request")
    if request.deadline_ms <= 0:
        raise Refusal("too_late", f"the deadline is {-request.deadline_ms} ms ago")
    if len(request.prompts) > MAX_WORDS:
        raise Refusal("bad_prompt", f"up to {MAX_WORDS} prompts can be looked for at once, got {len(request.prompts)}")
    for prompt in request.prompts:
        try:
            validate_word(prompt)
        except TargetError as error:
            raise Refusal("bad_prompt", f"a prompt can't be looked for: {error}") from error
    if needs_prompts and request.detects and not request.prompts:
        raise Refusal(
            "no_prompt",
            "this backend finds only what it is asked for: send prompts, or detects=false for the embedding",
        )
    check_rgbd(payload, request.image, request.depth, request.camera)


def check_texts(request: InferRequest) -> None:
    """Checks a request for text embeddings. Raises WireError if there are none or too many, or one is too long or blank."""
    if not 1 <= len(request.texts) <= MAX_TEXTS or any(len(text) > MAX_TEXT_CHARS for text in request.texts):
        raise WireError(
            f"expected 1 to {MAX_TEXTS} texts of up to {MAX_TEXT_CHARS} characters, got {len(request.texts)}, "
            f"the longest of {max(map(len, request.texts), default=0)}"
        )
    if bad := [text for text in request.texts if not text.isprintable() or not text.strip()]:
        raise WireError(f"a text holds letters, digits and signs that can be seen, got {bad[0][:40]!r}")
