"""How views enter fusion: which sources are subscribed to, which words are looked for, and which view is perceived next."""
