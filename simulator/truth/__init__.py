"""What only a simulator knows: perception from instance ids, true or through a model of a detector's errors."""
