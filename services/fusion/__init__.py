"""Fusion: the joint maps of a building, made from what robots and surveillance cameras see.

``service.FusionService.step`` shows what happens to a frame:

intake/        subscribes to robots and to the cameras that eq. 1 invokes, and has perception workers look at the newest frames
map_log/       logs each perceived view, and integrates it into the maps; after a restart, it restores the maps
core/          the joint maps themselves: point cloud, obstacles, frontiers, values (eq. 2), objects (eq. 3)
answers/       announces revisions, and answers queries for layers, objects and the log
"""
