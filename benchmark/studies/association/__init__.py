"""Which way of making objects of detections errs least."""
