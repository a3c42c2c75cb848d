"""Views before they reach a map: whether they can be, which cameras send them (eq. 1), and in which order they are looked at."""
