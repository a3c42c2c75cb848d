"""The recorder: every mission as one MCAP file, which Foxglove shows and ``surveilnav replay`` plays.

service            follows missions and records what is published about them
view_recorder      records every view that goes into fusion's maps, in fusion's order
map_recorder       records layers and objects for Foxglove, at intervals
prompt_embeddings  records the embedding of each mission's prompt
writer             writes the files on a thread of its own
folder, queries    the recordings that there are: listing, reading, deleting
recorded, reading  reads a recording
core               what a message becomes in a file, and which files are deleted
"""
