"""Playing a split of the dataset: workers, records that survive a kill, the numbers."""
