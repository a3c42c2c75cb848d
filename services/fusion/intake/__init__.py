"""How views come in: who is listened to, which words perception looks for, and which view it is asked about next."""
