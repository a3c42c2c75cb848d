"""The joint object map: detections become points, points become objects (eq. 3), objects gather evidence and are confirmed."""
