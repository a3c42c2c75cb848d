"""The geometry of a floor (point cloud, obstacle, explored and frontier grids) and its value map (eq. 2)."""
