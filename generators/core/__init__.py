"""Scene, rays, free space and boxes, which all other generators use; imports nothing else of generators."""
