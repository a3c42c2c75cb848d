"""What a sensor saw, as arrays, and how it is packed into bytes: posed RGB-D views, masks, pictures."""
