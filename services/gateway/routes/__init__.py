"""The addresses of the REST interface, a router for each kind of resource."""
