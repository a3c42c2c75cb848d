"""Views before they reach a map: validation, camera invocation (eq. 1), and the order in which they are perceived."""
