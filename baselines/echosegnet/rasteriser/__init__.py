"""Drawing Gaussians: gsplat on CUDA, plain torch elsewhere."""
