"""What a worker decides: who waits, who goes first, who is turned away, what is kept. Pure: no clock, no thread, no log.

queue      what waits before each stage
checks     what a request must hold
cache      answers and text embeddings, by content
probe      the picture that a worker must answer before it is ready
answer     what a finished view becomes on the bus
"""
