"""What the robot may go to: objects, frontiers, floors. Questions only: nothing here changes what a mission remembers."""
