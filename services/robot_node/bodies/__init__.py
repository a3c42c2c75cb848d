"""What moves and sees: the protocol ``Body`` (``body``), and a robot in a simulated building (``simulated``)."""
