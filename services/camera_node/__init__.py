"""One surveillance camera: encodes and publishes the views of its source while somebody listens.

sources/   where the pictures come from: the protocol ``Source``, the simulated one, one without its mask zones
zones      what nobody is shown: the file of mask zones, and its pixels
frames     pictures as bytes, each encoded once
service    puts the views that are due
eyes       the camera's own perception, for its summary
slots      which camera of the plan this process is
core       the decisions: which views to send, what the summary says
"""
