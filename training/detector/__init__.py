"""The detector ``compact``: from rendered views to weights of our own."""
