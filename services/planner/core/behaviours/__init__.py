"""What the robot does about the chosen option, on the way to it and there. Behaviours record what they do in the memory."""
