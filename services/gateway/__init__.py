"""The gateway: REST resources for missions, cameras, robots, objects, maps and traffic, event streams, and a web page."""
