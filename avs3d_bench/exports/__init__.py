"""A dataset in the forms that other tools read. Start reading here; each name is imported on first use.

| name               | what                                                            | needs                |
|--------------------|-----------------------------------------------------------------|----------------------|
| `AVS3DDataset`     | a `torch.utils.data.Dataset`                                    | torch                |
| `write_webdataset` | tar shards, reproducible and resumable                          | nothing              |
| `shard_paths`      | the tars of a folder, by split                                  | nothing              |
| `decode_sample`    | what WebDataset yields, as arrays                               | nothing              |
| `write_huggingface`| Parquet files and a card for `datasets.load_dataset`            | pyarrow, datasets    |
| `write_qa`         | questions about what is heard, with exact answers               | nothing              |
| `waveform`         | an undecoded audio value of `datasets`, as samples              | nothing              |
| `write_seld`       | sound event localisation and detection: the layouts of DCASE    | av for films         |
| `SeldSettings`     | what `write_seld` writes, and how                               | nothing              |
| `write_croissant`  | a Croissant description                                         | nothing              |
| `write_card`       | a dataset card                                                  | nothing              |
| `write_release`    | archives to be hosted, with checksums, card and licences        | nothing              |
| `get_release`      | download a release, check it and unpack it                      | pooch                |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
