"""One surveillance camera: renders, encodes and publishes views while somebody listens."""
