"""What fusion says on the bus: revisions as they change, and answers about layers, objects, pictures and its log."""
