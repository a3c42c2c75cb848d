"""What fusion publishes and answers: revisions when they change, and queries for maps, objects, pictures and the log."""
