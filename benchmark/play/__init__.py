"""One search in one process, from the same cores as the services."""
