"""Fusion: the joint maps of a building, made of what robots and surveillance cameras see.

What happens when a frame arrives (``service.FusionService.step``):

sources              keeps the subscriptions that eq. 1 asks for, and hands over the newest frame of each view
perception_client    has a perception worker look at it
words                what is looked for: open missions' targets, and a standing list
kept_pictures        cameras' newest pictures, looked at again for a new word
workers              asks the worker that answers soonest, another if that is late
durable_map          logs the view (``journal``, ``store``), then adds it to the joint map
core                 the joint map itself: cloud, obstacles, frontiers, values (eq. 2), objects (eq. 3)
revisions            announces what the maps have processed
replies              answers those who ask for layers and objects
"""
