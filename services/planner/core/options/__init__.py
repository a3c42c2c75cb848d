"""What the robot could do next. Each file proposes options, and changes nothing.

option             ``Option``: a place to go to, the chance that the target is found there, and what that costs
confirmed_objects  objects that fusion confirmed as the target
candidates         objects that may be the target
frontiers          frontiers to explore, and the rules that rate them
other_floors       stairs towards another floor
doubtful_objects   objects that were dismissed, to be looked at once more from elsewhere
second_looks       places to look around from once more
closed_passages    waiting for a door or a lift
last_resort        the likeliest object of all, on weaker evidence, or the way to a floor that has a likelier one
unchosen_objects   no options: what people are told of objects that weren't chosen

What options are compared by. T is the travel time [m], p the chance of an object to be the target:

confirmed, candidate   p / (T + verify_cost_m), doubtful ones too
accepted object        1: it comes before all else
frontier               places_certainty / (T + the way that is expected beyond it), by ``places``. With the paper's strategies
                       chance / (T + explore_cost_m), chance = explore_chance x width x value (``goals/frontiers.py``), or with
                       ``frontier_score="value"`` the value alone. Rules of the benchmark have their own.
stairs, by evidence    e / (path + floor_search_m), e what cameras there saw. Until the robot has set out, it is weighed by the
                       odds that there is no target here.
other stairs           0: they are proposed once nothing else is left, and compared with nothing
look around, passage   the same; their numbers mean nothing
"""
