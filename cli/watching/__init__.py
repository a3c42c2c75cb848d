"""The live screen of ``surveilnav watch``.

known    what was last heard of the building; alerts: what of it is wrong, and since when
feed     the threads that keep it up to date
screen   pure: lines that fit the terminal
lines    one event as a line
"""
