"""A simulated building: what stands in for a real one. Plans and meshes become scenes; scenes are rendered, walked and judged."""
