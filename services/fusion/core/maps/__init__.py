"""The geometry of a floor (point cloud; obstacle, exploration and frontier maps), and its value map (eq. 2)."""
