"""One robot: its body carries out commands, it publishes observations. Simulated or real, the contract is the same.

bodies/      what moves and sees: the protocol ``Body``, the simulated one
core         the motion of a simulated robot, and what a robot says of itself
observation  a look as message and bytes
service      takes commands, one at a time, and publishes
"""
