"""The tracer on a CUDA device: the kernels' bodies are those of the CPU (`generators.acoustics.tracer.kernels`)."""
