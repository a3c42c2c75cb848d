"""What makes the maps outlive the process: a write-ahead log of views, snapshots, and the history of objects."""
