"""A sense of place: what a learned model expects beyond each frontier, from what the joint maps show around it."""
