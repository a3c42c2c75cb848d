"""Who may do what on the bus and over REST: identities, certificates, access rules, API keys."""
