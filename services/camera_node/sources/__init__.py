"""Where a camera's pictures come from: the protocol ``Source`` (``source``), and a simulated building (``simulated``)."""
