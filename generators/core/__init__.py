"""Scene, rays, free space, boxes: what everything else stands on; imports nothing else of generators."""
