"""What the robot could do next. Each file proposes options of one kind, and changes nothing.

option             ``Option``: a place to go to, the chance that the target is found there, and what that costs
confirmed_objects  objects that fusion confirmed as the target
candidates         objects that may be the target
frontiers          frontiers to explore, and the rules that rate them
other_floors       stairs towards another floor
second_looks       places to look around from once more
closed_passages    waiting for a door or a lift
last_resort        the likeliest object of all, on weaker evidence
"""
