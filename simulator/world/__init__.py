"""A scene as a robot meets it: geometry, rays, free ground, ways, goals, places for cameras."""
