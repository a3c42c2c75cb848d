"""Pictures of a scene without a GPU: colours, light, depth and instance ids."""
