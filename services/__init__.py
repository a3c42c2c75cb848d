"""The microservices. Each is its own process; none imports another."""
