"""What a camera node decides, without bus and clock.

sending        which views to send now
summary        what the camera's own detector should see next, and what the summary says
change         which pictures of a living camera show something new
stream_health  what a stream is doing: the watchdog's rules
lease          which camera a process takes that has none
"""
