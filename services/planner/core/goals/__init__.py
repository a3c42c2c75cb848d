"""What the robot may head for: objects, frontiers, floors, stairs. Questions only: nothing here changes the memory."""
