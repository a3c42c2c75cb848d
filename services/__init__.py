"""The microservices. Each is its own process; none imports another.

camera_node    a surveillance camera: sends a view while somebody listens
robot_node     a robot: carries out one action at a time, says what it sees
perception     detections and embeddings of a view, on request
fusion         the joint maps of all views; invokes the cameras
planner        missions: chooses waypoints, commands the robot, decides the stop
gateway        all of it over HTTP, and a page

In each, ``core`` decides and is pure, ``service`` puts it on the bus, ``__main__`` puts it together.
"""
