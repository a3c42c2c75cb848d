"""Pure: what the bus says, as resources, pictures, sums and problems."""
