"""One surveillance camera: encodes and publishes the views of its source while somebody listens."""
