"""The error model of ``simulated``, fitted to a real detector."""
