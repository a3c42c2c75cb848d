"""The joint object map: detections are located in the world, associated with objects (eq. 3), fused into them, and confirmed."""
