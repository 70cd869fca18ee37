"""The contract of avs3d-bench: schema, layout, geometry, reading, writing and validating datasets.

    from avs3d_bench import Dataset, SubmissionWriter, validate

    dataset = Dataset("data/demo")
    observation = dataset[0]
    validate("data/demo").valid

`Dataset` reads, `SubmissionWriter` writes what is scored, `validate` names every problem of a dataset by file. The
public names are listed in `__init__.pyi`; importing this package imports nothing: names are imported on first use.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
