"""Where a camera's pictures come from: the protocol ``Source`` (``source``), a simulated building (``simulated``), and the
wrapper that hides mask zones (``masked``)."""
