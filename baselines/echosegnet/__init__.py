"""EchoSegnet: 3D Gaussian splatting, 2D masks lifted into it, and binaural sound to choose among them.

`pipeline` reads as the story of the job; `views`, `gaussians`, `rasterise` and `train` make the scene, `lift` and
`decompose` bring masks into it, `aisrm` and `spatial` listen, `render` writes the masks of the test views.
`training_stage` and `voting_stage` keep what takes long. `run` and `jobs` do that for a dataset on several devices,
`kernels` and `memory` are what their processes share. All coordinates are in the world of `sparse/0` (Y down, metres,
OpenCV cameras). Importing the package itself imports no torch.

Examples:
    >>> from avs3d_bench import Dataset
    >>> from baselines.echosegnet.train import DensityControl, TrainingSettings
    >>> few = TrainingSettings(iterations=20, density=DensityControl(pixels_per_gaussian=20))  # for a trial
    >>> writer = echosegnet.write_echosegnet(
    ...     Dataset("data/demo"), "splats", echosegnet.OracleMasks(), echosegnet.Settings(training=few),
    ...     work="work", devices=("cpu",), only=["part_1/*"], overwrite=True,
    ... )
    >>> sorted(path.name for path in writer.path.rglob("*.png"))
    ['frame_000.png', 'frame_008.png']
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
