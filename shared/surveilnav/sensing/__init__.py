"""RGB-D views, detections and map layers as arrays, and their encoding as bytes."""
