"""Training of our own networks. Nothing else imports it; it needs PyTorch where weights are moved (``.venv-torch``)."""
