"""What a worker decides. Pure: no clock, no thread, no log.

queue    the requests that wait before each stage: order, capacity, deadlines
checks   what a request must contain
cache    the byte-bounded cache, and cache keys by content
probe    the picture that a worker must answer before it is ready
reply    the reply to a request, fresh or from the cache
refusal  why a request gets no reply
"""
