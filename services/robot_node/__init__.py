"""One robot: its body carries out commands, the node publishes what it observes. The contract is the same for a simulated
and a real robot.

bodies/      what moves and sees: the protocol ``Body``, and the simulated robot
service      carries out one command at a time, publishes observations and status
core         the node's rules: halting, and the state that it reports
halt_switch  the halt, kept on disk so that a restart doesn't release the robot
observation  an observation as message and payload
verdicts     simulation only: whether a stop was a success
"""
