"""Storage that lets the maps survive a restart: a write-ahead log of views, snapshots, and the history of objects."""
