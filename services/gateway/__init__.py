"""The gateway: missions, cameras, robots, objects, map layers and traffic over HTTP, and a plain page."""
