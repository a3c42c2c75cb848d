"""One robot: its body carries out commands, it publishes observations. Simulated or real, the contract is the same."""
