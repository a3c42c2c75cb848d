"""Episodes, baselines and tables: the services' cores composed in one process, without a bus."""
