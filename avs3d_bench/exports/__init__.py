"""A dataset in the forms that other tools read. This is the room to enter by; each name is imported when it is used.

| name               | what                                                            | needs                |
|--------------------|-----------------------------------------------------------------|----------------------|
| `AVS3DDataset`     | a `torch.utils.data.Dataset`                                    | torch                |
| `write_webdataset` | tar shards, reproducible and resumable                          | nothing              |
| `decode_sample`    | what WebDataset yields, as arrays                               | nothing              |
| `write_huggingface`| Parquet files and a card for `datasets.load_dataset`            | pyarrow, datasets    |
| `waveform`         | an undecoded audio value of `datasets`, as samples              | nothing              |
| `write_croissant`  | a Croissant description                                         | nothing              |
| `write_card`       | a dataset card                                                  | nothing              |
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from avs3d_bench.exports.card import write_card
    from avs3d_bench.exports.croissant import write_croissant
    from avs3d_bench.exports.huggingface import waveform, write_huggingface
    from avs3d_bench.exports.torch_dataset import AVS3DDataset
    from avs3d_bench.exports.webdataset import decode_sample, write_webdataset

__all__ = [
    "AVS3DDataset",
    "decode_sample",
    "waveform",
    "write_card",
    "write_croissant",
    "write_huggingface",
    "write_webdataset",
]

_HOMES = {
    "AVS3DDataset": "torch_dataset",
    "decode_sample": "webdataset",
    "waveform": "huggingface",
    "write_card": "card",
    "write_croissant": "croissant",
    "write_huggingface": "huggingface",
    "write_webdataset": "webdataset",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
