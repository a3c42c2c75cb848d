"""What a vision-language model is asked."""


def value_prompt(target: str) -> str:
    """The text that a view's embedding is compared with for the value map (the paper's section on it, eq. 2)."""
    return f"seems like there is a {target}"
